"""The tree of frames: looks up where one frame is in another at a stamp, as tf2 does, without ROS."""

import itertools
import math

from rft_ros.estimator.samples import ABSURD, Reason, TransformSample
from rft_ros.estimator.timeline import (
    LATE,
    NEW_RUN,
    NEXT,
    REPEATED,
    Timeline,
    interpolated,
    slerp,
    succession,
)
from rft_ros.rft import unit_quaternion
from rft_ros.rft.frames import Placement

_HISTORY_COUNT = 1024  # transforms kept of a moving frame: 2 s at 500 Hz, twice `PATIENCE_NS`
_MAX_LISTED_COUNT = 20


class Transforms:
    """A tree of frames. As in tf2, a frame's parent at a stamp is that of the last transform before it.

    `sentences`: by reason, the last transform that was refused or had another parent than the one before.
    """

    def __init__(self) -> None:
        self.sentences: dict[Reason, str] = {}
        # by child; a fixed frame has one transform
        self._frames: dict[str, Timeline[TransformSample]] = {}
        self._ends: tuple[str, str] | None = None
        self._aside = set[str]()
        """Frames that are not between the ends, whose history is dropped; none until transforms link the ends."""
        self._places: dict[tuple[str, str], Placement | None] = {}  # what `fixed` has found

    def keep(self, target: str, source: str) -> None:
        """Keep the history of the frames on the way between two frames only, once transforms link the two."""
        self._ends = target, source
        self._relink()

    def push(self, sample: TransformSample) -> Reason | None:
        """Add a transform. Returns the reason if it is refused.

        `TF_TWO_PARENTS` is returned for a transform that is used, but has another parent than the one before.
        """
        fault = self._add(sample)
        if fault is None:
            return None
        reason, what = fault
        self.sentences[reason] = f"{_described(sample)}: {what}"
        return reason

    def _add(self, sample: TransformSample) -> tuple[Reason, str] | None:
        """Add a transform. Returns what is wrong with it, if anything is."""
        child = sample.child
        frame = self._frames.get(child)
        last = frame.last if frame else None
        link = sample.parent, sample.fixed
        is_same_link = last is not None and (last.parent, last.fixed) == link
        if is_same_link and not sample.fixed and child in self._aside:
            return None
        quaternion = unit_quaternion(*sample.quaternion)
        if quaternion is None:
            return Reason.TF_INVALID, "the quaternion is not of unit length"
        fault = self._fault(sample, is_new_link=not is_same_link)
        if fault is not None:
            return fault
        if last is not None and not is_same_link:
            fault = Reason.TF_TWO_PARENTS, f"before in {last.parent!r}{_kind(last)}"
        goes_on = last is not None and not last.fixed and not sample.fixed
        follows = self._frames[child].follows(sample.stamp) if goes_on else NEXT
        if last is not None and follows in (REPEATED, LATE):
            return fault or (
                Reason.TF_OUT_OF_ORDER,
                f"{last.stamp - sample.stamp} ns before the last one",
            )
        if follows is NEW_RUN:
            self.start_run(sample.stamp)
        if not goes_on or follows is NEW_RUN:
            self._frames[child] = Timeline(maxlen=_HISTORY_COUNT)
        stamp = 0 if sample.fixed else sample.stamp  # a fixed transform is before all others
        self._frames[child].append(sample._replace(stamp=stamp, quaternion=quaternion))
        if not (goes_on and is_same_link and follows is NEXT):
            self._relink()
        return fault

    def _fault(self, sample: TransformSample, *, is_new_link: bool) -> tuple[Reason, str] | None:
        """Why a transform cannot be used, wherever it comes in the order of its frame."""
        if not (sample.parent and sample.child):
            return Reason.TF_INVALID, "a name is missing"
        if not math.hypot(*sample.position) < ABSURD:
            return Reason.TF_INVALID, "the position is not finite"
        if not sample.fixed and sample.stamp <= 0:
            return Reason.TF_INVALID, "the stamp is zero"
        if sample.parent == sample.child:
            return Reason.TF_LOOP, "a frame cannot be its own parent"
        ancestors = self._line(sample.parent) if is_new_link else []
        if sample.child in ancestors:
            loop = ancestors[: ancestors.index(sample.child) + 1]
            return Reason.TF_LOOP, f"but {' in '.join(map(repr, loop))}"
        return None

    def start_run(self, stamp: int) -> None:
        """Start a new run at `stamp` [ns]: drop the moving frames whose transforms belong to the run before."""
        for child, last in self._links().items():
            if not last.fixed and succession(stamp, after=last.stamp) is NEW_RUN:
                del self._frames[child]
        self._relink()

    # --- places

    def at(self, target: str, source: str, stamp: int, max_age: int) -> Placement | Reason:
        """Placement of the frame `source` in the frame `target` at a stamp [ns].

        Each moving transform on the way is interpolated between those on both sides of the stamp, within `max_age`
        [ns]. Transforms that come later may resolve the reasons `TF_FRAME_UNKNOWN` and `TF_STALE`.
        """
        way = self._way(target, source, stamp)
        if way is None:
            return Reason.TF_FRAME_UNKNOWN
        ends = []
        reasons = []
        for frames in way:
            place = Placement()
            for frame in frames:
                step = _placed(self._frames[frame], stamp, max_age)
                if isinstance(step, Reason):
                    reasons.append(step)
                else:
                    place = step.of(place)
            ends.append(place)
        if reasons:  # one that later transforms do not resolve goes first
            return min(reasons, key=lambda reason: reason is Reason.TF_STALE)
        from_source, from_target = ends
        return from_target.inverse().of(from_source)

    def fixed(self, target: str, source: str) -> Placement | None:
        """Placement of the frame `source` in the frame `target`; None if fixed transforms alone do not link them."""
        if (target, source) not in self._places:
            place = self.at(target, source, 0, 0)  # before all stamps of moving transforms
            self._places[target, source] = place if isinstance(place, Placement) else None
        return self._places[target, source]

    def newest(self, target: str, source: str) -> int | None:
        """The last stamp [ns] at which all moving transforms between two frames are known; None if there are none."""
        lasts = [
            self._frames[frame].last
            for frames in self._way(target, source) or ()
            for frame in frames
        ]
        return min((last.stamp for last in lasts if last and not last.fixed), default=None)

    # --- for users

    def frames(self) -> list[str]:
        """The frames, each with its parent, such as ``'tool' in 'flange' (fixed)``; at most 20, and how many more."""
        found = [_described(link) for _, link in sorted(self._links().items())]
        if len(found) <= _MAX_LISTED_COUNT:
            return found
        return [*found[:_MAX_LISTED_COUNT], f"{len(found) - _MAX_LISTED_COUNT:,} more"]

    def unlinked(
        self, parameter: str, frame: str, other_frame: str, *, fixed: bool = False
    ) -> str | None:
        """A sentence if no transforms link `frame`, the value of `parameter`, and `other_frame`; None if some do.

        `fixed`: only fixed transforms count.
        """
        link = self.fixed(other_frame, frame) if fixed else self._way(other_frame, frame)
        if link is not None:
            return None
        missing = f"no transform names {parameter} {frame!r}"
        links = self._links()
        if frame in links or any(link.parent == frame for link in links.values()):
            kind = "fixed transforms" if fixed else "transforms"
            missing = f"no {kind} link {parameter} {frame!r} and {other_frame!r}"
        return f"{missing}; there are {', '.join(self.frames()) or 'none'}"

    def links(self, target: str, source: str) -> list[str]:
        """The transforms on the way between two frames, such as ``'tool' in 'flange' (fixed)``; none if not linked."""
        links = self._links()
        return [
            _described(links[name])
            for frames in self._way(target, source) or ()
            for name in frames
        ]

    def carriers(self, frame: str) -> list[str]:
        """The frames that carry a frame by fixed transforms, the nearest first; none if it moves in its parent."""
        line = self._line(frame)
        links = self._links()
        carriers: list[str] = []
        for child, parent in itertools.pairwise(line):
            if not links[child].fixed:
                break
            carriers.append(parent)
        return carriers

    # --- the tree

    def _links(self) -> dict[str, TransformSample]:
        """The last transform of each frame, by its name."""
        return {child: frame.last for child, frame in self._frames.items() if frame.last}

    def _line(self, frame: str, stamp: float = math.inf) -> list[str]:
        """A frame and its ancestors at a stamp [ns]."""
        found = [frame]
        parent = self._parent(frame, stamp)
        # transforms of several stamps may make a loop
        while parent is not None and parent not in found:
            found.append(parent)
            parent = self._parent(parent, stamp)
        return found

    def _parent(self, frame: str, stamp: float) -> str | None:
        """A frame's parent at a stamp [ns]; None at the root of the tree."""
        if frame not in self._frames:
            return None
        transform_before, transform_after, _ = self._frames[frame].around(stamp)
        link = transform_before or transform_after
        return link.parent if link else None

    def _way(
        self, target: str, source: str, stamp: float = math.inf
    ) -> tuple[list[str], list[str]] | None:
        """The frames from `source`, and those from `target`, up to their nearest common ancestor, which is left out.

        None if there is no common ancestor.
        """
        up = self._line(source, stamp)
        down = self._line(target, stamp)
        meet = next((frame for frame in up if frame in down), None)
        return None if meet is None else (up[: up.index(meet)], down[: down.index(meet)])

    def _relink(self) -> None:
        """Find what depends on the links of the tree again."""
        self._places.clear()
        way = self._way(*self._ends) if self._ends else None
        self._aside = set() if way is None else self._frames.keys() - {*way[0], *way[1]}
        for name in self._aside:
            while len(self._frames[name]) > 1:
                self._frames[name].popleft()


def _placed(frame: Timeline[TransformSample], stamp: int, max_age: int) -> Placement | Reason:
    """A frame in its parent at a stamp, interpolated between the transforms on both sides if it moves.

    Both are within `max_age` [ns] of the stamp. If the parent changes between them, the one before the stamp is used.
    """
    transform_before, transform_after, share = frame.around(stamp)
    if transform_before is None:
        return Reason.TF_MISSING
    if not transform_before.fixed and transform_before.stamp < stamp:
        if transform_after is None:
            return Reason.TF_STALE
        if max(transform_after.stamp - stamp, stamp - transform_before.stamp) > max_age:
            return Reason.TF_GAP
        if transform_after.parent == transform_before.parent:
            x, y, z = interpolated(transform_before.position, transform_after.position, share)
            return Placement(
                (x, y, z), slerp(transform_before.quaternion, transform_after.quaternion, share)
            )
    return Placement(transform_before.position, transform_before.quaternion)


def _described(sample: TransformSample) -> str:
    return f"{sample.child!r} in {sample.parent!r}{_kind(sample)}"


def _kind(sample: TransformSample) -> str:
    return " (fixed)" if sample.fixed else ""

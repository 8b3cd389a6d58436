"""The tree of frames: looks up where one frame is in another at a stamp, as tf2 does, without ROS."""

import math
from collections import deque
from enum import Enum

from rft_ros.estimator.samples import ABSURD, NEW_RUN, NEXT, Reason, TransformSample, around, succession
from rft_ros.rft import unit_quaternion
from rft_ros.rft.placement import Placement, Quaternion

__all__ = ["Transforms"]

_HISTORY = 1024  # transforms kept of a moving frame: 2 s at 500 Hz, twice `PATIENCE`
_LONGEST_NAME = 255
_MOST_FRAMES = 4096
_MOST_LISTED = 20


def _placed(history: deque[TransformSample], stamp: float, max_age: int) -> Placement | Reason:
    """A moving frame in its parent at a stamp, interpolated between the transforms on both sides.

    Both are within `max_age` [ns] of the stamp. If the parent changes between them, the one before the stamp is used.
    """
    before, after = around(history, stamp)
    if before is None:
        return Reason.TF_MISSING
    if before.stamp < stamp:
        if after is None:
            return Reason.TF_STALE
        if max(after.stamp - stamp, stamp - before.stamp) > max_age:
            return Reason.TF_GAP
        if after.parent == before.parent:
            return _interpolated(before, after, (stamp - before.stamp) / (after.stamp - before.stamp))
    return _place_of(before)


def _interpolated(a: TransformSample, b: TransformSample, share: float) -> Placement:
    """The placement at a share of the way from one to the other, at constant velocity and rate of turn."""
    x, y, z = (p + share * (q - p) for p, q in zip(a.position, b.position, strict=True))
    cosine = sum(p * q for p, q in zip(a.quaternion, b.quaternion, strict=True))
    angle = math.acos(min(1.0, abs(cosine)))
    first, second = 1.0 - share, share
    sine = math.sin(angle)
    if sine > 1e-6:
        first, second = math.sin(first * angle) / sine, math.sin(share * angle) / sine
    second = math.copysign(second, cosine)  # q and -q are one attitude
    i, j, k, w = (first * p + second * q for p, q in zip(a.quaternion, b.quaternion, strict=True))
    norm = math.hypot(i, j, k, w)
    return Placement((x, y, z), (i / norm, j / norm, k / norm, w / norm))


_IDENTITY = Placement((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def _place_of(sample: TransformSample) -> Placement:
    return Placement(sample.position, sample.quaternion)


class _Change(Enum):
    """What a transform does to the tree, if it can be used."""

    UNNEEDED = "nothing: the history of this moving frame is not needed"
    LATE = "nothing: it is stamped before the last one of this moving frame"
    NEXT = "it is the next one of a moving frame"
    NEW_RUN = "it is the first one of a new run"
    OTHER_PARENT = "the moving frame has another parent from now on"
    NEW_LINK = "it replaces what is known of the frame, if anything is"


_UNNEEDED, _LATE, _NEXT, _NEW_RUN, _OTHER_PARENT, _NEW_LINK = _Change  # a member takes 0.1 us to look up in its class


def _change(sample: TransformSample, last: TransformSample | None, *, is_needed: bool) -> _Change:
    """What a transform does after the last one of its frame. `is_needed`: whether the frame's history is kept."""
    if last is None or last.fixed or sample.fixed:
        return _NEW_LINK
    has_same_parent = last.parent == sample.parent
    if has_same_parent and not is_needed:
        return _UNNEEDED
    follows = succession(sample.stamp, after=last.stamp)
    if follows is NEW_RUN:
        return _NEW_RUN
    if follows is not NEXT:
        return _LATE
    if has_same_parent:
        return _NEXT
    return _OTHER_PARENT if is_needed else _NEW_LINK


class Transforms:
    """A tree of frames. As in tf2, a frame's parent at a stamp is that of the last transform before it.

    `sentences`: by reason, the last transform that was refused or had another parent than the one before.
    """

    def __init__(self) -> None:
        self.sentences: dict[Reason, str] = {}
        self._fixed: dict[str, TransformSample] = {}  # by child, which is not in `_moving`
        self._moving: dict[str, deque[TransformSample]] = {}  # by child, in the order of stamps
        self._ends: tuple[str, str] | None = None
        self._kept: set[str] | None = None
        """Frames between the ends, whose history is kept; None: not linked yet, every history is kept."""
        self._places: dict[tuple[str, str], Placement] = {}  # what `fixed` has found

    def keep(self, target: str, source: str) -> None:
        """Keep the history of the frames on the way between two frames only, once transforms link the two."""
        if self._ends != (target, source):
            self._ends = target, source
            self._find_kept()

    def push(self, sample: TransformSample) -> Reason | None:
        """Add a transform. Returns the reason if it is refused.

        `TF_TWO_PARENTS` is returned for a transform that is used, but has another parent than the one before.
        """
        last = self._last(sample.child)
        change = _change(sample, last, is_needed=self._kept is None or sample.child in self._kept)
        if change is _UNNEEDED:
            return None
        quaternion = unit_quaternion(*sample.quaternion)
        reason, what = self._judged(sample, quaternion, last, change)
        if reason is not None:
            self.sentences[reason] = f"{_described(sample)}: {what}"
        if quaternion is None or reason not in (None, Reason.TF_TWO_PARENTS) or change is _LATE:
            return reason
        if change is _NEW_RUN:
            self.start_run(sample.stamp)
        self._add(sample._replace(quaternion=quaternion), change)
        return reason

    def _last(self, child: str) -> TransformSample | None:
        """The last transform of a frame; None if it has none, as the root of the tree."""
        history = self._moving.get(child)
        return history[-1] if history else self._fixed.get(child)

    def _add(self, sample: TransformSample, change: _Change) -> None:
        """Add a transform that can be used."""
        if change is _NEXT:
            self._moving[sample.child].append(sample)
            return
        if change is _OTHER_PARENT:
            self._moving[sample.child].append(sample)
        elif sample.fixed:
            self._moving.pop(sample.child, None)
            self._fixed[sample.child] = sample
        else:
            self._fixed.pop(sample.child, None)
            self._moving[sample.child] = deque([sample], maxlen=_HISTORY)
        self._find_kept()
        self._places.clear()

    def _judged(
        self, sample: TransformSample, quaternion: Quaternion | None, last: TransformSample | None, change: _Change
    ) -> tuple[Reason | None, str]:
        """Why a transform that follows `last` of its frame cannot be used, and a description; (None, "") if it can."""
        stamp, parent, child, position, _, fixed = sample
        if not (parent and child and max(len(parent), len(child)) <= _LONGEST_NAME):
            return Reason.TF_INVALID, f"a name is missing or longer than {_LONGEST_NAME} characters"
        if quaternion is None:
            return Reason.TF_INVALID, "the quaternion is not of unit length"
        if not math.hypot(*position) < ABSURD:
            return Reason.TF_INVALID, "the position is not finite"
        if not fixed and stamp <= 0:
            return Reason.TF_INVALID, "the stamp is zero"
        if last is None and len(self._fixed) + len(self._moving) >= _MOST_FRAMES:
            return Reason.TF_INVALID, f"there are {_MOST_FRAMES:,} frames already"
        if parent == child:
            return Reason.TF_LOOP, "a frame cannot be its own parent"
        known = last is not None and last.parent == parent
        ancestors = self._line(parent)
        if not known and child in ancestors:
            return Reason.TF_LOOP, f"but {' in '.join(map(repr, ancestors[: ancestors.index(child) + 1]))}"
        if last is not None and not (known and last.fixed == fixed):
            return Reason.TF_TWO_PARENTS, f"before in {last.parent!r}{_kind(last)}"
        if last is not None and change is _LATE:
            return Reason.TF_OUT_OF_ORDER, f"{last.stamp - stamp} ns before the last one"
        return None, ""

    def start_run(self, stamp: int) -> None:
        """Start a new run at `stamp` [ns]: drop the moving frames whose transforms belong to the run before."""
        before = [n for n, h in self._moving.items() if succession(stamp, after=h[-1].stamp) is NEW_RUN]
        for name in before:
            del self._moving[name]
        if before:
            self._find_kept()

    def at(self, target: str, source: str, stamp: int, max_age: int) -> Placement | Reason:
        """Placement of the frame `source` in the frame `target` at a stamp [ns].

        Each moving transform on the way is interpolated between those on both sides of the stamp, within `max_age`
        [ns]. Transforms that come later may resolve the reasons `TF_FRAME_UNKNOWN` and `TF_STALE`.
        """
        way = self._way(target, source, stamp)
        if way is None:
            return Reason.TF_FRAME_UNKNOWN
        from_source, from_target = [_IDENTITY], [_IDENTITY]  # from either end to the common ancestor, step by step
        reason = None
        for frames, places in zip(way, (from_source, from_target), strict=True):
            for frame in frames:
                fixed = self._fixed.get(frame)
                step = _place_of(fixed) if fixed else _placed(self._moving[frame], stamp, max_age)
                if isinstance(step, Placement):
                    places.append(step.of(places[-1]))
                elif reason in (None, Reason.TF_STALE):
                    reason = step
        return reason or from_target[-1].inverse().of(from_source[-1])

    def fixed(self, target: str, source: str) -> Placement | None:
        """Placement of the frame `source` in the frame `target`; None if fixed transforms alone do not link them."""
        found = self._places.get((target, source))
        if found is not None:
            return found
        way = self._way(target, source)
        if way is None or any(frame in self._moving for frames in way for frame in frames):
            return None
        place = self.at(target, source, 0, 0)
        if isinstance(place, Placement):
            self._places[target, source] = place
            return place
        return None

    def newest(self, target: str, source: str) -> int | None:
        """The last stamp [ns] at which all moving transforms between two frames are known; None if there are none."""
        way = [frame for frames in self._way(target, source) or () for frame in frames]
        return min((self._moving[frame][-1].stamp for frame in way if frame in self._moving), default=None)

    def frames(self) -> list[str]:
        """The frames, each with its parent, such as ``'tool' in 'flange' (fixed)``; at most 20, and how many more."""
        found = [_described(link) for _, link in sorted(self._links().items())]
        if len(found) <= _MOST_LISTED:
            return found
        return [*found[:_MOST_LISTED], f"{len(found) - _MOST_LISTED:,} more"]

    def unlinked(self, parameter: str, frame: str, other: str, *, fixed: bool = False) -> str | None:
        """A sentence if no transforms link `frame`, the value of `parameter`, and `other`; None if some do.

        `fixed`: only fixed transforms count.
        """
        linked = self.fixed(other, frame) if fixed else self._way(other, frame)
        if linked is not None:
            return None
        missing = f"no transform names {parameter} {frame!r}"
        links = self._links()
        if frame in links or any(link.parent == frame for link in links.values()):
            missing = f"no {'fixed transforms' if fixed else 'transforms'} link {parameter} {frame!r} and {other!r}"
        return f"{missing}; there are {', '.join(self.frames()) or 'none'}"

    def links(self, target: str, source: str) -> list[str]:
        """The transforms on the way between two frames, such as ``'tool' in 'flange' (fixed)``; none if not linked."""
        up, down = self._way(target, source) or ([], [])
        links = self._links()
        return [_described(links[name]) for name in (*up, *down)]

    def _links(self) -> dict[str, TransformSample]:
        """The last transform of each frame, by its name."""
        return self._fixed | {child: history[-1] for child, history in self._moving.items()}

    def _line(self, frame: str, stamp: float = math.inf) -> list[str]:
        """A frame and its ancestors at a stamp [ns]."""
        found = [frame]
        parent = self._parent(frame, stamp)
        while parent is not None and parent not in found:  # transforms of several stamps may make a loop
            found.append(parent)
            parent = self._parent(parent, stamp)
        return found

    def _parent(self, frame: str, stamp: float) -> str | None:
        """A frame's parent at a stamp [ns]; None at the root of the tree."""
        fixed = self._fixed.get(frame)
        if fixed is not None:
            return fixed.parent
        history = self._moving.get(frame)
        if history is None:
            return None
        before, _ = around(history, stamp)
        return (before or history[0]).parent

    def _way(self, target: str, source: str, stamp: float = math.inf) -> tuple[list[str], list[str]] | None:
        """The frames from `source`, and those from `target`, up to their nearest common ancestor, which is left out.

        None if there is no common ancestor.
        """
        up, down = self._line(source, stamp), self._line(target, stamp)
        meet = next((frame for frame in up if frame in down), None)
        return None if meet is None else (up[: up.index(meet)], down[: down.index(meet)])

    def _find_kept(self) -> None:
        way = self._way(*self._ends) if self._ends else None
        self._kept = None if way is None else {*way[0], *way[1]}
        for name, history in self._moving.items():
            while self._kept is not None and name not in self._kept and len(history) > 1:
                history.popleft()


def _described(sample: TransformSample) -> str:
    """A frame in its parent; names that are too long are cut."""
    return f"{sample.child[:_LONGEST_NAME]!r} in {sample.parent[:_LONGEST_NAME]!r}{_kind(sample)}"


def _kind(sample: TransformSample) -> str:
    return " (fixed)" if sample.fixed else ""

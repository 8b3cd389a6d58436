"""The tree of frames: looks up where one frame is in another at a stamp, as tf2 does, without ROS."""

import math
from collections import deque

from rft_ros.estimator.samples import ABSURD, TIME_JUMP, Reason, TransformSample, around
from rft_ros.rft import unit_quaternion
from rft_ros.rft.placement import Placement, Quaternion

__all__ = ["Transforms"]

_HISTORY = 1024  # transforms kept of a moving frame: 2 s at 500 Hz, twice `PATIENCE`
_LONGEST_NAME = 255
_MOST_FRAMES = 4096
_MOST_LISTED = 20


def _placed(history: deque[TransformSample], stamp: float, max_age: int) -> Placement | Reason:
    """A frame in its parent at a stamp, interpolated between the transforms on both sides, within `max_age` [ns].

    If the parent changes between them, the transform before the stamp is used.
    """
    before, after = around(history, stamp)
    if before is None:
        return Reason.TF_MISSING
    if before.stamp < stamp and not before.fixed:
        if after is None:
            return Reason.TF_STALE
        if max(after.stamp - stamp, stamp - before.stamp) > max_age:
            return Reason.TF_GAP
        if after.parent == before.parent:
            return _between(before, after, (stamp - before.stamp) / (after.stamp - before.stamp))
    return Placement(before.position, before.quaternion)


def _between(a: TransformSample, b: TransformSample, share: float) -> Placement:
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


class Transforms:
    """A tree of frames. As in tf2, a frame's parent at a stamp is that of the last transform before it.

    `sentences`: by reason, the last transform that was refused or had another parent than the one before.
    """

    def __init__(self) -> None:
        self.sentences: dict[Reason, str] = {}
        self._links: dict[str, deque[TransformSample]] = {}  # by child, in the order of stamps; the last if it is fixed
        self._ends: tuple[str, str] | None = None
        self._kept: set[str] | None = None  # frames on the way between the ends; None: the ends are not linked
        self._fixed: dict[tuple[str, str], Placement] = {}

    def keep(self, target: str, source: str) -> None:
        """Keep the history of the frames on the way between two frames only, once transforms link the two."""
        if self._ends != (target, source):
            self._ends = target, source
            self._find_kept()

    def push(self, sample: TransformSample) -> Reason | None:
        """Add a transform. Returns the reason if it is refused.

        `TF_TWO_PARENTS` is returned for a transform that is used, but has another parent than the one before.
        """
        history = self._links.get(sample.child)
        last = history[-1] if history else None
        moves = last is not None and not (last.fixed or sample.fixed)
        same = last is not None and last.parent == sample.parent
        aside = self._kept is not None and sample.child not in self._kept
        if aside and moves and same:
            return None  # the tree does not change, and the history of this frame is not needed
        quaternion = unit_quaternion(*sample.quaternion)
        reason, what = self._judged(sample, quaternion, last)
        if reason is not None:
            self.sentences[reason] = f"{_described(sample)}: {what}"
        if quaternion is None or reason not in (None, Reason.TF_TWO_PARENTS):
            return reason
        if moves and last is not None and sample.stamp <= last.stamp:
            if last.stamp - sample.stamp < TIME_JUMP:
                return reason
            self.start_run(sample.stamp)
            history = None
        if history is None or not moves or aside:
            same = False
            history = self._links[sample.child] = deque(maxlen=_HISTORY)
        history.append(sample._replace(quaternion=quaternion, stamp=0 if sample.fixed else sample.stamp))
        if not same:
            self._find_kept()
            self._fixed.clear()
        return reason

    def _judged(
        self, sample: TransformSample, quaternion: Quaternion | None, last: TransformSample | None
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
        if last is None and len(self._links) >= _MOST_FRAMES:
            return Reason.TF_INVALID, f"there are {_MOST_FRAMES:,} frames already"
        if parent == child:
            return Reason.TF_LOOP, "a frame cannot be its own parent"
        known = last is not None and last.parent == parent
        ancestors = self._line(parent)
        if not known and child in ancestors:
            return Reason.TF_LOOP, f"but {' in '.join(map(repr, ancestors[: ancestors.index(child) + 1]))}"
        if last is not None and not (known and last.fixed == fixed):
            return Reason.TF_TWO_PARENTS, f"before in {last.parent!r}{_kind(last)}"
        if last is not None and not fixed and 0 <= last.stamp - stamp < TIME_JUMP:
            return Reason.TF_OUT_OF_ORDER, f"{last.stamp - stamp} ns before the last one"
        return None, ""

    def start_run(self, stamp: int) -> None:
        """Start a new run at `stamp` [ns]: drop moving transforms later than that by `TIME_JUMP` or more."""
        late = [n for n, h in self._links.items() if not h[-1].fixed and h[-1].stamp - stamp >= TIME_JUMP]
        for name in late:
            del self._links[name]
        if late:
            self._find_kept()

    def at(self, target: str, source: str, stamp: int, max_age: int) -> Placement | Reason:
        """Placement of the frame `source` in the frame `target` at a stamp [ns].

        Each moving transform on the way is interpolated between those on both sides of the stamp, within `max_age`
        [ns]. The reason may pass as more transforms come if it is `TF_FRAME_UNKNOWN` or `TF_STALE`.
        """
        way = self._way(target, source, stamp)
        if way is None:
            return Reason.TF_FRAME_UNKNOWN
        identity = Placement((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        from_source, from_target = [identity], [identity]  # from either end to the common ancestor, step by step
        reason = None
        for frames, places in zip(way, (from_source, from_target), strict=True):
            for frame in frames:
                step = _placed(self._links[frame], stamp, max_age)
                if isinstance(step, Placement):
                    places.append(step.of(places[-1]))
                elif reason in (None, Reason.TF_STALE):
                    reason = step
        return reason or from_target[-1].inverse().of(from_source[-1])

    def fixed(self, target: str, source: str) -> Placement | None:
        """Placement of the frame `source` in the frame `target`; None if fixed transforms alone do not link them."""
        found = self._fixed.get((target, source))
        if found is not None:
            return found
        place = self.at(target, source, 0, 0)  # before the stamp of any moving one
        if not isinstance(place, Placement):
            return None
        self._fixed[target, source] = place
        return place

    def newest(self, target: str, source: str) -> int | None:
        """The last stamp [ns] at which all moving transforms between two frames are known; None if there are none."""
        last = [self._links[frame][-1] for frames in self._way(target, source) or () for frame in frames]
        return min((sample.stamp for sample in last if not sample.fixed), default=None)

    def frames(self) -> list[str]:
        """The frames, each with its parent, such as ``'tool' in 'flange' (fixed)``; at most 20, and how many more."""
        found = [_described(self._links[name][-1]) for name in sorted(self._links)]
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
        if frame in self._links or any(history[-1].parent == frame for history in self._links.values()):
            missing = f"no {'fixed transforms' if fixed else 'transforms'} link {parameter} {frame!r} and {other!r}"
        return f"{missing}; there are {', '.join(self.frames()) or 'none'}"

    def links(self, target: str, source: str) -> list[str]:
        """The transforms on the way between two frames, such as ``'tool' in 'flange' (fixed)``; none if not linked."""
        up, down = self._way(target, source) or ([], [])
        return [_described(self._links[name][-1]) for name in (*up, *down)]

    def _line(self, frame: str, stamp: float = math.inf) -> list[str]:
        """A frame and its ancestors at a stamp [ns]."""
        found = [frame]
        while history := self._links.get(found[-1]):
            parent = (around(history, stamp)[0] or history[0]).parent
            if parent in found:  # transforms of several stamps may make a loop
                break
            found.append(parent)
        return found

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
        for name, history in self._links.items():
            while self._kept is not None and name not in self._kept and len(history) > 1:
                history.popleft()


def _described(sample: TransformSample) -> str:
    """A frame in its parent; names that are too long are cut."""
    return f"{sample.child[:_LONGEST_NAME]!r} in {sample.parent[:_LONGEST_NAME]!r}{_kind(sample)}"


def _kind(sample: TransformSample) -> str:
    return " (fixed)" if sample.fixed else ""

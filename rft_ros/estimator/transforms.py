"""The tree of frames: where one frame is in another at a stamp. It uses no ROS."""

import math
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from rft_ros.estimator.samples import ABSURD, TIME_JUMP, Reason, TransformSample, Vector, Wrench
from rft_ros.rft import unit_quaternion

__all__ = ["Placement", "Transforms"]

_HISTORY = 4096  # transforms kept of a moving frame on the way: 8 s at 500 Hz
_UNLINKED_HISTORY = 512  # kept of each moving frame until the way is known: 1 s at 500 Hz, the patience of a pose
_LONGEST_NAME = 255
_MOST_FRAMES = 4096
_MOST_LISTED = 20

Quaternion = tuple[float, float, float, float]


class Placement(NamedTuple):
    """Pose of one frame in another: position [m], quaternion xyzw."""

    position: Vector
    quaternion: Quaternion

    def rotate(self, v: Vector) -> Vector:
        """A vector in the inner frame's axes, in the outer frame's."""
        x, y, z, w = self.quaternion
        a, b, c = v
        p, q, r = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
        return a + w * p + y * r - z * q, b + w * q + z * p - x * r, c + w * r + x * q - y * p

    def wrench(self, inner: Wrench) -> Wrench:
        """A wrench [N], [N m] in the inner frame's axes about its origin, in the outer frame's about its own."""
        a, b, c = self.rotate(inner[:3])
        d, e, f = self.rotate(inner[3:])
        x, y, z = self.position
        return a, b, c, d + y * c - z * b, e + z * a - x * c, f + x * b - y * a

    def of(self, inner: "Placement") -> "Placement":
        """The placement in the outer frame of what has the placement `inner` in this frame."""
        a, b, c = self.rotate(inner.position)
        px, py, pz = self.position
        x, y, z, w = self.quaternion
        p, q, r, s = inner.quaternion
        turned = (
            w * p + x * s + y * r - z * q,
            w * q - x * r + y * s + z * p,
            w * r + x * q - y * p + z * s,
            w * s - x * p - y * q - z * r,
        )
        return Placement((px + a, py + b, pz + c), turned)

    def inverse(self) -> "Placement":
        """The outer frame in the inner one."""
        x, y, z, w = self.quaternion
        back = Placement((0.0, 0.0, 0.0), (-x, -y, -z, w))
        a, b, c = back.rotate(self.position)
        return Placement((-a, -b, -c), back.quaternion)


_HERE = Placement((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


class _Link(NamedTuple):
    """A frame's transforms to its parent, in the order of their stamps; fixed: the last one alone."""

    fixed: bool
    history: deque[TransformSample]

    @property
    def newest(self) -> TransformSample:
        return self.history[-1]

    def at(self, stamp: int, max_age: int) -> tuple[str, Placement | Reason]:
        """Parent and placement at a stamp, interpolated between the transforms on both sides, within `max_age` [ns].

        Between two parents the transform before the stamp counts.
        """
        sample, after = self.newest, None
        if self.fixed:
            return sample.parent, Placement(*sample[3:5])
        for sample in reversed(self.history):
            if sample.stamp <= stamp:
                break
            after = sample
        else:
            return sample.parent, Reason.TF_MISSING
        if sample.stamp < stamp:
            if after is None:
                return sample.parent, Reason.TF_STALE
            if after.stamp - stamp > max_age or stamp - sample.stamp > max_age:
                return sample.parent, Reason.TF_GAP
            if after.parent == sample.parent:
                return sample.parent, _between(sample, after, (stamp - sample.stamp) / (after.stamp - sample.stamp))
        return sample.parent, Placement(*sample[3:5])


def _between(a: TransformSample, b: TransformSample, share: float) -> Placement:
    """The placement at a share of the way from one to the other, at constant velocity and rate of turn."""
    x, y, z = (p + share * (q - p) for p, q in zip(a.position, b.position, strict=True))
    cosine = sum(p * q for p, q in zip(a.quaternion, b.quaternion, strict=True))
    angle = math.acos(min(1.0, abs(cosine)))
    first, second = 1.0 - share, share
    if (sine := math.sin(angle)) > 1e-6:
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
        self._links: dict[str, _Link] = {}
        self._ends: tuple[str, str] | None = None
        self._kept: set[str] | None = None  # frames on the way between the ends; None: not linked
        self._fixed: dict[tuple[str, str], Placement] = {}

    def keep(self, target: str, source: str) -> None:
        """Keep the history of no frames but those on the way between two frames, once transforms link these."""
        if self._ends != (target, source):
            self._ends = target, source
            self._find_kept()

    def push(self, sample: TransformSample) -> Reason | None:
        """Add a transform; returns the reason if it is refused, and `TF_TWO_PARENTS` if it is taken nevertheless."""
        link = self._links.get(sample.child)
        aside = self._kept is not None and sample.child not in self._kept and not sample.fixed
        if aside and link is not None and not link.fixed and link.newest.parent == sample.parent:
            return None  # the last one that was kept says as much about the tree
        quaternion = unit_quaternion(*sample.quaternion)
        reason, what = self._judged(sample, quaternion, link)
        if reason is not None:
            fixed = " (fixed)" * sample.fixed
            self.sentences[reason] = f"{_short(sample.child)} in {_short(sample.parent)}{fixed}: {what}"
        if quaternion is None or reason not in (None, Reason.TF_TWO_PARENTS):
            return reason
        if link is not None and not (link.fixed or sample.fixed) and sample.stamp <= link.newest.stamp:
            if link.newest.stamp - sample.stamp < TIME_JUMP:
                return reason
            self.begin_again(sample.stamp)
            link = None
        if link is None or link.fixed != sample.fixed:
            link = self._links[sample.child] = _Link(sample.fixed, deque(maxlen=1 if sample.fixed else _HISTORY))
        begins = not link.history or link.newest.parent != sample.parent
        if aside:
            link.history.clear()
        elif self._kept is None and self._ends and len(link.history) >= _UNLINKED_HISTORY:
            link.history.popleft()
        link.history.append(sample._replace(quaternion=quaternion))
        if begins:
            self._find_kept()
        if begins or link.fixed:
            self._fixed.clear()
        return reason

    def _judged(
        self, sample: TransformSample, quaternion: Quaternion | None, link: _Link | None
    ) -> tuple[Reason | None, str]:
        """What is wrong with a transform of a frame that has this link, and in words."""
        stamp, parent, child, position, _, fixed = sample
        if not (parent and child and max(len(parent), len(child)) <= _LONGEST_NAME):
            return Reason.TF_INVALID, f"a name is missing or longer than {_LONGEST_NAME} characters"
        if quaternion is None:
            return Reason.TF_INVALID, "the quaternion is not of unit length"
        if not math.hypot(*position) < ABSURD:
            return Reason.TF_INVALID, "the position is not finite"
        if not fixed and stamp <= 0:
            return Reason.TF_INVALID, "the stamp is zero"
        if link is None and len(self._links) >= _MOST_FRAMES:
            return Reason.TF_INVALID, f"there are {_MOST_FRAMES:,} frames already"
        known = link is not None and link.newest.parent == parent
        if not known and child in (line := self._line(parent)):
            return Reason.TF_LOOP, f"but {' in '.join(map(repr, line[: line.index(child) + 1]))}"
        if link is None:
            return None, ""
        behind = link.newest.stamp - stamp
        late = not (fixed or link.fixed) and 0 <= behind < TIME_JUMP
        if known and link.fixed == fixed:
            return (Reason.TF_OUT_OF_ORDER, f"{behind} ns before the last one") if late else (None, "")
        return Reason.TF_TWO_PARENTS, f"before in {link.newest.parent!r}" + " (fixed)" * link.fixed

    def begin_again(self, stamp: int) -> None:
        """Forget moving transforms that lie a time jump or more after a stamp [ns]: they belong to the run before."""
        late = [n for n, k in self._links.items() if not k.fixed and k.newest.stamp - stamp >= TIME_JUMP]
        for name in late:
            del self._links[name]
        if late:
            self._find_kept()

    def at(self, target: str, source: str, stamp: int | None, max_age: int = 0) -> Placement | Reason:
        """Placement of the frame `source` in the frame `target` at a stamp [ns]; None: by fixed transforms alone.

        Each moving transform on the way is interpolated between those on both sides of the stamp, within `max_age`
        [ns]. The reason may pass as more transforms come if it is `TF_FRAME_UNKNOWN` or `TF_STALE`.
        """
        ends = dict(self._climb(target, stamp, max_age))
        for frame, end in self._climb(source, stamp, max_age):
            if frame in ends:
                other = ends[frame]
                if isinstance(end, Reason) or isinstance(other, Reason):
                    return _reason(end, other)
                return other.inverse().of(end)
        return Reason.TF_FRAME_UNKNOWN

    def _climb(self, frame: str, stamp: int | None, max_age: int) -> Iterator[tuple[str, Placement | Reason]]:
        """A frame and its ancestors, and the frame's placement in each."""
        end: Placement | Reason = _HERE
        seen: set[str] = set()
        while frame not in seen:  # transforms of several stamps may make a loop
            seen.add(frame)
            yield frame, end
            link = self._links.get(frame)
            if link is None or (stamp is None and not link.fixed):
                return
            frame, step = link.at(stamp or 0, max_age)
            end = _reason(end, step) if isinstance(end, Reason) or isinstance(step, Reason) else step.of(end)

    def fixed(self, target: str, source: str) -> Placement | None:
        """Placement of the frame `source` in the frame `target`; None if fixed transforms alone do not link them."""
        found = self._fixed.get((target, source))
        if found is None and isinstance(placement := self.at(target, source, None), Placement):
            found = self._fixed[target, source] = placement
        return found

    def newest(self, target: str, source: str) -> int | None:
        """The last stamp [ns] at which all moving transforms between two frames are known; None if there are none."""
        links = [self._links[frame] for frame in self._way(target, source) or ()]
        return min((link.newest.stamp for link in links if not link.fixed), default=None)

    def frames(self) -> list[str]:
        """The frames, each with its parent, such as ``tool in flange (fixed)``; of many the first."""
        links = sorted(self._links.items())
        found = [f"{_short(c)} in {_short(k.newest.parent)}{' (fixed)' * k.fixed}" for c, k in links[:_MOST_LISTED]]
        return [*found, f"{len(links) - _MOST_LISTED:,} more"] if len(links) > _MOST_LISTED else found

    def linked(self, target: str, source: str) -> bool:
        """Whether the newest transforms link two frames."""
        return self._way(target, source) is not None

    def unlinked(self, parameter: str, frame: str, other: str, *, kind: str = "") -> str:
        """A sentence: no transforms of this kind link `frame`, named by a parameter, and the frame `other`."""
        missing = f"no transform names {parameter} {_short(frame)}"
        if frame in self._links or any(link.newest.parent == frame for link in self._links.values()):
            missing = f"no {kind}transforms link {parameter} {_short(frame)} and {_short(other)}"
        return f"{missing}; there are {', '.join(self.frames()) or 'none'}"

    def _line(self, frame: str) -> list[str]:
        """A frame and its ancestors, by the newest transforms."""
        found = [frame]
        while (link := self._links.get(frame)) is not None and link.newest.parent not in found:
            frame = link.newest.parent
            found.append(frame)
        return found

    def _way(self, target: str, source: str) -> list[str] | None:
        """The frames from `source` and from `target` up to their nearest common one, without it; None: no such."""
        up, down = self._line(source), self._line(target)
        meet = next((frame for frame in up if frame in down), None)
        return None if meet is None else up[: up.index(meet)] + down[: down.index(meet)]

    def _find_kept(self) -> None:
        way = self._way(*self._ends) if self._ends else None
        self._kept = None if way is None else set(way)
        for name, link in self._links.items():
            while self._kept is not None and name not in self._kept and len(link.history) > 1:
                link.history.popleft()


def _reason(a: Placement | Reason, b: Placement | Reason) -> Reason:
    """Of one or two reasons that which does not pass, else the first."""
    found = [end for end in (a, b) if isinstance(end, Reason)]
    return found[-1] if found[0] is Reason.TF_STALE else found[0]


def _short(name: str) -> str:
    return repr(name if len(name) <= _LONGEST_NAME else name[:_LONGEST_NAME] + "...")

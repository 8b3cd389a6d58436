"""The tree of frames: where one frame is in another at a stamp. It uses no ROS."""

import math
from collections import deque
from typing import NamedTuple

from rft_ros.estimator.samples import ABSURD, TIME_JUMP, Reason, TransformSample, Vector, Wrench
from rft_ros.rft import unit_quaternion

__all__ = ["Placement", "Transforms"]

_HISTORY = 4096  # transforms kept of a moving frame: 8 s at 500 Hz

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


class _Link:
    """A frame's transforms to its parent, in the order of their stamps."""

    def __init__(self, parent: str, *, fixed: bool) -> None:
        self.parent = parent
        self.fixed = fixed
        self.history: deque[TransformSample] = deque(maxlen=1 if fixed else _HISTORY)

    def at(self, stamp: int, max_age: int) -> Placement | Reason:
        """Placement at a stamp, interpolated between the transforms on both sides, each within `max_age` [ns]."""
        after = None
        for sample in reversed(self.history):
            if sample.stamp <= stamp or self.fixed:
                break
            after = sample
        else:
            return Reason.TF_MISSING if self.history else Reason.TF_STALE  # none yet of this run
        if self.fixed or sample.stamp == stamp:
            return Placement(sample.position, sample.quaternion)
        if after is None:
            return Reason.TF_STALE
        if stamp - sample.stamp > max_age or after.stamp - stamp > max_age:
            return Reason.TF_GAP
        share = (stamp - sample.stamp) / (after.stamp - sample.stamp)
        (px, py, pz), (qx, qy, qz) = sample.position, after.position
        position = px + share * (qx - px), py + share * (qy - py), pz + share * (qz - pz)
        return Placement(position, _slerp(sample.quaternion, after.quaternion, share))


def _slerp(p: Quaternion, q: Quaternion, share: float) -> Quaternion:
    cosine = sum(a * b for a, b in zip(p, q, strict=True))
    sign = -1.0 if cosine < 0.0 else 1.0
    angle = math.acos(min(1.0, abs(cosine)))
    sine = math.sin(angle)
    first, second = 1.0 - share, sign * share
    if sine > 1e-6:
        first, second = math.sin(first * angle) / sine, sign * math.sin(share * angle) / sine
    px, py, pz, pw = (first * a + second * b for a, b in zip(p, q, strict=True))
    norm = math.hypot(px, py, pz, pw)
    return px / norm, py / norm, pz / norm, pw / norm


class Transforms:
    """A tree of frames. A frame's first transform decides its parent, and whether it is fixed there or moves."""

    def __init__(self) -> None:
        self._links: dict[str, _Link] = {}
        self._paths: dict[tuple[str, str], tuple[list[_Link], list[_Link]]] = {}
        self._fixed: dict[tuple[str, str], Placement] = {}

    def push(self, sample: TransformSample) -> Reason | None:
        """Add a transform; returns the reason if it is refused."""
        quaternion = unit_quaternion(*sample.quaternion)
        usable = math.hypot(*sample.position) < ABSURD and (sample.fixed or sample.stamp > 0)
        if quaternion is None or not usable or not sample.parent or not sample.child:
            return Reason.TF_INVALID
        link = self._links.get(sample.child)
        if link is None:
            if sample.parent == sample.child or sample.child in self._ancestors(sample.parent):
                return Reason.TF_LOOP
            link = self._links[sample.child] = _Link(sample.parent, fixed=sample.fixed)
            self._paths.clear()
        elif link.parent != sample.parent or link.fixed != sample.fixed:
            return Reason.TF_TWO_PARENTS
        elif not link.fixed and link.history and sample.stamp <= link.history[-1].stamp:
            if link.history[-1].stamp - sample.stamp < TIME_JUMP:
                return Reason.TF_OUT_OF_ORDER
            self.begin_again(sample.stamp)
        link.history.append(sample._replace(quaternion=quaternion))
        if link.fixed:
            self._fixed.clear()
        return None

    def begin_again(self, stamp: int) -> None:
        """Forget moving transforms that lie a time jump or more after a stamp [ns]: they belong to the run before."""
        for link in self._links.values():
            if not link.fixed and link.history and link.history[-1].stamp - stamp >= TIME_JUMP:
                link.history.clear()

    def at(self, target: str, source: str, stamp: int, max_age: int) -> Placement | Reason:
        """Placement of the frame `source` in the frame `target` at a stamp [ns].

        Each moving transform on the way is interpolated between those on both sides of the stamp, within `max_age`
        [ns]. The reason may pass as more transforms come if it is `TF_FRAME_UNKNOWN` or `TF_STALE`.
        """
        path = self._path(target, source)
        if path is None:
            return Reason.TF_FRAME_UNKNOWN
        ends = []
        worst: Reason | None = None
        for links in path:
            end = _HERE
            for link in links:
                step = link.at(stamp, max_age)
                if isinstance(step, Reason):
                    worst = step if worst is None or worst is Reason.TF_STALE else worst
                else:
                    end = step.of(end)
            ends.append(end)
        return ends[1].inverse().of(ends[0]) if worst is None else worst

    def fixed(self, target: str, source: str) -> Placement | None:
        """Placement of the frame `source` in the frame `target`; None if fixed transforms alone do not link them."""
        found = self._fixed.get((target, source))
        path = self._path(target, source) if found is None else None
        if path is not None and all(link.fixed for links in path for link in links):
            placement = self.at(target, source, 0, 0)
            if isinstance(placement, Placement):
                found = self._fixed[target, source] = placement
        return found

    def newest(self, target: str, source: str) -> int | None:
        """The last stamp [ns] at which all moving transforms between two frames are known; None if there are none."""
        path = self._path(target, source) or ([], [])
        moving = [link.history for links in path for link in links if not link.fixed]
        return min(history[-1].stamp for history in moving) if moving and all(moving) else None

    def frames(self) -> list[str]:
        """The frames, each with its parent, such as ``tool in flange (fixed)``."""
        return [f"{c} in {link.parent}" + " (fixed)" * link.fixed for c, link in sorted(self._links.items())]

    def _ancestors(self, frame: str) -> list[str]:
        found = []
        while (link := self._links.get(frame)) is not None:
            frame = link.parent
            found.append(frame)
        return found

    def _path(self, target: str, source: str) -> tuple[list[_Link], list[_Link]] | None:
        """The links from `source` and from `target` up to their nearest common frame; None if there is none."""
        path = self._paths.get((target, source))
        if path is None:
            up, down = [source, *self._ancestors(source)], [target, *self._ancestors(target)]
            meet = next((frame for frame in up if frame in down), None)
            if meet is not None:
                up, down = up[: up.index(meet)], down[: down.index(meet)]
                path = self._paths[target, source] = [self._links[f] for f in up], [self._links[f] for f in down]
        return path

"""Watches for poses that are farther from the one before than a tool can move: no model of motion fits them."""

import math

from rft_ros.estimator.samples import PoseSample
from rft_ros.rft.frames import Vector

FASTEST_M_S = 5.0
"""No arm moves a tool faster."""

_MIN_JUMP_M = 0.01  # stamps that jitter make a shorter step look fast
_RECENT_NS = 2_000_000_000  # so long after the last jump it is told
_REPEATED_JUMP_COUNT = 10  # jumps; fewer are single ones
_RETURN_SHARE = 0.2  # of a jump: so near to the pose before the last one, the jump went back

TWO_PUBLISHERS = "the poses jump to and fro, as with two publishers on one topic: stop one of them"
IN_MILLIMETRES = "the poses move faster than any arm: their driver must give metres, and not millimetres (factor 0.001)"
A_JUMP = (
    f"a pose jumped farther than a tool can move (over {1e3 * _MIN_JUMP_M:g} mm and {FASTEST_M_S:g} m/s): look for a"
    " reset of the poses' origin, lost messages or a second publisher"
)


class PoseJumps:
    """Follows the poses of one tool."""

    def __init__(self) -> None:
        self._last: PoseSample | None = None
        self._before_last: Vector | None = None
        self._jumped_at: int | None = None  # stamp of the last jump [ns]
        # of the jumps that follow each other within `_RECENT_NS`
        self._count = 0
        self._returns = 0

    def follow(self, pose: PoseSample) -> None:
        """Add the next pose, in world axes."""
        last = self._last
        before_last = self._before_last
        self._last = pose
        if last is None:
            return
        self._before_last = last.position
        length = math.dist(pose.position, last.position)
        seconds = 1e-9 * (pose.stamp - last.stamp)
        if length <= _MIN_JUMP_M or length <= FASTEST_M_S * seconds:
            return
        if not self._is_recent(pose.stamp):
            self._count = 0
            self._returns = 0
        self._jumped_at = pose.stamp
        self._count += 1
        if before_last and math.dist(pose.position, before_last) < _RETURN_SHARE * length:
            self._returns += 1

    @property
    def sentence(self) -> str:
        """What the last jumps show; "" if none was recent. It has no numbers, so that it is one problem in a log."""
        if self._last is None or not self._is_recent(self._last.stamp):
            return ""
        if self._returns >= _REPEATED_JUMP_COUNT:
            return TWO_PUBLISHERS
        is_to_and_fro = 2 * self._returns >= self._count
        return (
            IN_MILLIMETRES if self._count >= _REPEATED_JUMP_COUNT and not is_to_and_fro else A_JUMP
        )

    def _is_recent(self, stamp: int) -> bool:
        """Whether the last jump is recent at a stamp [ns], which may be near 0, as in a simulation."""
        return self._jumped_at is not None and stamp - self._jumped_at <= _RECENT_NS

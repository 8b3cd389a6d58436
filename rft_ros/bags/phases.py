"""The phase of every pose: where the tool's lowest point is and how it moves, without flicker."""

import math
from collections.abc import Iterator
from enum import Enum
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from rft_ros.estimator import Estimate, Estimator, NoEstimate, Reason
from rft_ros.rft import rotation_matrix
from rft_ros.rft.compilation import compiled
from rft_ros.rft.frames import from_frame, rotation

__all__ = ["LowestPoint", "Moment", "Phase", "Phases"]


class Phase(str, Enum):
    """What the tool does; users read the values.

    APPROACH: its lowest point is above the surface, except in WITHDRAWAL. PENETRATION: below it, and that point moves
    down. DWELL: below it, slower than `rest_speed`. WITHDRAWAL: that point moves up, or has left the grains and has not
    moved down or sideways since. PLOUGHING: below the surface, any other motion.
    """

    APPROACH = "approach"
    PENETRATION = "penetration"
    PLOUGHING = "ploughing"
    DWELL = "dwell"
    WITHDRAWAL = "withdrawal"

    __str__ = str.__str__


class Moment(NamedTuple):
    """Position and motion of the tool's lowest point at a stamp [ns].

    `depth` [m]: negative above the surface. `sinking`: downward velocity, `travel`: speed of the lowest point, `speed`:
    upper bound on the speeds of the tool's plates [m/s].
    """

    stamp: int
    depth: float
    sinking: float
    travel: float
    speed: float


_UNPLACED = {
    Reason.POSE_NOT_FINITE,
    Reason.POSE_QUATERNION_NOT_UNIT,
    Reason.POSE_FRAME_UNKNOWN,
    Reason.POSE_STAMP_ZERO,
    Reason.POSE_REPEATED,
    Reason.POSE_OUT_OF_ORDER,
}
"""Reasons after which the depth is unknown."""


@compiled
def _lowest_point(corners, state, out):  # type: ignore[no-untyped-def]
    """Write the lowest corner's world z [m], its velocity [m/s] and the world's z axis in the tool frame to `out`."""
    axes = rotation(state[3], state[4], state[5], state[6])
    x = y = z = math.inf
    for corner in corners:
        cx, cy, cz = from_frame(axes, corner[0], corner[1], corner[2])
        if cz < z:
            x, y, z = cx, cy, cz
    wx, wy, wz = state[10], state[11], state[12]
    out[0] = state[2] + z
    out[1], out[2], out[3] = state[7] + wy * z - wz * y, state[8] + wz * x - wx * z, state[9] + wx * y - wy * x
    out[4], out[5], out[6] = axes[6], axes[7], axes[8]


class LowestPoint:
    """Depth and motion of the lowest point of an estimator's tool, pose by pose."""

    def __init__(self, estimator: Estimator) -> None:
        self._estimator = estimator
        self._corners = estimator.model.tool.corners
        self._out = np.zeros(7)
        self._deepest = -math.inf
        self._up = np.array([0.0, 0.0, 1.0])

    def after(self, answer: Estimate | NoEstimate) -> tuple[float | None, Moment | None]:
        """Depth [m] at the pose just answered, None if unknown, and the motion.

        The motion is None without an estimate, except at rest.
        """
        if isinstance(answer, NoEstimate) and answer.reason is not Reason.AT_REST:
            return None if answer.reason in _UNPLACED else self._estimator.depth(), None
        _lowest_point(self._corners, self._estimator.state, self._out)
        height, vx, vy, vz, *up = self._out.tolist()
        mapped = self._estimator.ground is not None
        depth = self._estimator.surface.depth if mapped else self._estimator.settings.surface_height - height
        if depth > self._deepest:
            self._deepest, self._up = depth, np.array(up)
        speed = answer.speed if isinstance(answer, Estimate) else 0.0
        return depth, Moment(answer.stamp, depth, -vz, math.hypot(vx, vy, vz), speed)

    def vertical_axis(self) -> tuple[str, str]:
        """The sensor axis nearest to vertical at the greatest depth, and whether it points "up" or "down"."""
        up = self._up @ rotation_matrix(self._estimator.settings.load_cell.quaternion)
        axis = int(np.argmax(np.abs(up)))
        return "xyz"[axis], "up" if up[axis] > 0.0 else "down"


_HOLD = 100_000_000  # shortest phase [ns]; it counts from its first moment
_WAITING = 4096  # greatest number of moments that wait for their phase
_STEEP, _STILL_STEEP = 0.1, 0.05
"""Sine of the least slope that counts as down or up; the second value applies within that phase."""

_STILL_AT_REST = 1.5  # a tool at rest counts as at rest up to this many times `rest_speed`

_Item = TypeVar("_Item")
_Settled = tuple[_Item, Phase | None]


class Phases(Generic[_Item]):
    """Assign phases to a sequence of moments, each with an item of the caller's.

    `push` returns the items in order, each with its phase, once that is settled: at most 0.1 s later.
    """

    def __init__(self, rest_speed: float) -> None:
        self._rest_speed = rest_speed
        self._phase: Phase | None = None
        self._candidate: Phase | None = None
        self._since = 0
        self._newest = 0
        self._waiting: list[tuple[_Item, bool]] = []

    def push(self, item: _Item, moment: Moment | None) -> list[_Settled[_Item]]:
        """Add a moment, None for unknown motion (its phase is None too); return the items that are now settled."""
        if moment is None:
            if not self._waiting:
                return [(item, None)]
            self._waiting.append((item, False))
            return list(self._settle(self._candidate)) if len(self._waiting) >= _WAITING else []
        settled: list[_Settled[_Item]] = []
        if moment.stamp < self._newest:  # a time jump: start again
            settled += self.finish()
            self._phase = None
        self._newest = moment.stamp
        seen = self._phase_of(moment)
        if self._phase is None:
            self._phase = seen
        if seen is self._phase:
            return [*settled, *self._settle(seen), (item, seen)]  # what waits was noise
        if seen is not self._candidate or not self._waiting:
            settled += self._settle(self._phase)
            self._candidate, self._since = seen, moment.stamp
        self._waiting.append((item, True))
        if moment.stamp - self._since >= _HOLD or len(self._waiting) >= _WAITING:
            settled += self._settle(seen)
        return settled

    def finish(self) -> list[_Settled[_Item]]:
        """Return the items that still wait, with their phases."""
        return list(self._settle(self._candidate))

    def _settle(self, phase: Phase | None) -> Iterator[_Settled[_Item]]:
        waiting, self._waiting = self._waiting, []
        if waiting:
            self._phase = phase
        for item, known in waiting:
            yield item, phase if known else None

    def _phase_of(self, moment: Moment) -> Phase:
        """The phase at this moment, without the hold time; thresholds favour the current phase."""
        now = self._phase
        rest, travel = self._rest_speed, moment.travel
        down = moment.sinking >= max(rest, travel * (_STILL_STEEP if now is Phase.PENETRATION else _STEEP))
        up = -moment.sinking >= max(rest, travel * (_STILL_STEEP if now is Phase.WITHDRAWAL else _STEEP))
        if moment.depth <= 0.0:
            if now is None or now is Phase.APPROACH or down:
                return Phase.APPROACH
            still = moment.speed < rest * _STILL_AT_REST and now is Phase.WITHDRAWAL
            return Phase.WITHDRAWAL if up or still else Phase.APPROACH
        if moment.speed < rest * (_STILL_AT_REST if now is Phase.DWELL else 1.0):
            return Phase.DWELL
        if down:
            return Phase.PENETRATION
        return Phase.WITHDRAWAL if up else Phase.PLOUGHING

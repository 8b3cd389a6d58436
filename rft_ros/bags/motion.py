"""Where the tool is and which way its lowest point goes, by the estimator's state at a pose."""

import math

import numpy as np

from rft_ros.bags.phases import Moment
from rft_ros.estimator import Estimate, Estimator, NoEstimate, Reason
from rft_ros.rft import rotation_matrix
from rft_ros.rft.compilation import compiled
from rft_ros.rft.frames import rotation

__all__ = ["Motion"]

_UNPLACED = {
    Reason.POSE_NOT_FINITE,
    Reason.POSE_QUATERNION_NOT_UNIT,
    Reason.POSE_FRAME_UNKNOWN,
    Reason.POSE_STAMP_ZERO,
    Reason.POSE_REPEATED,
    Reason.POSE_OUT_OF_ORDER,
}
"""Reasons for which a pose does not say where the tool is now."""


@compiled
def _lowest_point(corners, state, out):  # type: ignore[no-untyped-def]
    """World z of the lowest corner [m], its velocity [m/s], and the world's z axis in the tool frame: 7 numbers."""
    a = rotation(state[3], state[4], state[5], state[6])
    lowest, at = math.inf, 0
    for k in range(corners.shape[0]):
        height = a[6] * corners[k, 0] + a[7] * corners[k, 1] + a[8] * corners[k, 2]
        if height < lowest:
            lowest, at = height, k
    cx, cy, cz = corners[at, 0], corners[at, 1], corners[at, 2]
    x, y = a[0] * cx + a[1] * cy + a[2] * cz, a[3] * cx + a[4] * cy + a[5] * cz
    wx, wy, wz = state[10], state[11], state[12]
    out[0] = state[2] + lowest
    out[1], out[2], out[3] = (
        state[7] + wy * lowest - wz * y,
        state[8] + wz * x - wx * lowest,
        state[9] + wx * y - wy * x,
    )
    out[4], out[5], out[6] = a[6], a[7], a[8]


class Motion:
    """The motion of an estimator's tool, pose by pose."""

    def __init__(self, estimator: Estimator) -> None:
        self._estimator = estimator
        self._corners = estimator.model.tool.corners
        self._settings = estimator.settings
        self._out = np.zeros(7)
        self._deepest = -math.inf
        self._up = np.array([0.0, 0.0, 1.0])

    def after(self, answer: Estimate | NoEstimate) -> tuple[float | None, Moment | None]:
        """Depth of the lowest point at the pose just answered [m], and its motion.

        None if the pose does not tell the one, or gave no estimate for any other reason than rest.
        """
        speed = 0.0
        if isinstance(answer, Estimate):
            speed = answer.speed
        elif answer.reason in _UNPLACED:
            return None, None
        elif answer.reason is not Reason.AT_REST:
            return self._estimator.depth(), None
        _lowest_point(self._corners, self._estimator.state, self._out)
        height, vx, vy, vz, *up = self._out.tolist()
        depth = self._settings.surface_height - height
        if depth > self._deepest:
            self._deepest, self._up = depth, np.array(up)
        return depth, Moment(answer.stamp, depth, -vz, math.hypot(vx, vy, vz), speed)

    def vertical_axis(self) -> tuple[str, str]:
        """The sensor axis nearest to vertical where the tool was deepest, and where it points."""
        up = self._up @ rotation_matrix(self._settings.load_cell.quaternion)
        axis = int(np.argmax(np.abs(up)))
        return "xyz"[axis], "up" if up[axis] > 0.0 else "down"

"""The standard deviation of a prediction without learning, (L6) of docs/learning.md."""

import math

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft.kernel.compilation import compiled

__all__ = ["without_learning"]

Array = NDArray[np.float64]

# relative standard deviations
_STRENGTH_ERROR = 0.15  # relative error of a calibrated ζ whose error is not known
_HORIZONTAL_ERROR, _VERTICAL_ERROR = 0.4, 0.1  # of these parts of the force, beside ζ's
_HORIZONTAL_SHARE, _VERTICAL_SHARE = 0.03, 0.15  # of the whole force: an upright plate lifts more than the model says
_NOISE_FLOOR = 0.05  # of any component of the force [N]
_TORQUE_ERROR = 0.5  # of the torque, beside ζ's
_LEVER = 0.07  # of the point where the force acts, over the tool's reach


@compiled
def without_learning(row: Array, zeta_error: float, reach: float, answer: Array) -> None:
    """Write a prediction without learning, (L6), to `answer`, shape [12]: force [N], torque [N m], a deviation of each.

    `row`: the model, begins with force and torque; world axes. `zeta_error`: relative standard error of ζ, 0 if
    unknown. `reach` of the tool [m].
    """
    zeta_error = zeta_error or _STRENGTH_ERROR
    for i in range(6):
        answer[i] = row[i]
    flat, vertical = answer[0] ** 2 + answer[1] ** 2, answer[2] ** 2
    whole = flat + vertical
    horizontally, vertically = zeta_error**2 + _HORIZONTAL_ERROR**2, zeta_error**2 + _VERTICAL_ERROR**2
    answer[6] = answer[7] = math.sqrt(horizontally * flat + _HORIZONTAL_SHARE**2 * whole + _NOISE_FLOOR**2)
    answer[8] = math.sqrt(vertically * vertical + _VERTICAL_SHARE**2 * whole + _NOISE_FLOOR**2)
    for i in range(3, 6):
        answer[6 + i] = math.sqrt((zeta_error**2 + _TORQUE_ERROR**2) * answer[i] ** 2 + (_LEVER * reach) ** 2 * whole)

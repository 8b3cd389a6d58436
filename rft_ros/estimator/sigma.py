"""The standard deviation of a prediction without learning, (L6) of docs/learning.md."""

import math

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft.kernel.compilation import compiled, inlined

__all__ = ["parts_of_prediction", "predict_without_learning"]

Array = NDArray[np.float64]

# relative standard deviations
_STRENGTH_ERROR = 0.15  # relative error of a calibrated ζ whose error is not known
_HORIZONTAL_ERROR, _VERTICAL_ERROR = 0.4, 0.1  # of these parts of the force, beside ζ's
_HORIZONTAL_SHARE, _VERTICAL_SHARE = 0.03, 0.15  # of the whole force: an upright plate lifts more than the model says
_NOISE_FLOOR = 0.05  # of any component of the force [N]
_TORQUE_ERROR = 0.5  # of the torque, beside ζ's
_LEVER = 0.07  # of the point where the force acts, over the tool's reach


@inlined
def parts_of_prediction(with_sigma):
    """Views of a wrench with its standard deviations, shape [12]: force, torque, and the deviations of each."""
    return with_sigma[0:3], with_sigma[3:6], with_sigma[6:9], with_sigma[9:12]


@compiled
def predict_without_learning(row: Array, zeta_error: float, reach: float, with_sigma: Array) -> None:
    """Write a prediction without learning, (L6), to `with_sigma`, shape [12]: wrench and deviations.

    `row`: the model, begins with force and torque; world axes. `zeta_error`: relative standard error of ζ, 0 if
    unknown. `reach` of the tool [m].
    """
    zeta_error = zeta_error or _STRENGTH_ERROR
    for i in range(6):
        with_sigma[i] = row[i]
    force, torque, force_sigma, torque_sigma = parts_of_prediction(with_sigma)
    flat, vertical = force[0] ** 2 + force[1] ** 2, force[2] ** 2
    whole = flat + vertical
    horizontally, vertically = zeta_error**2 + _HORIZONTAL_ERROR**2, zeta_error**2 + _VERTICAL_ERROR**2
    force_sigma[0] = force_sigma[1] = math.sqrt(horizontally * flat + _HORIZONTAL_SHARE**2 * whole + _NOISE_FLOOR**2)
    force_sigma[2] = math.sqrt(vertically * vertical + _VERTICAL_SHARE**2 * whole + _NOISE_FLOOR**2)
    of_point = (_LEVER * reach) ** 2 * whole
    for i in range(3):
        torque_sigma[i] = math.sqrt((zeta_error**2 + _TORQUE_ERROR**2) * torque[i] ** 2 + of_point)

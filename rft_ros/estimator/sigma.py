"""The standard deviation of a prediction: (L6) of docs/learning.md without learning, and wider during a withdrawal.

A withdrawal is the motion in which a tool is pulled out of the grains. On the way up the law predicts a downward force
of a tenth to a quarter of the last push. Real grains still push at first; within a millimetre of path the force drops
to almost nothing. The standard deviation covers the range between.
"""

import math

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.motion import Motion
from rft_ros.rft.frames import WRENCH, Vector
from rft_ros.rft.kernel.compilation import compiled, inlined

Array = NDArray[np.float64]

# relative standard deviations
_HORIZONTAL_ERROR_SHARE = 0.4  # of these parts of the force, in addition to ζ's error
_VERTICAL_ERROR_SHARE = 0.1
_HORIZONTAL_OF_WHOLE_SHARE = (
    0.03  # of the whole force: an upright plate lifts more than the model says
)
_VERTICAL_OF_WHOLE_SHARE = 0.15
_NOISE_FLOOR_N = 0.05  # of any component of the force
_TORQUE_ERROR_SHARE = 0.5  # of the torque, in addition to ζ's error

LEVER_SHARE = 0.07
"""Standard deviation of the point where the force acts, over the tool's reach."""

# of a withdrawal
_MIN_RISE_SHARE = 0.5  # rise over the path of the fastest point
_RELEASE_PATH_M = 0.001  # path over which the last push decays to 1/e while the tool is withdrawn
SIGMA = slice(6, 12)
"""The standard deviations of a prediction, shape [12]; before them lies the wrench, `rft_ros.rft.WRENCH`."""


@inlined
def parts_of_prediction(wrench_and_sigma):
    """Views of a wrench with its standard deviations, shape [12]: force, torque, and the deviations of each."""
    return (
        wrench_and_sigma[0:3],
        wrench_and_sigma[3:6],
        wrench_and_sigma[6:9],
        wrench_and_sigma[9:12],
    )


@compiled
def predict_without_learning(
    row: Array, strength_error: float, reach: float, wrench_and_sigma: Array
) -> None:
    """Write a prediction without learning, (L6), to `wrench_and_sigma`, shape [12]: wrench and deviations.

    `row`: the model, begins with force and torque; world axes. `strength_error`: relative standard error of
    ζ. `reach` of the tool [m].
    """
    wrench = wrench_and_sigma[WRENCH]
    for i in range(6):
        wrench[i] = row[i]
    force, torque, force_sigma, torque_sigma = parts_of_prediction(wrench_and_sigma)
    flat = force[0] ** 2 + force[1] ** 2
    vertical = force[2] ** 2
    whole = flat + vertical
    horizontally = strength_error**2 + _HORIZONTAL_ERROR_SHARE**2
    vertically = strength_error**2 + _VERTICAL_ERROR_SHARE**2
    force_sigma[0] = force_sigma[1] = math.sqrt(
        horizontally * flat + _HORIZONTAL_OF_WHOLE_SHARE**2 * whole + _NOISE_FLOOR_N**2
    )
    force_sigma[2] = math.sqrt(
        vertically * vertical + _VERTICAL_OF_WHOLE_SHARE**2 * whole + _NOISE_FLOOR_N**2
    )
    lever_variance = (LEVER_SHARE * reach) ** 2 * whole
    for i in range(3):
        torque_sigma[i] = math.sqrt(
            (strength_error**2 + _TORQUE_ERROR_SHARE**2) * torque[i] ** 2 + lever_variance
        )


def is_withdrawn(rise: float, path: float, force: Vector) -> bool:
    """Whether a tool in the grains is withdrawn: it moves up, or the model's force [N] points down.

    `rise` of the tool over a `path` of its fastest point [m], or both per time [m/s].
    """
    return rise > _MIN_RISE_SHARE * path or force[2] < -0.5 * math.hypot(*force)


class Withdrawal:
    """Follows one tool from pose to pose: `follow` its motion, then `widen` the prediction's standard deviations."""

    def __init__(self) -> None:
        self.active = False
        """Whether the last path of the tool was that of a withdrawal."""
        self._path = 0.0  # since the last push [m]
        self._push = np.zeros(12)  # the last prediction before the withdrawal
        self._moves = False

    def follow(self, motion: Motion, force: Vector, *, in_grains: bool) -> None:
        """Update with the motion at the next pose. `force`: of the model there [N].

        A tool at rest in the grains keeps what it was: a pause on the way up does not end the withdrawal.
        """
        self._moves = not in_grains or (motion.path > 0.0 and not motion.rests)
        if self._moves:
            self.active = in_grains and is_withdrawn(motion.rise, motion.path, force)
        self._path = self._path + motion.path if self.active else 0.0

    def widen(self, wrench_and_sigma: Array) -> None:
        """While `active`, widen the deviations of a prediction by what is left of the last push, and by the prediction.

        `wrench_and_sigma`, shape [12]: the wrench and its standard deviations.
        """
        if self.active:
            wrench = wrench_and_sigma[WRENCH]
            sigma = wrench_and_sigma[SIGMA]
            remaining_share = math.exp(-self._path / _RELEASE_PATH_M)
            push_error = np.abs(self._push[WRENCH] - wrench) + self._push[SIGMA]
            remaining_error = remaining_share * push_error
            sigma[:] = np.sqrt(sigma * sigma + remaining_error * remaining_error + wrench * wrench)
        elif self._moves:
            self._push[:] = wrench_and_sigma

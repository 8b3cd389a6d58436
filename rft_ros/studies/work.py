"""The work that a motion costs against the grains: power of the wrench, integrated over time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import trapezoid

__all__ = ["Work", "power", "work"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Work:
    """Work done on the grains [J], positive where they resist.

    `vertical`: of the vertical force over the vertical displacement of the tool frame's origin. `total`: of the whole
    wrench, so that turning and sideways motion count too.
    """

    vertical: float
    total: float


def power(states: Array, wrenches: Array) -> Array:
    """Power of the whole wrench against the motion [W], shape [n]: -(F·v + T·ω), positive where the grains resist.

    `states`: shape [n, 13], columns `rft_ros.rft.STATE`. `wrenches`: shape [n, 6 or more], force on the tool [N] and
    torque about its frame's origin [N m], world axes.
    """
    return np.asarray(-(wrenches[:, :6] * states[:, 7:13]).sum(axis=1))


def work(times: Array, states: Array, wrenches: Array) -> Work:
    """Vertical and total work over a motion, by the trapezoidal rule; arguments as for `power`, times [s] too."""
    return Work(
        vertical=float(trapezoid(-wrenches[:, 2] * states[:, 9], times)),
        total=float(trapezoid(power(states, wrenches), times)),
    )

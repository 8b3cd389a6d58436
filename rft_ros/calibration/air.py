"""What a load cell reads in the air, which is linear in ten numbers: bias, mass, and mass times its centre."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import FORCE, TORQUE

Array = NDArray[np.float64]

BIAS = slice(0, 6)
MASS = 6
MOMENT = slice(7, 10)
"""The ten numbers: the bias [N], [N m], the mass [kg], and the mass times its centre [kg m]."""

MIN_GRAVITY_SPREAD_RATIO = 0.15
"""Least `spread` of gravity's direction in the load cell that tells bias, mass and centre apart."""

_MIN_EIGENVALUE_RATIO = 1e-10
"""Least eigenvalue of the normal matrix, relative to its greatest one, whose direction the readings determine."""


def cross(vectors: Array) -> Array:
    """Matrices that give the cross products of n vectors with another one, shape [n, 3, 3]."""
    return np.swapaxes(np.cross(vectors[:, None, :], np.eye(3)), 1, 2)


def columns_in_air(gravity: Array) -> Array:
    """What each of the ten numbers adds to a reading with the sign of a wrench on the tool, shape [n, 6, 10].

    `gravity`: in the axes of the load cell [m/s²], shape [n, 3].
    """
    columns = np.zeros((len(gravity), 6, 10))
    columns[:, :, BIAS] = np.eye(6)
    columns[:, FORCE, MASS] = gravity
    columns[:, TORQUE, MOMENT] = cross(-gravity)
    return columns


class FitInAir(NamedTuple):
    """Least squares of n readings.

    `values` of the free numbers, shape [k], and their standard `errors`; `residuals`, shape [n, 6]; `inverse`, shape
    [k, n * 6], times a change of the readings is the change of the values.
    """

    values: Array
    errors: Array
    residuals: Array
    inverse: Array


def fit_in_air(columns: Array, readings: Array, errors: Array | float = 0.0) -> FitInAir:
    """Fit readings with these errors, shape [n, 6], or some of their axes, by columns of shape [n, 6, k].

    The variance of a reading is the greater of its axis' scatter about the fit and its own error squared.
    """
    matrix = columns.reshape(readings.size, -1)
    # by normal equations, which take a tenth of the time for thousands of readings
    inverse = (
        np.linalg.pinv(matrix.T @ matrix, rcond=_MIN_EIGENVALUE_RATIO, hermitian=True) @ matrix.T
    )
    values = inverse @ readings.ravel()
    residuals = readings - (matrix @ values).reshape(readings.shape)
    freedom = np.sum(1.0 - np.einsum("nk,kn->n", matrix, inverse).reshape(readings.shape), axis=0)
    scatter = np.sum(residuals**2, axis=0) / np.maximum(freedom, 1.0)
    variance = np.broadcast_to(np.maximum(scatter, errors**2), readings.shape).ravel()
    return FitInAir(values, np.sqrt(inverse**2 @ variance), residuals, inverse)


def spread(directions: Array) -> float:
    """RMS spread of unit vectors, shape [n, 3], in the second of their main directions."""
    sizes = np.linalg.svd(directions - directions.mean(axis=0), compute_uv=False)
    return float(sizes[1] / np.sqrt(len(directions))) if len(sizes) > 1 else 0.0

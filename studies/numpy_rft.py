"""The published rule in plain vectorised NumPy: angles by arctan2, Li's nine terms, tanh and arctanh.

The compiled kernel is compared with it. Written from docs/method.md, independently of the kernel.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import ANGULAR_VELOCITY, QUATERNION, VELOCITY, Medium, Plates, rotation_matrix

__all__ = ["AlphaY", "constant", "linear", "wrench"]

Array = NDArray[np.float64]
AlphaY = Callable[[Array], Array | float]
"""β [rad] -> α_y [N/cm³]."""

A1, A2, A3 = 0.440850096954369, 3.62263982880971, 1.60910808139526
B1, B2, B3 = 1.99392673405210, 1.61146827229181, 0.973746396532650
N1 = A1 * (np.tanh(A2 - A3) + np.tanh(A3))
N23 = B1 * (np.arctanh(B2 - B3) + np.arctanh(B3))


def constant(medium: Medium) -> AlphaY:
    """α_y of the flat plate at every β."""
    return lambda _beta: medium.C11 + medium.C01 + medium.Cm11


def linear(beta: Array) -> Array:
    """α_y = 0.2035 - 0.0015 β[deg]."""
    return 0.2035 - 0.0015 * np.degrees(beta)


def wrench(
    plates: Plates,
    medium: Medium,
    zeta: float,
    alpha_y: AlphaY,
    state: Array,
    *,
    live_only: bool = False,
) -> Array:
    """Force [N] and torque about the tool frame's origin [N m], shape [6], at one state; the surface is at z = 0.

    `live_only`: first pick out the plates that carry a force, submerged and leading, so that the rest costs less.
    """
    to_world = rotation_matrix(state[QUATERNION])
    r = to_world @ plates.centroids
    n = to_world @ plates.normals
    v = state[VELOCITY, None] + np.cross(state[ANGULAR_VELOCITY], r, axis=0)
    depth = -(state[2] + r[2])
    live = (depth > 0.0) & ((v * n).sum(axis=0) > 0.0)
    area = plates.areas
    if live_only:
        r, n, v, depth, area = r[:, live], n[:, live], v[:, live], depth[live], area[live]
    else:
        area = np.where(live, area, 0.0)
    v = v / np.sqrt((v * v).sum(axis=0))

    flat = np.abs(n[2]) >= 1.0 - 1e-3
    e2x = np.where(flat, v[0] + 1e-5, n[0])
    e2y = np.where(flat, v[1], n[1])
    length = np.sqrt(e2x * e2x + e2y * e2y)
    e2x, e2y = e2x / length, e2y / length

    v1 = v[0] * e2y - v[1] * e2x
    v2 = v[0] * e2x + v[1] * e2y
    v23 = np.sqrt(v2 * v2 + v[2] * v[2])
    beta = np.arctan2(n[2], n[0] * e2x + n[1] * e2y) + np.pi / 2
    gamma = -np.arctan2(v[2], v2)

    m = medium
    two_beta = 2.0 * beta
    plus, minus = gamma + two_beta, gamma - two_beta
    alpha_z = (
        m.A00
        + m.A10 * np.cos(two_beta)
        + m.B11 * np.sin(plus)
        + m.B01 * np.sin(gamma)
        + m.Bm11 * np.sin(minus)
    )
    alpha_x = (
        m.C11 * np.cos(plus)
        + m.C01 * np.cos(gamma)
        + m.Cm11 * np.cos(minus)
        + m.D10 * np.sin(two_beta)
    )
    f1 = A1 * (np.tanh(A2 * np.abs(v1) - A3) + np.tanh(A3)) / N1
    f23 = B1 * (np.arctanh(B2 * np.minimum(v23, 1.0) - B3) + np.arctanh(B3)) / N23

    weight = zeta * 1e6 * depth * area
    t1 = -weight * f1 * alpha_y(beta) * np.sign(v1)
    t2 = -weight * f23 * alpha_x
    force = np.array([t1 * e2y + t2 * e2x, t2 * e2y - t1 * e2x, weight * f23 * alpha_z])
    return np.concatenate([force.sum(axis=1), np.cross(r, force, axis=0).sum(axis=1)])

"""The displacement of a tool from one state to the next, which moves the memory of its plates.

A displacement is twelve numbers, in world axes: of the tool frame's origin [m], and a matrix by rows. A point at x from
the origin moved by origin + matrix x. Arrays have the numbers in a row, of which compiled loops take a `Displacement`.
A measured pose is followed at the distance of a dead band, which filters its noise; a simulator needs none.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft.arguments import number
from rft_ros.rft.frames import (
    QUATERNION,
    attitude,
    from_frame,
    into_frame,
    parts_of_state,
    rotation,
)
from rft_ros.rft.kernel.compilation import compiled, inlined

Array = NDArray[np.float64]

DISPLACEMENT_COUNT = 12
"""Numbers of a displacement in an array."""

_XX, _XY, _XZ, _YX, _YY, _YZ, _ZX, _ZY, _ZZ = range(3, DISPLACEMENT_COUNT)
"""Columns of the matrix in an array of displacements."""


class Displacement(NamedTuple):
    """A displacement: of the origin [m], and the matrix by rows."""

    origin: tuple[float, float, float]
    matrix: tuple[float, float, float, float, float, float, float, float, float]


NO_DISPLACEMENT = Displacement(
    origin=(0.0, 0.0, 0.0), matrix=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
)
"""Of a tool that did not move."""

SLACK = 10e-6
"""Dead band [m] for measured poses: five standard deviations of encoders of 2 µm."""

MAX_DISPLACEMENT_M = 1e30
"""Bounds displacements, so that no product overflows."""

FOLLOWER = np.dtype(
    (np.record, [("is_known", float), ("position", float, 3), ("rotation", float, 9)])
)
"""The pose that follows a tool's: 1 after the first state and 0 before, position [m], rotation matrix by rows."""

_TINY = 1e-60  # least squared speeds and lengths that are divided by


@inlined
def _write_change(position, rotation, is_known, state, change):
    """Write the displacement from a pose to that of a state. `is_known`: 1, or 0 for no displacement."""
    axes = attitude(state[QUATERNION])
    for c in range(3):
        change[c] = is_known * min(
            max(state[c] - position[c], -MAX_DISPLACEMENT_M), MAX_DISPLACEMENT_M
        )
    for first in range(0, 9, 3):
        x = axes[first] - rotation[first]
        y = axes[first + 1] - rotation[first + 1]
        z = axes[first + 2] - rotation[first + 2]
        x, y, z = from_frame(axes, x, y, z)
        change[3 + first] = is_known * x
        change[4 + first] = is_known * y
        change[5 + first] = is_known * z


@inlined
def between(state_before, state, displacement):
    """Write the displacement from one state, shape [13], to another one; none from a state that is all zeros."""
    is_known = 0.0
    for c in range(3, 7):
        if state_before[c] != 0.0:
            is_known = 1.0
    _write_change(state_before, attitude(state_before[QUATERNION]), is_known, state, displacement)


@inlined
def displacement_in(row):
    """The `Displacement` in a row of an array, shape [12]."""
    origin = row[0], row[1], row[2]
    matrix = row[3], row[4], row[5], row[6], row[7], row[8], row[9], row[10], row[11]
    return Displacement(origin=origin, matrix=matrix)


@inlined
def twist_along(displacement):
    """A twist in whose direction a displacement goes."""
    dx, dy, dz = displacement.origin
    _, xy, xz, yx, _, yz, zx, zy, _ = displacement.matrix
    return dx, dy, dz, 0.5 * (zy - yz), 0.5 * (xz - zx), 0.5 * (yx - xy)


@inlined
def product(row, twist, reach):
    """The inner product of a displacement, shape [12], and a twist [m²/s]. `reach` [m] weighs turns."""
    dx, dy, dz, rx, ry, rz = twist_along(displacement_in(row))
    vx, vy, vz, wx, wy, wz = twist
    return dx * vx + dy * vy + dz * vz + reach * reach * (rx * wx + ry * wy + rz * wz)


@inlined
def _bounded(x):
    return min(max(x, -MAX_DISPLACEMENT_M), MAX_DISPLACEMENT_M)


@inlined
def _reduce(displacement, state, reach, dead_band):
    """Reduce a displacement D to its part beyond the dead band b.

    Its component along the velocity is scaled by 1 - b / |D|. The component across it is scaled by 1 - b / |across|, so
    it counts only where it exceeds b by itself: noise of the poses then hardly changes the direction.
    """
    _, _, velocity, angular_velocity = parts_of_state(state)
    vx = _bounded(velocity[0])
    vy = _bounded(velocity[1])
    vz = _bounded(velocity[2])
    wx = _bounded(angular_velocity[0])
    wy = _bounded(angular_velocity[1])
    wz = _bounded(angular_velocity[2])
    square = 0.0
    for c in range(3):
        square += displacement[c] * displacement[c]
    for c in range(3, DISPLACEMENT_COUNT):
        square += 0.5 * reach * reach * displacement[c] * displacement[c]
    inner_product = product(displacement, (vx, vy, vz, wx, wy, wz), reach)
    speed_square = vx * vx + vy * vy + vz * vz + reach * reach * (wx * wx + wy * wy + wz * wz)
    share = max(1.0 - dead_band / max(sqrt(square), _TINY), 0.0)
    time = 0.0
    share_across = share
    if speed_square > _TINY:
        time = inner_product / speed_square
        distance_across = sqrt(max(square - inner_product * time, 0.0))
        share_across = max(1.0 - dead_band / max(distance_across, _TINY), 0.0)
        time *= share - share_across
    for c in range(DISPLACEMENT_COUNT):
        displacement[c] *= share_across
    displacement[0] += time * vx
    displacement[1] += time * vy
    displacement[2] += time * vz
    displacement[_XY] -= time * wz
    displacement[_XZ] += time * wy
    displacement[_YX] += time * wz
    displacement[_YZ] -= time * wx
    displacement[_ZX] -= time * wy
    displacement[_ZY] += time * wx


@inlined
def follow(follower, state, reach, dead_band, displacement):
    """Write the displacement of a tool to its next state, shape [13], and move the pose that follows it.

    `follower`: a record of `FOLLOWER`. `reach` of the plates, `dead_band` [m].
    """
    change = np.empty(DISPLACEMENT_COUNT)
    _write_change(follower.position, follower.rotation, follower.is_known, state, change)
    for c in range(DISPLACEMENT_COUNT):
        displacement[c] = change[c]
    if dead_band > 0.0:
        _reduce(displacement, state, reach, dead_band)
    # what the dead band leaves for later
    axes = attitude(state[QUATERNION])
    for c in range(3):
        follower.position[c] = state[c] - (change[c] - displacement[c])
    for first in range(0, 9, 3):
        x = change[3 + first] - displacement[3 + first]
        y = change[4 + first] - displacement[4 + first]
        z = change[5 + first] - displacement[5 + first]
        x, y, z = into_frame(axes, x, y, z)
        follower.rotation[first] = axes[first] - x
        follower.rotation[first + 1] = axes[first + 1] - y
        follower.rotation[first + 2] = axes[first + 2] - z
    follower.is_known = 1.0


@inlined
def half_way_axes(axes, displacement):
    """The axes of the tool half a displacement before those at its end; rotation matrices by rows."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = displacement.matrix
    # quaternion of the turn, scaled: its real part is 4 cos² of half the angle
    w, x, y, z = max(4.0 - xx - yy - zz, 0.0), zy - yz, xz - zx, yx - xy
    w += sqrt(max(w * w + x * x + y * y + z * z, _TINY))
    per_norm = 1.0 / sqrt(w * w + x * x + y * y + z * z)
    back = rotation(-x * per_norm, -y * per_norm, -z * per_norm, w * per_norm)
    a, d, g = from_frame(back, axes[0], axes[3], axes[6])
    b, e, h = from_frame(back, axes[1], axes[4], axes[7])
    c, f, i = from_frame(back, axes[2], axes[5], axes[8])
    return a, b, c, d, e, f, g, h, i


@inlined
def in_tool_axes(axes, half_way, displacement):
    """The displacement that takes a point in tool axes at the end, and gives its path in the tool's axes half-way.

    `displacement`: the same in world axes. `axes` at the end, `half_way`: rotation matrices.
    """
    matrix = displacement.matrix
    x = into_frame(axes, *matrix[:3])
    y = into_frame(axes, *matrix[3:6])
    z = into_frame(axes, *matrix[6:])
    p = into_frame(half_way, x[0], y[0], z[0])
    q = into_frame(half_way, x[1], y[1], z[1])
    r = into_frame(half_way, x[2], y[2], z[2])
    return Displacement(
        origin=into_frame(half_way, *displacement.origin),
        matrix=(p[0], q[0], r[0], p[1], q[1], r[1], p[2], q[2], r[2]),
    )


@inlined
def shift_of(displacement, point):
    """The displacement of a point of the tool by the tool's `Displacement`; both in world or in tool axes."""
    dx, dy, dz = displacement.origin
    xx, xy, xz, yx, yy, yz, zx, zy, zz = displacement.matrix
    x, y, z = point
    return (
        dx + xx * x + xy * y + xz * z,
        dy + yx * x + yy * y + yz * z,
        dz + zx * x + zy * y + zz * z,
    )


@compiled
def _between_each(states_before, states, displacements):
    for k in range(len(states)):
        between(states_before[k], states[k], displacements[k])


@compiled
def _follow_each(followers, states, reach, dead_band, displacements):
    for k in range(len(states)):
        follow(followers[0], states[k], reach, dead_band, displacements[k])


def displacements_between(states_before: Array, states: Array) -> Array:
    """The displacements between states, each of shape [n, 13], shape [n, 12]; none from a state that is all zeros."""
    displacements = np.empty((len(states), DISPLACEMENT_COUNT))
    _between_each(states_before, states, displacements)
    return displacements


def displacements_followed(states: Array, *, reach: float, dead_band: float) -> Array:
    """The displacements of a tool at successive states, shape [n, 13], beyond a dead band [m]; shape [n, 12].

    `reach` of its plates [m]. The first state has none.
    """
    number("dead_band", dead_band, least=0.0)
    displacements = np.empty((len(states), DISPLACEMENT_COUNT))
    _follow_each(np.zeros(1, FOLLOWER), states, reach, dead_band, displacements)
    return displacements

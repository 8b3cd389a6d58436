"""The displacement of a tool from one state to the next, which moves the memory of its plates.

A displacement is twelve numbers, in world axes: of the tool frame's origin [m], and a matrix by rows. A point at x from
the origin moved by origin + matrix x. A measured pose is followed at the distance of a dead band, which filters its
noise; a simulator needs none.
"""

from math import sqrt

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

DISPLACEMENT = 12
"""Numbers of a displacement."""

_XY = 4
_XZ = 5
_YX = 6
_YZ = 8
_ZX = 9
_ZY = 10
"""Places in a displacement of the numbers of its matrix that a rotation changes first."""

SLACK = 10e-6
"""Dead band [m] for measured poses: five standard deviations of encoders of 2 µm."""

FAR = 1e30
"""Bounds displacements [m], so that no product overflows."""

FOLLOWED = np.dtype([("is_known", float), ("position", float, 3), ("rotation", float, 9)])
"""The pose that follows a tool's: 1 after the first state and 0 before, position [m], rotation matrix by rows."""

_TINY = 1e-60  # least squared speeds and lengths that are divided by


@inlined
def _write_change(position, rotation, is_known, state, change):
    """Write the displacement from a pose to that of a state. `is_known`: 1, or 0 for no displacement."""
    axes = attitude(state[QUATERNION])
    for c in range(3):
        change[c] = is_known * min(max(state[c] - position[c], -FAR), FAR)
    for first in range(0, 9, 3):
        x = axes[first] - rotation[first]
        y = axes[first + 1] - rotation[first + 1]
        z = axes[first + 2] - rotation[first + 2]
        x, y, z = from_frame(axes, x, y, z)
        change[3 + first] = is_known * x
        change[4 + first] = is_known * y
        change[5 + first] = is_known * z


@inlined
def between(before, state, moved):
    """Write the displacement from one state, shape [13], to another one; none from a state that is all zeros."""
    is_known = 0.0
    for c in range(3, 7):
        if before[c] != 0.0:
            is_known = 1.0
    _write_change(before, attitude(before[QUATERNION]), is_known, state, moved)


@inlined
def as_motion(moved):
    """A displacement in an array, shape [12], as origin and matrix."""
    origin = moved[0], moved[1], moved[2]
    matrix = (
        moved[3],
        moved[4],
        moved[5],
        moved[6],
        moved[7],
        moved[8],
        moved[9],
        moved[10],
        moved[11],
    )
    return origin, matrix


@inlined
def twist_along(motion):
    """A twist in whose direction a displacement goes."""
    (dx, dy, dz), (_, xy, xz, yx, _, yz, zx, zy, _) = motion
    return dx, dy, dz, 0.5 * (zy - yz), 0.5 * (xz - zx), 0.5 * (yx - xy)


@inlined
def product(moved, twist, reach):
    """The inner product of a displacement, shape [12], and a twist [m²/s]. `reach` [m] weighs turns."""
    dx, dy, dz, rx, ry, rz = twist_along(as_motion(moved))
    vx, vy, vz, wx, wy, wz = twist
    return dx * vx + dy * vy + dz * vz + reach * reach * (rx * wx + ry * wy + rz * wz)


@inlined
def _bounded(x):
    return min(max(x, -FAR), FAR)


@inlined
def _reduce(moved, state, reach, dead_band):
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
        square += moved[c] * moved[c]
    for c in range(3, DISPLACEMENT):
        square += 0.5 * reach * reach * moved[c] * moved[c]
    along = product(moved, (vx, vy, vz, wx, wy, wz), reach)
    speed_square = vx * vx + vy * vy + vz * vz + reach * reach * (wx * wx + wy * wy + wz * wz)
    share = max(1.0 - dead_band / max(sqrt(square), _TINY), 0.0)
    time = 0.0
    share_across = share
    if speed_square > _TINY:
        time = along / speed_square
        across = sqrt(max(square - along * time, 0.0))
        share_across = max(1.0 - dead_band / max(across, _TINY), 0.0)
        time *= share - share_across
    for c in range(DISPLACEMENT):
        moved[c] *= share_across
    moved[0] += time * vx
    moved[1] += time * vy
    moved[2] += time * vz
    moved[_XY] -= time * wz
    moved[_XZ] += time * wy
    moved[_YX] += time * wz
    moved[_YZ] -= time * wx
    moved[_ZX] -= time * wy
    moved[_ZY] += time * wx


@inlined
def follow(followed, state, reach, dead_band, moved):
    """Write the displacement of a tool to its next state, shape [13], and move the pose that follows it.

    `followed`: a record of `FOLLOWED`. `reach` of the plates, `dead_band` [m].
    """
    change = np.empty(DISPLACEMENT)
    _write_change(followed.position, followed.rotation, followed.is_known, state, change)
    for c in range(DISPLACEMENT):
        moved[c] = change[c]
    if dead_band > 0.0:
        _reduce(moved, state, reach, dead_band)
    # what the dead band leaves for later
    axes = attitude(state[QUATERNION])
    for c in range(3):
        followed.position[c] = state[c] - (change[c] - moved[c])
    for first in range(0, 9, 3):
        x = change[3 + first] - moved[3 + first]
        y = change[4 + first] - moved[4 + first]
        z = change[5 + first] - moved[5 + first]
        x, y, z = into_frame(axes, x, y, z)
        followed.rotation[first] = axes[first] - x
        followed.rotation[first + 1] = axes[first + 1] - y
        followed.rotation[first + 2] = axes[first + 2] - z
    followed.is_known = 1.0


@inlined
def half_way_axes(axes, motion):
    """The axes of the tool half a displacement before those at its end; rotation matrices by rows."""
    _, (xx, xy, xz, yx, yy, yz, zx, zy, zz) = motion
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
def in_tool_axes(axes, half_way, motion):
    """The displacement of a place that is given in tool axes at the end, in the tool's axes half-way.

    Origin and matrix, as `motion`, which has both in world axes. `axes` at the end, `half_way`: rotation matrices.
    """
    (dx, dy, dz), matrix = motion
    x = into_frame(axes, *matrix[:3])
    y = into_frame(axes, *matrix[3:6])
    z = into_frame(axes, *matrix[6:])
    p = into_frame(half_way, x[0], y[0], z[0])
    q = into_frame(half_way, x[1], y[1], z[1])
    r = into_frame(half_way, x[2], y[2], z[2])
    return into_frame(half_way, dx, dy, dz), (p[0], q[0], r[0], p[1], q[1], r[1], p[2], q[2], r[2])


@inlined
def moved_by(motion, place):
    """The displacement of a place by that of a tool, as origin and matrix; both in world or in tool axes."""
    (dx, dy, dz), (xx, xy, xz, yx, yy, yz, zx, zy, zz) = motion
    x, y, z = place
    return (
        dx + xx * x + xy * y + xz * z,
        dy + yx * x + yy * y + yz * z,
        dz + zx * x + zy * y + zz * z,
    )


@compiled
def _between_each(before, states, moved):
    for k in range(len(states)):
        between(before[k], states[k], moved[k])


@compiled
def _follow_each(followed, states, reach, dead_band, moved):
    for k in range(len(states)):
        follow(followed[0], states[k], reach, dead_band, moved[k])


def displacements_between(before: Array, states: Array) -> Array:
    """The displacements between states, each of shape [n, 13], shape [n, 12]; none from a state that is all zeros."""
    moved = np.empty((len(states), DISPLACEMENT))
    _between_each(before, states, moved)
    return moved


def displacements_followed(states: Array, *, reach: float, dead_band: float) -> Array:
    """The displacements of a tool at successive states, shape [n, 13], beyond a dead band [m]; shape [n, 12].

    `reach` of its plates [m]. The first state has none.
    """
    number("dead_band", dead_band, least=0.0)
    moved = np.empty((len(states), DISPLACEMENT))
    _follow_each(np.zeros(1, FOLLOWED), states, reach, dead_band, moved)
    return moved

"""The compiled loops: the tractions of many plates, summed to a wrench (Treers et al. 2021, eq. 1)."""

import zlib
from math import sqrt
from pathlib import Path
from typing import Any

import numba
import numpy as np

from rft_ros.rft.blocks import BLOCK, CAREFUL, PLAIN, SKIP_WET, kind_of_block
from rft_ros.rft.compiled import OPTIONS, inlined
from rft_ros.rft.frames import rotation
from rft_ros.rft.traction import traction_per_depth
from rft_ros.rft.wet_part import wet_part

__all__ = ["KERNELS"]


@inlined
def _motion(state, reach):  # type: ignore[no-untyped-def]
    """Rotation matrix (9 numbers, by rows) and twist (6 numbers) of a state, the twist scaled to order one.

    The law is rate-independent, so a common factor is free: it keeps squares of speeds from over- and underflow.
    """
    vx, vy, vz, wx, wy, wz = state[7], state[8], state[9], state[10], state[11], state[12]
    # The 1e-9 m bounds the scaled angular velocity of plates at the origin, which would be inf * 0.
    fastest = max(abs(vx), abs(vy), abs(vz), max(reach, 1e-9) * max(abs(wx), abs(wy), abs(wz)))
    s = 1.0 / fastest if fastest > 1e-290 else 0.0
    return rotation(state[3], state[4], state[5], state[6]), (vx * s, vy * s, vz * s, wx * s, wy * s, wz * s)


@inlined
def _in_tool_axes(axes, x, y, z):  # type: ignore[no-untyped-def]
    xx, xy, xz, yx, yy, yz, zx, zy, zz = axes
    return xx * x + yx * y + zx * z, xy * x + yy * y + zy * z, xz * x + yz * y + zz * z


@inlined
def _length(v):  # type: ignore[no-untyped-def]
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@inlined
def _plate(rows, i, axes, twist, law, below, refined, careful):  # type: ignore[no-untyped-def]
    """One plate: where its force acts from the tool frame's origin, the force, world axes; its submerged area.

    `below`: depth of the tool frame's origin. `careful` False: the plate is submerged and not nearly flat. This and
    `refined` must be constants, or the loop does not become vector code.
    """
    xx, xy, xz, yx, yy, yz, zx, zy, zz = axes
    vx, vy, vz, wx, wy, wz = twist
    a, b, c = rows[0, i], rows[1, i], rows[2, i]
    area = rows[6, i]
    depth = below - (zx * a + zy * b + zz * c)
    weight = depth * area
    if refined:
        # e0, e1 and -(e0 + e1) are the corners from the centroid
        e0x, e0y, e0z, e1x, e1y, e1z = rows[7, i], rows[8, i], rows[9, i], rows[10, i], rows[11, i], rows[12, i]
        h0 = zx * e0x + zy * e0y + zz * e0z
        h1 = zx * e1x + zy * e1y + zz * e1z
        if careful:
            p0, p1, p2, share = wet_part(depth - h0, depth - h1, depth + h0 + h1)
            mean = p0 + p1 + p2
            weight = mean * area
            area *= share
            per_mean = 1.0 / mean if mean > 1e-290 else 0.0
            k0, k1 = (p0 - p2) * per_mean, (p1 - p2) * per_mean
        else:
            per_depth = -1.0 / (12.0 * depth)
            k0, k1 = per_depth * (2.0 * h0 + h1), per_depth * (h0 + 2.0 * h1)
        a, b, c = a + k0 * e0x + k1 * e1x, b + k0 * e0y + k1 * e1y, c + k0 * e0z + k1 * e1z
    elif careful:
        area = area if depth > 0.0 else 0.0
        weight = depth * area
    x, y, z = xx * a + xy * b + xz * c, yx * a + yy * b + yz * c, zx * a + zy * b + zz * c
    a, b, c = rows[3, i], rows[4, i], rows[5, i]
    nx, ny, nz = xx * a + xy * b + xz * c, yx * a + yy * b + yz * c, zx * a + zy * b + zz * c
    ux, uy, uz = vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x
    lead = ux * nx + uy * ny + uz * nz
    if refined:
        per_speed = 1.0 / sqrt(max(ux * ux + uy * uy + uz * uz, 1e-290))
        # from 0 to 1 over the angles that the plate stands for; in abs, since selects would branch
        q = lead * per_speed * rows[13, i]
        weight *= 0.5 * (abs(q + 0.5) - abs(q - 0.5) + 1.0)
    else:
        weight = weight if lead > 0.0 else 0.0
    tx, ty, tz = traction_per_depth(law, nx, ny, nz, ux, uy, uz, careful)
    return x, y, z, tx * weight, ty * weight, tz * weight, area


@inlined
def _sum(rows, first, last, axes, twist, law, below, refined, careful):  # type: ignore[no-untyped-def]
    """Force, torque and submerged area of consecutive plates."""
    fx = fy = fz = tx = ty = tz = submerged = 0.0
    for i in range(first, last):
        x, y, z, dx, dy, dz, area = _plate(rows, i, axes, twist, law, below, refined, careful)
        fx += dx
        fy += dy
        fz += dz
        tx += y * dz - z * dy
        ty += z * dx - x * dz
        tz += x * dy - y * dx
        submerged += area
    return fx, fy, fz, tx, ty, tz, submerged


def _kernels(source: int, refined: bool) -> tuple[Any, Any]:
    """The compiled loops over states and over plates, for one rule of integration.

    numba's cache knows when this file changes, not when a law or a model in another one does: `source`, in the closure,
    is part of the cache's key and does.
    """

    def of_states(rows, bounds, reach, law, surface_height, states, out):  # type: ignore[no-untyped-def]
        if source == 0:
            return
        for k in range(states.shape[0]):
            axes, twist = _motion(states[k], reach)
            below = surface_height - states[k, 2]
            linear = _in_tool_axes(axes, twist[0], twist[1], twist[2])
            angular = _in_tool_axes(axes, twist[3], twist[4], twist[5])
            fastest = _length(linear) + _length(angular) * reach
            up = axes[6:]
            fx = fy = fz = tx = ty = tz = submerged = 0.0
            # unsigned, or numba looks for negative indices in the inner loops
            b, blocks = np.uint64(0), np.uint64(bounds.shape[0])
            kind = kind_of_block(bounds, b, linear, angular, fastest, reach, up, below)
            while b < blocks:
                first, run = b, kind
                while b < blocks and kind == run:
                    submerged += bounds[b, 18] if kind == SKIP_WET else 0.0
                    b += np.uint64(1)
                    if b < blocks:
                        kind = kind_of_block(bounds, b, linear, angular, fastest, reach, up, below)
                if run in (PLAIN, CAREFUL):
                    i, j = first * np.uint64(BLOCK), b * np.uint64(BLOCK)
                    if run == PLAIN:
                        part = _sum(rows, i, j, axes, twist, law, below, refined, False)
                    else:
                        part = _sum(rows, i, j, axes, twist, law, below, refined, True)
                    fx += part[0]
                    fy += part[1]
                    fz += part[2]
                    tx += part[3]
                    ty += part[4]
                    tz += part[5]
                    submerged += part[6]
            out[k, 0], out[k, 1], out[k, 2] = fx, fy, fz
            out[k, 3], out[k, 4], out[k, 5] = tx, ty, tz
            out[k, 6] = submerged

    def of_plates(rows, reach, law, surface_height, state, order, out):  # type: ignore[no-untyped-def]
        if source == 0:
            return
        axes, twist = _motion(state, reach)
        below = surface_height - state[2]
        for i in range(len(order)):
            _, _, _, dx, dy, dz, _ = _plate(rows, i, axes, twist, law, below, refined, True)
            out[order[i], 0], out[order[i], 1], out[order[i], 2] = dx, dy, dz

    for function in (of_states, of_plates):  # an index of the cache for each rule: two processes fill them at a time
        function.__qualname__ += "_refined" if refined else "_centroid"
    jit = numba.njit(cache=True, nogil=True, **OPTIONS)
    return jit(of_states), jit(of_plates)


def _source() -> int:
    """A number over all source files of this package, never 0."""
    return 1 + zlib.crc32(b"".join(file.read_bytes() for file in sorted(Path(__file__).parent.glob("*.py"))))


KERNELS = {"centroid": _kernels(_source(), False), "refined": _kernels(_source(), True)}
"""For each rule of integration, the loop over states and the loop over the plates of one state."""

"""The compiled loops: the tractions of many plates, summed to a wrench (Treers et al. 2021, eq. 1)."""

from typing import Any

import numba
import numpy as np

from rft_ros.rft.blocks import BLOCK, CUT, PLAIN, SKIP_WET, kind_of_block
from rft_ros.rft.compiled import OPTIONS, SOURCE, inlined
from rft_ros.rft.element import element, in_tool_axes, length, motion
from rft_ros.rft.traction import BLENDED, NEVER_FLAT, SWITCHED, traction_per_depth

__all__ = ["KERNELS"]


@inlined
def _plate(rows, i, axes, twist, law, below, refined, careful, flatness):  # type: ignore[no-untyped-def]
    """Force on one plate and where it acts, world axes, from the tool frame's origin; its submerged area."""
    (x, y, z), (nx, ny, nz), (ux, uy, uz), load, share, area = element(rows, i, axes, twist, below, refined, careful)
    tx, ty, tz = traction_per_depth(law, nx, ny, nz, ux, uy, uz, flatness)
    load = load * share if refined else (load if share > 0.0 else 0.0)
    return x, y, z, tx * load, ty * load, tz * load, area


@inlined
def _sum(rows, first, last, axes, twist, law, below, refined, careful, flatness):  # type: ignore[no-untyped-def]
    """Force, torque and submerged area of consecutive plates."""
    fx = fy = fz = tx = ty = tz = submerged = 0.0
    for i in range(first, last):
        x, y, z, dx, dy, dz, area = _plate(rows, i, axes, twist, law, below, refined, careful, flatness)
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

    `source`: `compiled.SOURCE`, which in the closure is part of the cache's key.
    """
    flatness = BLENDED if refined else SWITCHED

    def of_states(rows, bounds, reach, law, surface_height, states, out):  # type: ignore[no-untyped-def]
        if source == 0:
            return
        for k in range(states.shape[0]):
            axes, twist, _ = motion(states[k], reach)
            below = surface_height - states[k, 2]
            linear = in_tool_axes(axes, twist[0], twist[1], twist[2])
            angular = in_tool_axes(axes, twist[3], twist[4], twist[5])
            fastest = length(linear) + length(angular) * reach
            up = axes[6:]
            fx = fy = fz = tx = ty = tz = submerged = 0.0
            # unsigned, or numba looks for negative indices in the inner loops
            b, blocks = np.uint64(0), np.uint64(bounds.shape[0])
            kind = kind_of_block(bounds, b, linear, angular, fastest, reach, up, below, refined)
            while b < blocks:
                first, run = b, kind
                while b < blocks and kind == run:
                    submerged += bounds[b, 18] if kind == SKIP_WET else 0.0
                    b += np.uint64(1)
                    if b < blocks:
                        kind = kind_of_block(bounds, b, linear, angular, fastest, reach, up, below, refined)
                if run >= PLAIN:
                    i, j = first * np.uint64(BLOCK), b * np.uint64(BLOCK)
                    if run == PLAIN:
                        part = _sum(rows, i, j, axes, twist, law, below, refined, False, NEVER_FLAT)
                    elif run == CUT:
                        part = _sum(rows, i, j, axes, twist, law, below, refined, True, NEVER_FLAT)
                    else:
                        part = _sum(rows, i, j, axes, twist, law, below, refined, True, flatness)
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
        axes, twist, _ = motion(state, reach)
        below = surface_height - state[2]
        for i in range(len(order)):
            _, _, _, dx, dy, dz, _ = _plate(rows, i, axes, twist, law, below, refined, True, flatness)
            out[order[i], 0], out[order[i], 1], out[order[i], 2] = dx, dy, dz

    for function in (of_states, of_plates):  # an index of the cache for each rule: two processes fill them at a time
        function.__qualname__ += "_refined" if refined else "_centroid"
    jit = numba.njit(cache=True, nogil=True, **OPTIONS)
    return jit(of_states), jit(of_plates)


KERNELS = {"centroid": _kernels(SOURCE, False), "refined": _kernels(SOURCE, True)}
"""For each rule of integration, the loop over states and the loop over the plates of one state."""

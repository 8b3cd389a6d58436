"""The compiled loops: the tractions of many plates, summed to a wrench, Eq. (9)."""

from math import cos, radians, sin
from typing import Any

import numba
import numpy as np

from rft_ros.rft.blocks import BLOCK, CUT, PLAIN, SKIP_WET, kind_of_block
from rft_ros.rft.compiled import OPTIONS, SOURCE, inlined
from rft_ros.rft.element import element, in_tool_axes, motion, seen_from_tool
from rft_ros.rft.traction import BLENDED, NEVER_FLAT, SWITCHED, traction_per_depth

__all__ = ["EDGE_AREAS", "KERNELS", "added", "with_area"]


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


@inlined
def with_area(total, area):  # type: ignore[no-untyped-def]
    """A wrench and submerged area, with more area."""
    return total[0], total[1], total[2], total[3], total[4], total[5], total[6] + area


@inlined
def added(a, b):  # type: ignore[no-untyped-def]
    """Two wrenches and submerged areas, in their order."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5], a[6] + b[6]


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
            seen = seen_from_tool(axes, twist, reach)
            total = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            # unsigned, or numba looks for negative indices in the inner loops
            b, blocks = np.uint64(0), np.uint64(bounds.shape[0])
            kind = kind_of_block(bounds, b, seen, below, refined)
            while b < blocks:
                first, run = b, kind
                while b < blocks and kind == run:
                    total = with_area(total, bounds[b, 18] if kind == SKIP_WET else 0.0)
                    b += np.uint64(1)
                    if b < blocks:
                        kind = kind_of_block(bounds, b, seen, below, refined)
                if run >= PLAIN:
                    i, j = first * np.uint64(BLOCK), b * np.uint64(BLOCK)
                    if run == PLAIN:
                        part = _sum(rows, i, j, axes, twist, law, below, refined, False, NEVER_FLAT)
                    elif run == CUT:
                        part = _sum(rows, i, j, axes, twist, law, below, refined, True, NEVER_FLAT)
                    else:
                        part = _sum(rows, i, j, axes, twist, law, below, refined, True, flatness)
                    total = added(total, part)
            for c in range(7):
                out[k, c] = total[c]

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


def _edge_areas(source: int) -> Any:
    def edge_areas(rows, reach, surface_height, state):  # type: ignore[no-untyped-def]
        """Wet area [m²] that is nearly horizontal and leads; that moves nearly along itself; all of it."""
        flat = edge = wet = 0.0
        if source == 0:
            return flat, edge, wet
        axes, twist, _ = motion(state, reach)
        below = surface_height - state[2]
        vx, vy, vz = in_tool_axes(axes, twist[0], twist[1], twist[2])
        wx, wy, wz = in_tool_axes(axes, twist[3], twist[4], twist[5])
        zx, zy, zz = axes[6:]
        for i in range(rows.shape[1]):
            a, b, c, nx, ny, nz = rows[0, i], rows[1, i], rows[2, i], rows[3, i], rows[4, i], rows[5, i]
            area = rows[6, i] if below - (zx * a + zy * b + zz * c) > 0.0 else 0.0
            ux, uy, uz = vx + wy * c - wz * b, vy + wz * a - wx * c, vz + wx * b - wy * a
            lead = ux * nx + uy * ny + uz * nz
            up = zx * nx + zy * ny + zz * nz
            horizontal = ux * ux + uy * uy + uz * uz - (zx * ux + zy * uy + zz * uz) ** 2
            wet += area
            # a jump of e2 needs a direction to jump to: none in vertical motion, and none of a plate that is just flat
            tilted = (abs(up) > _LEVEL) & (abs(up) < 1.0 - 1e-9) & (horizontal > 1e-6)
            flat += area if tilted & (lead > 0.0) else 0.0
            edge += area if lead * lead < _ALONG * (ux * ux + uy * uy + uz * uz) else 0.0
        return flat, edge, wet

    return numba.njit(cache=True, nogil=True, **OPTIONS)(edge_areas)


_LEVEL = cos(radians(5.0))
_ALONG = sin(radians(1.0)) ** 2

EDGE_AREAS = _edge_areas(SOURCE)
"""The loop behind `wrench.edge_shares`."""

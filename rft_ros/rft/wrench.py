"""The wrench on a tool of many plates: superposition of the plates' tractions (Treers et al. 2021, eq. 1).

Force ON the tool BY the grains; world axes, z up; torque about the tool frame's origin.
"""

import itertools
import os
import zlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from math import sqrt
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from rft_ros.rft.alpha_y import Table, as_table
from rft_ros.rft.frames import STATE, rotation
from rft_ros.rft.plates import Plates
from rft_ros.rft.traction import Law, traction_per_depth

__all__ = ["COLUMNS", "plate_forces", "wrenches"]

COLUMNS = ("fx", "fy", "fz", "tx", "ty", "tz", "submerged_area")
"""Columns of a result: force [N], torque about the tool frame's origin [N m], area below the surface [m²]."""

_WORTH_A_THREAD = 200_000  # plate evaluations, about a millisecond

# Reassociation lets the sums over plates use vector registers; the order is then fixed by the compiled code, the same
# for one state and for many. NaN and infinity keep their meaning.
_FASTMATH = {"reassoc", "contract", "arcp", "nsz"}


@numba.njit(inline="always")
def _motion(state, reach):  # type: ignore[no-untyped-def]
    """Rotation matrix (9 numbers, by rows) and twist (6 numbers) of a state, the twist scaled to order one.

    The law is rate-independent, so a common factor is free: it keeps squares of speeds from over- and underflow.
    """
    vx, vy, vz, wx, wy, wz = state[7], state[8], state[9], state[10], state[11], state[12]
    # The 1e-9 m bounds the scaled angular velocity of plates at the origin, which would be inf * 0.
    fastest = max(abs(vx), abs(vy), abs(vz), max(reach, 1e-9) * max(abs(wx), abs(wy), abs(wz)))
    s = 1.0 / fastest if fastest > 1e-290 else 0.0
    return rotation(state[3], state[4], state[5], state[6]), (vx * s, vy * s, vz * s, wx * s, wy * s, wz * s)


@numba.njit(inline="always")
def _plate(plates, i, axes, twist, law, below):  # type: ignore[no-untyped-def]
    """One plate: centroid from the tool frame's origin, force on it, area if it is submerged; world axes.

    `below`: depth of the tool frame's origin.
    """
    xx, xy, xz, yx, yy, yz, zx, zy, zz = axes
    vx, vy, vz, wx, wy, wz = twist
    a, b, c = plates[0, i], plates[1, i], plates[2, i]
    x, y, z = xx * a + xy * b + xz * c, yx * a + yy * b + yz * c, zx * a + zy * b + zz * c
    a, b, c = plates[3, i], plates[4, i], plates[5, i]
    nx, ny, nz = xx * a + xy * b + xz * c, yx * a + yy * b + yz * c, zx * a + zy * b + zz * c

    ux, uy, uz = vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x
    speed = sqrt(ux * ux + uy * uy + uz * uz)
    per_speed = 1.0 / speed if speed > 0.0 else 0.0
    ux, uy, uz = ux * per_speed, uy * per_speed, uz * per_speed

    depth = below - z
    area = plates[6, i] if depth > 0.0 else 0.0
    leading = ux * nx + uy * ny + uz * nz > 0.0
    weight = depth * area if leading else 0.0
    tx, ty, tz = traction_per_depth(law, nx, ny, nz, ux, uy, uz)
    return x, y, z, tx * weight, ty * weight, tz * weight, area


def _kernels(source: int) -> tuple[Any, Any]:
    """The compiled loops over states and over plates.

    numba's cache knows when this file changes, not when a law or a model in another one does: `source`, in the closure,
    is part of the cache's key and does.
    """

    @numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=_FASTMATH)
    def of_states(plates, reach, law, surface_height, states, out):  # type: ignore[no-untyped-def]
        if source == 0:
            return
        for k in range(states.shape[0]):
            axes, twist = _motion(states[k], reach)
            below = surface_height - states[k, 2]
            fx = fy = fz = tx = ty = tz = submerged = 0.0
            for i in range(plates.shape[1]):
                x, y, z, dx, dy, dz, area = _plate(plates, i, axes, twist, law, below)
                fx += dx
                fy += dy
                fz += dz
                tx += y * dz - z * dy
                ty += z * dx - x * dz
                tz += x * dy - y * dx
                submerged += area
            out[k, 0], out[k, 1], out[k, 2] = fx, fy, fz
            out[k, 3], out[k, 4], out[k, 5] = tx, ty, tz
            out[k, 6] = submerged

    @numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=_FASTMATH)
    def of_plates(plates, reach, law, surface_height, state, out):  # type: ignore[no-untyped-def]
        if source == 0:
            return
        axes, twist = _motion(state, reach)
        below = surface_height - state[2]
        for i in range(plates.shape[1]):
            _, _, _, dx, dy, dz, _ = _plate(plates, i, axes, twist, law, below)
            out[i, 0], out[i, 1], out[i, 2] = dx, dy, dz

    return of_states, of_plates


def _source() -> int:
    """A number over all source files of this package, never 0."""
    return 1 + zlib.crc32(b"".join(file.read_bytes() for file in sorted(Path(__file__).parent.glob("*.py"))))


_wrenches, _plate_forces = _kernels(_source())
_ENTRIES: dict[tuple[type, type], Callable[..., None]] = {}


def _entry(plates: Plates, law: Law) -> Callable[..., None]:
    """The machine code for a law and its α_y model, without numba's search by every argument's type (1.7 us a call).

    A model with arrays goes the long way: how they lie in memory is part of its type.
    """
    if isinstance(law.alpha_y, Table):
        return _wrenches
    key = type(law), type(law.alpha_y)
    entry = _ENTRIES.get(key)
    if entry is None:
        states = np.zeros((1, len(STATE)))
        arguments = plates.packed, plates.reach, law, 0.0, states, np.empty((1, len(COLUMNS)))
        signature = tuple(numba.typeof(a) for a in arguments)
        _wrenches.compile(signature)
        entry = _ENTRIES[key] = _wrenches.get_overload(signature)
    return entry


def plate_forces(
    plates: Plates, law: Law, state: NDArray[np.float64], *, surface_height: float = 0.0
) -> NDArray[np.float64]:
    """Force on each plate [N], shape [n, 3], world axes, at one state, shape [13]; their sum is the wrench's force."""
    law = law._replace(alpha_y=as_table(law.alpha_y))  # drawing is worth one compilation, not one for each model
    out = np.empty((len(plates), 3))
    _plate_forces(plates.packed, plates.reach, law, surface_height, state, out)
    return out


def wrenches(
    plates: Plates,
    law: Law,
    states: NDArray[np.float64],
    *,
    surface_height: float = 0.0,
    threads: int | None = None,
    out: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Wrench at each state, by the published rule: depth and velocity taken at each plate's centroid.

    `states`: shape [n, 13], columns `STATE`; finite, unit quaternions (`rft_ros.rft.frames.checked_states` checks).
    `surface_height`: world z of the undisturbed surface [m]. `threads`: default all cores when the work is worth it.
    Returns shape [n, 7], columns `COLUMNS`: force on the tool by the grains [N] and torque about the tool frame's
    origin [N m], world axes; submerged area [m²]. Each row is the same, to the last bit, whatever n and the threads.
    """
    n = len(states)
    # The kernel was compiled for arrays that lie in memory like this.
    if states.dtype != np.float64 or not (states.flags.c_contiguous and states.flags.writeable):
        states = np.array(states, dtype=np.float64, order="C")
    result = np.empty((n, len(COLUMNS))) if out is None else out
    if result.dtype != np.float64 or not (result.flags.c_contiguous and result.flags.writeable):
        result[:] = wrenches(plates, law, states, surface_height=surface_height, threads=threads)
        return result
    kernel = _entry(plates, law)
    workers = threads or (os.cpu_count() or 1)
    workers = min(workers, n, 1 + n * len(plates) // _WORTH_A_THREAD)
    if workers <= 1:
        kernel(plates.packed, plates.reach, law, surface_height, states, result)
        return result
    edges = np.linspace(0, n, workers + 1).astype(int)
    with ThreadPoolExecutor(workers) as pool:
        jobs = [
            pool.submit(kernel, plates.packed, plates.reach, law, surface_height, states[a:b], result[a:b])
            for a, b in itertools.pairwise(edges)
        ]
        for job in jobs:
            job.result()
    return result

"""The wrench on a tool of many plates: superposition of the plates' tractions, Eq. (9).

Force ON the tool BY the grains; world axes, z up; torque about the tool frame's origin.
"""

import itertools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft.alpha_y import Table, as_table
from rft_ros.rft.compiled import forgiving, machine_code
from rft_ros.rft.frames import STATE
from rft_ros.rft.kernel import EDGE_AREAS, KERNELS
from rft_ros.rft.plates import Plates
from rft_ros.rft.traction import Law

__all__ = ["COLUMNS", "edge_shares", "plate_forces", "wrenches"]

COLUMNS = ("fx", "fy", "fz", "tx", "ty", "tz", "submerged_area")
"""Columns of a result: force [N], torque about the tool frame's origin [N m], area below the surface [m²]."""

_WORTH_A_THREAD = 200_000  # plate evaluations, about a millisecond
_CORES = os.cpu_count() or 1

_LOOPS = {rule: (forgiving(of_states), forgiving(of_plates)) for rule, (of_states, of_plates) in KERNELS.items()}
_EDGE_AREAS = forgiving(EDGE_AREAS)
_ENTRIES: dict[tuple[str, type, type], Callable[..., None]] = {}


def _entry(plates: Plates, law: Law) -> Callable[..., None]:
    """Compile for a law and its α_y model, once; where the model has arrays, numba looks itself at each call."""
    kernel: Callable[..., None] = _LOOPS[plates.integration][0]
    if isinstance(law.alpha_y, Table):
        return kernel
    states, out = np.zeros((1, len(STATE))), np.empty((1, len(COLUMNS)))
    blocks = plates.blocks
    entry = machine_code(kernel, (blocks.rows, blocks.bounds, plates.reach, law, 0.0, states, out))
    _ENTRIES[plates.integration, type(law), type(law.alpha_y)] = entry
    return entry


def plate_forces(
    plates: Plates, law: Law, state: NDArray[np.float64], *, surface_height: float = 0.0
) -> NDArray[np.float64]:
    """Force on each plate by the grains [N], shape [n, 3], world axes, in the plates' order: the terms of Eq. (9).

    `state`: shape [13], columns `STATE`, as for `wrenches`. `surface_height`: world z of the surface [m].
    """
    law = law._replace(alpha_y=as_table(law.alpha_y))  # drawing is worth one compilation, not one for each model
    out = np.empty((len(plates), 3))
    _, kernel = _LOOPS[plates.integration]
    kernel(plates.blocks.rows, plates.reach, law, surface_height, state, plates.blocks.order, out)
    return out


def edge_shares(plates: Plates, state: NDArray[np.float64], *, surface_height: float = 0.0) -> tuple[float, float]:
    """Shares of the wet area where the published rule jumps: within 5° of horizontal, within 1° of its own motion.

    `state`: shape [13], columns `STATE`; `surface_height` [m]. Each lies in 0 to 1, no unit; both 0 in the air.
    """
    flat, edge, wet = _EDGE_AREAS(plates.blocks.rows, plates.reach, surface_height, state)
    return (flat / wet, edge / wet) if wet > 0.0 else (0.0, 0.0)


def wrenches(
    plates: Plates,
    law: Law,
    states: NDArray[np.float64],
    *,
    surface_height: float = 0.0,
    threads: int | None = None,
    out: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Wrench at each state, Eq. (9), by the rule that `plates.integration` names.

    `states`: shape [n, 13], columns `STATE`; finite, unit quaternions (`rft_ros.rft.frames.checked_states` checks).
    `surface_height`: world z of the undisturbed surface [m]. `threads`: default all cores when the work is worth it.
    `out`: where to write the result, instead of a new array.
    Returns shape [n, 7], columns `COLUMNS`: force on the tool by the grains [N] and torque about the tool frame's
    origin [N m], world axes; submerged area [m²]. Each row is the same, to the last bit, whatever n and the threads.
    """
    # The kernel was compiled for arrays that lie in memory like this.
    if not (states.flags.carray and states.dtype.char == "d"):
        states = np.array(states, dtype=np.float64, order="C")
    if out is None:
        out = np.empty((len(states), len(COLUMNS)))
    elif not (out.flags.carray and out.dtype.char == "d"):
        out[:] = wrenches(plates, law, states, surface_height=surface_height, threads=threads)
        return out
    kernel = _ENTRIES.get((plates.integration, law.__class__, law.alpha_y.__class__)) or _entry(plates, law)
    blocks, reach = plates.blocks, plates.reach
    rows, bounds = blocks.rows, blocks.bounds
    n = len(states)
    workers = 1 if threads == 1 else min(threads or _CORES, n, 1 + n * len(plates) // _WORTH_A_THREAD)
    if workers <= 1:
        kernel(rows, bounds, reach, law, surface_height, states, out)
        return out
    edges = np.linspace(0, n, workers + 1).astype(int)
    with ThreadPoolExecutor(workers) as pool:
        jobs = [
            pool.submit(kernel, rows, bounds, reach, law, surface_height, states[a:b], out[a:b])
            for a, b in itertools.pairwise(edges)
        ]
        for job in jobs:
            job.result()
    return out

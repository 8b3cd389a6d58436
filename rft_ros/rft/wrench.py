"""The wrench on a tool of many plates: superposition of the plates' tractions, Eq. (9), with or without memory.

Force ON the tool BY the grains; world axes, z up; torque about the tool frame's origin.
"""

import itertools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rft_ros.rft.arguments import FLOAT, number, numbers
from rft_ros.rft.compilation import machine_code
from rft_ros.rft.frames import STATE
from rft_ros.rft.kernel import EDGE_AREAS, PLATE_FORCES, SUMS
from rft_ros.rft.memory import Memory
from rft_ros.rft.plates import Plates
from rft_ros.rft.traction import Law, Treers2021, checked_law

__all__ = ["COLUMNS", "LEVEL", "SENSITIVITIES", "edge_share", "plate_forces", "wrenches", "wrenches_in_time"]

Array = NDArray[np.float64]

COLUMNS = ("fx", "fy", "fz", "tx", "ty", "tz", "submerged_area")
"""Columns of a result: force [N], torque about the tool frame's origin [N m], area below the surface [m²]."""

SENSITIVITIES = ("dfx_dh", "dfy_dh", "dfz_dh", *(f"{r}_f{f}" for r in "xyz" for f in "xyz"))
"""Further columns: derivative of the force by the surface height [N/m], the sum of traction per depth times wet area;
and the sums over plates of r_j f_l [N m], r from the tool frame's origin, which make up the torque."""

_WORTH_A_THREAD = 200_000  # plate evaluations, about a millisecond
_CORES = os.cpu_count() or 1

_STATE_ROW = (len(STATE),)
_WIDTH = len(COLUMNS) + len(SENSITIVITIES)

_Code = tuple[Callable[..., None], Law]
# By a law's id: the law, which keeps the id from being reused, and by rule and loop the compiled code with the checked
# law that it takes.
_CODE: dict[int, tuple[Law, dict[tuple[object, ...], _Code]]] = {}
_LAWS_KEPT = 32
_ENTRIES: dict[tuple[object, ...], Callable[..., None]] = {}
"""The compiled loops by rule, loop and law: looking one up through numba takes 0.4 ms."""

LEVEL = 0.0, 0.0
"""The slope of a level surface."""


def wrenches(
    plates: Plates,
    law: Law,
    states: ArrayLike,
    *,
    surface_height: float = 0.0,
    slope: tuple[float, float] = LEVEL,
    threads: int | None = None,
    sensitivities: bool = False,
    out: Array | None = None,
) -> Array:
    """Wrench at each state, Eq. (9), by the integration rule of `plates`.

    `states`: shape [n, 13], columns `STATE`; finite, unit quaternions (see `checked_states`). `surface_height`: world z
    of the undisturbed surface [m], at x = y = 0 if it is inclined; `slope`: its dz/dx and dz/dy, depth stays vertical.
    `threads`: default one, or all cores for large inputs. `out`: array for the result, shape [n, 19], float64,
    C-contiguous.
    Returns shape [n, 7], columns `COLUMNS`: force on the tool by the grains [N] and torque about the tool frame's
    origin [N m], world axes; submerged area [m²]. With `sensitivities`: shape [n, 19], columns `SENSITIVITIES` added.
    A row does not depend on the other rows or on `threads`, to the last bit. Raises ValueError or TypeError that names
    the argument that cannot be used.
    """
    entry, law = _code(plates, law, None)
    incline = _incline(slope)
    blocks, reach, height = plates.blocks, plates.reach, number("surface_height", surface_height)
    states = numbers("states", states, _STATE_ROW)
    n = len(states)
    result = _result(out, n)
    workers = 1 if threads == 1 else _workers(threads, n, len(plates))
    if workers <= 1:
        entry(blocks.rows, blocks.bounds, reach, law, height, incline, states, None, result)
    else:
        tool = blocks.rows, blocks.bounds, reach, law, height, incline
        edges = np.linspace(0, n, workers + 1).astype(int)
        with ThreadPoolExecutor(workers) as pool:
            for job in [
                pool.submit(entry, *tool, states[a:b], None, result[a:b]) for a, b in itertools.pairwise(edges)
            ]:
                job.result()
    return result if sensitivities else result[:, : len(COLUMNS)]


def wrenches_in_time(
    plates: Plates,
    law: Law,
    states: ArrayLike,
    durations: ArrayLike,
    memory: Memory,
    *,
    mobilization_length: float,
    surface_height: float = 0.0,
    slope: tuple[float, float] = LEVEL,
    sensitivities: bool = False,
    out: Array | None = None,
) -> Array:
    """`wrenches` of plates with memory, Eq. (10), at successive states, shape [n, 13].

    `durations`: shape [n], time since the previous state [s]; 0 for the very first. `memory`: of these plates, updated
    in place; of many bodies, row i is of body i. `mobilization_length`: λ at the depth `rft_ros.rft.memory.DEPTH` [m],
    positive.
    """
    if memory.__class__ is not Memory:
        raise TypeError(f"memory is {memory!r}; create one with Memory(plates)")
    entry, law = _code(plates, law, memory)
    incline = _incline(slope)
    if memory.plates is not plates and not np.array_equal(memory.plates.blocks.rows, plates.blocks.rows):
        raise ValueError("memory belongs to other plates; create one with Memory(plates)")
    blocks, height = plates.blocks, number("surface_height", surface_height)
    states = numbers("states", states, _STATE_ROW)
    n = len(states)
    durations = numbers("durations", durations, rows=n)
    if not (durations[0] if n == 1 else durations.min(initial=0.0)) >= 0.0:
        raise ValueError("durations has a value that is negative or NaN; states must be in chronological order")
    length = number("mobilization_length", mobilization_length, positive=True)
    if memory.bodies not in (1, n):
        raise ValueError(f"memory is of {memory.bodies} bodies; states has {n} rows")
    past = durations, length, memory.tractions, memory.active, memory.motion, memory.stiffness
    result = _result(out, n)
    entry(blocks.rows, blocks.bounds, plates.reach, law, height, incline, states, past, result)
    return result if sensitivities else result[:, : len(COLUMNS)]


def plate_forces(
    plates: Plates,
    law: Law,
    state: ArrayLike,
    *,
    surface_height: float = 0.0,
    slope: tuple[float, float] = LEVEL,
) -> Array:
    """Force on each plate by the grains [N], shape [n, 3], world axes, in the plates' order: the terms of Eq. (9).

    `state`: shape [13], columns `STATE`, as for `wrenches`. `surface_height` [m], `slope`: as there.
    """
    entry, law = _code(plates, law, "forces")
    blocks, incline, out = plates.blocks, _incline(slope), np.empty((len(plates), 3))
    height, one = number("surface_height", surface_height), numbers("state", state, rows=13)
    entry(blocks.rows, plates.reach, law, height, incline, one, blocks.order, out)
    return out


def edge_share(plates: Plates, state: ArrayLike, *, surface_height: float = 0.0) -> float:
    """Share of the wet area that moves within 1° of its own plane, where a degree decides how much of it leads.

    `state`: shape [13], columns `STATE`; `surface_height` [m]. In 0 to 1, no unit; 0 in the air.
    """
    _check_plates(plates)
    height, one = number("surface_height", surface_height), numbers("state", state, rows=13)
    edge, wet = EDGE_AREAS(plates.blocks.rows, plates.reach, height, one)
    return edge / wet if wet > 0.0 else 0.0


def _code(plates: Plates, law: Law, loop: Memory | Literal["forces"] | None) -> _Code:
    """The compiled loop and the law to pass to it; compiles when a law's type is first seen.

    `loop`: "forces" on each plate, else sums over plates, with a memory or without.
    """
    key = plates.integration if plates.__class__ is Plates else "", loop.__class__
    found = _CODE.get(id(law))
    if found is not None and key in found[1]:
        return found[1][key]
    _check_plates(plates)
    good = checked_law(law)
    model = *key, good.__class__, good.alpha_y.__class__ if isinstance(good, Treers2021) else None
    if model not in _ENTRIES:
        _ENTRIES[model] = _compiled(plates, good, loop)
    if found is None:
        if len(_CODE) >= _LAWS_KEPT:
            _CODE.clear()
        found = _CODE[id(law)] = law, {}
    code = found[1][key] = _ENTRIES[model], good
    return code


def _compiled(plates: Plates, law: Law, loop: Memory | Literal["forces"] | None) -> Callable[..., None]:
    blocks, state, out = plates.blocks, np.zeros((1, 13)), np.zeros((1, _WIDTH))
    if loop == "forces":
        one = plates.reach, law, 0.0, LEVEL, state[0], blocks.order, out
        return machine_code(PLATE_FORCES[plates.integration], (blocks.rows, *one))
    past = loop and (np.zeros(1), 1.0, *loop.arrays.values())
    scene = blocks.rows, blocks.bounds, plates.reach, law, 0.0, LEVEL
    return machine_code(SUMS[plates.integration], (*scene, state, past, out))


def _incline(slope: tuple[float, float]) -> tuple[float, float]:
    """The slope as two floats."""
    if slope is LEVEL:
        return slope
    try:
        x, y = slope
    except (TypeError, ValueError):
        raise ValueError(f"slope is {slope!r}; it must be two numbers, dz/dx and dz/dy") from None
    return number("slope[0]", x), number("slope[1]", y)


def _check_plates(plates: Plates) -> None:
    if plates.__class__ is not Plates:
        raise TypeError(f"plates is {plates!r}; make them with Plates.from_arrays or Plates.from_triangles")


def _workers(threads: int | None, states: int, plates: int) -> int:
    """The number of threads for this many states and plates."""
    if threads is not None and number("threads", threads) < 1:
        raise ValueError(f"threads is {threads}; it must be at least 1")
    return min(int(threads or _CORES), states, 1 + states * plates // _WORTH_A_THREAD)


def _result(out: Array | None, n: int) -> Array:
    """The array for the result: `out`, checked, or a new one."""
    shape = n, _WIDTH
    if out is None:
        return np.empty(shape)
    if out.__class__ is np.ndarray and out.dtype is FLOAT and out.flags.carray and out.shape == shape:
        return out
    what = f"{out.dtype} of shape {list(out.shape)}" if isinstance(out, np.ndarray) else repr(out)
    raise ValueError(f"out is {what}; it must be a writable, C-contiguous array of float64, shape {list(shape)}")

"""The wrench on a tool of many plates: superposition of the plates' tractions, Eq. (9), with or without memory.

Force ON the tool BY the grains; world axes, z up; torque about the tool frame's origin.
"""

import itertools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rft_ros.rft.agarwal2023 import Agarwal2023
from rft_ros.rft.arguments import FLOAT, number, numbers
from rft_ros.rft.compilation import machine_code
from rft_ros.rft.frames import STATE
from rft_ros.rft.kernel import EDGE_AREAS, SUMS
from rft_ros.rft.memory import TRACTIONS, Memory, remember
from rft_ros.rft.plates import BLOCK, Plates
from rft_ros.rft.traction import Law, Treers2021, not_a_law, tractions

__all__ = ["COLUMNS", "LEVEL", "SENSITIVITIES", "compile_memory", "compile_tractions", "edge_share", "plate_forces"]
__all__ += ["prepared", "wrenches", "wrenches_in_time"]

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
    height, slope = _checked(plates, law, surface_height, slope)
    states = numbers("states", states, _STATE_ROW)
    n = len(states)
    result = _result(out, n, sensitivities)
    workers = 1 if threads == 1 else _workers(threads, n, len(plates))
    if workers <= 1:
        _loop()(plates.form, law.packed, height, slope, states, _NO_MEMORY, result)
    else:
        scene, edges = (plates.form, law.packed, height, slope), np.linspace(0, n, workers + 1).astype(int)
        with ThreadPoolExecutor(workers) as pool:
            for job in [
                pool.submit(_loop(), *scene, states[a:b], _NO_MEMORY, result[a:b]) for a, b in itertools.pairwise(edges)
            ]:
                job.result()
    return result if sensitivities or out is None else result[:, : len(COLUMNS)]


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
    height, slope = _checked(plates, law, surface_height, slope)
    if memory.plates is not plates and not np.array_equal(memory.plates.rows, plates.rows):
        raise ValueError("memory belongs to other plates; create one with Memory(plates)")
    states = numbers("states", states, _STATE_ROW)
    n = len(states)
    durations = numbers("durations", durations, rows=n)
    if not (durations[0] if n == 1 else durations.min(initial=0.0)) >= 0.0:
        raise ValueError("durations has a value that is negative or NaN; states must be in chronological order")
    length = number("mobilization_length", mobilization_length, positive=True)
    if memory.bodies not in (1, n):
        raise ValueError(f"memory is of {memory.bodies} bodies; states has {n} rows")
    past = True, durations, length, memory.numbers
    result = _result(out, n, sensitivities)
    _loop()(plates.form, law.packed, height, slope, states, past, result)
    return result if sensitivities or out is None else result[:, : len(COLUMNS)]


def prepared(
    plates: Plates, law: Law, memory: Memory | None = None, length: float = 1.0, *, bodies: slice = slice(None)
) -> Callable[..., None]:
    """`wrenches`, or with a memory `wrenches_in_time`, for steps that must be short: a call checks nothing.

    That saves 4 us. `length`: the mobilization length [m]. `bodies`: those of the memory whose states will be given.
    Call it with states, durations, surface height [m], slope and out: of the types and shapes that `wrenches_in_time`
    names, C-contiguous. Raises TypeError for what is no plates or no law, ValueError for a length that is not positive.
    """
    _checked(plates, law, 0.0, LEVEL)
    loop, form, packed, length = _loop(), plates.form, law.packed, number("mobilization_length", length, positive=True)
    remembers, kept = (False, _NO_MEMORY[3]) if memory is None else (True, memory.numbers[bodies])

    def step(states: Array, durations: Array, height: float, slope: tuple[float, float], out: Array) -> None:
        loop(form, packed, height, slope, states, (remembers, durations, length, kept), out)

    return step


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
    height, slope = _checked(plates, law, surface_height, slope)
    states = numbers("state", state, rows=13).reshape(1, 13)
    forces, ordered = np.zeros((plates.bounds.shape[1] * BLOCK, 3)), np.empty((len(plates), 3))
    _loop()(plates.form, law.packed, height, slope, states, _NO_MEMORY, forces)
    ordered[plates.order] = forces[: len(plates)]
    return ordered


def edge_share(plates: Plates, state: ArrayLike, *, surface_height: float = 0.0) -> float:
    """Share of the wet area that moves within 1° of its own plane, where a degree decides how much of it leads.

    `state`: shape [13], columns `STATE`; `surface_height` [m]. In 0 to 1, no unit; 0 in the air.
    """
    if plates.__class__ is not Plates:
        raise _not_plates(plates)
    height, one = number("surface_height", surface_height), numbers("state", state, rows=13)
    edge, wet = EDGE_AREAS(plates.packed, plates.reach, height, one)
    return edge / wet if wet > 0.0 else 0.0


_LAWS = Treers2021, Agarwal2023


def _checked(
    plates: Plates, law: Law, surface_height: float, slope: tuple[float, float]
) -> tuple[float, tuple[float, float]]:
    """The surface's height and slope as floats."""
    if plates.__class__ is not Plates:
        raise _not_plates(plates)
    if law.__class__ not in _LAWS:
        raise not_a_law(law)
    return number("surface_height", surface_height), slope if slope is LEVEL else _incline(slope)


_NO_MEMORY = False, np.zeros(1), 1.0, np.zeros((1, TRACTIONS))


@cache
def _loop() -> Callable[..., None]:
    """The compiled loop, from the cache on disk if it is there."""
    plates = Plates.from_arrays([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]], [1.0])
    law = Agarwal2023(1.0, 0.0).packed
    return machine_code(SUMS, (plates.form, law, 0.0, LEVEL, np.zeros((1, 13)), _NO_MEMORY, np.zeros((1, _WIDTH))))


def compile_tractions() -> None:
    """Compile the law's part of the loop, which takes a quarter of its time, in another process than the loop."""
    machine_code(tractions, (Agarwal2023(1.0, 0.0).packed, np.zeros(1), np.uint64(0), 0))


def compile_memory() -> None:
    """Compile the memory's part before the loop, so that `compile_tractions` beside ends before the loop needs it."""
    chunk, place, still = np.zeros(1), np.uint64(0), ((0.0,) * 3, (0.0,) * 9)
    machine_code(remember, (chunk, place, chunk, place, still, 0.0, LEVEL, 1.0))


def _incline(slope: tuple[float, float]) -> tuple[float, float]:
    """The slope as two floats."""
    try:
        x, y = slope
    except (TypeError, ValueError):
        raise ValueError(f"slope is {slope!r}; it must be two numbers, dz/dx and dz/dy") from None
    return number("slope[0]", x), number("slope[1]", y)


def _not_plates(plates: object) -> TypeError:
    return TypeError(f"plates is {plates!r}; make them with Plates.from_arrays or Plates.from_triangles")


def _workers(threads: int | None, states: int, plates: int) -> int:
    """The number of threads for this many states and plates."""
    if threads is not None and number("threads", threads) < 1:
        raise ValueError(f"threads is {threads}; it must be at least 1")
    return min(int(threads or _CORES), states, 1 + states * plates // _WORTH_A_THREAD)


def _result(out: Array | None, n: int, sensitivities: bool) -> Array:
    """The array for the result: `out`, checked, or a new one."""
    if out is None:
        return np.empty((n, _WIDTH if sensitivities else len(COLUMNS)))
    shape = n, _WIDTH
    if out.__class__ is np.ndarray and out.dtype is FLOAT and out.flags.carray and out.shape == shape:
        return out
    what = f"{out.dtype} of shape {list(out.shape)}" if isinstance(out, np.ndarray) else repr(out)
    raise ValueError(f"out is {what}; it must be a writable, C-contiguous array of float64, shape {list(shape)}")

"""The wrench on a tool of many plates: superposition of the plates' tractions, Eq. (9), with or without memory.

Force ON the tool BY the grains; world axes, z up; torque about the tool frame's origin.
"""

import os
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rft_ros.rft.agarwal2023 import Agarwal2023
from rft_ros.rft.arguments import MOST, finite_numbers, number, numbers, whole_number
from rft_ros.rft.displacement import DISPLACEMENT_COUNT, NO_DISPLACEMENT, displacements_between
from rft_ros.rft.frames import COLUMNS, STATE, WIDTH
from rft_ros.rft.grains import PackedLaw
from rft_ros.rft.kernel import loops
from rft_ros.rft.kernel.compilation import machine_code
from rft_ros.rft.memory import NO_MEMORY, Memory, Past, add_memory
from rft_ros.rft.plates import BLOCK, Plates
from rft_ros.rft.stiffness import NO_STIFFNESS
from rft_ros.rft.traction import Law, packed_law, tractions

Array = NDArray[np.float64]

LEVEL = 0.0, 0.0
"""The slope of a level surface."""

_MIN_THREAD_PLATE_COUNT = 200_000  # plate evaluations, about a millisecond
_CORES = os.cpu_count() or 1
_ROW = (len(STATE),)


def wrenches(
    plates: Plates,
    law: Law,
    states: ArrayLike,
    *,
    surface_height: float = 0.0,
    slope: tuple[float, float] = LEVEL,
    threads: int | None = None,
    sensitivities: bool = False,
) -> Array:
    """Wrench at each state, Eq. (9), by the integration rule of `plates`.

    `states`: shape [n, 13], columns `STATE`; finite, unit quaternions (see `checked_states`). `surface_height`: world z
    of the undisturbed surface [m], at x = y = 0 if it is inclined; `slope`: its dz/dx and dz/dy, depth stays vertical.
    `threads`: default one, or all cores for large inputs.
    Returns shape [n, 7], columns `COLUMNS`: force on the tool by the grains [N] and torque about the tool frame's
    origin [N m], world axes; submerged area [m²]. With `sensitivities`: shape [n, 19], columns `SENSITIVITIES` added.
    A row does not depend on the other rows or on `threads`, to the last bit. Raises ValueError or TypeError that names
    the argument that cannot be used.
    """
    loop = _loop()
    arguments = _model_arguments(plates, law, surface_height, slope)
    states = numbers("states", states, _ROW)
    n = len(states)
    result = _result(states, sensitivities)
    workers = _workers(threads, n, len(plates))
    if workers <= 1:
        loop(*arguments, states, NO_MEMORY, result)
        return result
    edges = np.linspace(0, n, workers + 1).astype(int)
    with ThreadPoolExecutor(workers) as pool:
        parts = [
            pool.submit(loop, *arguments, states[a:b], NO_MEMORY, result[a:b])
            for a, b in pairwise(edges)
        ]
    for part in parts:
        part.result()
    return result


def wrenches_in_time(
    plates: Plates,
    law: Law,
    states: ArrayLike,
    memory: Memory | ArrayLike,
    after_durations: Memory | None = None,
    *,
    displacements: ArrayLike | None = None,
    surface_height: float = 0.0,
    slope: tuple[float, float] = LEVEL,
    sensitivities: bool = False,
) -> Array:
    """`wrenches` of plates with memory, Eq. (10), at successive states, shape [n, 13].

    `law`: with its `mobilization_length`, λ at the depth `rft_ros.rft.memory.REFERENCE_DEPTH_M`, positive. `memory`: of
    these plates, updated in place. `displacements`: of the tool to each state, shape [n, 12]
    (`rft_ros.rft.displacement`), whatever time they took; by default those between the poses of the states.
    Raises ValueError also for values that are not finite; the memory is then as it was.
    `after_durations`: the memory, in calls written for the preview, which give durations in its place; they change
    nothing.
    """
    if after_durations is not None:
        warnings.warn(
            "wrenches_in_time takes no durations any more", DeprecationWarning, stacklevel=2
        )
        memory = after_durations
    arguments = _model_arguments(plates, law, surface_height, slope)
    checked_memory = _checked_memory(memory, plates)
    _require_memory(law)
    states = finite_numbers("states", states, _ROW)
    if displacements is None:
        checked_displacements = displacements_between(
            np.vstack([checked_memory.last, states[:-1]]), states
        )
    else:
        checked_displacements = finite_numbers(
            "displacements", displacements, (DISPLACEMENT_COUNT,), rows=len(states)
        )
    result = _result(states, sensitivities)
    _loop()(
        *arguments,
        states,
        Past(
            has_memory=True,
            blocks=checked_memory.blocks,
            stiffness=NO_STIFFNESS,
            displacements=checked_displacements,
        ),
        result,
    )
    if len(states):
        checked_memory.last[:] = states[-1]
    return result


def prepared(plates: Plates, memory: Memory | None = None) -> Callable[..., None]:
    """`wrenches`, or with a memory `wrenches_in_time`, for steps that must be short: a call checks nothing.

    Call it with the law's `packed_law`, states, surface height [m], slope, the displacements to the states and the
    array for the result, shape [n, 7] or [n, 19]. With a memory, the law must have a mobilization length; without one
    the displacements do not matter. `Memory.last` stays as it is. The arguments have the types and shapes that
    `wrenches_in_time` names, and all arrays are C-contiguous. Raises ValueError or TypeError that names the argument
    that cannot be used.
    """
    loop = _loop()
    packed_plates = _checked(plates).packed
    checked_memory = None if memory is None else _checked_memory(memory, plates)

    def step(
        law: PackedLaw,
        states: Array,
        height: float,
        slope: tuple[float, float],
        displacements: Array,
        result: Array,
    ) -> None:
        past = (
            NO_MEMORY
            if checked_memory is None
            else Past(
                has_memory=True,
                blocks=checked_memory.blocks,
                stiffness=NO_STIFFNESS,
                displacements=displacements,
            )
        )
        loop(packed_plates, law, height, slope, states, past, result)

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
    arguments = _model_arguments(plates, law, surface_height, slope)
    states = numbers("state", state, rows=13).reshape(1, 13)
    forces = np.zeros((plates.bounds.shape[1] * BLOCK, 3))
    ordered_forces = np.empty((len(plates), 3))
    _loop()(*arguments, states, NO_MEMORY, forces)
    ordered_forces[plates.order] = forces[: len(plates)]
    return ordered_forces


def _checked(plates: Plates) -> Plates:
    if not isinstance(plates, Plates):
        raise TypeError(
            f"plates is {plates!r}; make them with Plates.from_arrays or Plates.from_triangles"
        )
    return plates


def _model_arguments(
    plates: Plates, law: Law, height: float, slope: tuple[float, float]
) -> tuple[Any, ...]:
    """The checked arguments of the loop: plates, law, surface height and slope."""
    if slope is not LEVEL:
        x, y = (number("slope", part) for part in numbers("slope", slope, rows=2).tolist())
        slope = x, y
    return _checked(plates).packed, packed_law(law), number("surface_height", height), slope


def _require_memory(law: Law) -> None:
    """Refuse a law without a mobilization length, whose memory is to be evaluated."""
    number("mobilization_length of the law", law.mobilization_length, positive=True)


def _checked_memory(memory: object, plates: Plates) -> Memory:
    """A memory of these plates."""
    if not isinstance(memory, Memory):
        raise TypeError(f"memory is {memory!r}; create one with Memory(plates)")
    if memory.plates is not plates and not np.array_equal(memory.plates.rows, plates.rows):
        raise ValueError("memory belongs to other plates; create one with Memory(plates)")
    return memory


def _workers(threads: int | None, states: int, plates: int) -> int:
    most = _CORES if threads is None else whole_number("threads", threads, most=MOST)
    return min(most, states, 1 + states * plates // _MIN_THREAD_PLATE_COUNT)


def _result(states: Array, sensitivities: bool) -> Array:
    return np.empty((len(states), WIDTH if sensitivities else len(COLUMNS)))


@cache
def _loop() -> Callable[..., None]:
    """The compiled loop, from the cache on disk if it is there."""
    plate = Plates.from_arrays([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]], [1.0])
    arguments = _model_arguments(plate, Agarwal2023(), 0.0, LEVEL)
    return machine_code(
        loops.sums, (*arguments, np.zeros((1, len(STATE))), NO_MEMORY, np.zeros((1, len(COLUMNS))))
    )


def compile_tractions() -> None:
    """Compile the law's part of the loop, which the loop loads when it is compiled later."""
    machine_code(tractions, (packed_law(Agarwal2023()), np.zeros(1), np.uint64(0), False, False))


def compile_memory() -> None:
    """Compile the memory's part of the loop, which the loop loads when it is compiled later."""
    law = packed_law(Agarwal2023()).numbers[0]
    blocks = NO_MEMORY.blocks
    number = np.uint64(0)  # only the types of these values count
    machine_code(
        add_memory,
        (np.zeros(1), number, number, blocks, NO_DISPLACEMENT, 0.0, LEVEL, law),
    )

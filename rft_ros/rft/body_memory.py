"""The memory of many bodies in compiled code, for a simulator: evaluate a body at a state, its stiffness, a copy.

`wrenches_in_time` is the same for one tool in Python. A trial step is evaluated with a copy, so that the memory stays.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft.displacement import DISPLACEMENT_COUNT, between
from rft_ros.rft.frames import STATE
from rft_ros.rft.kernel.compilation import inlined
from rft_ros.rft.kernel.loops import sums
from rft_ros.rft.memory import BLOCK_STATE, Past
from rft_ros.rft.stiffness import STIFFNESS

Array = NDArray[np.float64]


class Surface(NamedTuple):
    """The plane of the grains' surface: its height at x = y = 0 [m], and its dz/dx and dz/dy."""

    height: float
    slope: tuple[float, float]


class BodyMemories(NamedTuple):
    """The memories of n bodies. `blocks`: shape [n, most blocks of a body]. `stiffness`: its sums at the last state.

    `last`: the last states, shape [n, 13], columns `rft_ros.rft.STATE`; zeros before the first.
    """

    blocks: NDArray[np.void]
    stiffness: NDArray[np.void]
    last: Array


class BodyMemory(NamedTuple):
    """The memory of one body: its `blocks`, shape [blocks]; `stiffness`, shape [1]; and `last` state, shape [13]."""

    blocks: NDArray[np.void]
    stiffness: NDArray[np.void]
    last: Array


def empty_memories(bodies: int, *, most_blocks: int) -> BodyMemories:
    """The memories of bodies that were not in grains yet."""
    return BodyMemories(
        blocks=np.zeros((bodies, most_blocks), BLOCK_STATE),
        stiffness=np.zeros(bodies, STIFFNESS),
        last=np.zeros((bodies, len(STATE))),
    )


@inlined
def memory_of(memories, body):
    """The memory of one body, whose changes are those of `memories`."""
    return BodyMemory(
        blocks=memories.blocks[body],
        stiffness=memories.stiffness[body : body + 1],
        last=memories.last[body],
    )


@inlined
def copy(memory):
    """A memory that changes without the given one."""
    return BodyMemory(
        blocks=memory.blocks.copy(),
        stiffness=memory.stiffness.copy(),
        last=memory.last.copy(),
    )


@inlined
def evaluate(plates, law, surface, memory, state, out):
    """Move a body and its memory to a state, shape [13], and write its wrench there, `out` of shape [1, 6].

    `plates`: its `PackedPlates`. `law`: a `PackedLaw`. `surface`: a `Surface`. `out` of shape [plates, 3] takes the
    forces of the plates instead, added to those in it, in the kernel's order.
    """
    displacements = np.empty((1, DISPLACEMENT_COUNT))
    between(memory.last, state, displacements[0])
    past = Past(True, memory.blocks, memory.stiffness, displacements)
    sums(plates, law, surface.height, surface.slope, state.reshape(1, len(STATE)), past, out)
    # an assignment to a slice would compile numba's strings, for its error: 2 s each time
    for k in range(len(STATE)):
        memory.last[k] = state[k]


@inlined
def stiffness(memory, matrix):
    """Write the stiffness B at the last state, shape [6, 6] [N/m, N, N m]. A displacement d adds -B d to the wrench."""
    s = memory.stiffness[0]
    rows = (
        (s.k, 0.0, 0.0, 0.0, s.z, -s.y),
        (0.0, s.k, 0.0, -s.z, 0.0, s.x),
        (0.0, 0.0, s.k, s.y, -s.x, 0.0),
        (0.0, -s.z, s.y, s.yy + s.zz, -s.xy, -s.xz),
        (s.z, 0.0, -s.x, -s.xy, s.xx + s.zz, -s.yz),
        (-s.y, s.x, 0.0, -s.xz, -s.yz, s.xx + s.yy),
    )
    for i in range(6):
        for j in range(6):
            matrix[i, j] = rows[i][j]

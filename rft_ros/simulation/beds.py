"""The grains around many bodies, in flat arrays, so that one compiled step evaluates tools of any numbers of plates."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import Law, Plates, body_memory
from rft_ros.rft.arguments import number
from rft_ros.rft.body_memory import BodyMemories, Surface, empty_memories, memory_of
from rft_ros.rft.grains import PackedLaw
from rft_ros.rft.kernel.compilation import compiled, inlined
from rft_ros.rft.plates import BOUNDS, PackedPlates
from rft_ros.rft.traction import packed_law

Array = NDArray[np.float64]

SHAPE = np.dtype(
    [
        ("rows", int),  # where its part of `Beds.rows` begins
        ("rows_end", int),
        ("bounds", int),  # where its part of `Beds.bounds` begins
        ("blocks", int),  # of its plates
        ("is_refined", int),
        ("reach", float),  # of its plates [m]
    ]
)
"""Where the plates of a body are, which never changes."""

MOTION = np.dtype(
    [
        ("height", float),  # of its surface at x = y = 0 [m]
        ("slope_x", float),
        ("slope_y", float),
        ("explicit", float, 6),  # wrench of the grains at the last state
        ("wrench", float, 6),  # held over the step that begins there
        ("duration", float),  # of this step [s]
        ("is_near", int),  # whether it may reach the surface in this step
        ("energy", float),  # that the grains have taken [J]
    ]
)
"""The surface below a body, and the step that begins at its last state."""


class Beds(NamedTuple):
    """What the compiled step takes of the grains around n bodies.

    `shapes`, `motions`: records of `SHAPE` and `MOTION`, shape [n]. `rows`, `bounds`: of `Plates`, one tool after the
    other. `laws`, `table`: the laws' `PackedLaw`; record i of `laws` is of body i. `length`: the mobilization length
    [m].
    """

    shapes: NDArray[np.void]
    motions: NDArray[np.void]
    rows: Array
    bounds: Array
    laws: NDArray[np.void]
    table: Array
    length: float
    memories: BodyMemories


def make_beds(plates: Sequence[Plates], law: Law) -> Beds:
    """Level beds at height 0 without hysteresis. `plates`: of each body, often the same.

    Raises TypeError for what is not a law, and ValueError for one without memory.
    """
    kernel_law = packed_law(law)
    length = number("mobilization_length of the law", law.mobilization_length, positive=True)
    tools = list(dict.fromkeys(plates))
    tool_numbers = {tool: number for number, tool in enumerate(tools)}
    shapes = np.zeros(len(tools), SHAPE)
    shapes["rows_end"] = np.cumsum([tool.blocks.size for tool in tools])
    shapes["rows"][1:] = shapes["rows_end"][:-1]
    shapes["blocks"] = [tool.bounds.shape[1] for tool in tools]
    shapes["bounds"][1:] = BOUNDS * np.cumsum(shapes["blocks"])[:-1]
    shapes["is_refined"] = [tool.integration == "refined" for tool in tools]
    shapes["reach"] = [tool.reach for tool in tools]
    laws = np.repeat(kernel_law.numbers, len(plates))
    beds = Beds(
        shapes=shapes[[tool_numbers[tool] for tool in plates]],
        motions=np.zeros(len(plates), MOTION),
        rows=np.concatenate([tool.blocks for tool in tools]),
        bounds=np.concatenate([tool.bounds.ravel() for tool in tools]),
        laws=laws.view(),
        table=kernel_law.table,
        length=length,
        memories=empty_memories(len(plates), most_blocks=shapes["blocks"].max()),
    )
    for array in (beds.rows, beds.bounds, beds.laws):
        array.flags.writeable = False  # a part of the types that the kernel is compiled for
    return beds


def set_law(beds: Beds, body: int, law: Law) -> None:
    """Give the grains around a body other numbers of the same law."""
    laws = beds.laws.base
    assert laws is not None
    laws[body] = packed_law(law).numbers[0]


@inlined
def evaluate(beds, b, memory, state, out):
    """Move body b to a state, shape [13], with its `memory` or a copy, and write its wrench, shape [1, 6].

    `out` of shape [plates, 3] takes the forces of the plates, in the kernel's order.
    """
    shape = beds.shapes[b]
    motion = beds.motions[b]
    bounds = beds.bounds[shape.bounds : shape.bounds + BOUNDS * shape.blocks]
    plates = PackedPlates(
        rows=beds.rows[shape.rows : shape.rows_end],
        bounds=bounds.reshape(BOUNDS, shape.blocks),
        is_refined=shape.is_refined == 1,
        reach=shape.reach,
    )
    law = PackedLaw(beds.laws[b : b + 1], beds.table)
    surface = Surface(motion.height, (motion.slope_x, motion.slope_y))
    body_memory.evaluate(plates, law, surface, memory, state, out)


@compiled
def add_forces_on_plates(beds, b, forces):
    """Add to the force on each plate of a body at its last state, shape [plates, 3], kernel's order."""
    memory = body_memory.copy(memory_of(beds.memories, b))
    evaluate(beds, b, memory, memory.last.copy(), forces)


def stiffness_matrices(beds: Beds) -> Array:
    """The stiffness B of each body at its last state, shape [n, 6, 6]."""
    matrices = np.empty((len(beds.motions), 6, 6))
    for b, matrix in enumerate(matrices):
        body_memory.stiffness(memory_of(beds.memories, b), matrix)
    return matrices

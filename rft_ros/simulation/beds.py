"""The grains around many bodies, in flat arrays, so that one compiled step evaluates tools of any numbers of plates."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import Law, Plates
from rft_ros.rft.arguments import number
from rft_ros.rft.displacement import DISPLACEMENT, between
from rft_ros.rft.grains import PackedLaw
from rft_ros.rft.kernel.compilation import compiled, inlined
from rft_ros.rft.kernel.loops import sums
from rft_ros.rft.memory import BLOCK_STATE, STIFFNESS, Past
from rft_ros.rft.plates import BOUNDS
from rft_ros.rft.traction import packed_law

Array = NDArray[np.float64]

BODY = np.dtype(
    [
        ("rows", int),  # where its part of `Beds.rows` begins
        ("rows_end", int),
        ("bounds", int),  # where its part of `Beds.bounds` begins
        ("blocks", int),  # of its plates
        ("is_refined", int),
        ("reach", float),  # of its plates [m]
        ("height", float),  # of its surface at x = y = 0 [m]
        ("slope_x", float),
        ("slope_y", float),
        ("state", float, 13),  # the last one
        ("explicit", float, 6),  # wrench of the grains there
        ("wrench", float, 6),  # held over the step that begins there
        ("duration", float),  # of this step [s]
        ("is_near", int),  # whether it may reach the surface in this step
        ("energy", float),  # that the grains have taken [J]
    ]
)
"""A body: its shape, its surface, and its motion."""


class Beds(NamedTuple):
    """What the compiled step takes of the grains around n bodies.

    `bodies`: records of `BODY`, shape [n]. `rows`, `bounds`: of `Plates`, one tool after the other. `numbers`, `table`:
    the laws' `PackedLaw`; record i of `numbers` is of body i. `length`: the mobilization length [m]. `memory`: of
    `Memory.blocks`, row i of body i, and `stiffness`.
    """

    bodies: NDArray[np.void]
    rows: Array
    bounds: Array
    numbers: NDArray[np.void]
    table: Array
    length: float
    memory: NDArray[np.void]
    stiffness: NDArray[np.void]


def make_beds(plates: Sequence[Plates], law: Law) -> Beds:
    """Level beds at height 0 without hysteresis. `plates`: of each body, often the same.

    Raises TypeError for what is not a law, and ValueError for one without memory.
    """
    packed = packed_law(law)
    length = number("mobilization_length of the law", law.mobilization_length, positive=True)
    places = {shape: place for place, shape in enumerate(dict.fromkeys(plates))}
    shapes = np.zeros(len(places), BODY)
    shapes["rows_end"] = np.cumsum([shape.blocks.size for shape in places])
    shapes["rows"][1:] = shapes["rows_end"][:-1]
    shapes["blocks"] = [shape.bounds.shape[1] for shape in places]
    shapes["bounds"][1:] = BOUNDS * np.cumsum(shapes["blocks"])[:-1]
    shapes["is_refined"] = [shape.integration == "refined" for shape in places]
    shapes["reach"] = [shape.reach for shape in places]
    numbers = np.repeat(packed.numbers, len(plates))
    beds = Beds(
        bodies=shapes[[places[shape] for shape in plates]],
        rows=np.concatenate([shape.blocks for shape in places]),
        bounds=np.concatenate([shape.bounds.ravel() for shape in places]),
        numbers=numbers.view(),
        table=packed.table,
        length=length,
        memory=np.zeros((len(plates), shapes["blocks"].max()), BLOCK_STATE),
        stiffness=np.zeros(len(plates), STIFFNESS),
    )
    for array in (beds.rows, beds.bounds, beds.numbers):
        array.flags.writeable = False  # a part of the types that the kernel is compiled for
    return beds


def laws_of(beds: Beds) -> NDArray[np.void]:
    """The numbers of the bodies' laws, to be changed."""
    assert beds.numbers.base is not None
    return beds.numbers.base


@inlined
def evaluate(beds, b, memory, stiffness, states, out):
    """Write the wrench of body b, shape [1, 6], at its next state, shape [1, 13].

    `memory`: its row of `Beds.memory` or a copy, shape [blocks]; it takes the step. `stiffness`: takes the sums,
    shape [1]. `out` of shape [plates, 3] takes the forces of the plates, in the kernel's order.
    """
    body = beds.bodies[b]
    moved = np.empty((1, DISPLACEMENT))
    between(body.state, states[0], moved[0])
    bounds = beds.bounds[body.bounds : body.bounds + BOUNDS * body.blocks]
    form = (
        beds.rows[body.rows : body.rows_end],
        bounds.reshape(BOUNDS, body.blocks),
        body.is_refined == 1,
        body.reach,
    )
    law = PackedLaw(beds.numbers[b : b + 1], beds.table)
    past = Past(True, memory, stiffness, moved)
    sums(form, law, body.height, (body.slope_x, body.slope_y), states, past, out)


@compiled
def forces_on_plates(beds, b, forces):
    """Add to the force on each plate of a body at its last state, shape [plates, 3], kernel's order."""
    memory = beds.memory[b].copy()
    state = beds.bodies[b].state.copy().reshape(1, 13)
    evaluate(beds, b, memory, np.empty(1, STIFFNESS), state, forces)


@inlined
def stiffness_matrix(s, b):
    """Write the stiffness B, shape [6, 6] [N/m, N, N m]. A displacement d adds -B d. `s`: a record of `STIFFNESS`."""
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
            b[i, j] = rows[i][j]

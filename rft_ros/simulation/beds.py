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

_BODY = np.dtype(
    [(name, np.int64) for name in ("rows", "rows_end", "bounds", "blocks", "refined")]
    + [(name, np.float64) for name in ("reach", "height", "slope_x", "slope_y")]
)


class Beds(NamedTuple):
    """What the compiled step takes of the grains around n bodies.

    `bodies`: shape [n]: where the body's part of `rows` begins and ends and that of `bounds` begins, the number of its
    blocks, its reach [m], the height of its surface at x = y = 0 [m], the surface's slopes, and whether its plates are
    refined. `rows`, `bounds`: of `Plates`, one tool after the other. `numbers`, `table`: the laws' `PackedLaw`;
    record i of `numbers` is of body i. `length`: the mobilization length [m]. `memory`: of
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
    shapes = {id(p): p for p in plates}
    of_shape = {}
    rows: list[Array] = []
    bounds: list[Array] = []
    rows_end = bounds_end = 0
    for key, shape in shapes.items():
        own_rows, own_bounds, *_ = shape.form
        body = np.zeros((), _BODY)
        body["rows"] = rows_end
        body["bounds"] = bounds_end
        rows_end += own_rows.size
        bounds_end += own_bounds.size
        body["rows_end"] = rows_end
        body["blocks"] = shape.bounds.shape[1]
        body["refined"] = shape.integration == "refined"
        body["reach"] = shape.reach
        of_shape[key] = body
        rows.append(own_rows.ravel())
        bounds.append(own_bounds.ravel())
    numbers = np.repeat(packed.numbers, len(plates))
    beds = Beds(
        bodies=np.array([of_shape[id(p)] for p in plates]),
        rows=np.concatenate(rows),
        bounds=np.concatenate(bounds),
        numbers=numbers.view(),
        table=packed.table,
        length=length,
        memory=np.zeros(
            (len(plates), max(shape.bounds.shape[1] for shape in shapes.values())), BLOCK_STATE
        ),
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
def evaluate(beds, b, memory, stiffness, before, states, out):
    """Write the row of `wrenches_in_time` of body b, shape [1, 19], at its state, shape [1, 13].

    `memory`: its row of `Beds.memory` or a copy, shape [1, blocks]; it takes the step from the state `before`, shape
    [13]. `stiffness`: takes the sums, shape [1].
    `out` of shape [plates, 3] takes the forces of the plates, in the kernel's order.
    """
    moved = np.empty((1, DISPLACEMENT))
    between(before, states[0], moved[0])
    p = beds.bodies[b]
    bounds = beds.bounds[p.bounds : p.bounds + BOUNDS * p.blocks].reshape(BOUNDS, p.blocks)
    form = beds.rows[p.rows : p.rows_end], bounds, p.refined == 1, p.reach
    law = PackedLaw(beds.numbers[b : b + 1], beds.table)
    past = Past(True, memory, stiffness, moved)
    sums(form, law, p.height, (p.slope_x, p.slope_y), states, past, out)


@compiled
def forces_on_plates(beds, body, states, forces):
    """Write the force on each plate of a body at its last state, shape [1, 13]: shape [plates, 3], kernel's order."""
    forces[:] = 0.0
    memory = beds.memory[body : body + 1].copy()
    evaluate(beds, body, memory, np.empty(1, STIFFNESS), states[0], states, forces)


@inlined
def stiffness_matrix(s, b):
    """Write the stiffness B, shape [6, 6] [N/m, N, N m]. A displacement d adds -B d. `s`: a record of `STIFFNESS`."""
    b[0] = (s.k, 0.0, 0.0, 0.0, s.z, -s.y)
    b[1] = (0.0, s.k, 0.0, -s.z, 0.0, s.x)
    b[2] = (0.0, 0.0, s.k, s.y, -s.x, 0.0)
    b[3] = (0.0, -s.z, s.y, s.yy + s.zz, -s.xy, -s.xz)
    b[4] = (s.z, 0.0, -s.x, -s.xy, s.xx + s.zz, -s.yz)
    b[5] = (-s.y, s.x, 0.0, -s.xz, -s.yz, s.xx + s.yy)

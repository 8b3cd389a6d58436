"""The grains around many bodies, in flat arrays, so that one compiled step evaluates tools of any numbers of plates."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import Law, Memory, Plates
from rft_ros.rft import memory as kept
from rft_ros.rft.arguments import number
from rft_ros.rft.grains import PackedLaw
from rft_ros.rft.kernel.compilation import compiled, inlined
from rft_ros.rft.kernel.loops import sums
from rft_ros.rft.plates import BOUNDS
from rft_ros.rft.traction import packed_law

__all__ = ["Beds", "evaluate", "forces_on_plates", "laws_of", "make_beds", "stiffness_matrix"]

Array = NDArray[np.float64]

_BODY = np.dtype(
    [(name, np.int64) for name in ("rows", "rows_end", "bounds", "blocks", "refined")]
    + [(name, np.float64) for name in ("reach", "height", "slope_x", "slope_y")]
)


class Beds(NamedTuple):
    """What the compiled step takes of the grains around n bodies.

    `bodies`: shape [n]: where the body's part of `rows` begins and ends and that of `bounds` begins, the number of its
    blocks, its reach [m], the height of its surface at x = y = 0 [m], the surface's slopes, and whether its plates are
    refined. `rows`, `bounds`: of `Plates`, one tool after the other. `law`, `alpha_y`, `numbers`, `table`: the laws'
    `PackedLaw`; row i of `numbers` is of body i. `length`: the mobilization length [m]. `memory`: `Memory.numbers`, row
    i of body i.
    """

    bodies: NDArray[np.void]
    rows: Array
    bounds: Array
    law: int
    alpha_y: int
    numbers: Array
    table: Array
    length: float
    memory: Array


def make_beds(plates: Sequence[Plates], law: Law) -> Beds:
    """Level beds at height 0 without hysteresis. `plates`: of each body, often the same.

    Raises TypeError for what is not a law, and ValueError for one without memory.
    """
    packed, shapes = packed_law(law), list({id(p): p for p in plates}.values())
    length = number("mobilization_length of the law", law.mobilization_length, positive=True)
    rows, bounds = ([np.ravel(a) for a in arrays] for arrays in zip(*(p.form[:2] for p in shapes), strict=True))
    row, bound, places = 0, 0, {}
    for p, its_rows, its_bounds in zip(shapes, rows, bounds, strict=True):
        places[id(p)] = row, row + its_rows.size, bound, p.bounds.shape[1], p.integration == "refined", p.reach
        row, bound = row + its_rows.size, bound + its_bounds.size
    bodies = np.array([(*places[id(p)], 0.0, 0.0, 0.0) for p in plates], _BODY)
    numbers = np.array([packed.numbers] * len(plates))
    memory = np.zeros((len(plates), max(Memory(p).numbers.size for p in shapes)))
    tools = np.concatenate(rows), np.concatenate(bounds)
    for array in (*tools, fixed := numbers.view()):
        array.flags.writeable = False  # a part of the types that the kernel is compiled for
    return Beds(bodies, *tools, packed.law, packed.alpha_y, fixed, packed.table, length, memory)


def laws_of(beds: Beds) -> Array:
    """The numbers of the bodies' laws, to be changed."""
    assert beds.numbers.base is not None
    return beds.numbers.base


@inlined
def evaluate(beds, b, memory, states, out):
    """Write the row of `wrenches_in_time` of body b, shape [1, 19], at its state, shape [1, 13].

    `memory`: its row of `Beds.memory` or a copy, shape [1, m]; it takes the step from the state before. `out` of shape
    [plates, 3] takes the forces of the plates, in the kernel's order.
    """
    p = beds.bodies[b]
    bounds = beds.bounds[p.bounds : p.bounds + BOUNDS * p.blocks].reshape(BOUNDS, p.blocks)
    form = beds.rows[p.rows : p.rows_end], bounds, p.refined == 1, p.reach
    law = PackedLaw(beds.law, beds.alpha_y, beds.numbers[b], beds.table)
    past = True, memory
    sums(form, law, p.height, (p.slope_x, p.slope_y), states, past, out)


@compiled
def forces_on_plates(beds, body, states, forces):
    """Write the force on each plate of a body at its last state, shape [1, 13]: shape [plates, 3], kernel's order."""
    forces[:] = 0.0
    evaluate(beds, body, beds.memory[body : body + 1].copy(), states, forces)


@inlined
def stiffness_matrix(memory, b):
    """Write the stiffness B of a row of `Beds.memory`, shape [6, 6] [N/m, N, N m]. A displacement d adds -B d.

    It is that of the last state, from the sums of `Memory.stiffness`.
    """
    s, x, y, z = memory[kept.K], memory[kept.K_X], memory[kept.K_Y], memory[kept.K_Z]
    xx, yy, zz = memory[kept.K_XX], memory[kept.K_YY], memory[kept.K_ZZ]
    xy, xz, yz = memory[kept.K_XY], memory[kept.K_XZ], memory[kept.K_YZ]
    b[:] = 0.0
    b[0, 0] = b[1, 1] = b[2, 2] = s
    b[0, 4], b[0, 5], b[1, 3], b[1, 5], b[2, 3], b[2, 4] = z, -y, -z, x, y, -x
    b[4, 0], b[5, 0], b[3, 1], b[5, 1], b[3, 2], b[4, 2] = z, -y, -z, x, y, -x
    b[3, 3], b[4, 4], b[5, 5] = yy + zz, xx + zz, xx + yy
    b[3, 4], b[3, 5], b[4, 5] = -xy, -xz, -yz
    b[4, 3], b[5, 3], b[5, 4] = -xy, -xz, -yz

"""A chunk of plates on its way through the kernel: rows of numbers on the stack, which stay in the first-level cache.

Each step of the kernel is a loop over the plates of a chunk. LLVM vectorises it because all rows lie in one array at
constant distances, so that it knows which of them overlap.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import carray, types
from numba.extending import intrinsic, overload

from rft_ros.rft.kernel.compilation import inlined
from rft_ros.rft.plates import BLOCK

BLOCK_COUNT = 8
"""Blocks of plates in a chunk."""

LENGTH = BLOCK_COUNT * BLOCK + 8
"""Numbers from one row to the next: rows a multiple of 512 bytes apart would compete for lines of the cache."""

POSITION, NORMAL, VELOCITY, TRACTION, STEEP_TRACTION = (3 * LENGTH * k for k in range(5))
"""Where the three rows of each vector begin, world axes: centre of load [m], from the tool frame's origin; outward
normal; direction of the velocity; traction per depth [N/m³]; the same with each plate's own e2."""

SPEED, E2_X, E2_Y, SIN_B, COS_B, SIN_G, COS_G, LOAD, AREA, SHARE, E1_FACTOR, TANGENT = (
    LENGTH * k for k in range(15, 27)
)
"""Where the row of each number begins: scaled speed; e2; sine and cosine of β and γ; load [m³] and area [m²] that the
traction acts on; leading share; the traction's part along e1 per α_y; its tangent with memory times the load [N/m]."""

BLOCK_KIND, STEEP_BLOCKS, FLAT_BLOCKS, TOTAL = (LENGTH * k for k in range(27, 31))
"""Where other rows begin: kinds of the blocks in a window; numbers of those to evaluate, without and with plates that
may be horizontal; totals of the state, in the order of a result."""

WINDOW = BLOCK_COUNT * BLOCK
"""Blocks that are classified together; a row has room for a number of each."""

SIZE = LENGTH * 31


@intrinsic
def _on_the_stack(_: Any) -> Any:
    def generate(_: Any, builder: Any, *__: Any) -> Any:
        with builder.goto_entry_block():
            array = builder.alloca(ir.ArrayType(ir.DoubleType(), SIZE))
        array.align = 64
        return builder.bitcast(array, ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(), generate


def wide_vectors() -> None:
    """Let LLVM use vectors of 512 bits in the compiled function that calls this, where the processor has them.

    On Intel's LLVM prefers 256 bits, since older ones lower their clock for 512. With 256 bits the steps take a tenth
    longer.
    """


@intrinsic
def _wide_vectors(_: Any) -> Any:
    def generate(context: Any, builder: Any, *_: Any) -> Any:
        # `set.add`, since llvmlite's own `add` refuses attributes that are not on its list
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    return types.void(), generate


@overload(wide_vectors, inline="always")  # into numba's own code, before LLVM's functions are made
def _compiled_wide_vectors() -> Any:
    def call():
        _wide_vectors()

    return call


@inlined
def new_chunk():
    """An array of `SIZE` numbers on the stack of the compiled function that calls this."""
    return carray(_on_the_stack(), (SIZE,))


@inlined
def at(begin, i):
    """The index of number i in the row that begins there.

    It is unsigned, since numba's code for negative indices would prevent vectorisation.
    """
    return np.uint64(begin) + np.uint64(i)


@inlined
def triple(rows, begin, i, length=LENGTH):
    """A vector of plate i, from the three rows of this length that begin there: of the chunk, or of a block."""
    return rows[at(begin, i)], rows[at(begin + length, i)], rows[at(begin + 2 * length, i)]


@inlined
def put(chunk, begin, i, vector):
    """Store a vector of plate i in the three rows of a chunk that begin there."""
    x, y, z = vector
    chunk[at(begin, i)] = x
    chunk[at(begin + LENGTH, i)] = y
    chunk[at(begin + 2 * LENGTH, i)] = z

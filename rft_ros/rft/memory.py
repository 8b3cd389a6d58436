"""Memory: grains must be sheared over a distance before they resist fully.

Each plate keeps its traction per depth τ, which approaches the law's t along the plate's own path, Eq. (10):
dτ/ds = (t - τ) / λ. At rest the traction stays. The paper reports the lag but does not model it; docs/accuracy.md has
the measurements behind the form below.
"""

from dataclasses import dataclass, field
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft.compilation import inlined
from rft_ros.rft.plates import BLOCK, Plates

__all__ = ["DEPTH", "TRAILING", "Memory", "approach", "fraction_left", "is_faded", "set_to_zero"]

DEPTH = 0.03
"""Depth [m] at which a plate's λ equals the mobilization length; λ grows with the square of depth."""

TRAILING = 0.04
"""λ of a trailing plate relative to that of a leading one."""

_FADED = 1e-9  # a trailing block with tractions below this times the law's stiffness counts as empty


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """The memory of the plates of one tool, in the order of their blocks; ``Memory(plates)`` is empty.

    `tractions`: shape [6, m]: traction per depth [N/m³], world axes, and the law's value at the last state. `active`:
    shape [m / BLOCK], 1 for a block with any traction. `motion`: shape [7]: speed of the last state [m/s], -1 before
    the first, and the last twist that was not zero, scaled to order one.
    """

    plates: Plates
    tractions: NDArray[np.float64] = field(init=False)
    active: NDArray[np.uint8] = field(init=False)
    motion: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        m = self.plates.blocks.rows.shape[1]
        object.__setattr__(self, "tractions", np.zeros((6, m)))
        object.__setattr__(self, "active", np.zeros(m // BLOCK, dtype=np.uint8))
        object.__setattr__(self, "motion", np.array([-1.0, *np.zeros(6)]))


@inlined
def _exp_minus(x):  # type: ignore[no-untyped-def]
    """exp(-x) for x >= 0, to 1e-11 and exactly 1 for 0: the series at x / 64, squared six times."""
    y = min(x, 40.0) * (1.0 / 64.0)
    y2 = y * y
    e = (1.0 - y) + y2 * ((1 / 2 - y * (1 / 6)) + y2 * (1 / 24 - y * (1 / 120)))
    e = e * e
    e = e * e
    e = e * e
    e = e * e
    e = e * e
    return e * e


@inlined
def fraction_left(velocity, depth, leads, per_length):  # type: ignore[no-untyped-def]
    """Fraction of a traction that remains after a step: exp(-Δs/λ), Eq. (10).

    `velocity`: scaled; its length times `per_length` is Δs / λ at a depth of 1 m.
    """
    ux, uy, uz = velocity
    squared = ux * ux + uy * uy + uz * uz
    ratio = per_length if leads else per_length / TRAILING
    return _exp_minus(ratio * squared / (sqrt(max(squared, 1e-290)) * (depth * depth + 1e-30)))


@inlined
def approach(tractions, i, asked, left, leads):  # type: ignore[no-untyped-def]
    """Move a plate's traction towards the law's value, `asked`, over one step; returns the traction."""
    ax, ay, az = asked
    mx, my, mz = tractions[0, i], tractions[1, i], tractions[2, i]
    bx, by, bz = tractions[3, i], tractions[4, i], tractions[5, i]
    tractions[3, i], tractions[4, i], tractions[5, i] = ax, ay, az
    # the mean of the law's values at both ends of the step makes it second-order accurate
    gx, gy, gz = 0.5 * (ax + bx) - mx, 0.5 * (ay + by) - my, 0.5 * (az + bz) - mz
    # λ is half as long for a decreasing traction: twice the exponent
    w = 1.0 - (left * left if (gx * mx + gy * my + gz * mz < 0.0) & leads else left)
    return mx + w * gx, my + w * gy, mz + w * gz


@inlined
def is_faded(tractions, b, stiffness):  # type: ignore[no-untyped-def]
    """Whether the tractions of a block are negligible."""
    largest = 0.0
    for i in range(b * np.uint64(BLOCK), (b + np.uint64(1)) * np.uint64(BLOCK)):
        largest = max(largest, abs(tractions[0, i]), abs(tractions[1, i]), abs(tractions[2, i]))
    return largest < _FADED * stiffness


@inlined
def set_to_zero(tractions, b):  # type: ignore[no-untyped-def]
    """Clear the memory of a block."""
    for i in range(b * np.uint64(BLOCK), (b + np.uint64(1)) * np.uint64(BLOCK)):
        for k in range(6):
            tractions[k, i] = 0.0

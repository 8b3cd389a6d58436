"""Memory: grains must be sheared over a distance before they push with full strength.

Each plate keeps its traction per depth, which follows what the law asks for over the plate's own path, Eq. (10):
dτ/ds = (t - τ) / λ. At rest there is no path and the traction stays. This is not in the paper, which sees the lag and
leaves it out; the measurements behind the form below are in docs/accuracy.md.
"""

from dataclasses import dataclass, field
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft.compilation import inlined
from rft_ros.rft.plates import BLOCK, Plates

__all__ = ["DEPTH", "TRAILING", "Memory", "approach", "fraction_left", "is_faded", "set_to_zero"]

DEPTH = 0.03
"""Depth [m] at which a plate's λ is the mobilization length; it grows with the square of depth."""

TRAILING = 0.04
"""λ of a plate that no longer leads, over that of one whose traction grows."""

_FADED = 1e-9  # tractions over the law's stiffness, below which a trailing block counts as empty


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """What the plates of one tool remember, in the order of their blocks.

    `tractions`: shape [6, m]: traction per depth [N/m³], world axes, and what the law last asked for. `active`: shape
    [m / BLOCK], 1 where a block remembers anything. `motion`: shape [7]: speed of the last state [m/s], -1 before any,
    and the last twist that was not zero, scaled to order one.
    """

    plates: Plates
    tractions: NDArray[np.float64] = field(init=False)
    active: NDArray[np.uint8] = field(init=False)
    motion: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        m = self.plates.blocks.rows.shape[1]
        object.__setattr__(self, "tractions", np.zeros((6, m)))
        object.__setattr__(self, "active", np.zeros(m // BLOCK, dtype=np.uint8))
        object.__setattr__(self, "motion", np.zeros(7))
        self.forget()

    @classmethod
    def of(cls, plates: Plates) -> "Memory":
        """An empty memory for these plates."""
        return cls(plates)

    def forget(self) -> None:
        """Clear the memory: the motion since the last state is unknown."""
        self.tractions[:] = 0.0
        self.active[:] = 0
        self.motion[:] = 0.0
        self.motion[0] = -1.0


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
    """Fraction of a traction that is left after a step: exp(-Δs/λ), Eq. (10).

    `velocity`: scaled; its length times `per_length` is Δs / λ at a depth of 1 m.
    """
    ux, uy, uz = velocity
    squared = ux * ux + uy * uy + uz * uz
    ratio = per_length if leads else per_length / TRAILING
    return _exp_minus(ratio * squared / (sqrt(max(squared, 1e-290)) * (depth * depth + 1e-30)))


@inlined
def approach(tractions, i, asked, left, leads):  # type: ignore[no-untyped-def]
    """Let a plate's traction follow what the law asks for over one step, and return it."""
    ax, ay, az = asked
    mx, my, mz = tractions[0, i], tractions[1, i], tractions[2, i]
    bx, by, bz = tractions[3, i], tractions[4, i], tractions[5, i]
    tractions[3, i], tractions[4, i], tractions[5, i] = ax, ay, az
    # the mean of what is asked for at both ends of the step makes it exact to second order
    gx, gy, gz = 0.5 * (ax + bx) - mx, 0.5 * (ay + by) - my, 0.5 * (az + bz) - mz
    # λ is half as long for a traction that falls: twice the exponent
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

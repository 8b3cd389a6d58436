"""Memory: grains must be sheared over a distance before they resist fully, and let go over a shorter one, Eq. (10).

Each plate keeps its traction per depth τ, in world axes; the radius y of its elastic zone; the law's traction t when it
last yielded; and the gap g behind it. A step moves it by D, of which D_n = D·n along its normal:

- A retreat of a plate without traction leaves a fifth of it open: g grows by -0.2 D_n. On the way back the gap closes
  before anything else happens.
- Inside its elastic zone, abs(τ) <= y, a plate is a spring: τ falls by k D, k = max(abs(t), y) / l(d). Nothing is
  counted there, so noise at rest teaches it nothing.
- Beyond it, a plate that leads yields: τ approaches the law's t over λ(d), or half of it where it falls, along the
  path that remains, and y = abs(τ).
- A plate that trails keeps abs(τ) <= y and is never pulled: τ·n < 0, or τ = 0. While it slips, or
  abs(τ) is below y / 2, y fades over 3 λ(d).

λ(d) is the mobilization length times (d / `DEPTH`)², and l(d) the elastic share of it, within the bounds below.

Energy. Per depth and area a plate stores abs(τ)² / 2k <= abs(τ) l / 2, and at constant depth it gives back no more
than that: a spring gives what it took, a plate that yields or slips has τ·D <= 0 (if the law has), and one that lets
go loses what it stored. So no closed path at constant depth yields work. With a change of depth the force follows the
load at constant τ, and closed paths within the elastic zone can yield up to (l / d) of the energy stored.

Constants. λ's square and its halving were chosen on ten simulated runs at 0 to 45 mm, hence `GREATEST`. The elastic
share was chosen on the withdrawal of the ABB plate; the gap, the fading of y and `LEAST_ELASTIC` on two simulated runs
of small retreats (docs/accuracy.md).
"""

from dataclasses import KW_ONLY, dataclass, field
from math import sqrt

import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from rft_ros.rft.compilation import inlined
from rft_ros.rft.frames import from_frame, into_frame
from rft_ros.rft.plates import BLOCK, Plates

__all__ = ["DEPTH", "GAPS", "LOADED", "SLACK", "Memory"]
__all__ += ["advance", "displacement", "forget", "is_empty", "open_gaps"]

DEPTH = 0.03
"""Depth [m] at which a plate's λ equals the mobilization length; λ grows with the square of depth."""

LEAST, GREATEST = 1.0 / 6.0, 2.25
"""The least and the greatest λ(d), over the mobilization length: those of 12 and 45 mm of depth."""

ELASTIC, LEAST_ELASTIC = 0.08, 1.0 / 30.0
"""The elastic length l(d) over λ(d); above 20 mm it is longer, the second number of mobilization lengths at 14 mm, and
at the surface as short again, so that a light tool gets back little energy."""

YIELD_FADES = 3.0
"""Path over which y fades, over λ(d)."""

OPEN = 0.2
"""Growth of the gap over the retreat."""

WIDEST = 5e-3
"""The widest gap [m]."""

SLACK = 10e-6
"""`Memory.slack` [m] for measured poses: five standard deviations of encoders of 2 µm."""

GAPS, LOADED = 1, 2
"""Values of `Memory.active`: the block's plates have no more than gaps behind them; they have tractions."""

_FADED = 1e-6  # square:  a trailing plate whose y has fallen to this share of abs(t) remembers nothing
_NONE = 1e-30  # added to y² of a plate with a gap, so that it has a sign [N²/m⁶]
_FAR = 1e30  # bounds displacements [m], so that no product overflows
_TINY = 1e-290  # avoids 0 / 0


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """The memory of the plates of one tool, in the order of their blocks; ``Memory(plates)`` is empty.

    `slack` [m]: so far the tool moves before its plates do, and so far it must turn back before they do, for poses with
    noise; a simulator needs none. `tractions`: shape [7, m]: τ and t [N/m³], world axes; y², negative where there is a
    gap, g [m] being in the first row. `active`: shape [m / BLOCK], 0, `GAPS` or `LOADED`. `motion`: shape [20]: the
    last twist that was not zero, scaled to order one; 1 after the first state; slack; the pose that the plates have
    followed to: position [m] and rotation matrix.
    `stiffness`: shape [10], at the last state: Σ k L, Σ k L x (3) and Σ k L (xx, yy, zz, xy, xz, yz) over plates at x
    from the tool frame's origin [m], world axes, of load L [m³] and modulus k [N/m⁴], abs(t) / λ(d) where it yields.
    Of many `bodies` of these plates, state i is of body i, and the arrays have a row for each.
    """

    plates: Plates
    _: KW_ONLY
    slack: float = 0.0
    bodies: int = 1
    tractions: NDArray[np.float64] = field(init=False)
    active: NDArray[np.uint8] = field(init=False)
    motion: NDArray[np.float64] = field(init=False)
    stiffness: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        n, m = self.bodies, self.plates.blocks.rows.shape[1]
        object.__setattr__(self, "tractions", np.zeros((n, 7, m)))
        object.__setattr__(self, "active", np.zeros((n, m // BLOCK), dtype=np.uint8))
        object.__setattr__(self, "motion", np.tile([*np.zeros(7), self.slack, *np.zeros(12)], (n, 1)))
        object.__setattr__(self, "stiffness", np.zeros((n, 10)))

    @property
    def arrays(self) -> dict[str, NDArray[np.float64] | NDArray[np.uint8]]:
        """What it remembers, by name: the fields above, in their units, shape [bodies, ...]."""
        return {name: getattr(self, name) for name in ("tractions", "active", "motion", "stiffness")}

    def copy_from(self, other: "Memory") -> None:
        """Take over what a memory of the same plates and number of bodies holds, into the same arrays."""
        for mine, theirs in zip(self.arrays.values(), other.arrays.values(), strict=True):
            np.copyto(mine, theirs)

    def part(self, first: int, last: int) -> "Memory":
        """The memory of bodies `first` to `last` - 1, which shares its arrays with this one."""
        made = Memory(self.plates, slack=self.slack)
        object.__setattr__(made, "bodies", last - first)
        for name, array in self.arrays.items():
            object.__setattr__(made, name, array[first:last])
        return made


@intrinsic
def _select(_, condition, yes, no):  # type: ignore[no-untyped-def]
    """One instruction for ``yes if condition else no``: LLVM follows repeated branches apart and computes all ways."""

    def generate(_, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.select(*arguments)

    return types.float64(types.boolean, types.float64, types.float64), generate


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
def displacement(motion, state, axes, reach, counts):  # type: ignore[no-untyped-def]
    """What the tool moved since the pose in `motion`, which follows: whether, origin [m], matrices.

    A point at x from the tool frame's origin moved by origin + matrix x; the first matrix takes x in world axes, the
    second in tool axes, and gives world and tool axes.
    """
    slack = motion[7]
    one = 1.0 if counts & (motion[6] > 0.0) else 0.0
    px, py, pz = (
        one * min(max(state[0] - motion[8], -_FAR), _FAR),
        one * min(max(state[1] - motion[9], -_FAR), _FAR),
        one * min(max(state[2] - motion[10], -_FAR), _FAR),
    )
    a, b, c, d, e, f, g, h, i = axes
    a, b, c = one * (a - motion[11]), one * (b - motion[12]), one * (c - motion[13])
    d, e, f = one * (d - motion[14]), one * (e - motion[15]), one * (f - motion[16])
    g, h, i = one * (g - motion[17]), one * (h - motion[18]), one * (i - motion[19])
    size = sqrt(px * px + py * py + pz * pz)
    size += reach * sqrt(0.5 * (a * a + b * b + c * c + d * d + e * e + f * f + g * g + h * h + i * i))
    part = 1.0 if slack <= 0.0 else (1.0 - slack / size if size > slack else 0.0)
    rest = one * (1.0 - part)
    motion[6] = 1.0
    for j in range(3):
        motion[8 + j] = state[j]
    for j in range(9):
        motion[11 + j] = axes[j]
    if rest > 0.0:  # the slack trails behind
        for j, v in enumerate((px, py, pz, a, b, c, d, e, f, g, h, i)):
            motion[8 + j] -= rest * v
    px, py, pz = part * px, part * py, part * pz
    a, b, c, d, e, f, g, h, i = (
        part * a,
        part * b,
        part * c,
        part * d,
        part * e,
        part * f,
        part * g,
        part * h,
        part * i,
    )
    turn = (*from_frame(axes, a, b, c), *from_frame(axes, d, e, f), *from_frame(axes, g, h, i))
    p, q, r = into_frame(axes, a, d, g), into_frame(axes, b, e, h), into_frame(axes, c, f, i)
    inner = p[0], q[0], r[0], p[1], q[1], r[1], p[2], q[2], r[2]
    return size * part > 0.0, (px, py, pz), turn, inner


@inlined
def advance(tractions, i, normal, moved, asked, leads, depth, length):  # type: ignore[no-untyped-def]
    """Advance a plate's traction over one step; returns it and the modulus by which it falls with motion [N/m⁴].

    `moved`: its displacement [m]; `asked`: the law's traction per depth, 0 if it trails.
    """
    nx, ny, nz = normal
    dx, dy, dz = moved
    ax, ay, az = asked
    mx, my, mz = tractions[0, i], tractions[1, i], tractions[2, i]
    bx, by, bz = tractions[3, i], tractions[4, i], tractions[5, i]
    limit = tractions[6, i]  # y²
    opened = limit < 0.0
    gap = _select(opened, mx, 0.0)
    mx = _select(opened, 0.0, mx)
    limit = _select(opened, -limit - _NONE, limit)

    mm = mx * mx + my * my + mz * mz
    bb = bx * bx + by * by + bz * bz
    dn = dx * nx + dy * ny + dz * nz
    # what counts is the part of the displacement after the gap has closed
    shut = max(gap - max(dn, 0.0), 0.0) + _select(leads | (mm > 0.0), 0.0, OPEN * max(-dn, 0.0))
    used = _select(gap > 0.0, max(dn - gap, 0.0) / max(dn, _TINY), _select(shut > 0.0, 0.0, 1.0))

    square = depth * depth * (1.0 / (DEPTH * DEPTH))
    ratio = min(max(square, LEAST), GREATEST)
    per_span = 1.0 / (length * ratio)
    strength = sqrt(_select(bb > 0.0, max(bb, limit), ax * ax + ay * ay + az * az))
    longer = max(ratio, LEAST_ELASTIC / ELASTIC - square) * (1.0 / LEAST_ELASTIC)
    k = used * strength * per_span * min(1.0 / ELASTIC, longer)
    kx, ky, kz = k * dx, k * dy, k * dz
    tx, ty, tz = mx - kx, my - ky, mz - kz
    presses = (tx * nx + ty * ny + tz * nz < 0.0) | (dn >= 0.0)
    # One root and one division serve three cases. Leading: the elastic share of the displacement, up to the yield
    # surface. Trailing: the share of the traction that stays, within y, or over l(d) of a retreat without pressure.
    kk, q = kx * kx + ky * ky + kz * kz, kx * mx + ky * my + kz * mz
    tt = tx * tx + ty * ty + tz * tz
    root = sqrt(_select(leads, q * q + kk * max(limit - mm, 0.0), _select(presses, tt * min(tt, limit), mm)))
    over = _select(leads, q + root, _select(presses, root, max(mm + k * dn * root, 0.0)))
    part = min(over / max(_select(leads, kk, _select(presses, tt, mm)), _TINY), 1.0)

    way = sqrt(dx * dx + dy * dy + dz * dz)
    fades = _select((tt >= 0.25 * limit) & (tt <= limit) & presses, 0.0, 1.0 / YIELD_FADES)
    path = way * _select(leads, used - used * part, fades)
    left = _exp_minus(path * per_span)
    squared = left * left
    yields = leads & (path > 0.0)
    faded = limit * squared
    none = faded <= _FADED * bb
    limit = _select(leads, limit, _select(none, 0.0, faded))
    keeps = _select(leads, 1.0, _select(none, 0.0, part))
    moves = _select(leads, part, _select(presses, keeps, 0.0))
    mx, my, mz = keeps * mx - moves * kx, keeps * my - moves * ky, keeps * mz - moves * kz

    mean = _select(bb > 0.0, 0.5, 1.0)
    gx, gy, gz = bx + mean * (ax - bx) - mx, by + mean * (ay - by) - my, bz + mean * (az - bz) - mz
    w = _select(yields, 1.0 - _select(gx * mx + gy * my + gz * mz < 0.0, squared, left), 0.0)
    mx, my, mz = mx + w * gx, my + w * gy, mz + w * gz
    mm = mx * mx + my * my + mz * mz
    limit = _select(yields, mm, limit)

    gapes = shut > 0.0
    tractions[0, i] = _select(gapes, min(shut, WIDEST), mx)
    tractions[1, i] = my
    tractions[2, i] = mz
    tractions[3, i] = _select(yields, ax, bx)
    tractions[4, i] = _select(yields, ay, by)
    tractions[5, i] = _select(yields, az, bz)
    tractions[6, i] = _select(gapes, -limit - _NONE, limit)
    stiff = _select(yields, strength * per_span, k)
    return mx, my, mz, _select(leads | (mm > 0.0), stiff, 0.0)


@inlined
def open_gaps(tractions, rows, b, shift, turn):  # type: ignore[no-untyped-def]
    """Follow the gaps behind a block of plates that trail and have no traction; `shift`, `turn`: in tool axes."""
    for i in range(b * np.uint64(BLOCK), (b + np.uint64(1)) * np.uint64(BLOCK)):
        x, y, z = rows[0, i], rows[1, i], rows[2, i]
        dx = shift[0] + turn[0] * x + turn[1] * y + turn[2] * z
        dy = shift[1] + turn[3] * x + turn[4] * y + turn[5] * z
        dz = shift[2] + turn[6] * x + turn[7] * y + turn[8] * z
        dn = dx * rows[3, i] + dy * rows[4, i] + dz * rows[5, i]
        gap = min(max(tractions[0, i] - max(dn, 0.0), 0.0) + OPEN * max(-dn, 0.0), WIDEST)
        tractions[0, i] = gap
        tractions[6, i] = -_NONE if gap > 0.0 else 0.0


@inlined
def is_empty(tractions, b):  # type: ignore[no-untyped-def]
    """Whether the plates of a block remember no more than a gap."""
    largest = 0.0
    for i in range(b * np.uint64(BLOCK), (b + np.uint64(1)) * np.uint64(BLOCK)):
        largest = max(largest, abs(tractions[6, i]))
    return largest <= _NONE


@inlined
def forget(tractions, b):  # type: ignore[no-untyped-def]
    """Clear the memory of a block."""
    for i in range(b * np.uint64(BLOCK), (b + np.uint64(1)) * np.uint64(BLOCK)):
        for k in range(7):
            tractions[k, i] = 0.0

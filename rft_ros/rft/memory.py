"""Memory: grains must be sheared over a distance before they resist fully, and let go over a shorter one, Eq. (10).

Each plate keeps its traction per depth τ, in world axes; the radius y of its elastic zone; the law's traction t when it
last yielded; and the gap g behind it. A step moves it by D, of which D_n = D·n along its normal:

- A retreat of a plate without traction leaves a fifth of it open: g grows by -0.2 D_n. On the way back the gap closes
  before anything else happens.
- Inside its elastic zone, abs(τ) <= y, a plate is a spring: τ falls by k D, k = max(abs(t), y) / l(d). Nothing is
  counted there, so noise at rest teaches it nothing.
- Beyond it, a plate that leads yields: τ approaches the law's t over λ(d), or half of it where it falls, along the
  path that remains, and y = abs(τ).
- A plate that trails keeps abs(τ) <= y and is never pulled: τ·n < 0, or τ = 0. While it slips, or has lost half of y, y
  fades over 3 λ(d).

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
"""The elastic length l(d), over λ(d); the least one, over the mobilization length."""

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

_FADED = 1e-3  # a trailing plate whose y has fallen to this share of abs(t) remembers nothing
_FAR = 1e30  # bounds displacements [m], so that no product overflows
_TINY = 1e-290  # avoids 0 / 0


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """The memory of the plates of one tool, in the order of their blocks; ``Memory(plates)`` is empty.

    `slack` [m]: so far the tool moves before its plates do, and so far it must turn back before they do, for poses with
    noise; a simulator needs none. `tractions`: shape [8, m]: τ and t [N/m³], world axes; y [N/m³]; g [m]. `active`:
    shape [m / BLOCK], 0, `GAPS` or `LOADED`. `motion`: shape [20]: the last twist that was not zero, scaled to order
    one; 1 after the first state; slack; the pose that the plates have followed to: position [m] and rotation matrix.
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
        object.__setattr__(self, "tractions", np.zeros((n, 8, m)))
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
    limit, gap = tractions[6, i], tractions[7, i]
    mm = mx * mx + my * my + mz * mz
    size = sqrt(mm)
    bb = bx * bx + by * by + bz * bz

    dn = dx * nx + dy * ny + dz * nz
    way = sqrt(dx * dx + dy * dy + dz * dz)
    shut = gap - max(dn, 0.0)
    tractions[7, i] = min(max(shut, 0.0) + (0.0 if leads | (mm > 0.0) else OPEN * max(-dn, 0.0)), WIDEST)
    # what counts is the part of the displacement after the gap has closed; a grazing plate, which leads, has none
    used = 1.0 if (gap == 0.0) | (leads & (dn <= 0.0)) else max(-shut, 0.0) / max(dn, _TINY)
    s = used * way

    ratio = min(max(depth * depth * (1.0 / (DEPTH * DEPTH)), LEAST), GREATEST)
    span = length * ratio
    k = used * max(sqrt(bb), limit) / (length * max(ELASTIC * ratio, LEAST_ELASTIC))
    kx, ky, kz = k * dx, k * dy, k * dz
    full = k * way

    # leading: elastic up to the yield surface, then towards the law
    q = kx * mx + ky * my + kz * mz
    elastic = min((q + sqrt(q * q + full * full * max(limit * limit - mm, 0.0))) / max(full * full, _TINY), 1.0)
    lx, ly, lz = mx - elastic * kx, my - elastic * ky, mz - elastic * kz
    # trailing: elastic and perfectly plastic; what does not press lets go over l(d) of retreat
    tx, ty, tz = mx - kx, my - ky, mz - kz
    trial = sqrt(tx * tx + ty * ty + tz * tz)
    presses = (tx * nx + ty * ny + tz * nz < 0.0) | (dn >= 0.0)
    back = limit / trial if trial > limit else 1.0
    loose = max(1.0 + k * dn / max(size, _TINY), 0.0)
    tx, ty, tz = (
        (back * tx if presses else loose * mx),
        (back * ty if presses else loose * my),
        (back * tz if presses else loose * mz),
    )
    fades = way if (not presses) | (trial < 0.5 * limit) else min((trial - limit) / max(k, _TINY), s)

    slid = s * (1.0 - elastic) if leads else max(fades, 0.0) * (1.0 / YIELD_FADES)
    left = _exp_minus(slid / span)
    yields = leads & (slid > 0.0)
    first = bb == 0.0
    gx = 0.5 * (ax + (ax if first else bx)) - lx
    gy = 0.5 * (ay + (ay if first else by)) - ly
    gz = 0.5 * (az + (az if first else bz)) - lz
    w = 1.0 - (left * left if gx * lx + gy * ly + gz * lz < 0.0 else left)
    lx, ly, lz = lx + w * gx, ly + w * gy, lz + w * gz
    bx, by, bz = (ax if yields else bx), (ay if yields else by), (az if yields else bz)
    limit = (sqrt(lx * lx + ly * ly + lz * lz) if yields else limit) if leads else limit * left
    none = (not leads) & (limit * limit <= _FADED * _FADED * bb)
    tractions[3, i], tractions[4, i], tractions[5, i] = (
        (0.0 if none else bx),
        (0.0 if none else by),
        (0.0 if none else bz),
    )
    tractions[6, i] = 0.0 if none else limit
    mx, my, mz = (lx if leads else tx), (ly if leads else ty), (lz if leads else tz)
    carries = (not none) & (leads | (mx * mx + my * my + mz * mz > 0.0))
    stiff = sqrt(bx * bx + by * by + bz * bz) / span if yields else k
    return (0.0 if none else mx), (0.0 if none else my), (0.0 if none else mz), (stiff if carries else 0.0)


@inlined
def open_gaps(tractions, rows, b, shift, turn):  # type: ignore[no-untyped-def]
    """Follow the gaps behind a block of plates that trail and have no traction; `shift`, `turn`: in tool axes."""
    for i in range(b * np.uint64(BLOCK), (b + np.uint64(1)) * np.uint64(BLOCK)):
        x, y, z = rows[0, i], rows[1, i], rows[2, i]
        dx = shift[0] + turn[0] * x + turn[1] * y + turn[2] * z
        dy = shift[1] + turn[3] * x + turn[4] * y + turn[5] * z
        dz = shift[2] + turn[6] * x + turn[7] * y + turn[8] * z
        dn = dx * rows[3, i] + dy * rows[4, i] + dz * rows[5, i]
        tractions[7, i] = min(max(tractions[7, i] - max(dn, 0.0), 0.0) + OPEN * max(-dn, 0.0), WIDEST)


@inlined
def is_empty(tractions, b):  # type: ignore[no-untyped-def]
    """Whether the plates of a block remember no more than a gap."""
    largest = 0.0
    for i in range(b * np.uint64(BLOCK), (b + np.uint64(1)) * np.uint64(BLOCK)):
        largest = max(largest, tractions[6, i])
    return largest == 0.0


@inlined
def forget(tractions, b):  # type: ignore[no-untyped-def]
    """Clear the memory of a block."""
    for i in range(b * np.uint64(BLOCK), (b + np.uint64(1)) * np.uint64(BLOCK)):
        for k in range(8):
            tractions[k, i] = 0.0

"""Memory: grains must be sheared over a distance before they resist fully, and let go over a shorter one, Eq. (10).

Each plate keeps its traction per depth τ, in world axes; the radius y of its elastic zone; the law's traction t when it
last yielded; and the gap g behind it. A step moves it by D, of which D_n = D·n along its normal:

- A retreat of a plate without traction leaves a fifth of it open: g grows by -0.2 D_n. On the way back the gap closes
  before anything else happens.
- Inside its elastic zone, abs(τ) <= y, a plate is a spring: τ falls by k D, k = max(abs(t), y) / l(d). Nothing is
  counted there, so noise at rest teaches it nothing.
- Beyond it, a plate that leads yields: τ approaches the law's t over λ(d), or half of it where it falls, along the
  path that remains, and y = abs(τ).
- A plate that trails keeps abs(τ) <= y. While it presses, τ·n < 0, it is a spring that slips at y; where it slips, or
  abs(τ) is below y / 2, y fades over 3 λ(d). A retreat that ends its pressure releases it: τ shrinks to zero over l(d)
  of any motion, so that what is left of it cannot push the plate along.
- Under the refined rule a plate passes from the rule for leading plates to that for trailing ones over 2° of its
  direction of motion (`TRAILING`), with the mean of both, so that noise of a velocity does not choose between them.

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
from math import radians, sin, sqrt

import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from rft_ros.rft.frames import from_frame, into_frame
from rft_ros.rft.kernel import chunk as row
from rft_ros.rft.kernel.chunk import at, put, triple, wide_vectors
from rft_ros.rft.kernel.compilation import STEP, compiled, inlined
from rft_ros.rft.plates import BLOCK, Plates

__all__ = ["DEPTH", "GAPS", "LOADED", "MOTION", "SLACK", "TRACTIONS", "TRAILING", "Memory"]
__all__ += ["displacement", "forget", "is_empty", "open_gaps", "remember"]

DEPTH = 0.03
"""Depth [m] at which a plate's λ equals the mobilization length; λ grows with the square of depth."""

LEAST, GREATEST = 1.0 / 6.0, 2.25
"""The least and the greatest λ(d), over the mobilization length: those of 12 and 45 mm of depth."""

ELASTIC, LEAST_ELASTIC = 0.08, 1.0 / 30.0
"""The elastic length l(d) over λ(d); above 20 mm it is longer, the second number of mobilization lengths at 14 mm, and
at the surface as short again, so that a light tool gets back little energy."""

YIELD_FADES = 3.0
"""Path over which y fades, over λ(d)."""

TRAILING = sin(radians(2.0))
"""A refined plate passes from the rule for leading plates to that for trailing ones while -v·n over abs(v) grows by
this, from where its leading share ends: noise of a velocity must not choose between them."""

OPEN = 0.2
"""Growth of the gap over the retreat."""

WIDEST = 5e-3
"""The widest gap [m]."""

SLACK = 10e-6
"""`Memory.slack` [m] for measured poses: five standard deviations of encoders of 2 µm."""

GAPS, LOADED = 1.0, 2.0
"""States of a block: its plates have no more than gaps behind them; they have tractions."""

MOTION, TRACTIONS = 10, 30
"""Where the motion, and the blocks' states with their plates' tractions, begin in `Memory.numbers`."""

_BEGUN, _SLACK, _POSE = 6, 7, 8  # in the motion

_FADED = 1e-6  # square:  a trailing plate whose y has fallen to this share of abs(t) remembers nothing
_NONE = 1e-30  # added to y² of a plate with a gap, so that it has a sign [N²/m⁶]
_FAR = 1e30  # bounds displacements [m], and 1 / _FAR the mobilization length, so that no product overflows
_TINY = 1e-290  # avoids 0 / 0


Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """The memory of the plates of one tool; ``Memory(plates)`` is empty.

    `slack` [m]: so far the tool moves before its plates do, and so far it must turn back before they do, for poses with
    noise; a simulator needs none. Of many `bodies` of these plates, state i is of body i.
    `numbers`: shape [bodies, m], what it remembers, one after the other: `stiffness`; from `MOTION` on the last twist
    that was not zero, scaled to order one, 1 after the first state, slack [m] and the pose that the plates have
    followed to, position [m] and rotation matrix; from `TRACTIONS` on by block 0, `GAPS` or `LOADED`, and then by block
    τ and t [N/m³], world axes, and y², which is negative where there is a gap, g [m] being in τ's first row.
    """

    plates: Plates
    _: KW_ONLY
    slack: float = 0.0
    bodies: int = 1
    numbers: Array = field(init=False)

    def __post_init__(self) -> None:
        blocks = self.plates.bounds.shape[1]
        object.__setattr__(self, "numbers", np.zeros((self.bodies, TRACTIONS + blocks * (1 + 7 * BLOCK))))
        self.numbers[:, MOTION + _SLACK] = self.slack

    def widen_slack(self, slack: float) -> None:
        """Set the slack of all bodies from now on [m], at least that of the memory's beginning."""
        self.numbers[:, MOTION + _SLACK] = max(slack, self.slack)

    @property
    def stiffness(self) -> Array:
        """At the last state Σ k L, Σ k L x (3) and Σ k L (xx, yy, zz, xy, xz, yz), shape [bodies, 10].

        Over plates at x from the tool frame's origin [m], world axes, of load L [m³] and modulus k [N/m⁴], which is
        abs(t) / λ(d) where the plate yields.
        """
        return self.numbers[:, :MOTION]


@intrinsic
def _select(_, condition, yes, no):
    """One instruction for ``yes if condition else no``: LLVM follows repeated branches apart and computes all ways."""

    def generate(_, builder, signature, arguments):
        return builder.select(*arguments)

    return types.float64(types.boolean, types.float64, types.float64), generate


@inlined
def _exp_minus(x):
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
def _difference(a, b, k):
    return a[0] - b[k], a[1] - b[k + 1], a[2] - b[k + 2]


@inlined
def _times(s, v):
    return s * v[0], s * v[1], s * v[2]


@inlined
def displacement(last, state, axes, reach, counts):
    """What the tool moved since the pose in `last`, which follows: whether, origin [m], matrices.

    `last`: `Memory.numbers` from `MOTION` on. A point at x from the tool frame's origin moved by origin + matrix x; the
    first matrix takes x in world axes, the second in tool axes, and gives world and tool axes.
    """
    one = 1.0 if counts & (last[_BEGUN] > 0.0) else 0.0
    px, py, pz = _difference(state, last, _POSE)
    shift = _times(one, (min(max(px, -_FAR), _FAR), min(max(py, -_FAR), _FAR), min(max(pz, -_FAR), _FAR)))
    x = _times(one, _difference(axes[:3], last, _POSE + 3))  # rows of the change of the rotation matrix
    y = _times(one, _difference(axes[3:6], last, _POSE + 6))
    z = _times(one, _difference(axes[6:], last, _POSE + 9))
    size, spin, slack = 0.0, 0.0, last[_SLACK]
    for v in shift:
        size += v * v
    for v in (*x, *y, *z):
        spin += v * v
    size = sqrt(size) + reach * sqrt(0.5 * spin)
    part = 1.0 if slack <= 0.0 else (1.0 - slack / size if size > slack else 0.0)
    rest = one * (1.0 - part)  # the slack trails behind
    last[_BEGUN] = 1.0
    for j, v in enumerate((state[0], state[1], state[2], *axes)):
        last[_POSE + j] = v
    for j, v in enumerate((*shift, *x, *y, *z)):
        last[_POSE + j] -= rest * v
    shift, x, y, z = _times(part, shift), _times(part, x), _times(part, y), _times(part, z)
    p, q, r = into_frame(axes, x[0], y[0], z[0]), into_frame(axes, x[1], y[1], z[1]), into_frame(axes, x[2], y[2], z[2])
    turn = (*from_frame(axes, *x), *from_frame(axes, *y), *from_frame(axes, *z))
    inner = p[0], q[0], r[0], p[1], q[1], r[1], p[2], q[2], r[2]
    return size * part > 0.0, (shift, turn), (into_frame(axes, *shift), inner)


@inlined
def _moved(motion, place):
    """The displacement of a place by a motion of `displacement`, both in world or in tool axes."""
    (dx, dy, dz), (xx, xy, xz, yx, yy, yz, zx, zy, zz) = motion
    x, y, z = place
    return dx + xx * x + xy * y + xz * z, dy + yx * x + yy * y + yz * z, dz + zx * x + zy * y + zz * z


@inlined
def advance(past, normal, moved, asked, share, leading, depth, length):
    """A plate's traction after one step, what it remembers then, and the modulus of its fall with motion [N/m⁴].

    `past`: τ (below m), the law's t when it last yielded (b), and y² (limit), as in `Memory.numbers`; `moved`: its
    displacement D [m]; `asked`: the law's t now, times the `share` of the plate that leads (a); `leading`: the weight
    of the rule for a plate that leads, 0 to 1; the rule for one that trails has the rest.
    """
    nx, ny, nz = normal
    dx, dy, dz = moved
    ax, ay, az = asked
    (mx, my, mz), (bx, by, bz), limit = past
    trailing = 1.0 - leading
    opened = limit < 0.0
    gap = _select(opened, mx, 0.0)
    mx = _select(opened, 0.0, mx)
    limit = _select(opened, -limit - _NONE, limit)

    mm = mx * mx + my * my + mz * mz
    bb = bx * bx + by * by + bz * bz
    dn = dx * nx + dy * ny + dz * nz
    # what counts is the part of the displacement after the gap has closed
    shut = max(gap - max(dn, 0.0), 0.0) + _select((share > 0.0) | (mm > 0.0), 0.0, OPEN * max(-dn, 0.0))
    square = depth * depth * (1.0 / (DEPTH * DEPTH))
    ratio = min(max(square, LEAST), GREATEST)
    ahead = max(dn, _TINY)
    r = 1.0 / (ahead * ratio)
    used = _select(gap > 0.0, max(dn - gap, 0.0) * (r * ratio), _select(shut > 0.0, 0.0, 1.0))
    per_span = (1.0 / max(length, 1.0 / _FAR)) * (r * ahead)
    strength = sqrt(_select(bb > 0.0, max(bb, limit), ax * ax + ay * ay + az * az))
    longer = max(ratio, LEAST_ELASTIC / ELASTIC - square) * (1.0 / LEAST_ELASTIC)
    k = used * strength * per_span * min(1.0 / ELASTIC, longer)
    kx, ky, kz = k * dx, k * dy, k * dz
    way = sqrt(dx * dx + dy * dy + dz * dz)

    # a plate that leads: elastic up to the yield surface, then τ follows the law along the path that remains
    kk, q = kx * kx + ky * ky + kz * kz, kx * mx + ky * my + kz * mz
    elastic = min((q + sqrt(q * q + kk * max(limit - mm, 0.0))) / max(kk, _TINY), 1.0)
    path = way * (used - used * elastic)
    yields = path > 0.0
    left = _exp_minus(path * per_span)
    ux, uy, uz = mx - elastic * kx, my - elastic * ky, mz - elastic * kz
    mean = _select(bb > 0.0, 0.5, 1.0)
    gx, gy, gz = bx + mean * (ax - bx) - ux, by + mean * (ay - by) - uy, bz + mean * (az - bz) - uz
    w = _select(yields, 1.0 - _select(gx * ux + gy * uy + gz * uz < 0.0, left * left, left), 0.0)
    ux, uy, uz = ux + w * gx, uy + w * gy, uz + w * gz
    limit_leading = _select(yields, ux * ux + uy * uy + uz * uz, limit)

    # a plate that trails: a spring that slips at y while it presses; released over l(d) of any motion where it does not
    tx, ty, tz = mx - kx, my - ky, mz - kz
    tt = tx * tx + ty * ty + tz * tz
    presses = (tx * nx + ty * ny + tz * nz < 0.0) | (dn >= 0.0)
    root = sqrt(_select(presses, tt * min(tt, limit), mm))
    over = _select(presses, root, max(mm - k * way * root, 0.0))
    stays = min(over / max(_select(presses, tt, mm), _TINY), 1.0)
    holds = (tt >= 0.25 * limit) & (tt <= limit) & presses
    fade = _exp_minus(_select(holds, 0.0, way * per_span * (1.0 / YIELD_FADES)))
    faded = limit * (fade * fade)
    none = faded <= _FADED * bb
    stays = _select(none, 0.0, stays)
    moves = _select(presses, stays, 0.0)

    mx = leading * ux + trailing * (stays * mx - moves * kx)
    my = leading * uy + trailing * (stays * my - moves * ky)
    mz = leading * uz + trailing * (stays * mz - moves * kz)
    limit = leading * limit_leading + trailing * _select(none, 0.0, faded)
    renewed = yields & (share > 0.0)
    yielded = _select(renewed, ax, bx), _select(renewed, ay, by), _select(renewed, az, bz)

    gapes = shut > 0.0
    kept = _select(gapes, min(shut, WIDEST), mx), my, mz
    limit = _select(gapes, -limit - _NONE, limit)
    stiff = leading * _select(yields, strength * per_span, k) + trailing * k
    loaded = (leading > 0.0) | (mx * mx + my * my + mz * mz > 0.0)
    return (mx, my, mz), (kept, yielded, limit), _select(loaded, stiff, 0.0)


def _remember(chunk, i0, memory, first, motion, below, slope, length):
    """Replace the law's tractions of a block, in a chunk from plate `i0` on, by those with memory.

    `first`: where its tractions begin in `Memory.numbers`. `motion`: of `displacement`, world axes; `below`, `slope`:
    depth of the tool frame's origin [m], and the surface's.
    """
    wide_vectors()
    for j in range(BLOCK):
        i = at(i0, j)
        x, y, z = place = triple(chunk, row.PLACE, i)
        ex, ey, ez = moved = _moved(motion, place)
        # half a step before
        depth = below - z + 0.5 * ez + slope[0] * (x - 0.5 * ex) + slope[1] * (y - 0.5 * ey)
        share, load = chunk[at(row.SHARE, i)], chunk[at(row.LOAD, i)]
        asked = _times(share, triple(chunk, row.TRACTION, i))
        leading = chunk[at(row.LEADING, i)]
        kept, yielded = triple(memory, first, j, BLOCK), triple(memory, first + 3 * BLOCK, j, BLOCK)
        past = kept, yielded, memory[at(first + 6 * BLOCK, j)]
        traction, past, stiff = advance(past, triple(chunk, row.NORMAL, i), moved, asked, share, leading, depth, length)
        wet = 1.0 if load > 0.0 else 0.0
        put(chunk, row.TRACTION, i, _times(wet, traction))
        chunk[at(row.STIFF, i)] = stiff * max(load, 0.0)
        kept, yielded, limit = past
        put(memory, first, j, _times(wet, kept), BLOCK)
        put(memory, first + 3 * BLOCK, j, _times(wet, yielded), BLOCK)
        memory[at(first + 6 * BLOCK, j)] = wet * limit


remember = compiled(_remember, **STEP)


@inlined
def open_gaps(memory, first, rows, form, motion):
    """Follow the gaps behind a block that trails and has no traction.

    `first`, `form`: where it begins in `Memory.numbers` and in `rows`; `motion`: of `displacement`, tool axes.
    """
    for i in range(BLOCK):
        place = triple(rows, form, i, BLOCK)
        nx, ny, nz = triple(rows, form + 3 * BLOCK, i, BLOCK)
        dx, dy, dz = _moved(motion, place)
        dn = dx * nx + dy * ny + dz * nz
        gap = min(max(memory[at(first, i)] - max(dn, 0.0), 0.0) + OPEN * max(-dn, 0.0), WIDEST)
        memory[at(first, i)] = gap
        memory[at(first + 6 * BLOCK, i)] = -_NONE if gap > 0.0 else 0.0


@inlined
def is_empty(memory, first):
    """Whether the plates of a block remember no more than a gap."""
    largest = 0.0
    for i in range(BLOCK):
        largest = max(largest, abs(memory[at(first + 6 * BLOCK, i)]))
    return largest <= _NONE


@inlined
def forget(memory, first):
    """Clear the memory of a block."""
    for i in range(7 * BLOCK):
        memory[at(first, i)] = 0.0

"""Memory: grains resist fully only after they have been sheared over a distance, Eq. (10).

Each plate keeps its traction per depth τ, in world axes; the radius y of its elastic zone; the strength s of the grains
by which it yielded; the demand at the last state; and the gap g behind it. A step moves it by D, of which D_n = D·n is
along its normal. The demand is the traction t by the law, times the share of the plate that leads.

- Gap. A retreat of a plate without traction opens a gap: g grows by -0.2 D_n. On the way back the gap closes before
  anything else happens. A refined plate that leads closes it by at least `GRAZING` of its path.
- Elastic zone. While abs(τ) <= y a plate is a spring: τ falls by k D, k = max(s, y) / l(d). Nothing else changes there,
  so noise at rest changes nothing.
- Yield. Beyond the zone, a plate that leads yields: over the rest of the path, τ approaches the mean of the demands at
  both ends of the step. The length of this approach is λ(d), or λ(d) / 2 where τ falls. y follows abs(τ). s follows
  abs(t) over λ(d) / 8, and at once while y is small.
- Slip. A plate that trails keeps abs(τ) <= y: beyond, the spring slips. Where it slips, or abs(τ) is below y / 2, y
  fades over 3 λ(d).
- Release. Grains do not pull. A plate is pressed if its traction points inwards, τ·n < 0, or if it moves outwards,
  D_n > 0. In the part of a step in which it is not pressed there is no spring: τ shrinks to zero over l(d) of motion in
  any direction, and then the gap opens. On a plate that leads, only a τ along the motion, τ·D > 0, shrinks in this way;
  any other τ follows the law.
- Under the refined rule a plate passes from yielding to slipping over 2° of its direction of motion (`TRAILING`), with
  the mean of both, so that noise of a velocity does not choose between them.

λ(d) is the mobilization length times (d / `DEPTH`)², and l(d) the elastic share of it, within the bounds below.

Energy. Per depth and area a plate stores abs(τ)² / 2k <= abs(τ) l / 2, and at constant depth it gives back no more
than that: a spring gives what it took, a plate that yields or slips has τ·D <= 0 (if the law has), and a release loses
what was stored. So no closed path at constant depth yields work. With a change of depth the force follows the load at
constant τ, and closed paths within the elastic zone can yield up to (l / d) of the energy stored.

Continuity. Under the refined rule a small change of a path makes a small change of the force, at v·n = 0, D_n = 0,
g = 0, τ = 0 and D = 0 too. So each switch in `advance` is a ramp, and a step is divided where a part of it ends. Two
jumps are left. A plate that leaves the grains loses its memory, and where a path only just touches the surface a small
change decides whether it leaves. And a vanishing velocity can have any direction; while D = 0 this decides nothing.

Constants. λ's square and its halving were chosen on ten simulated runs at 0 to 45 mm, hence `GREATEST`. The elastic
share was chosen on the withdrawal of the ABB plate; the gap, the fading of y and `LEAST_ELASTIC` on two simulated runs
of small retreats (docs/accuracy.md). The widths of the ramps were not fitted.
"""

from dataclasses import KW_ONLY, dataclass, field
from math import radians, sin, sqrt
from typing import NamedTuple

import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from rft_ros.rft.arguments import number, whole_number
from rft_ros.rft.frames import from_frame, into_frame
from rft_ros.rft.kernel import chunk as row
from rft_ros.rft.kernel.chunk import at, put, triple, wide_vectors
from rft_ros.rft.kernel.compilation import STEP, compiled, inlined
from rft_ros.rft.plates import BLOCK, IN_BLOCK, ROWS_OF_REFINED, Plates

__all__ = ["DEPTH", "ELASTIC", "EMPTY", "GAPS", "LOADED", "MOST_BODIES", "SLACK", "TRAILING", "Memory"]
__all__ += ["GRAZING", "HEAD", "IN_HEAD", "IN_MEMORY", "IN_STIFFNESS", "OF_BLOCK", "WEAKEST"]
__all__ += ["InHead", "InMemory", "InStiffness"]
__all__ += ["add_memory", "clear", "displacement", "follow_gap", "forget_demand"]

DEPTH = 0.03
"""Depth [m] at which a plate's λ equals the mobilization length; λ grows with the square of depth."""

LEAST, GREATEST = 1.0 / 6.0, 2.25
"""The least and the greatest λ(d), over the mobilization length: those of 12 and 45 mm of depth."""

ELASTIC, LEAST_ELASTIC = 0.08, 1.0 / 30.0
"""Set the elastic length l(d). From 19 mm of depth on it is `ELASTIC` λ(d). From 19 to 14 mm it stays at
`LEAST_ELASTIC` mobilization lengths. Above 14 mm it falls, to `ELASTIC` λ(d) at the surface, so that a light tool gets
back little energy."""

YIELD_FADES = 3.0
"""Path over which y fades, over λ(d)."""

TRAILING = sin(radians(2.0))
"""Width, in -v·n over abs(v), of the ramp from the rule for leading plates to that for trailing ones, for a refined
plate. It begins where the leading share is 0. Without it noise of a velocity would choose the rule."""

GRAZING = sin(radians(1.0))
"""A refined plate that leads closes its gap by at least this share of its path, for the normals that it stands for."""

WEAKEST = 0.01
"""The least strength that the elastic modulus is computed with, over ζ times 1 N/cm³."""

OPEN = 0.2
"""Growth of the gap over the retreat."""

WIDEST = 5e-3
"""The widest gap [m]."""

SLACK = 10e-6
"""`Memory.slack` [m] for measured poses: five standard deviations of encoders of 2 µm."""

MOST_BODIES = 1_000_000
"""The greatest number of bodies in one memory."""

EMPTY, GAPS, LOADED = 0.0, 1.0, 2.0
"""States of a block: nothing in memory; no more than gaps behind its plates; a traction of at least one plate."""


class InStiffness(NamedTuple):
    """Where each sum of `Memory.stiffness` is: `k`, Σ k L; `x` to `z`, Σ k L x (3); `xx` to `yz`, Σ k L (xx, ...)."""

    k: int
    x: int
    y: int
    z: int
    xx: int
    yy: int
    zz: int
    xy: int
    xz: int
    yz: int


IN_STIFFNESS = InStiffness(k=0, x=1, y=2, z=3, xx=4, yy=5, zz=6, xy=7, xz=8, yz=9)


class InHead(NamedTuple):
    """Where each part of the head of a row of `Memory.numbers` begins; the ten sums of `InStiffness` are before these.

    `twist`: the last twist that was not zero, scaled to order one (6). `begun`: 1 after the first state. `dead_band`
    [m]. `position` [m] (3) and `rotation`, a matrix by rows (9): the pose that the plates have followed to.
    """

    twist: int
    begun: int
    dead_band: int
    position: int
    rotation: int


IN_HEAD = InHead(twist=10, begun=16, dead_band=17, position=18, rotation=21)
HEAD = IN_HEAD.rotation + 9
"""Numbers in the head of a row of `Memory.numbers`: there the states of the blocks begin."""


class InMemory(NamedTuple):
    """Where the rows of a block begin in `Memory.numbers`, counted from the block's first number.

    `traction`: τ [N/m³], world axes, three rows; with a gap behind the plate g [m] in the first of them, and 0.
    `demand`: the demand at the last state [N/m³], world axes, three rows. `yield2`: y², negative with a gap.
    `strength`: s [N/m³].
    """

    traction: int
    demand: int
    yield2: int
    strength: int


IN_MEMORY = InMemory(traction=0, demand=3 * BLOCK, yield2=6 * BLOCK, strength=7 * BLOCK)
OF_BLOCK = 8 * BLOCK
"""Numbers of a block in `Memory.numbers`."""

_FADED = 1e-6  # y² of a trailing plate is 0 once it has faded to this share of s²
_NONE = 1e-30  # added to y² of a plate with a gap, so that it has a sign [N²/m⁶]
_FAR = 1e30  # bounds displacements [m], and 1 / _FAR the mobilization length, so that no product overflows
_WEAK, _SHORT = 1e-60, 1e-60  # least tractions per depth, or their squares, and lengths that are divided by
_FALLS = 10.0  # λ(d) is halved where τ falls: fully if the cosine between -τ and its change is over 1 / this
_AT_ONCE = 10.0  # a released plate that leads yields over its whole path where its leading share is over 1 / this
_SHRINKS = 10.0  # a released τ shrinks fully where the cosine between τ and the motion is over 1 / this
_SWIFT = 8.0  # s follows abs(t) over λ(d) / this
_ENDS = 0.05  # on the ramp to trailing, a release that ends with this share of a step left over takes the rest of τ


Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """The memory of the plates of one tool; ``Memory(plates)`` is empty.

    `slack` [m]: the dead band on the displacement, which filters the noise of poses. The plates follow the tool's pose
    at this distance. A simulator needs none. Of many `bodies` of these plates, state i is of body i.
    `numbers`: shape [bodies, m]. In each row, one after the other: the head, `InStiffness` and `InHead`; the state of
    each block, `EMPTY`, `GAPS` or `LOADED`; and block by block the rows of `InMemory`. Raises ValueError for a `slack`
    or a number of bodies that cannot be used.
    """

    plates: Plates
    _: KW_ONLY
    slack: float = 0.0
    bodies: int = 1
    numbers: Array = field(init=False)

    def __post_init__(self) -> None:
        blocks = self.plates.bounds.shape[1]
        bodies = whole_number("bodies", self.bodies, most=MOST_BODIES)
        number("slack", self.slack, least=0.0)
        object.__setattr__(self, "numbers", np.zeros((bodies, HEAD + blocks * (1 + OF_BLOCK))))
        self.slacks[:] = self.slack

    @property
    def slacks(self) -> Array:
        """The dead band of each body [m], shape [bodies]."""
        return self.numbers[:, IN_HEAD.dead_band]

    @property
    def stiffness(self) -> Array:
        """The sums of `InStiffness` at the last state, shape [bodies, 10].

        Over plates at x from the tool frame's origin [m], world axes, of load L [m³] and modulus k [N/m⁴], which is
        abs(t) / λ(d) where the plate yields.
        """
        return self.numbers[:, : len(IN_STIFFNESS)]


@intrinsic
def _select(_, condition, yes, no):
    """One instruction for ``yes if condition else no``.

    Of repeated branches on one condition LLVM would make a path for each case, and evaluate all of them.
    """

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
def displacement(memory, state, axes, reach, counts):
    """The displacement of the tool since the pose in memory. Moves that pose after the tool, at the dead band.

    `memory`: a row of `Memory.numbers`. Returns whether the tool moved, and origin [m] and matrix in world axes and in
    tool axes: a point at x from the tool frame's origin moved by origin + matrix x.
    """
    one = 1.0 if counts & (memory[IN_HEAD.begun] > 0.0) else 0.0
    px, py, pz = _difference(state, memory, IN_HEAD.position)
    shift = _times(one, (min(max(px, -_FAR), _FAR), min(max(py, -_FAR), _FAR), min(max(pz, -_FAR), _FAR)))
    x = _times(one, _difference(axes[:3], memory, IN_HEAD.rotation))  # rows of the change of the rotation matrix
    y = _times(one, _difference(axes[3:6], memory, IN_HEAD.rotation + 3))
    z = _times(one, _difference(axes[6:], memory, IN_HEAD.rotation + 6))
    size, spin, dead_band = 0.0, 0.0, memory[IN_HEAD.dead_band]
    for v in shift:
        size += v * v
    for v in (*x, *y, *z):
        spin += v * v
    size = sqrt(size) + reach * sqrt(0.5 * spin)
    part = 1.0 if dead_band <= 0.0 else (1.0 - dead_band / size if size > dead_band else 0.0)
    rest = one * (1.0 - part)  # the dead band trails behind
    memory[IN_HEAD.begun] = 1.0
    for j, v in enumerate((state[0], state[1], state[2], *axes)):
        memory[IN_HEAD.position + j] = v
    for j, v in enumerate((*shift, *x, *y, *z)):
        memory[IN_HEAD.position + j] -= rest * v
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
def advance(past, normal, moved, law, share, leading, closes, depth, length, weakest, all_lead):
    """A plate's traction after one step, its memory then, and the modulus of its elastic change [N/m⁴].

    `past`: τ, the demand at the last state (before), y² (yield2) and the strength s, as in `Memory.numbers`; `moved`:
    its displacement D [m]; `law`: the law's t now, which times the plate's leading `share` is the demand; `leading`:
    the weight of the rule for a plate that leads, 0 to 1; the rule for one that trails has the rest. `closes`: at least
    this share of its path closes a gap. `weakest`: the least s [N/m³]. `all_lead`, a constant: `leading` is 1 for all
    plates of the loop, which then has no code of the other rule.
    """
    nx, ny, nz = normal
    dx, dy, dz = moved
    law_x, law_y, law_z = law
    demand_x, demand_y, demand_z = share * law_x, share * law_y, share * law_z
    (tau_x, tau_y, tau_z), (before_x, before_y, before_z), yield2, strength = past
    opened = yield2 < 0.0
    gap = _select(opened, tau_x, 0.0)
    tau_x = _select(opened, 0.0, tau_x)
    yield2 = _select(opened, -yield2 - _NONE, yield2)
    y = sqrt(yield2)

    law2 = law_x * law_x + law_y * law_y + law_z * law_z
    demand2 = share * share * law2
    before2 = before_x * before_x + before_y * before_y + before_z * before_z
    pull = tau_x * nx + tau_y * ny + tau_z * nz
    way = sqrt(dx * dx + dy * dy + dz * dz)
    per_way = 1.0 / max(way, _SHORT)
    # the parts of the outward normal and of τ along the direction of D: roots of them need not wait for k
    forward, along = (dx * nx + dy * ny + dz * nz) * per_way, (dx * tau_x + dy * tau_y + dz * tau_z) * per_way

    # the part of the displacement that counts, after the gap has closed; k, the modulus of the elastic zone
    closing = way * max(forward, closes)
    counts = _select(gap > 0.0, max(closing - gap, 0.0) / max(closing, _SHORT), 1.0)
    square = depth * depth * (1.0 / (DEPTH * DEPTH))
    ratio = min(max(square, LEAST), GREATEST)
    per_span = (1.0 / max(length, 1.0 / _FAR)) / ratio
    longer = max(ratio, LEAST_ELASTIC / ELASTIC - square) * (1.0 / LEAST_ELASTIC)
    stiffest = max(strength, y, weakest)
    k = counts * stiffest * (per_span * min(1.0 / ELASTIC, longer))
    kx, ky, kz = k * dx, k * dy, k * dz
    fall = max(k * way, _WEAK)
    per_fall = 1.0 / fall

    # released is the part in which neither its traction nor its motion presses the plate; the rest is a spring
    pressed = min(max(-pull, 0.0) / (fall * max(-forward, TRAILING)), 1.0)
    released = (1.0 - pressed) * (1.0 - min(max(forward, 0.0) * (1.0 / TRAILING), 1.0))
    spring = 1.0 - released

    # a plate that leads: a released τ that pushes it on shrinks; elastic up to the yield surface; then τ follows the
    # law along the path that remains
    tau2 = tau_x * tau_x + tau_y * tau_y + tau_z * tau_z
    per_held = 1.0 / max(sqrt(tau2), _WEAK)
    pushes = min(_SHRINKS * max(along * per_held, 0.0), 1.0)
    keeps = max(1.0 - (fall * per_held) * (released * pushes), 0.0)
    left_x, left_y, left_z, along = keeps * tau_x, keeps * tau_y, keeps * tau_z, keeps * along
    inside = max(yield2 - keeps * keeps * tau2, 0.0)
    elastic = min((along + sqrt(along * along + inside)) * per_fall, spring)
    path = way * counts * (spring - elastic + released * min(_AT_ONCE * share, 1.0))
    led_x, led_y, led_z = left_x - elastic * kx, left_y - elastic * ky, left_z - elastic * kz
    mean = min(2.0 * min(demand2, before2) / max(demand2, before2, _WEAK), 0.5)
    change_x = demand_x + mean * (before_x - demand_x) - led_x
    change_y = demand_y + mean * (before_y - demand_y) - led_y
    change_z = demand_z + mean * (before_z - demand_z) - led_z
    change_led = change_x * led_x + change_y * led_y + change_z * led_z
    change2 = change_x * change_x + change_y * change_y + change_z * change_z
    led2 = led_x * led_x + led_y * led_y + led_z * led_z
    falls = min(max(-_FALLS * change_led / max(sqrt(change2 * (change2 + led2)), weakest * weakest), 0.0), 1.0)
    remains = _exp_minus(path * per_span * (1.0 + falls))
    approach = 1.0 - remains
    spare = remains * remains * max(yield2 - led2, 0.0)
    led_x, led_y, led_z = led_x + approach * change_x, led_y + approach * change_y, led_z + approach * change_z
    yields = path > 0.0
    yield2_leading = _select(yields, led_x * led_x + led_y * led_y + led_z * led_z + spare, yield2)
    swift = path * per_span * max(_SWIFT * y, strength, weakest)
    law_size = sqrt(law2)
    hardens = swift / max(y + swift, _WEAK) * (law_size - strength)
    stiff = _select(yields, max(stiffest, law_size) * per_span, k)
    gap = max(gap - closing, 0.0)

    if all_lead:
        tau_x, tau_y, tau_z, yield2, strength = led_x, led_y, led_z, yield2_leading, strength + hardens
    else:
        trailing = 1.0 - leading
        # a plate that trails: the spring slips at y
        tried_x, tried_y, tried_z = tau_x - spring * kx, tau_y - spring * ky, tau_z - spring * kz
        tried2 = tried_x * tried_x + tried_y * tried_y + tried_z * tried_z
        tried = sqrt(tried2)
        size = min(tried, y)
        loose = min(max(5.0 - 20.0 * tried2 / max(yield2, _WEAK), 0.0), 1.0)
        slips = (tried - size) * per_fall
        fades = released + spring * min(max(loose, slips), 1.0)
        fade = _exp_minus(way * fades * per_span * (1.0 / YIELD_FADES))
        floor = _FADED * strength * strength
        yield2_trailing = max((yield2 + floor) * (fade * fade) - floor, 0.0)

        # what the release does not need ends what the rule for leading plates keeps, and then opens the gap
        unused = trailing * max(released - size * per_fall, 0.0)
        leads = leading * max(1.0 - unused * (1.0 / _ENDS), 0.0)
        trails = trailing * max(size - fall * released, 0.0) / max(tried, _WEAK)
        retreat = way * max(-forward, 0.0)
        gap += OPEN * retreat * max((unused - _ENDS) * (1.0 / (1.0 - _ENDS)), 0.0)

        tau_x = leads * led_x + trails * tried_x
        tau_y = leads * led_y + trails * tried_y
        tau_z = leads * led_z + trails * tried_z
        yield2 = leading * yield2_leading + trailing * yield2_trailing
        strength += leading * hardens
        stiff = leading * stiff + trailing * k
        stiff = _select((leading > 0.0) | (tau_x * tau_x + tau_y * tau_y + tau_z * tau_z > 0.0), stiff, 0.0)

    opened = gap > 0.0
    kept = _select(opened, min(gap, WIDEST), tau_x), tau_y, tau_z
    yield2 = _select(opened, -yield2 - _NONE, yield2)
    return (tau_x, tau_y, tau_z), (kept, (demand_x, demand_y, demand_z), yield2, strength), stiff


@inlined
def _advance_block(chunk, i0, memory, first, motion, below, slope, grains, all_lead):
    """`advance` for the plates of a block; returns how many of them have tractions then."""
    wide_vectors()
    length, weakest, refined = grains
    loaded = 0.0
    for j in range(BLOCK):
        i = at(i0, j)
        x, y, z = place = triple(chunk, row.PLACE, i)
        ex, ey, ez = moved = _moved(motion, place)
        # half a step before
        depth = below - z + 0.5 * ez + slope[0] * (x - 0.5 * ex) + slope[1] * (y - 0.5 * ey)
        share, load = chunk[at(row.SHARE, i)], chunk[at(row.LOAD, i)]
        law = triple(chunk, row.TRACTION, i)
        leading = 1.0 if all_lead else chunk[at(row.LEADING, i)]
        kept = triple(memory, first + IN_MEMORY.traction, j, BLOCK)
        demand = triple(memory, first + IN_MEMORY.demand, j, BLOCK)
        past = kept, demand, memory[at(first + IN_MEMORY.yield2, j)], memory[at(first + IN_MEMORY.strength, j)]
        closes = GRAZING * share if refined else 0.0
        normal = triple(chunk, row.NORMAL, i)
        traction, past, stiff = advance(
            past, normal, moved, law, share, leading, closes, depth, length, weakest, all_lead
        )
        wet = 1.0 if load > 0.0 else 0.0
        put(chunk, row.TRACTION, i, _times(wet, traction))
        chunk[at(row.STIFF, i)] = stiff * max(load, 0.0)
        kept, demand, yield2, strength = past
        put(memory, first + IN_MEMORY.traction, j, _times(wet, kept), BLOCK)
        put(memory, first + IN_MEMORY.demand, j, _times(wet, demand), BLOCK)
        memory[at(first + IN_MEMORY.yield2, j)] = wet * yield2
        memory[at(first + IN_MEMORY.strength, j)] = wet * strength
        loaded += 1.0 if abs(wet * yield2) > _NONE else 0.0
    return loaded


@inlined
def _weights(chunk, i0, rows, b, refined):
    """Whether all plates of block b, in a chunk from plate `i0` on, lead; stores their weights `LEADING` if not."""
    wide_vectors()
    count = 0.0
    for j in range(BLOCK):
        count += 1.0 if chunk[at(row.SHARE, at(i0, j))] > 0.0 else 0.0
    if count == BLOCK:
        return True
    if refined:
        half_angles = b * np.uint64(ROWS_OF_REFINED * BLOCK) + np.uint64(IN_BLOCK.half_angle)
        for j in range(BLOCK):
            i = at(i0, j)
            nx, ny, nz = triple(chunk, row.NORMAL, i)
            vx, vy, vz = triple(chunk, row.VELOCITY, i)
            beyond = min(nx * vx + ny * vy + nz * vz + 0.5 / rows[at(half_angles, j)], 0.0)
            chunk[at(row.LEADING, i)] = max(1.0 + beyond * (1.0 / TRAILING), 0.0)
    else:
        for j in range(BLOCK):
            i = at(i0, j)
            chunk[at(row.LEADING, i)] = chunk[at(row.SHARE, i)]
    return False


def _add_memory(chunk, count, memory, first_in_memory, rows, motion, below, slope, grains):
    """Replace the law's tractions of the blocks in a chunk, `count`, by those with memory, and store their states.

    `first_in_memory`: where the plates begin in `Memory.numbers`; `rows`: `Plates.blocks`. `motion`: of `displacement`,
    world axes; `below`, `slope`: depth of the tool frame's origin [m], and the surface's; `grains`: mobilization length
    [m], least strength [N/m³], and whether the rule is the refined one.
    """
    wide_vectors()
    _, _, refined = grains
    for j in range(count):
        b, i0 = np.uint64(chunk[at(row.NUMBER, j)]), np.uint64(j) * np.uint64(BLOCK)
        first = first_in_memory + b * np.uint64(OF_BLOCK)
        if _weights(chunk, i0, rows, b, refined):  # true for most blocks; takes less than half of the other case's time
            loaded = _advance_block(chunk, i0, memory, first, motion, below, slope, grains, True)
        else:
            loaded = _advance_block(chunk, i0, memory, first, motion, below, slope, grains, False)
        memory[at(HEAD, b)] = LOADED if loaded > 0.0 else GAPS


add_memory = compiled(_add_memory, **STEP)


@inlined
def follow_gap(memory, first, i, normal, place, motion):
    """Follow the gap behind plate i of a block that trails and has no traction.

    `first`: where the block begins in `Memory.numbers`; `motion`: of `displacement`, in the axes of normal and place.
    """
    nx, ny, nz = normal
    dx, dy, dz = _moved(motion, place)
    dn = dx * nx + dy * ny + dz * nz
    gap = min(max(memory[at(first + IN_MEMORY.traction, i)] - max(dn, 0.0), 0.0) + OPEN * max(-dn, 0.0), WIDEST)
    memory[at(first + IN_MEMORY.traction, i)] = gap
    memory[at(first + IN_MEMORY.yield2, i)] = -_NONE if gap > 0.0 else 0.0
    put(memory, first + IN_MEMORY.demand, i, (0.0, 0.0, 0.0), BLOCK)


@inlined
def forget_demand(memory, first):
    """Clear the demand on a block at the last state, where it trails and has not moved."""
    for i in range(3 * BLOCK):
        memory[at(first + IN_MEMORY.demand, i)] = 0.0


@inlined
def clear(memory, first):
    """Clear the memory of a block."""
    for i in range(OF_BLOCK):
        memory[at(first, i)] = 0.0

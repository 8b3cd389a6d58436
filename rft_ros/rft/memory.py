"""Memory: grains resist fully only after they have been sheared over a distance, Eq. (10).

Each plate keeps its traction per depth τ, in world axes; the radius y of its yield surface; the gap g behind it; and
the share u of the law's traction that sliding has worn off. A step moves it by D. With its outward normal n, the share
of it that leads q, q times the traction by the law t, the strength σ of the law (ζ times 1 N/cm³, or ξ), and the
mobilization length λ at its depth, all but σ half a step before its end:

    k  = E σ / λ                                         modulus of the spring, the same in all directions
    c  = min(max(D·n, 0), g)                             closes the gap
    r  = max(-D·n - max(-τ·n, 0) / k, 0)                 retreat beyond contact                                 (10a)
    D' = (1 - c / |D|) D + r n,   e = D' / |D'|          moves the spring
    a  = (2 max(τ·e, 0) + y - |τ|) / k                   the path along e on which it stays elastic             (10b)
    τ1 = τ - k min(a, |D'|) e,   p = max(|D'| - a, 0)    spring; plastic path                                   (10c)
    s  = D·n / |D|,   d = max(-D·E3, 0) / |D|            how far the face leads, and how far it dives
    S  = max(S0 (1 - d), S1)
    u∞ = U max(-n·E3, 0) min(max(1 - s / S, 0), 1)       a face that looks down and slides
    z  = min(2 q, 1) p / ℓ,   ℓ = max(C, B λ) while u grows, B λ while it falls
    w  = x (e^-z - e^-x) / ((x - z) (1 - e^-x)),   x = (1 + f) p / λ
    t' = (1 - u∞ - (u - u∞) w) t,   u <- u∞ + (u - u∞) e^-z                                                     (10d)
    τ2 = t' + (τ1 - t') e^-x,   y <- |τ2| + (y - |τ1|) e^-x        τ approaches t', and y approaches |τ|        (10e)
    τ <- τ2 max(1 - k r / |τ2|, 0),   y <- max(y (1 - r / F λ), |τ|),   g <- g - c + G r                        (10f)

In words: within its yield surface a plate is a spring. Beyond, it yields: its traction approaches the law's over the
path λ, and up to twice as fast where it falls; f is the positive part of τ1·v / (|v| max(|τ1|, |v|)) with v = τ1 less
(1 - u) t, u at the end of the step. Grains do not pull: a plate that retreats from them unloads, then loses what is
left of its traction and opens a gap. The path on which the gap closes moves nothing else, whatever its direction.

A face that looks down and slides along itself loses its pressure over C: grains that it sheared once carry no more.
In a press s is 1, and nothing wears. The less a face dives, the more it must lead to find grains that were not sheared
before by the parts of the tool ahead of it, so S falls with the dive d. Leading over B λ restores what was worn. A
plate that trails wears nothing; one that slides exactly along itself has q = 1/2. At rest the plastic path is 0, so
noise within the yield surface wears nothing. Over p du/dp = (u∞ - u) z / p and dτ/dp = ((1 - u) t - τ) x / p:
(10d) and (10e) solve both exactly for constant f and t, so one step of a straight path is as good as many. On a
curved path n, q and t are those half-way, from the twist and the displacement (`half_way_axes`).

The displacement of a step is that of the tool (`displacement`). Nothing else decides how far the plates have moved,
whatever time it took.

λ is the mobilization length times (d / `REFERENCE_DEPTH_M`)² at the plate's depth d, within the bounds below.

Continuity. Each line is Lipschitz in D, n, q, t and the state, and under the refined rule the share, and so t, is
continuous too; v·n = 0, D·n = 0, g = 0 and τ = 0 are no special cases. A state at which the plate has not moved
changes nothing, whatever its time and velocity. Two jumps are left: a plate that leaves the grains loses its memory,
and a vanishing velocity can have any direction, which decides t once the plate moves. A velocity of zero has that of
the displacement.

Energy. At constant depth no closed path yields work. Per depth and area a plate stores |τ|² / 2k: the spring gives
back what it took, yielding takes since the law resists (`rft.traction.MIN_RESISTANCE_SHARE`), and a release only loses.
With a change of depth the force follows the load at constant τ.
"""

from dataclasses import dataclass, field
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft.displacement import DISPLACEMENT_COUNT, MAX_DISPLACEMENT_M, shift_of
from rft_ros.rft.frames import STATE
from rft_ros.rft.kernel import chunk as layout
from rft_ros.rft.kernel.chunk import at, put, triple, wide_vectors
from rft_ros.rft.kernel.compilation import STEP, compiled, inlined
from rft_ros.rft.plates import BLOCK, Plates
from rft_ros.rft.stiffness import NO_STIFFNESS


class PlateState(NamedTuple):
    """What one plate keeps. `load` and `store` alone know where."""

    tau_x: float  # traction per depth τ [N/m³], world axes
    tau_y: float
    tau_z: float
    radius: float  # y, of the yield surface [N/m³]
    gap: float  # g [m]
    worn: float  # u, share of the law's traction


BLOCK_STATE = np.dtype((np.record, [(name, float, BLOCK) for name in PlateState._fields]))
"""What the plates of a block keep: `PlateState` number by number."""

EMPTY = PlateState(tau_x=0.0, tau_y=0.0, tau_z=0.0, radius=0.0, gap=0.0, worn=0.0)
"""Of a plate that is not in the grains."""


@inlined
def load(block, i):
    """The `PlateState` of plate i of a block."""
    return PlateState(
        tau_x=block.tau_x[i],
        tau_y=block.tau_y[i],
        tau_z=block.tau_z[i],
        radius=block.radius[i],
        gap=block.gap[i],
        worn=block.worn[i],
    )


@inlined
def store(block, i, state):
    """Keep the `PlateState` of plate i of a block."""
    block.tau_x[i] = state.tau_x
    block.tau_y[i] = state.tau_y
    block.tau_z[i] = state.tau_z
    block.radius[i] = state.radius
    block.gap[i] = state.gap
    block.worn[i] = state.worn


_TINY = 1e-60
"""Least length [m], and traction per depth [N/m³], that something is divided by."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """The memory of the plates of one tool; ``Memory(plates)`` is empty.

    `blocks`: records of `BLOCK_STATE`, shape [blocks]. `last`: the last state, shape [13]; zeros before the first.
    """

    plates: Plates
    blocks: NDArray[np.void] = field(init=False)
    last: Array = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "blocks", np.zeros(self.plates.bounds.shape[1], BLOCK_STATE))
        object.__setattr__(self, "last", np.zeros(len(STATE)))


class Past(NamedTuple):
    """What the loop takes of the memory: `Memory.blocks`, and the displacements to the states, shape [states, 12].

    `stiffness`: records of `STIFFNESS` to sum up at each state, shape [1], or [0] where nobody asks for them.
    """

    has_memory: bool
    blocks: NDArray[np.void]
    stiffness: NDArray[np.void]
    displacements: Array


NO_MEMORY = Past(
    has_memory=False,
    blocks=np.zeros(1, BLOCK_STATE),
    stiffness=NO_STIFFNESS,
    displacements=np.zeros((1, DISPLACEMENT_COUNT)),
)
"""For plates without memory."""


@inlined
def _times(s, v):
    return s * v[0], s * v[1], s * v[2]


REFERENCE_DEPTH_M = 0.03
"""Depth at which a plate's λ equals the mobilization length; λ grows with the square of depth."""

MIN_LENGTH_RATIO = 0.1
MAX_LENGTH_RATIO = 2.25
"""The least and the greatest λ(d), over the mobilization length: those of 9.5 and 45 mm of depth."""

MODULUS_FACTOR = 12.0
"""E: modulus of the spring, over the strength of the law and λ."""

FADE_PATH_RATIO = 3.0
"""F: path of retreat over which the yield surface shrinks, over λ."""

GAP_SHARE = 0.2
"""G: growth of the gap over the retreat."""

WEAR_PATH_M = 0.013
"""C: path over which a sliding face loses its pressure. Chosen on the seen runs and a real wheel's spins."""

RESTORE_PATH_RATIO = 1.5
"""B: path over which a face that leads regains its pressure, over λ."""

MAX_WORN_SHARE = 0.9
"""U: greatest share that sliding wears off. Chosen with a real wheel's spins and drags."""

LEVEL_LEAD_SHARE = 0.75
"""S0: lead from which on a face that moves level meets fresh grains. Chosen with the smooth wheel's drags in sight;
from 0.7 to 0.8 no error changes by more than 0.6 points."""

DIVING_LEAD_SHARE = 0.3
"""S1: the same for a face that dives steeply. Chosen on the seen simulated runs."""


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
def _steadily_worn(lead, dive, down):
    """u∞ of Eq. (10d). `lead`: s. `dive`: d. `down`: -n·E3."""
    fresh_lead = max(LEVEL_LEAD_SHARE * (1.0 - dive), DIVING_LEAD_SHARE)
    return MAX_WORN_SHARE * max(down, 0.0) * min(max(1.0 - lead / fresh_lead, 0.0), 1.0)


@inlined
def _contact(gap, outward, unloading):
    """c and r of Eq. (10a), and the gap g after the step. `outward`: D·n. `unloading`: path on which contact ends."""
    gap_path = min(max(outward, 0.0), gap)
    retreat = max(-outward - unloading, 0.0)
    return gap_path, retreat, gap - gap_path + GAP_SHARE * retreat


@inlined
def advance(old, normal, shift, share, target, length, strength):
    """A plate's state after one step, Eqs. (10a) to (10f), and its tangent [N/m⁴].

    `old`: its `PlateState`. `shift`: D [m]. `share`: q. `target`: t [N/m³]. `length`: λ [m]. `strength`: σ [N/m³]. The
    tangent: the modulus of the change of the traction with the displacement. In the code a is `elastic_path`, c
    `gap_path`, r `retreat`, |D'| `contact_path`, p `plastic_path`, x `yielding`. `late` t: what the approach to t' has
    over that to (1 - u) t.
    """
    tau_x, tau_y, tau_z = old.tau_x, old.tau_y, old.tau_z
    nx, ny, nz = normal
    dx, dy, dz = shift
    per_modulus = length * (1.0 / (MODULUS_FACTOR * strength))

    outward = dx * nx + dy * ny + dz * nz
    pressure = max(-(tau_x * nx + tau_y * ny + tau_z * nz), 0.0)
    gap_path, retreat, gap = _contact(old.gap, outward, pressure * per_modulus)
    step = max(sqrt(dx * dx + dy * dy + dz * dz), _TINY)
    # |D'|: gap_path and retreat are not both positive
    in_contact = step - gap_path
    contact_path = sqrt(
        max(in_contact * in_contact + retreat * (2.0 * outward + retreat), _TINY * _TINY)
    )
    inverse = 1.0 / (step * length * contact_path)  # one division for three
    per_step = length * contact_path * inverse
    per_length = step * contact_path * inverse
    per_contact_path = step * length * inverse
    modulus = MODULUS_FACTOR * strength * per_length
    lead = outward * per_step
    dive = max(-dz, 0.0) * per_step
    contact_share = 1.0 - gap_path * per_step
    ex = (contact_share * dx + retreat * nx) * per_contact_path
    ey = (contact_share * dy + retreat * ny) * per_contact_path
    ez = (contact_share * dz + retreat * nz) * per_contact_path

    tau_along = ex * tau_x + ey * tau_y + ez * tau_z
    tau = sqrt(tau_x * tau_x + tau_y * tau_y + tau_z * tau_z)
    elastic_path = (2.0 * max(tau_along, 0.0) + max(old.radius - tau, 0.0)) * per_modulus
    elastic = min(elastic_path, contact_path)
    plastic_path = contact_path - elastic
    fall = modulus * elastic
    tau_x, tau_y, tau_z = tau_x - fall * ex, tau_y - fall * ey, tau_z - fall * ez

    steady = _steadily_worn(lead, dive, -nz)
    per_wear = min(1.0 / WEAR_PATH_M, per_length * (1.0 / RESTORE_PATH_RATIO))
    per_wear = per_wear if steady > old.worn else per_length * (1.0 / RESTORE_PATH_RATIO)
    per_wear *= min(2.0 * share, 1.0)
    decay = _exp_minus(plastic_path * per_wear)
    excess = old.worn - steady
    worn = steady + excess * decay
    tx, ty, tz = _times(1.0 - worn, target)
    cx, cy, cz = tx - tau_x, ty - tau_y, tz - tau_z
    change = sqrt(cx * cx + cy * cy + cz * cz)
    trial_size = sqrt(tau_x * tau_x + tau_y * tau_y + tau_z * tau_z)
    # f = falling / size_squared, and x / (x - z) is 1.5 at most
    falling = max(-(cx * tau_x + cy * tau_y + cz * tau_z), 0.0)
    square = max(change * max(change, trial_size), _TINY)
    both = square + falling
    rest = both - square * (per_wear * length)
    inverse = 1.0 / (square * rest)  # one division for two
    yielding = plastic_path * per_length * (both * rest * inverse)
    yield_decay = _exp_minus(yielding - plastic_path * per_wear)
    approach = 1.0 - decay * yield_decay
    late = excess * decay * (approach - (1.0 - yield_decay) * (both * square * inverse))
    tau_x, tau_y, tau_z = (
        tau_x + approach * cx + late * target[0],
        tau_y + approach * cy + late * target[1],
        tau_z + approach * cz + late * target[2],
    )
    size = sqrt(tau_x * tau_x + tau_y * tau_y + tau_z * tau_z)
    radius = old.radius + (size - trial_size) - approach * max(old.radius - trial_size, 0.0)

    kept_share = 1.0 - min(modulus * retreat, size) / max(size, _TINY)
    radius = max(
        radius * max(1.0 - retreat * per_length * (1.0 / FADE_PATH_RATIO), 0.0), kept_share * size
    )
    tangent = modulus + plastic_path * per_contact_path * (
        max(size, change) * per_length - modulus
    )
    tangent *= 1.0 if kept_share * size > 0.0 else 0.0  # without traction nothing is stiff
    tau_x, tau_y, tau_z = kept_share * tau_x, kept_share * tau_y, kept_share * tau_z
    state = PlateState(tau_x=tau_x, tau_y=tau_y, tau_z=tau_z, radius=radius, gap=gap, worn=worn)
    return state, tangent


def _add_memory(chunk, numbers, count, blocks, displacement, origin_depth, slope, law):
    """Replace the law's tractions of the blocks in a chunk, `count`, by those with memory, and store their states.

    `numbers`: where those of the blocks begin in the chunk. `blocks`: of the memory. `displacement`: of the tool, world
    axes. `origin_depth` of the tool frame [m], and the `slope` of the surface. `law`: its numbers.
    """
    wide_vectors()
    for b in range(count):
        block = blocks[np.uint64(chunk[at(numbers, b)])]
        for j in range(BLOCK):
            i = at(np.uint64(b) * np.uint64(BLOCK), j)
            x, y, z = position = triple(chunk, layout.POSITION, i)
            dx, dy, dz = shift = shift_of(displacement, position)
            half_step_depth = (
                origin_depth - z + 0.5 * dz + slope[0] * (x - 0.5 * dx) + slope[1] * (y - 0.5 * dy)
            )
            depth_ratio2 = (
                half_step_depth * half_step_depth * (1.0 / (REFERENCE_DEPTH_M * REFERENCE_DEPTH_M))
            )
            length_ratio = min(max(depth_ratio2, MIN_LENGTH_RATIO), MAX_LENGTH_RATIO)
            length = max(law.mobilization_length, 1.0 / MAX_DISPLACEMENT_M) * length_ratio
            share = chunk[at(layout.SHARE, i)]
            target = _times(share, triple(chunk, layout.TRACTION, i))
            normal = triple(chunk, layout.NORMAL, i)
            new, tangent = advance(
                load(block, j), normal, shift, share, target, length, law.stiffness
            )
            volume = chunk[at(layout.LOAD, i)]
            state = new if volume > 0.0 else EMPTY
            put(chunk, layout.TRACTION, i, (state.tau_x, state.tau_y, state.tau_z))
            chunk[at(layout.TANGENT, i)] = tangent * max(volume, 0.0)
            store(block, j, state)


add_memory = compiled(_add_memory, **STEP)


@inlined
def clear(block):
    """Empty the memory of a block."""
    for i in range(BLOCK):
        store(block, i, EMPTY)


@inlined
def is_elastic(block):
    """Whether a plate of a block has a yield surface, without which it has no traction."""
    sum_of_radii = 0.0
    for i in range(BLOCK):
        sum_of_radii += load(block, i).radius
    return sum_of_radii > 0.0


@inlined
def follow_gap(block, i, normal, shift):
    """`advance` for plate i of a block that is not elastic and trails: of its memory only the gap changes."""
    nx, ny, nz = normal
    dx, dy, dz = shift
    old = load(block, i)
    _, _, gap = _contact(old.gap, dx * nx + dy * ny + dz * nz, 0.0)
    store(
        block,
        i,
        PlateState(
            tau_x=old.tau_x,
            tau_y=old.tau_y,
            tau_z=old.tau_z,
            radius=old.radius,
            gap=gap,
            worn=old.worn,
        ),
    )

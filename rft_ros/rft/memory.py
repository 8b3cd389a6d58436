"""Memory: grains resist fully only after they have been sheared over a distance, Eq. (10).

Each plate keeps its traction per depth τ, in world axes; the radius y of its yield surface; and the gap g behind it.
A step moves it by D. With its outward normal n and half angle θ (0 for a point), the traction t by the law times the
share of the plate that leads, the strength σ of the law (ζ times 1 N/cm³), and the mobilization length λ at its depth:

    k  = E σ / λ                                         modulus of the spring, the same in all directions
    P  = max(-τ·n, 0) / k                                the retreat that would unload its pressure             (10a)
    c  = min(max(D·n, 0), g)                             closes the gap
    D' = D - min(D·n, c) n,   u = D' / |D'|              motion along the plate, or into the grains             (10b)
    a  = (2 max(τ·u, 0) + y - |τ|) / k                   the path along u on which it stays elastic
    ρ  = max(-D·n - sin θ |D'|, 0)                       retreat of the whole fan of normals
    w  = min(ρ, max(|D'| - c - a, 0))                    while the plate slides, the gap takes it up to P;
    v  = min(ρ - w, P)                                   else it unloads the spring;                            (10c)
    q  = min(w, max(P - v - g + c, 0))                   what the gap takes
    r  = ρ - v - q                                       the rest is beyond contact
    h  = |D'| - r - c                                    path in contact
    τ1 = τ + k v n - k min(a, h) u                       spring, for h > 0                                      (10d)
    p  = max(h - a, 0)                                   plastic path: τ approaches t, and y approaches |τ|
    τ2 = t + (τ1 - t) e^(-(1 + f) p / λ),   y <- |τ2| + (y - |τ1|) e^(-(1 + f) p / λ)                           (10e)
    τ <- τ2 max(1 - k max(-h, 0) / |τ2|, 0),   y <- max(y (1 - r / F λ), |τ|),   g <- g - c + q + G r            (10f)

In words: within its yield surface a plate is a spring. Beyond, it yields: its traction approaches the law's over the
path λ, and up to twice as fast where it falls; f is the positive part of τ1·(τ1 - t) / (|τ1 - t| max(|τ1|, |τ1 - t|)).
Grains do not pull: a plate that retreats from them unloads, then loses what is left of its traction and opens a gap,
which closes before they push again. A plate that slides keeps its pressure until it has retreated by P, so that noise
to and fro across its motion does not unload it.

λ is the mobilization length times (d / `DEPTH`)² at the plate's depth d, within `LEAST` and `GREATEST`.

Continuity. Each line is Lipschitz in D, n, t and the state, and under the refined rule the share, and so t, is
continuous too; v·n = 0, D·n = 0, g = 0 and τ = 0 are no special cases. A state at which the plate has not moved
changes nothing, whatever its time and velocity. Two jumps are left: a plate that leaves the grains loses its memory,
and a vanishing velocity can have any direction, which decides t once the plate moves.

Energy. At constant depth no closed path yields work. Per depth and area a plate stores |τ|² / 2k: the spring gives
back what it took, yielding takes since the law resists (`rft.traction.LEAST_RESISTANCE`), and a release only loses.
With a change of depth the force follows the load at constant τ.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np

from rft_ros.rft.kernel import chunk as row
from rft_ros.rft.kernel.chunk import at, put, triple, wide_vectors
from rft_ros.rft.kernel.compilation import STEP, compiled, inlined
from rft_ros.rft.memory_state import FAR, GAP, HEAD, OF_BLOCK, RADIUS, TAU, moved_by
from rft_ros.rft.plates import BLOCK

__all__ = ["DEPTH", "STIFF", "Mobilization", "add_memory", "advance", "follow_gap", "is_elastic"]

DEPTH = 0.03
"""Depth [m] at which a plate's λ equals the mobilization length; λ grows with the square of depth."""

LEAST, GREATEST = 0.1, 2.25
"""The least and the greatest λ(d), over the mobilization length: those of 9.5 and 45 mm of depth."""

STIFF = 12.0
"""E: modulus of the spring, over the strength of the law and λ."""

FADES = 3.0
"""F: path of retreat over which the yield surface shrinks, over λ."""

OPEN = 0.2
"""G: growth of the gap over the retreat."""


class Mobilization(NamedTuple):
    """The numbers of a law that its memory takes: mobilization length [m] and strength [N/m³]."""

    length: float
    strength: float


_TINY = 1e-60  # least tractions per depth, and lengths, that are divided by


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
def advance(past, normal, width, moved, target, span, strength):
    """A plate's traction τ, yield radius y and gap g after one step, Eqs. (10a) to (10f), and its tangent [N/m⁴].

    `past`: the three before. `width`: sin θ. `moved`: the displacement D [m]. `target`: t [N/m³]. `span`: λ [m].
    `strength`: σ [N/m³]. The tangent: the modulus of the change of the traction with the displacement.
    """
    (tau_x, tau_y, tau_z), radius, gap = past
    nx, ny, nz = normal
    dx, dy, dz = moved
    tx, ty, tz = target
    per_modulus = span * (1.0 / (STIFF * strength))

    outward = dx * nx + dy * ny + dz * nz
    closed = min(max(outward, 0.0), gap)
    drop = min(outward, closed)
    dx, dy, dz = dx - drop * nx, dy - drop * ny, dz - drop * nz
    way = sqrt(dx * dx + dy * dy + dz * dz)
    length = max(way, _TINY)
    inverse = 1.0 / (length * span)  # one division for two
    per_way, per_span = span * inverse, length * inverse
    modulus = STIFF * strength * per_span
    ux, uy, uz = dx * per_way, dy * per_way, dz * per_way

    pressure = max(-(tau_x * nx + tau_y * ny + tau_z * nz), 0.0) * per_modulus
    along = ux * tau_x + uy * tau_y + uz * tau_z
    tau = sqrt(tau_x * tau_x + tau_y * tau_y + tau_z * tau_z)
    reach = (2.0 * max(along, 0.0) + max(radius - tau, 0.0)) * per_modulus

    retreat = max(-outward - width * way, 0.0)
    slips = min(retreat, max(way - closed - reach, 0.0))
    unloads = min(retreat - slips, pressure)
    slack = min(slips, max(pressure - unloads - (gap - closed), 0.0))
    beyond = retreat - unloads - slack
    relief = modulus * unloads
    tau_x, tau_y, tau_z = tau_x + relief * nx, tau_y + relief * ny, tau_z + relief * nz
    contact = way - beyond - closed
    path = max(contact, 0.0)
    elastic = min(reach, path)
    plastic, fall = path - elastic, modulus * elastic
    tau_x, tau_y, tau_z = tau_x - fall * ux, tau_y - fall * uy, tau_z - fall * uz

    cx, cy, cz = tx - tau_x, ty - tau_y, tz - tau_z
    change, tried = sqrt(cx * cx + cy * cy + cz * cz), sqrt(tau_x * tau_x + tau_y * tau_y + tau_z * tau_z)
    falls = max(-(cx * tau_x + cy * tau_y + cz * tau_z), 0.0) / max(change * max(change, tried), _TINY)
    approach = 1.0 - _exp_minus(plastic * per_span * (1.0 + falls))
    tau_x, tau_y, tau_z = tau_x + approach * cx, tau_y + approach * cy, tau_z + approach * cz
    size = sqrt(tau_x * tau_x + tau_y * tau_y + tau_z * tau_z)
    radius += (size - tried) - approach * max(radius - tried, 0.0)

    keeps = 1.0 - min(modulus * max(-contact, 0.0), size) / max(size, _TINY)
    radius = max(radius * max(1.0 - beyond * per_span * (1.0 / FADES), 0.0), keeps * size)
    tangent = modulus + plastic * per_way * (max(size, change) * per_span - modulus)
    tangent *= 1.0 if keeps * size > 0.0 else 0.0  # without traction nothing is stiff
    return (keeps * tau_x, keeps * tau_y, keeps * tau_z), radius, gap - closed + slack + OPEN * beyond, tangent


def _add_memory(chunk, count, memory, motion, below, slope, mobilization):
    """Replace the law's tractions of the blocks in a chunk, `count`, by those with memory, and store their states.

    `memory`: a row of `Memory.numbers`. `motion`: of `displacement`, world axes; `below`, `slope`: depth of the tool
    frame's origin [m], and the surface's; `mobilization`: of the law.
    """
    wide_vectors()
    for b in range(count):
        first = np.uint64(HEAD) + np.uint64(chunk[at(row.NUMBER, b)]) * np.uint64(OF_BLOCK)
        for j in range(BLOCK):
            i = at(np.uint64(b) * np.uint64(BLOCK), j)
            x, y, z = place = triple(chunk, row.PLACE, i)
            ex, ey, ez = moved = moved_by(motion, place)
            # the depth half a step before
            depth = below - z + 0.5 * ez + slope[0] * (x - 0.5 * ex) + slope[1] * (y - 0.5 * ey)
            ratio = min(max(depth * depth * (1.0 / (DEPTH * DEPTH)), LEAST), GREATEST)
            span = max(mobilization.length, 1.0 / FAR) * ratio
            share, (tx, ty, tz) = chunk[at(row.SHARE, i)], triple(chunk, row.TRACTION, i)
            target = share * tx, share * ty, share * tz
            kept = triple(memory, first + TAU, j, BLOCK)
            past = kept, memory[at(first + RADIUS, j)], memory[at(first + GAP, j)]
            normal, width = triple(chunk, row.NORMAL, i), 0.5 / chunk[at(row.PER_WIDTH, i)]
            traction, radius, gap, tangent = advance(past, normal, width, moved, target, span, mobilization.strength)
            load = chunk[at(row.LOAD, i)]
            wet = 1.0 if load > 0.0 else 0.0
            traction = wet * traction[0], wet * traction[1], wet * traction[2]
            put(chunk, row.TRACTION, i, traction)
            chunk[at(row.TANGENT, i)] = tangent * max(load, 0.0)
            put(memory, first + TAU, j, traction, BLOCK)
            memory[at(first + RADIUS, j)] = wet * radius
            memory[at(first + GAP, j)] = wet * gap


add_memory = compiled(_add_memory, **STEP)


@inlined
def is_elastic(memory, first):
    """Whether a plate of the block that begins at `first` has a yield surface, without which it has no traction."""
    sum_of_radii = 0.0
    for i in range(BLOCK):
        sum_of_radii += memory[at(first + RADIUS, i)]
    return sum_of_radii > 0.0


@inlined
def follow_gap(memory, first, i, normal, place, motion):
    """`advance` for plate i of a block that is not elastic and trails: of its memory only the gap changes.

    `motion`: of `displacement`, in the axes of normal and place.
    """
    (nx, ny, nz), (dx, dy, dz) = normal, moved_by(motion, place)
    along, gap = dx * nx + dy * ny + dz * nz, memory[at(first + GAP, i)]
    memory[at(first + GAP, i)] = max(gap - max(along, 0.0), 0.0) + OPEN * max(-along, 0.0)

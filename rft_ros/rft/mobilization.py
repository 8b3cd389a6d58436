"""Forces with a memory: grains must be sheared over a distance before they push with full strength.

Each plate keeps its traction per depth, which follows what the law asks for over the plate's own path, Eq. (10):
dτ/ds = (t - τ) / λ. At rest no path is made and the traction stays. This is not in the paper, which sees the lag and
leaves it out; the numbers that decided the form below are in docs/accuracy.md.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from rft_ros.rft.alpha_y import Table
from rft_ros.rft.blocks import BLOCK, CUT, PLAIN, SKIP_DRY, SKIP_WET, kind_of_block
from rft_ros.rft.compiled import OPTIONS, SOURCE, forgiving, inlined, machine_code
from rft_ros.rft.element import element, motion, seen_from_tool
from rft_ros.rft.kernel import added, with_area
from rft_ros.rft.plates import Plates
from rft_ros.rft.traction import BLENDED, NEVER_FLAT, SWITCHED, Law, traction_per_depth

__all__ = ["DEPTH", "TRAILING", "Memory", "wrenches_in_time"]

DEPTH = 0.03
"""Depth [m] at which a plate's λ is the mobilization length; it grows with the square of depth."""

TRAILING = 0.04
"""λ of a plate that no longer leads, over that of one whose traction grows."""

_FADING = 5
"""Beside the kinds of `blocks`: all plates are submerged, none leads, and they remember."""

_NONE = 1e-100
"""Share of a plate that does not lead: what it forgets must not fade into numbers that the processor is slow with."""

_FORGOTTEN = 1e-9
"""Tractions of a trailing block, over the law's stiffness, that are as good as none."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """What the plates of one tool remember, in the order of their blocks.

    `tractions`: shape [6, m]: traction per depth [N/m³], world axes, and what the law last asked for. `active`: shape
    [m / BLOCK], 1 where a block remembers anything. `motion`: shape [7]: speed of the last state [m/s], -1 before any,
    and the last twist that was not zero, scaled to order one.
    """

    tractions: Array
    active: NDArray[np.uint8]
    motion: Array

    @classmethod
    def of(cls, plates: Plates) -> "Memory":
        """An empty memory for these plates."""
        m = plates.blocks.rows.shape[1]
        memory = cls(np.empty((6, m)), np.empty(m // BLOCK, dtype=np.uint8), np.empty(7))
        memory.forget()
        return memory

    def forget(self) -> None:
        """Begin anew: the tool was moved by nobody knows what."""
        self.tractions[:] = 0.0
        self.active[:] = 0
        self.motion[:] = 0.0
        self.motion[0] = -1.0


@inlined
def _left(x):  # type: ignore[no-untyped-def]
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
def _sum(rows, first, last, scene, refined, careful, flatness, path, per_length, memory):  # type: ignore[no-untyped-def]
    """As in `kernel`, with memory. `path`: metres for each unit of scaled speed; `per_length`: DEPTH² / λ [m]."""
    axes, twist, law, below = scene
    fx = fy = fz = tx = ty = tz = submerged = 0.0
    sunk = 0.5 * path * twist[2]  # the depth halfway through the step lies by this much from that at its end
    loading = path * per_length
    trailing = loading / TRAILING
    for i in range(first, last):
        place, normal, (ux, uy, uz), load, share, area = element(rows, i, axes, twist, below, refined, careful)
        (x, y, z), (nx, ny, nz) = place, normal
        share = max(share, _NONE)
        # before the law, which takes long and does not need it
        squared = ux * ux + uy * uy + uz * uz
        depth = below - z + sunk
        ratio = loading if share > _NONE else trailing
        left = _left(ratio * squared / (sqrt(max(squared, 1e-290)) * (depth * depth + 1e-30)))
        ax, ay, az = traction_per_depth(law, nx, ny, nz, ux, uy, uz, flatness)
        ax, ay, az = ax * share, ay * share, az * share
        mx, my, mz = memory[0, i], memory[1, i], memory[2, i]
        bx, by, bz = memory[3, i], memory[4, i], memory[5, i]
        memory[3, i], memory[4, i], memory[5, i] = ax, ay, az
        # the mean of what is asked for at both ends of the step makes it exact to second order
        gx, gy, gz = 0.5 * (ax + bx) - mx, 0.5 * (ay + by) - my, 0.5 * (az + bz) - mz
        # λ is half as long for a traction that grows less: twice the exponent
        w = 1.0 - (left * left if (gx * mx + gy * my + gz * mz < 0.0) & (share > _NONE) else left)
        mx, my, mz = mx + w * gx, my + w * gy, mz + w * gz
        if careful:
            mx, my, mz = (mx if load > 0.0 else 0.0), (my if load > 0.0 else 0.0), (mz if load > 0.0 else 0.0)
        memory[0, i], memory[1, i], memory[2, i] = mx, my, mz
        dx, dy, dz = mx * load, my * load, mz * load
        fx += dx
        fy += dy
        fz += dz
        tx += y * dz - z * dy
        ty += z * dx - x * dz
        tz += x * dy - y * dx
        submerged += area
    return fx, fy, fz, tx, ty, tz, submerged


@inlined
def _fades(memory, b, small):  # type: ignore[no-untyped-def]
    """Whether a block remembers next to nothing, which is then forgotten."""
    largest = 0.0
    for i in range(b * np.uint64(BLOCK), (b + np.uint64(1)) * np.uint64(BLOCK)):
        largest = max(largest, abs(memory[0, i]), abs(memory[1, i]), abs(memory[2, i]))
    return largest < small


@inlined
def _forget(memory, b):  # type: ignore[no-untyped-def]
    for i in range(b * np.uint64(BLOCK), (b + np.uint64(1)) * np.uint64(BLOCK)):
        for k in range(6):
            memory[k, i] = 0.0


@inlined
def _kind(bounds, b, seen, below, refined, active):  # type: ignore[no-untyped-def]
    """As `kind_of_block`; a block that trails and remembers is not passed over."""
    kind = kind_of_block(bounds, b, seen, below, refined)
    return _FADING if kind == SKIP_WET and active[b] else kind


def _kernel(source: int, refined: bool) -> Any:
    """The compiled loop over states in the order of time; see `kernel._kernels` for the cache."""
    flatness = BLENDED if refined else SWITCHED

    def in_time(rows, bounds, reach, law, span, surface, states, durations, memory, active, last, out):  # type: ignore[no-untyped-def]
        if source == 0:
            return
        per_length = min(DEPTH * DEPTH / span, 1e100)
        for k in range(states.shape[0]):
            axes, twist, scale = motion(states[k], reach)
            if scale > 0.0:
                for c in range(6):
                    last[1 + c] = twist[c]
            # a tool at rest is asked what it was asked while it moved; its path is 0
            twist = last[1], last[2], last[3], last[4], last[5], last[6]
            below = surface - states[k, 2]
            seen = seen_from_tool(axes, twist, reach)
            # metres for each unit of scaled speed: as fast as the mean of both ends of the step
            fastest = seen[2]
            now = fastest / scale if scale > 0.0 else 0.0
            before = last[0] if last[0] >= 0.0 else now
            path = 0.5 * (now + before) / fastest * durations[k] if now > 0.0 else 0.0
            last[0] = now
            total = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            # unsigned, or numba looks for negative indices in the inner loops
            b, blocks = np.uint64(0), np.uint64(bounds.shape[0])
            kind = _kind(bounds, b, seen, below, refined, active)
            while b < blocks:
                # one submerged block after a cut one goes with it: to begin a run costs more
                first, run, previous = b, kind, kind
                while b < blocks and (kind == run or (kind == PLAIN and previous == CUT)):
                    previous = kind
                    if kind == SKIP_DRY and active[b]:
                        _forget(memory, b)
                        active[b] = 0
                    total = with_area(total, bounds[b, 18] if kind == SKIP_WET else 0.0)
                    b += np.uint64(1)
                    if b < blocks:
                        kind = _kind(bounds, b, seen, below, refined, active)
                if run >= PLAIN:
                    i, j = first * np.uint64(BLOCK), b * np.uint64(BLOCK)
                    scene = axes, twist, law, below
                    if run == PLAIN:
                        part = _sum(rows, i, j, scene, refined, False, NEVER_FLAT, path, per_length, memory)
                    elif run in (CUT, _FADING):
                        part = _sum(rows, i, j, scene, refined, True, NEVER_FLAT, path, per_length, memory)
                    else:
                        part = _sum(rows, i, j, scene, refined, True, flatness, path, per_length, memory)
                    total = added(total, part)
                    for c in range(first, b):
                        active[c] = 1
                        if run == _FADING and _fades(memory, c, _FORGOTTEN * law.stiffness):
                            _forget(memory, c)
                            active[c] = 0
            for c in range(7):
                out[k, c] = total[c]

    in_time.__qualname__ += "_refined" if refined else "_centroid"
    return forgiving(numba.njit(nogil=True, **OPTIONS)(in_time))


_KERNELS = {"centroid": _kernel(SOURCE, False), "refined": _kernel(SOURCE, True)}
_ENTRIES: dict[tuple[str, type, type], Callable[..., None]] = {}


def wrenches_in_time(
    plates: Plates,
    law: Law,
    states: Array,
    durations: Array,
    memory: Memory,
    *,
    mobilization_length: float,
    surface_height: float = 0.0,
    out: Array | None = None,
) -> Array:
    """As `rft_ros.rft.wrenches`, of plates that remember: states, shape [n, 13], in the order of time.

    `durations`: shape [n], time [s] since the state before; 0 for the first of all. `memory`: of these plates, changed
    in place. `mobilization_length`: λ of a plate `DEPTH` deep [m], over 0.
    """
    if out is None:
        out = np.empty((len(states), 7))
    key = plates.integration, law.__class__, law.alpha_y.__class__
    entry = _ENTRIES.get(key)
    blocks = plates.blocks
    geometry = blocks.rows, blocks.bounds, plates.reach
    medium = law, mobilization_length, surface_height
    arguments = *geometry, *medium, states, durations, memory.tractions, memory.active, memory.motion, out
    if entry is None:
        entry = machine_code(_KERNELS[plates.integration], arguments)
        if not isinstance(law.alpha_y, Table):  # how its arrays lie in memory is part of its type
            _ENTRIES[key] = entry
    entry(*arguments)
    return out

"""The tool at some moments of a replay, coloured by traction."""

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.estimates import PHASES
from rft_ros.bags.phases import Phase
from rft_ros.estimator import Model
from rft_ros.report.animation import Animation, animate

__all__ = ["tool_animation"]

_FRACTIONS = (0.25, 0.5, 0.75)
_MOST_FACES = 4000


def tool_animation(rows: NDArray[np.void], model: Model, *, surface_height: float) -> Animation | None:
    """The tool on its way to the deepest penetration, there (shown first), and in the middle of the phases after it.

    `rows`: of a trace, with `state`. None if no estimate has the tool in the grains.
    """
    indices, chosen = _moments(rows)
    if not indices:
        return None
    states = np.array(rows["state"][indices])
    states[:, :2] = 0.0  # a recording may cross the bed
    return animate(
        f"Tool and traction{' (law without memory)' if model.mobilization_length > 0.0 else ''}",
        model.tool,
        model.law,
        states,
        [f"{1e3 * row['depth']:.1f} mm, {PHASES[row['phase']]}" for row in rows[indices]],
        surface_height=surface_height,
        first=chosen,
        most_faces=_MOST_FACES,
    )


def _moments(rows: NDArray[np.void]) -> tuple[list[int], int]:
    """Rows to show, in order, and which of them is the deepest of penetration (of anything, if there is none)."""
    answered = ~np.isnan(rows["predicted"][:, 0]) & (rows["depth"] > 0.0)
    sinking = answered & (rows["phase"] == PHASES.index(Phase.PENETRATION))
    use = np.flatnonzero(sinking if sinking.any() else answered)
    if not len(use):
        return [], 0
    depth = rows["depth"]
    deepest = int(use[np.argmax(depth[use])])
    before = use[use <= deepest]
    found = {deepest}
    for fraction in _FRACTIONS:
        found.add(int(before[np.argmin(np.abs(depth[before] - fraction * depth[deepest]))]))
    for phase in (Phase.PLOUGHING, Phase.WITHDRAWAL):
        after = np.flatnonzero(answered & (rows["phase"] == PHASES.index(phase)))
        if len(after):
            found.add(int(after[len(after) // 2]))
    ordered = sorted(found)
    return ordered, ordered.index(deepest)

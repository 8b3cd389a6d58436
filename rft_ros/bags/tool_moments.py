"""The tool at some moments of a replay, coloured by traction."""

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.estimates import PHASES
from rft_ros.bags.phases import Phase
from rft_ros.estimator import Model
from rft_ros.report.charts import ToolView, TractionMoment
from rft_ros.rft import plate_forces, rotation_matrix
from rft_ros.tool.drawing import drawable

__all__ = ["tool_view"]

_FRACTIONS = (0.25, 0.5, 0.75)
_MOST_FACES = 4000
_FORGETFUL = " The traction is that of the law at full strength: what the grains remember is left out of this picture."


def tool_view(rows: NDArray[np.void], model: Model, *, surface_height: float) -> ToolView | None:
    """The tool on its way to the deepest penetration, there (shown first), and in the middle of the phases after it.

    `rows`: of a trace, with `state`. None if no estimate has the tool in the grains.
    """
    indices, chosen = _moments(rows)
    if not indices:
        return None
    vertices, faces, plates = drawable(model.tool, most_faces=_MOST_FACES)
    moments = []
    for index in indices:
        row = rows[index]
        state = np.array(row["state"])
        forces = plate_forces(plates, model.law, state, surface_height=surface_height)
        placed = vertices @ rotation_matrix(state[3:7]).T
        placed[:, 2] += state[2]
        force = forces.sum(axis=0).tolist()
        moments.append(
            TractionMoment(
                label=f"{1e3 * row['depth']:.1f} mm, {PHASES[row['phase']]}",
                vertices=placed,
                traction=np.linalg.norm(forces, axis=1) / plates.packed[6],
                force=(force[0], force[1], force[2]),
            )
        )
    return ToolView(
        title="Tool and traction",
        sentence="The tool coloured by the predicted traction on its leading faces, in world axes (x and y from the"
        " tool's origin), the surface of the grains, and the predicted force as an arrow. The slider goes through"
        " moments of the recording." + (_FORGETFUL if model.mobilization_length > 0.0 else ""),
        faces=faces,
        moments=tuple(moments),
        chosen=chosen,
        surface_height=surface_height,
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

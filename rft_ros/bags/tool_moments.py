"""The tool at some moments of a replay, coloured by traction."""

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.phases import Phase
from rft_ros.bags.trace import PHASES
from rft_ros.estimator import Model
from rft_ros.report.charts import ToolView, TractionMoment
from rft_ros.rft import Plates, plate_forces, rotation_matrix
from rft_ros.tool import Tool

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
    vertices, faces = _drawable(model.tool)
    plates = _plates(vertices, faces)
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


def _drawable(tool: Tool) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices and faces, few enough for a page."""
    if len(tool.faces) <= _MOST_FACES:
        return tool.vertices, tool.faces
    import fast_simplification  # type: ignore[import-untyped]

    vertices, faces = fast_simplification.simplify(
        np.asarray(tool.vertices, dtype=np.float64), tool.faces.astype(np.int32), target_count=_MOST_FACES
    )
    vertices, faces = np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)
    return vertices, faces[np.linalg.norm(_areas(vertices, faces), axis=1) > 0.0]


def _areas(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64]:
    """Area vectors, outwards, shape [m, 3] [m²]."""
    a, b, c = vertices[faces.T]
    return np.asarray(np.cross(b - a, c - a) / 2.0)


def _plates(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> Plates:
    areas = _areas(vertices, faces)
    return Plates.from_arrays(vertices[faces].mean(axis=1), areas, np.linalg.norm(areas, axis=1))

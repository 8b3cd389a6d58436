"""What a tool goes through along its states, as a scene to be drawn."""

import numpy as np
from numpy.typing import NDArray

from rft_ros.report.moving_tool import MovingTool
from rft_ros.rft import Law, plate_forces, rotation_matrix
from rft_ros.tool import Tool
from rft_ros.tool.drawing import drawable

__all__ = ["moving_tool"]

_MOMENTS = 60
_MOST_FACES = 1500


def moving_tool(
    title: str,
    tool: Tool,
    law: Law,
    times: NDArray[np.float64],
    states: NDArray[np.float64],
    surface_height: float = 0.0,
) -> MovingTool:
    """The scene of states, shape [n, 13], at times [s], shape [n]; at most 60 moments, evenly by number.

    The traction is the law's, without memory. `surface_height` [m].
    """
    chosen = np.unique(np.linspace(0, len(states) - 1, min(len(states), _MOMENTS)).round().astype(int))
    vertices, faces, plates = drawable(tool, most_faces=_MOST_FACES)
    forces = np.array([plate_forces(plates, law, states[k], surface_height=surface_height) for k in chosen])
    placed = [vertices @ rotation_matrix(states[k, 3:7]).T + states[k, :3] for k in chosen]
    return MovingTool(
        title=title,
        times=times[chosen],
        placed=np.array(placed),
        faces=faces,
        traction=np.linalg.norm(forces, axis=2) / plates.packed[6],
        origins=states[chosen, :3],
        forces=forces.sum(axis=1),
        surface_height=surface_height,
    )

"""The face of a plate that is dragged: its plates alone, its depth, and forces along its own axes."""

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import Law, Plates, wrenches
from rft_ros.studies.motions import PlateDrag
from rft_ros.tool import Tool

__all__ = ["BELOW_90", "along_axes", "drag_force", "face", "face_depths"]

Array = NDArray[np.float64]

BELOW_90 = 90.0 - 1e-6
"""ψ [deg] in place of 90, where a vertical plate moves along itself and rounding decides whether its face leads."""


def face(tool: Tool) -> Plates:
    """The plates of the side that leads in `PlateDrag`, tool -z, without the narrow edges and the back."""
    rows = tool.plates.rows
    return Plates.from_rows(rows[:, rows[5] < -0.999])


def face_depths(own: Plates, states: Array) -> Array:
    """Depth of a face's middle below z = 0 [m] at states, shape [n, 13]; shape [n]."""
    offset = float(np.average(own.packed[2], weights=own.packed[6]))
    return np.asarray(-states[:, 2] - offset * (1.0 - 2.0 * (states[:, 3] ** 2 + states[:, 4] ** 2)))


def along_axes(forces: Array, psi_deg: float) -> Array:
    """Forces [N], shape [.., 3], along e1, e2, E3 of a plate whose e2 lies psi_deg [deg] from +x; same shape."""
    psi = np.deg2rad(psi_deg)
    sin, cos = np.sin(psi), np.cos(psi)
    return np.asarray(forces @ np.array([[sin, cos, 0.0], [-cos, sin, 0.0], [0.0, 0.0, 1.0]]))


def drag_force(plates: Plates, law: Law, drag: PlateDrag) -> Array:
    """Force along e1, e2, E3 on plates at the start of a drag [N], shape [3]."""
    return along_axes(wrenches(plates, law, drag.at(0.0))[0, :3], drag.psi_deg)

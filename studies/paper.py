"""The paper's medium, bodies and plate (Treers, Cao, Stuart 2021), as the studies use them."""

import math

import numpy as np
from numpy.typing import NDArray

from rft_ros.installation import share_directory
from rft_ros.parameters import Config, read_parameter_file
from rft_ros.rft import MEDIA, Law, Plates, alpha_y_model, law_named, wrenches
from rft_ros.sweeps.motions import Trajectory
from rft_ros.tool import Tool

__all__ = ["ALPHA_Y", "BELOW_90", "NOT_STATED", "PUBLISHED", "ZETA"]
__all__ += [
    "drag_force",
    "ellipsoid",
    "face_depths",
    "in_plate_axes",
    "law",
    "leading_face",
    "plate",
    "root_tip",
]

Array = NDArray[np.float64]

PUBLISHED = read_parameter_file(share_directory("rft_ros") / "config" / "published.yaml").values
"""The parameters of the model as published."""

ZETA = 0.33
"""Scale factor of the paper's glass beads: the mean of five vertical penetrations."""

ALPHA_Y = ("constant", "linear")
"""The paper's two models of α_y (IV-B)."""

NOT_STATED = "–"
"""Shown in place of a published number that this project does not have."""

BELOW_90 = 90.0 - 1e-6
"""ψ [deg] in place of 90, where a vertical plate moves in its own plane and rounding decides whether its face leads."""


def law(alpha_y: str, *, zeta: float = ZETA, name: str = "treers2021", **grains: float) -> Law:
    """The paper's model with Li's generic coefficients and α_y `constant` or `linear`; or the law of another name.

    `grains`: further numbers of a law, such as `density` [kg/m³] and `mobilization_length` [m].
    """
    generic = MEDIA["generic"]
    return law_named(name, generic, alpha_y_model(alpha_y, generic), zeta=zeta, **grains)


def plate() -> Tool:
    """The plate of Fig. 3: 51 mm square. Its thickness, 3.2 mm, is this project's choice. Published rule."""
    return _published_tool("plate")


def ellipsoid() -> Tool:
    """The ellipsoid of Fig. 7, 36 x 19 x 19 mm, origin at its centre; the shipped mesh, published rule."""
    return _published_tool("ellipsoid")


def root_tip() -> Tool:
    """The root tip of Fig. 8, 20 mm wide, 34.5 mm long; the shipped mesh, published rule.

    The origin lies 1.25 mm above its base, as the released code's centre of rotation does.
    """
    return _published_tool("root_tip", origin=(0.0, 0.0, 1.25))


def _published_tool(mesh: str, *, origin: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Tool:
    return Config.of({**PUBLISHED, "mesh.file": mesh, "mesh.origin": origin}).mesh.load()


def leading_face(tool: Tool) -> Plates:
    """The plates of the side that leads in `plate_drag` (tool -z), without the edges and the back."""
    rows = tool.plates.rows
    return Plates(rows[:, rows[5] < -0.999])


def face_depths(face: Plates, states: Array) -> Array:
    """Depth of a face's middle below z = 0 [m] at states, shape [n, 13]; shape [n]."""
    offset = float(np.average(face.centroids[2], weights=face.areas))
    return np.asarray(
        -states[:, 2] - offset * (1.0 - 2.0 * (states[:, 3] ** 2 + states[:, 4] ** 2))
    )


def in_plate_axes(forces: Array, psi_deg: float) -> Array:
    """Forces [N], shape [.., 3], along e1, e2, E3 of a plate whose e2 lies psi_deg [deg] from +x; same shape."""
    psi = np.deg2rad(psi_deg)
    sin, cos = np.sin(psi), np.cos(psi)
    return np.asarray(forces @ np.array([[sin, cos, 0.0], [-cos, sin, 0.0], [0.0, 0.0, 1.0]]))


def drag_force(plates: Plates, law: Law, drag: Trajectory) -> Array:
    """Force along e1, e2, E3 on plates at the start of a drag [N], shape [3]."""
    return in_plate_axes(wrenches(plates, law, drag.at(0.0))[0, :3], math.degrees(drag.yaw))

"""Concave tools: facets that face each other count fully, though the grains between them may move with the tool."""

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rft_ros.rft import plate_forces
from studies.paper import law
from studies.parameter_sweep import both_rules, scene_states
from studies.result import BLUE, GREEN, StudyResult, label_axes, new_figure, result_of_rows

__all__ = ["DEPTHS", "GAPS", "bowl", "fork", "resistance", "study"]

Array = NDArray[np.float64]

DEPTHS = (0.0, 0.005, 0.01, 0.015, 0.02, 0.025)
"""Depths of a bowl's hollow [m]; its mouth is 50 mm wide and faces down."""

GAPS = (0.0025, 0.005, 0.01, 0.02, 0.04)
"""Gaps between the two plates of a fork [m]; the plates are 50 mm square."""

_RADIUS, _WALL = 0.025, 0.002
_DOWN, _FORWARD = np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])


def bowl(depth: float) -> trimesh.Trimesh:
    """A bowl with its mouth down and an ellipsoidal hollow of this depth [m]; a disc for 0."""
    t = np.linspace(0.0, 0.5 * np.pi, 13)
    inside = np.column_stack([_RADIUS * np.sin(t), depth * np.cos(t)])
    outside = np.column_stack([(_RADIUS + _WALL) * np.sin(t[::-1]), (depth + _WALL) * np.cos(t[::-1])])
    mesh = trimesh.creation.revolve(np.vstack([inside, outside]), sections=32)
    if mesh.volume < 0.0:
        mesh.invert()
    return mesh


def fork(gap: float) -> trimesh.Trimesh:
    """Two upright plates, one behind the other along x, with this gap [m]."""
    plates = [trimesh.creation.box((0.003, 0.05, 0.05)).subdivide().subdivide() for _ in range(2)]
    for plate, side in zip(plates, (-0.5, 0.5), strict=True):
        plate.apply_translation([side * (gap + 0.003), 0.0, 0.0])
    return trimesh.util.concatenate(plates)


def resistance(mesh: trimesh.Trimesh, direction: Array) -> float:
    """Force against a motion [N]: refined rule, α_y constant, ζ = 1, the tool frame's origin 50 mm deep."""
    state = scene_states(Rotation.identity(), velocity=0.01 * direction)[0]
    forces = plate_forces(both_rules(mesh)["refined"], law("constant", zeta=1.0), state)
    return float(-(forces @ direction).sum())


def study() -> StudyResult:
    """Bowls pushed mouth first and forks dragged, over the force on their convex hulls."""
    kinds = (
        ("bowl", DEPTHS, bowl, _DOWN, "A bowl pushed down mouth first", "Depth of the hollow [mm]"),
        ("fork", GAPS, fork, _FORWARD, "Two plates, one behind the other, dragged", "Gap between the plates [mm]"),
    )
    figure = new_figure(8.4, 3.4)
    rows = []
    for axes, (kind, sizes, build, direction, title, x) in zip(figure.subplots(1, 2), kinds, strict=True):
        shares = []
        for size in sizes:
            mesh = build(size)
            shares.append(resistance(mesh, direction) / resistance(mesh.convex_hull.subdivide(), direction))
        rows += [(kind, size, share) for size, share in zip(sizes, shares, strict=True)]
        axes.axhline(100.0, color=GREEN, ls="--", label="convex hull (grains in the hollow move along)")
        axes.plot(1e3 * np.array(sizes), 100.0 * np.array(shares), "o-", color=BLUE, label="as computed")
        axes.set_ylim(0.0, 240.0)
        label_axes(axes, x=x, y="Force / force on the convex hull [%]", title=title)
    figure.axes[0].legend(fontsize=8)
    columns = (("tool", "{}"), ("hollow or gap", "{:.1f} mm", 1e3), ("force / force on the hull", "{:.0f} %", 100.0))
    return result_of_rows("fails_hollow", "Concave tools", figure, rows, *columns)

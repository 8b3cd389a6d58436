"""Concave tools: facets that face each other count fully, though the grains between them may move with the tool."""

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rft_ros.rft import plate_forces
from studies.paper import law
from studies.parameter_sweep import both_rules, scene_states
from studies.result import BLUE, GREEN, VERMILION, StudyResult, label_axes, new_figure, result_of_rows

__all__ = ["DEPTHS", "GAPS", "blocked", "bowl", "concavity", "fork", "resistance", "study"]

Array = NDArray[np.float64]

DEPTHS = (0.0, 0.005, 0.01, 0.015, 0.02, 0.025)
"""Depths of a bowl's hollow [m]; its mouth is 50 mm wide and faces down."""

GAPS = (0.0025, 0.005, 0.01, 0.02, 0.04)
"""Gaps between the two plates of a fork [m]; the plates are 50 mm square."""

_RADIUS, _WALL = 0.025, 0.002
_DOWN, _FORWARD = np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])
_FACETS, _RAYS = 64, 64  # facets that `concavity` samples, and rays from each
_AT_ONCE = 256  # rays, to bound memory
_INSIDE = 1e-9  # of a triangle: a ray that grazes its edge passes


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


def _hits(triangles: Array, origins: Array, directions: Array) -> NDArray[np.bool_]:
    """Which rays meet a triangle beyond a millionth of the largest coordinate (Möller and Trumbore 1997)."""
    corner, first, second = (
        triangles[:, 0],
        triangles[:, 1] - triangles[:, 0],
        triangles[:, 2] - triangles[:, 0],
    )
    near = 1e-6 * np.abs(triangles).max()
    found = []
    for k in range(0, len(origins), _AT_ONCE):
        ray = directions[k : k + _AT_ONCE, None]
        to = origins[k : k + _AT_ONCE, None] - corner
        across, aside = np.cross(ray, second), np.cross(to, first)
        determinant = (first * across).sum(axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v = (to * across).sum(axis=-1) / determinant, (ray * aside).sum(axis=-1) / determinant
            distance = (second * aside).sum(axis=-1) / determinant
            inside = np.minimum(np.minimum(u, v), 1.0 - u - v) > _INSIDE
        parallel = np.abs(determinant) < 1e-12 * (first**2).sum(axis=-1)
        found.append((inside & (distance > near) & ~parallel).any(axis=1))
    return np.concatenate(found)


def blocked(triangles: Array, directions: Array) -> NDArray[np.bool_]:
    """Whether a ray from each facet's middle in its direction meets another facet; shapes [n, 3, 3], [n, 3] -> [n]."""
    return _hits(triangles, triangles.mean(axis=1), directions)


def concavity(triangles: Array) -> float:
    """Share of a tool's view, by area and cosine, that is the tool itself; triangles of shape [n, 3, 3].

    0 for a convex tool, 1/2 inside a hemisphere. Samples at most 128 facets along 64 rays each.
    """
    doubled = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = 0.5 * np.linalg.norm(doubled, axis=1)
    some = np.flatnonzero(area > 0.0)[:: 1 + len(area) // (2 * _FACETS)]
    normal = doubled[some] / (2.0 * area[some, None])
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normal, first)
    # a spiral that fills the unit disc evenly; lifted to the half sphere it is cosine weighted (Malley's method)
    k = np.arange(_RAYS) + 0.5
    radius, angle = np.sqrt(k / _RAYS), k * np.pi * (3.0 - np.sqrt(5.0))
    x, y, z = radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1.0 - radius * radius)
    rays = x[:, None] * first[:, None] + y[:, None] * second[:, None] + z[:, None] * normal[:, None]
    middles = np.repeat(triangles[some].mean(axis=1), _RAYS, axis=0)
    seen = _hits(triangles, middles, rays.reshape(-1, 3)).reshape(-1, _RAYS).mean(axis=1)
    return float((seen * area[some]).sum() / area[some].sum())


def resistance(mesh: trimesh.Trimesh, direction: Array) -> tuple[float, float]:
    """Force against a motion [N] of all leading plates, and of those with nothing of the tool in front of them.

    By the refined rule, α_y constant, ζ = 1, with the tool frame's origin 50 mm deep.
    """
    plates = both_rules(mesh)["refined"]
    state = scene_states(Rotation.identity(), velocity=0.01 * direction)[0]
    against = -plate_forces(plates, law("constant", zeta=1.0), state) @ direction
    shadowed = blocked(mesh.triangles, np.tile(direction, (len(mesh.faces), 1)))
    return float(against.sum()), float(against[~shadowed].sum())


def study() -> StudyResult:
    """Bowls pushed mouth first and forks dragged: as computed, without shadowed facets, and as their convex hulls."""
    rows = []
    for kind, sizes, build, direction in (("bowl", DEPTHS, bowl, _DOWN), ("fork", GAPS, fork, _FORWARD)):
        for size in sizes:
            mesh = build(size)
            hull, _ = resistance(mesh.convex_hull.subdivide(), direction)
            counted, lit = resistance(mesh, direction)
            rows.append((kind, size, concavity(mesh.triangles), counted / hull, lit / hull))
    figure = new_figure(8.4, 3.6)
    for axes, (kind, title, x) in zip(
        figure.subplots(1, 2),
        (
            ("bowl", "A bowl pushed down mouth first", "Depth of the hollow [mm]"),
            ("fork", "Two plates, one behind the other, dragged", "Gap between the plates [mm]"),
        ),
        strict=True,
    ):
        of_kind = [row for row in rows if row[0] == kind]
        sizes_mm = [1e3 * row[1] for row in of_kind]
        axes.axhline(100.0, color=GREEN, ls="--", label="convex hull (grains in the hollow move along)")
        axes.plot(sizes_mm, [100.0 * row[3] for row in of_kind], "o-", color=BLUE, label="as computed: all that leads")
        axes.plot(sizes_mm, [100.0 * row[4] for row in of_kind], "s:", color=VERMILION, label="without shadowed facets")
        for size, row in zip(sizes_mm, of_kind, strict=True):
            axes.annotate(
                f"{100.0 * row[2]:.0f} %", (size, 100.0 * row[3]), (0, 6), textcoords="offset points", fontsize=7
            )
        axes.set_ylim(0.0, 240.0)
        axes.margins(x=0.13)  # the last number needs room
        label_axes(axes, x=x, y="Force / force on the convex hull [%]", title=title)
    figure.axes[0].legend(fontsize=8)
    text = "Numbers at the points: share of a facet's field of view that other parts of the tool block"
    figure.suptitle(text, fontsize=9)
    return result_of_rows(
        "fails_hollow",
        "Concave tools",
        figure,
        rows,
        ("tool", "{}"),
        ("hollow or gap", "{:.1f} mm", 1e3),
        ("concavity", "{:.0f} %", 100.0),
        ("force / force on the convex hull", "{:.0f} %", 100.0),
        ("without shadowed facets", "{:.0f} %", 100.0),
    )

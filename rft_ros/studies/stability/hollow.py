"""Concave tools: facets that face each other count fully, though the grains between them move with the tool."""

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from rft_ros.rft import plate_forces
from rft_ros.studies.figure import BLUE, GREEN, VERMILION, label_axes, new_figure
from rft_ros.studies.outcome import Outcome, TextTable
from rft_ros.studies.paper import law
from rft_ros.studies.stability.sight import blocked, seen_share
from rft_ros.studies.stability.sweep import Array, both_rules, scene_states

if TYPE_CHECKING:
    import trimesh

__all__ = ["DEPTHS", "GAPS", "bowl", "fork", "hollow", "resistance"]

DEPTHS = (0.0, 0.005, 0.01, 0.015, 0.02, 0.025)
"""Of a bowl's hollow [m]; its mouth is 50 mm wide and looks down."""

GAPS = (0.0025, 0.005, 0.01, 0.02, 0.04)
"""Between the two plates of a fork [m], which are 50 mm square."""

_RADIUS, _WALL = 0.025, 0.002

_DOWN, _ON = np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])


def bowl(depth: float) -> "trimesh.Trimesh":
    """A bowl, mouth down, with an ellipsoidal hollow of this depth [m]; a disc for 0."""
    import trimesh

    t = np.linspace(0.0, 0.5 * np.pi, 13)
    inside = np.column_stack([_RADIUS * np.sin(t), depth * np.cos(t)])
    outside = np.column_stack([(_RADIUS + _WALL) * np.sin(t[::-1]), (depth + _WALL) * np.cos(t[::-1])])
    mesh = trimesh.creation.revolve(np.vstack([inside, outside]), sections=32)
    if mesh.volume < 0.0:
        mesh.invert()
    return mesh


def fork(gap: float) -> "trimesh.Trimesh":
    """Two upright plates, one behind the other along x, so far apart [m]."""
    import trimesh

    plates = [trimesh.creation.box((0.003, 0.05, 0.05)).subdivide().subdivide() for _ in range(2)]
    for plate, side in zip(plates, (-0.5, 0.5), strict=True):
        plate.apply_translation([side * (gap + 0.003), 0.0, 0.0])
    return trimesh.util.concatenate(plates)


def resistance(mesh: "trimesh.Trimesh", direction: Array) -> tuple[float, float]:
    """Force against a motion [N], of all plates that lead, and of those with nothing of the tool before them.

    By the refined rule, α_y constant, ζ = 1, the tool frame's origin 50 mm deep.
    """
    plates = both_rules(np.array(mesh.vertices), np.array(mesh.faces))["refined"]
    state = scene_states(Rotation.identity(), velocity=0.01 * direction)[0]
    against = -plate_forces(plates, law("constant", zeta=1.0), state) @ direction
    shadowed = blocked(mesh.triangles, np.tile(direction, (len(mesh.faces), 1)))
    return float(against.sum()), float(against[~shadowed].sum())


def hollow() -> Outcome:
    """Bowls pushed mouth first and forks dragged: as computed, without shadowed facets, and as their convex hulls."""
    rows = []
    for kind, sizes, build, direction in (("bowl", DEPTHS, bowl, _DOWN), ("fork", GAPS, fork, _ON)):
        for size in sizes:
            mesh = build(size)
            solid, _ = resistance(mesh.convex_hull.subdivide(), direction)
            counted, lit = resistance(mesh, direction)
            rows.append((kind, size, seen_share(mesh.triangles), counted / solid, lit / solid))
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
        across = [1e3 * row[1] for row in of_kind]
        axes.axhline(100.0, color=GREEN, ls="--", label="grains in the hollow move along (convex hull)")
        axes.plot(across, [100.0 * row[3] for row in of_kind], "o-", color=BLUE, label="as computed: all that leads")
        axes.plot(across, [100.0 * row[4] for row in of_kind], "s:", color=VERMILION, label="without shadowed facets")
        for size, row in zip(across, of_kind, strict=True):
            axes.annotate(
                f"{100.0 * row[2]:.0f} %", (size, 100.0 * row[3]), (0, 6), textcoords="offset points", fontsize=7
            )
        axes.set_ylim(0.0, 240.0)
        label_axes(axes, x=x, y="Force, of the convex hull's [%]", title=title)
    figure.axes[0].legend(fontsize=8)
    figure.suptitle(
        "Small numbers: concavity, the share of what the tool's facets see that is the tool itself", fontsize=9
    )
    return Outcome(
        name="fails_hollow",
        title="Concave tools",
        figure=figure,
        numbers={
            "fails_hollow": {
                "tool": [row[0] for row in rows],
                "hollow_or_gap_m": [row[1] for row in rows],
                "concavity": [row[2] for row in rows],
                "force_over_hull": [row[3] for row in rows],
                "force_over_hull_without_shadowed": [row[4] for row in rows],
            }
        },
        table=TextTable(
            header=("tool", "hollow or gap", "concavity", "force, of the convex hull's", "without shadowed facets"),
            rows=tuple(
                (row[0], f"{1e3 * row[1]:.1f} mm", *(f"{100.0 * value:.0f} %" for value in row[2:])) for row in rows
            ),
        ),
    )

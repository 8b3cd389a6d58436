"""What a bad mesh does to the force: few facets, slivers, facets that repeat, face inwards or are missing."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import INTEGRATIONS, Plates, wrenches
from rft_ros.studies.figure import label_axes, new_figure
from rft_ros.studies.outcome import Outcome
from rft_ros.studies.paper import law
from rft_ros.studies.stability.drawing import RULE_COLOUR, by_rule_outcome
from rft_ros.studies.stability.sweep import Array, both_rules
from rft_ros.tool.random_motions import random_motions

__all__ = ["faulty_balls", "mesh_faults"]

_RADIUS = 0.025
_STATES = 300
_SHARE = 0.1  # of the facets that are at fault

Mesh = tuple[Array, NDArray[np.int64]]


def faulty_balls() -> Iterator[tuple[str, Mesh]]:
    """A ball of 1,280 facets, by what is wrong with it."""
    import trimesh

    good = trimesh.creation.icosphere(3, radius=_RADIUS)
    vertices, faces = np.array(good.vertices), np.array(good.faces, dtype=np.int64)
    random = np.random.default_rng(0)
    some = random.permutation(len(faces))[: int(_SHARE * len(faces))]
    yield "good, 1,280 facets", (vertices, faces)
    for level in (0, 1, 2):
        ball = trimesh.creation.icosphere(level, radius=_RADIUS)
        yield f"coarse, {len(ball.faces):,} facets", (np.array(ball.vertices), np.array(ball.faces, dtype=np.int64))
    yield "each cut into a sliver and the rest", _with_slivers(vertices, faces)
    yield "10 % twice", (vertices, np.concatenate([faces, faces[some]]))
    turned = faces.copy()
    turned[some] = turned[some][:, ::-1]
    yield "10 % inside out", (vertices, turned)
    yield "10 % missing", (vertices, np.delete(faces, some, axis=0))
    noisy = vertices + random.normal(0.0, 0.01 * _RADIUS, vertices.shape)
    yield "corners off by 1 % of the radius", (noisy, faces)


def _with_slivers(vertices: Array, faces: NDArray[np.int64]) -> Mesh:
    """Each facet cut through a corner and a point next to another: a thousandth of it is a sliver."""
    _, b, c = vertices[faces.T]
    new = len(vertices) + np.arange(len(faces))
    i, j, k = faces.T
    return np.vstack([vertices, b + 1e-3 * (c - b)]), np.vstack(
        [np.column_stack([i, j, new]), np.column_stack([i, new, k])]
    )


def mesh_faults() -> Outcome:
    """RMS error of the force over random motions, against the ball of 81,920 facets."""
    import trimesh

    exact = trimesh.creation.icosphere(6, radius=_RADIUS)
    fine = both_rules(np.array(exact.vertices), np.array(exact.faces))["refined"]
    states = random_motions(np.array(exact.vertices), _STATES, seed=1)
    truth = wrenches(fine, law("constant"), states)[:, :3]

    def error(plates: Plates) -> float:
        off = wrenches(plates, law("constant"), states)[:, :3] - truth
        return float(np.sqrt((off**2).sum() / (truth**2).sum()))

    errors = {name: {rule: error(p) for rule, p in both_rules(*mesh).items()} for name, mesh in faulty_balls()}
    figure = new_figure(8.4, 3.8)
    axes = figure.subplots()
    place = np.arange(len(errors))
    for rule, shift, hatch in zip(INTEGRATIONS, (0.2, -0.2), ("//", ""), strict=True):
        values = [100.0 * e[rule] for e in errors.values()]
        bars = axes.barh(
            place + shift, values, height=0.38, color=RULE_COLOUR[rule], hatch=hatch, edgecolor="white", label=rule
        )
        axes.bar_label(bars, fmt="%.2g", fontsize=7, padding=2)
    axes.set_yticks(place, list(errors), fontsize=8)
    axes.invert_yaxis()
    axes.set_xscale("log")
    label_axes(axes, x="RMS error of the force [%]", y="Mesh of a ball", legend={"loc": "lower right"})
    axes.set_title("A ball in random motions, against 81,920 facets", fontsize=10)
    return by_rule_outcome("fails_mesh", "Bad meshes", figure, of="mesh of a ball", what="rms_error", values=errors)

"""The force on bad meshes: few facets, slivers, facets that repeat, face inwards or are missing."""

from collections.abc import Iterator

import numpy as np
import trimesh

from rft_ros.rft import INTEGRATIONS, Plates, wrenches
from rft_ros.tool import random_motions
from studies.paper import law
from studies.parameter_sweep import RULE_COLOUR, Array, both_rules
from studies.result import StudyResult, label_axes, new_figure, result_of_rows

__all__ = ["faulty_balls", "study"]

_RADIUS = 0.025
_STATES = 300
_SHARE = 0.1  # of the facets that are wrong


def faulty_balls() -> Iterator[tuple[str, trimesh.Trimesh]]:
    """A ball of 1,280 facets with one fault each, by name."""

    def mesh(vertices: Array, faces: Array) -> trimesh.Trimesh:
        return trimesh.Trimesh(vertices, faces, process=False)  # or trimesh would mend the faults

    good = trimesh.creation.icosphere(3, radius=_RADIUS)
    vertices, faces = np.array(good.vertices), np.array(good.faces)
    random = np.random.default_rng(0)
    some = random.permutation(len(faces))[: int(_SHARE * len(faces))]
    yield "good, 1,280 facets", good
    for level in (0, 1, 2):
        ball = trimesh.creation.icosphere(level, radius=_RADIUS)
        yield f"coarse, {len(ball.faces):,} facets", ball
    # a cut through a corner and a point next to another: a thousandth of each facet is a sliver
    i, j, k = faces.T
    new = len(vertices) + np.arange(len(faces))
    cuts = vertices[j] + 1e-3 * (vertices[k] - vertices[j])
    halves = np.vstack([np.column_stack([i, j, new]), np.column_stack([i, new, k])])
    yield "each facet cut into a sliver and the rest", mesh(np.vstack([vertices, cuts]), halves)
    yield "10 % of the facets repeated", mesh(vertices, np.concatenate([faces, faces[some]]))
    turned = faces.copy()
    turned[some] = turned[some][:, ::-1]
    yield "10 % inverted", mesh(vertices, turned)
    yield "10 % missing", mesh(vertices, np.delete(faces, some, axis=0))
    yield (
        "vertices off by 1 % of the radius",
        mesh(vertices + random.normal(0.0, 0.01 * _RADIUS, vertices.shape), faces),
    )


def study() -> StudyResult:
    """RMS error of the force over random motions, against the ball of 81,920 facets."""
    exact = trimesh.creation.icosphere(6, radius=_RADIUS)
    fine = both_rules(exact)["refined"]
    states = random_motions(np.array(exact.vertices), _STATES, seed=1)
    truth = wrenches(fine, law("constant"), states)[:, :3]

    def error(plates: Plates) -> float:
        off = wrenches(plates, law("constant"), states)[:, :3] - truth
        return float(np.sqrt((off**2).sum() / (truth**2).sum()))

    errors = {
        name: {rule: error(p) for rule, p in both_rules(mesh).items()}
        for name, mesh in faulty_balls()
    }
    figure = new_figure(8.4, 3.8)
    axes = figure.subplots()
    place = np.arange(len(errors))
    for rule, shift, hatch in zip(INTEGRATIONS, (0.2, -0.2), ("//", ""), strict=True):
        values = [100.0 * e[rule] for e in errors.values()]
        bars = axes.barh(
            place + shift,
            values,
            height=0.38,
            color=RULE_COLOUR[rule],
            hatch=hatch,
            edgecolor="white",
            label=rule,
        )
        axes.bar_label(bars, fmt="%.2g", fontsize=7, padding=2)
    axes.set_yticks(place, list(errors), fontsize=8)
    axes.invert_yaxis()
    axes.set_xscale("log")
    label_axes(
        axes, x="RMS error of the force [%]", y="Mesh of a ball", legend={"loc": "lower right"}
    )
    axes.set_title("A ball in random motions, against 81,920 facets", fontsize=10)
    rows = [(name, *of_rule.values()) for name, of_rule in errors.items()]
    by_rule = ((rule, "{:.2g} %", 100.0) for rule in INTEGRATIONS)
    return result_of_rows(
        "fails_mesh", "Bad meshes", figure, rows, ("mesh of a ball", "{}"), *by_rule
    )

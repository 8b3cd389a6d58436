"""Mesh convergence on a sphere: error over facet size, time over facet count (paper Fig. 9).

Times vary from run to run; errors do not.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np
import trimesh
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rft_ros.rft import INTEGRATIONS, Integration, Plates, wrenches
from rft_ros.sweeps.motions import sample, straight
from rft_ros.tool import centroid_plates, refined_plates
from studies.paper import NOT_STATED, law
from studies.result import (
    BLACK,
    BLUE,
    GREY,
    ORANGE,
    StudyResult,
    label_axes,
    new_figure,
    published_against_ours,
)

__all__ = ["LEVELS", "RADIUS", "Convergence", "convergence", "fineness", "order", "study"]

Array = NDArray[np.float64]

RADIUS = 0.025
"""Radius of the sphere [m]. That of Fig. 9B is unknown here; the errors do not depend on it."""

LEVELS = range(6)
"""Subdivisions of an icosahedron: 20, 80, .. 20,480 facets."""

_REFERENCE = 7
_PLUNGE = straight(start_height=RADIUS, travel=2.0 * RADIUS, descent_deg=60.0, heading_deg=20.0)
_STATES = 60
_LEAST_SECONDS = 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Convergence:
    """Of one rule: facets, 1 / (κ Lc), RMS errors over the maximum force, seconds for one wrench; all shape [n]."""

    facets: Array
    fineness: Array
    errors: Array
    seconds: Array


def fineness(facets: int) -> float:
    """1 / (κ Lc) of a sphere: κ = 1 / radius, Lc the square root of the mean facet's area."""
    return float(np.sqrt(facets / (4.0 * np.pi)))


def convergence(
    levels: Sequence[int] = LEVELS, reference: int = _REFERENCE
) -> dict[Integration, Convergence]:
    """Both rules against the refined rule at level `reference`, over a plunge from touching to submerged."""
    states = sample(_PLUNGE, _STATES)[1]
    exact = _forces(_sphere(reference, "refined"), states)
    largest = np.linalg.norm(exact, axis=1).max()
    found: dict[Integration, Convergence] = {}
    for rule in INTEGRATIONS:
        bodies = [_sphere(level, rule) for level in levels]
        errors = [
            np.linalg.norm(_forces(plates, states) - exact, axis=1) / largest for plates in bodies
        ]
        found[rule] = Convergence(
            facets=np.array([len(plates) for plates in bodies], dtype=np.float64),
            fineness=np.array([fineness(len(plates)) for plates in bodies]),
            errors=np.array([np.sqrt((e**2).mean()) for e in errors]),
            seconds=np.array([_seconds(plates, states) for plates in bodies]),
        )
    return found


def order(one: Convergence) -> float:
    """Observed order of the error in κ Lc, over the four finest."""
    return float(-np.polyfit(np.log(one.fineness[-4:]), np.log(one.errors[-4:]), 1)[0])


def _sphere(level: int, rule: Integration) -> Plates:
    ball = trimesh.creation.icosphere(subdivisions=level, radius=RADIUS)
    make = refined_plates if rule == "refined" else centroid_plates
    return make(np.array(ball.vertices), np.array(ball.faces, dtype=np.int64))


def _forces(plates: Plates, states: Array) -> Array:
    return wrenches(plates, law("constant"), states)[:, :3]


def _seconds(plates: Plates, states: Array) -> float:
    """Time of one wrench on one core, best of several rounds."""
    model, best, began = law("constant"), np.inf, perf_counter()
    while perf_counter() - began < _LEAST_SECONDS or not np.isfinite(best):
        start = perf_counter()
        wrenches(plates, model, states, threads=1)
        best = min(best, (perf_counter() - start) / len(states))
    return best


def study() -> StudyResult:
    """Error and time of both rules over the number of facets."""
    found = convergence()
    rows = []
    for goal in (0.05, 0.01, 0.001):
        text = ", ".join(_enough(one, goal) for one in found.values())
        rows.append(
            (
                f"facets for {100.0 * goal:g} % of the maximum force: {', '.join(found)}",
                NOT_STATED,
                text,
            )
        )
    return StudyResult(
        name="convergence",
        title="Mesh convergence on a sphere (Fig. 9)",
        figure=_draw(found),
        table=published_against_ours(
            *rows,
            (
                f"observed order in κ Lc: {', '.join(found)}",
                NOT_STATED,
                ", ".join(f"{order(one):.1f}" for one in found.values()),
            ),
        ),
    )


def _enough(one: Convergence, goal: float) -> str:
    good = one.facets[one.errors <= goal]
    return f"{int(good[0]):,}" if len(good) else f"over {int(one.facets[-1]):,}"


def _draw(found: dict[Integration, Convergence]) -> Figure:
    from matplotlib.ticker import NullFormatter

    figure = new_figure(11.0, 4.6)
    times, errors = figure.subplots(1, 2)
    for (rule, one), colour, marker in zip(found.items(), (ORANGE, BLUE), ("o", "s"), strict=True):
        times.loglog(one.facets, 1e6 * one.seconds, marker=marker, color=colour, label=rule)
        label = f"{rule}: observed order {order(one):.1f}"
        errors.loglog(one.fineness, 100.0 * one.errors, marker=marker, color=colour, label=label)
    finest = found["centroid"]
    slope = 100.0 * finest.errors[0] * (finest.fineness / finest.fineness[0]) ** -2.0
    errors.loglog(finest.fineness, slope, ":", color=GREY, label="order 2")
    errors.axhline(1.0, color=BLACK, lw=0.8, ls="--", label="1 %")
    errors.xaxis.set_minor_formatter(NullFormatter())
    label_axes(
        times,
        x="Facets",
        y="Time of one wrench, one core [µs]",
        title="Time (Fig. 9A)",
        legend={"loc": "upper left"},
    )
    label_axes(
        errors,
        x="1 / (κ Lc)",
        y="RMS error over the maximum force [%]",
        title="Error (Fig. 9B)",
        legend={},
    )
    figure.suptitle(
        "Sphere plunging at 60° from touching to submerged, against the refined rule on 327,680 facets"
    )
    return figure

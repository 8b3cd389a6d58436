"""Accuracy against time: what one evaluation takes, and how far its force lies from the converged one.

Every rule, α_y model and reduction over the scenes of `chart_scenes`, beside a NumPy implementation. Takes minutes.
"""

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import log10
from statistics import median
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rft_ros.rft import INTEGRATIONS, LEVEL, MEDIA, Law, Plates, wrenches
from rft_ros.rft.result import WIDTH
from rft_ros.rft.wrench import prepared
from rft_ros.tool.reduce import chosen_plates, merged_plates
from studies import numpy_rft
from studies.chart_scenes import Scene, scenes
from studies.paper import ALPHA_Y, ZETA, law
from studies.pictures import legend_below
from studies.result import BLACK, BLUE, GREY, ORANGE, StudyResult, TextTable, label_axes, new_figure

__all__ = ["CHOSEN", "FULL", "MERGED", "NUMPY", "Point", "front", "median_seconds", "points", "study"]

Array = NDArray[np.float64]

FULL, MERGED, CHOSEN, NUMPY = "full mesh", "merged, any motion", "chosen for the scene", "full mesh, NumPy"
"""Where the plates of a point come from."""

_MERGED_TO, _CHOSEN = (30, 60, 120, 250, 500), (5, 10, 20, 40, 80, 160)
_TIMED = 40  # states
_NUMPY_STATES = 30  # it is slow
_CLEAR_GAIN = 0.05  # a smaller gain in error is noise
_ROUNDS, _ROUND_SECONDS = 15, 0.003


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One way to compute one scene.

    `time`: of an evaluation [s]. `error`: at the 95th percentile of states, over the scene's maximum force.
    """

    scene: str
    integration: str
    alpha_y: str
    reduction: str
    plates: int
    time: float
    error: float

    @property
    def name(self) -> str:
        """Such as "refined, 320 plates, full mesh, α_y constant"."""
        return f"{self.integration}, {self.plates:,} plates, {self.reduction}, α_y {self.alpha_y}"


def points(scene: Scene) -> list[Point]:
    """Every point of a scene. Plates are chosen on every other state; errors are measured on the rest."""
    states = np.ascontiguousarray(scene.states[1::2])
    one = [states[k : k + 1] for k in range(0, len(states), max(1, len(states) // _TIMED))]
    reference = scene.plates(scene.reference, "refined")
    converged = {name: wrenches(reference, law(name), states)[:, :3] for name in ALPHA_Y}
    found: list[tuple[Plates, str, str, Array]] = []  # plates, reduction, α_y model, errors
    calls: list[Callable[[], object]] = []
    for plates, reduction in _bodies(scene):
        for name in ALPHA_Y:
            off = wrenches(plates, law(name), states)[:, :3] - converged[name]
            found.append((plates, reduction, name, off))
            calls.append(partial(_one_by_one, plates, law(name), one))
        if (plates.integration, reduction) == ("centroid", FULL):
            every = slice(None, None, max(1, len(states) // _NUMPY_STATES))
            off = np.array([_by_numpy(plates, state)[:3] for state in states[every]])
            found.append((plates, NUMPY, "constant", off - converged["constant"][every]))
            calls.append(partial(_by_numpy, plates, states[-1]))
    return [
        Point(
            scene=scene.name,
            integration=plates.integration,
            alpha_y=alpha_y,
            reduction=reduction,
            plates=len(plates),
            time=seconds / (1 if reduction == NUMPY else len(one)),
            error=float(np.percentile(np.linalg.norm(off, axis=1), 95.0) / greatest),
        )
        for (plates, reduction, alpha_y, off), seconds in zip(found, median_seconds(calls), strict=True)
        for greatest in [np.linalg.norm(converged[alpha_y], axis=1).max()]
    ]


def _bodies(scene: Scene) -> Iterator[tuple[Plates, str]]:
    """Plates of a scene's body, and where they come from."""
    for rule in INTEGRATIONS:
        for level in range(scene.levels):
            yield scene.plates(level, rule), FULL
        delivered = scene.plates(scene.delivered, rule)
        for count in _MERGED_TO:
            if 2 * count < len(delivered):
                yield merged_plates(delivered, count), MERGED
        chosen: dict[int, Plates] = {}
        for plates in chosen_plates(delivered, scene.states[::2]) if scene.known else ():
            chosen[len(plates)] = plates
            if len(plates) >= _CHOSEN[-1]:
                break
        for count in _CHOSEN:
            if count in chosen:
                yield chosen[count], CHOSEN


def _one_by_one(plates: Plates, model: Law, states: Sequence[Array]) -> None:
    """Evaluate states as a tick does: one core, one state."""
    step, no_time, out = prepared(plates), np.zeros(1), np.empty((1, WIDTH))
    for state in states:
        step(model.packed, state, no_time, 0.0, LEVEL, out)


def _by_numpy(plates: Plates, state: Array) -> Array:
    generic = MEDIA["generic"]
    return numpy_rft.wrench(plates, generic, ZETA, lambda _beta: generic.alpha_x_flat, state)


def median_seconds(calls: Sequence[Callable[[], object]]) -> list[float]:
    """Median processor time of each warm call [s]. Calls take turns, so that a busy machine slows all alike."""

    def seconds(call: Callable[[], object], times: int) -> float:
        began = time.thread_time()
        for _ in range(times):
            call()
        return (time.thread_time() - began) / times

    times = [max(1, int(_ROUND_SECONDS / min(seconds(call, 1) for _ in range(2)))) for call in calls]
    turns = [[seconds(call, n) for call, n in zip(calls, times, strict=True)] for _ in range(_ROUNDS)]
    return [median(of_call) for of_call in zip(*turns, strict=True)]


def front(candidates: Sequence[Point]) -> list[Point]:
    """The Pareto front of time and error, ordered by time; a point joins it if it gains over 5 % in error."""
    best: list[Point] = []
    for candidate in sorted(candidates, key=lambda p: (p.time, p.error)):
        if not best or candidate.error < (1.0 - _CLEAR_GAIN) * best[-1].error:
            best.append(candidate)
    return best


COLOURS = {"centroid": ORANGE, "refined": BLUE}
NAMES = {"centroid": "published rule", "refined": "refined rule"}
MARKERS = {FULL: "o", MERGED: "s", CHOSEN: "^", NUMPY: "x"}
"""How points are drawn and rules are named."""

BUDGETS = {"1,000 Hz": 1e3, "500 Hz": 2e3, "125 Hz": 8e3}
"""Duration of a tick by rate [µs]."""

FLOOR = 1e-3
"""Smaller errors [%] are drawn here: a flat plate is exact with 12 plates."""

_GOALS = (5.0, 2.5, 1.0, 0.5)  # %


def _in_scenes(points: Sequence[Point]) -> dict[str, list[Point]]:
    """The points of each scene."""
    return {scene: [p for p in points if p.scene == scene] for scene in dict.fromkeys(p.scene for p in points)}


def _shown_error(point: Point) -> float:
    """The error at which a point is drawn [%]."""
    return max(100.0 * point.error, FLOOR)


def study() -> StudyResult:
    """Figure, page, numbers, and a table of the time that each accuracy takes."""
    points_of = []
    for scene in scenes():
        print(f"chart: {scene.name}", file=sys.stderr, flush=True)
        points_of += points(scene)
    return _result(points_of)


def _result(points: Sequence[Point]) -> StudyResult:
    by_scene = _in_scenes(points)
    best = {id(p) for of_scene in by_scene.values() for p in front(of_scene)}
    return StudyResult(
        name="chart",
        title="Accuracy against time",
        figure=_draw(by_scene),
        numbers={
            "chart": {
                "scene": [p.scene for p in points],
                "integration": [p.integration for p in points],
                "alpha_y": [p.alpha_y for p in points],
                "reduction": [p.reduction for p in points],
                "plates": [p.plates for p in points],
                "time_us": [1e6 * p.time for p in points],
                "error_percent": [100.0 * p.error for p in points],
                "on_front": [id(p) in best for p in points],
            }
        },
        table=_table(by_scene),
    )


def _table(by_scene: dict[str, list[Point]]) -> TextTable:
    rows = []
    for scene, points in by_scene.items():
        for goal in _GOALS:
            good = [p for p in points if 100.0 * p.error <= goal and p.alpha_y == "constant"]
            published = [p for p in good if p.integration == "centroid" and p.reduction == FULL]
            cheapest = min(published, key=lambda p: p.time, default=None)
            fastest = min(good, key=lambda p: p.time, default=None)
            rows.append(
                (
                    scene,
                    f"{goal:g} %",
                    f"{cheapest.plates:,} plates, {1e6 * cheapest.time:.1f} µs" if cheapest else "not reached",
                    f"{fastest.plates:,} plates, {1e6 * fastest.time:.1f} µs" if fastest else "not reached",
                    f"{fastest.integration}, {fastest.reduction}" if fastest else "",
                )
            )
    return TextTable(
        header=("scene", "within", "published rule, full mesh", "fastest of all", "which"), rows=tuple(rows)
    )


def _draw(by_scene: dict[str, list[Point]]) -> Figure:
    figure = new_figure(14.0, 8.6)
    panels = figure.subplots(2, (len(by_scene) + 1) // 2, sharex=True, sharey=True, squeeze=False).ravel()
    for axes, (scene, points) in zip(panels, by_scene.items(), strict=False):
        _draw_scene(axes, points)
        label_axes(axes, x="Time of one evaluation [µs]", y="Error against the converged force [%]", title=scene)
        axes.label_outer()
    handles: dict[str, Any] = {}
    for axes in panels:
        handles |= {label: handle for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    legend_below(figure, handles, ncols=5, fontsize=9)
    figure.suptitle(
        "Accuracy against time, one core: filled α_y constant, hollow α_y linear; numbers at the front count plates"
    )
    return figure


def _apart(best: Sequence[Point]) -> list[Point]:
    """Points of the front whose labels do not overlap."""
    apart: list[Point] = []

    def near(p: Point, q: Point) -> bool:
        return abs(log10(p.time / q.time)) < 0.35 and abs(log10(_shown_error(p) / _shown_error(q))) < 0.2

    for point in best:
        if not any(near(point, other) for other in apart):
            apart.append(point)
    return apart


def _draw_scene(axes: Axes, points: Sequence[Point]) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    for rule, colour in COLOURS.items():
        for reduction, marker in MARKERS.items():
            for model in ("constant", "linear"):
                chosen = [p for p in points if (p.integration, p.reduction, p.alpha_y) == (rule, reduction, model)]
                if not chosen:
                    continue
                colour_here = GREY if reduction == NUMPY else colour
                axes.plot(
                    [1e6 * p.time for p in chosen],
                    [_shown_error(p) for p in chosen],
                    marker=marker,
                    color=colour_here,
                    markerfacecolor=colour_here if model == "constant" else "none",
                    lw=0.8 if model == "constant" else 0.0,
                    alpha=0.9,
                    ms=5.5,
                    label=f"{NAMES[rule]}, {reduction}" if model == "constant" else None,
                )
    best = front(points)
    axes.step(
        [1e6 * p.time for p in best],
        [_shown_error(p) for p in best],
        where="post",
        color=BLACK,
        lw=1.8,
        alpha=0.6,
        zorder=1,
        label="Pareto front",
    )
    for point in _apart(best):
        axes.annotate(
            f"{point.plates:,}",
            (1e6 * point.time, _shown_error(point)),
            textcoords="offset points",
            xytext=(-4, -9),
            ha="right",
            fontsize=6.5,
        )
    for name, budget in BUDGETS.items():
        axes.axvline(budget, color=GREY, lw=1.0, ls="--")
        axes.text(
            budget, 0.985, name, rotation=90, ha="right", va="top", fontsize=7, transform=axes.get_xaxis_transform()
        )
    axes.set_ylim(0.7 * FLOOR, 130.0)

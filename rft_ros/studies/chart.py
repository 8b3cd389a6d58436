"""The chart of accuracy against time: a panel for each scene, the front of the best, and what a tick leaves."""

from collections.abc import Sequence
from math import log10
from typing import TYPE_CHECKING, Any

from rft_ros.report.legend import legend_below
from rft_ros.studies.chart_points import CHOSEN, FULL, MERGED, NUMPY, Point, front
from rft_ros.studies.figure import BLACK, BLUE, GREY, ORANGE, label_axes, new_figure
from rft_ros.studies.outcome import Outcome, TextTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["BUDGETS", "COLOURS", "FLOOR", "MARKERS", "NAMES", "chart_outcome", "in_scenes", "shown_error"]

COLOURS = {"centroid": ORANGE, "refined": BLUE}
NAMES = {"centroid": "published rule", "refined": "refined rule"}
MARKERS = {FULL: "o", MERGED: "s", CHOSEN: "^", NUMPY: "x"}
"""How a point is drawn, and its rule called."""

BUDGETS = {"1,000 Hz": 1e3, "500 Hz": 2e3, "125 Hz": 8e3}
"""What a tick leaves at most [µs]."""

FLOOR = 1e-3
"""Errors below this [%] are drawn there: a flat plate is exact with 12 plates."""

_GOALS = (5.0, 2.5, 1.0, 0.5)  # %


def in_scenes(points: Sequence[Point]) -> dict[str, list[Point]]:
    """The points of each scene."""
    return {scene: [p for p in points if p.scene == scene] for scene in dict.fromkeys(p.scene for p in points)}


def shown_error(point: Point) -> float:
    """Where a point is drawn [%]."""
    return max(100.0 * point.error, FLOOR)


def chart_outcome(points: Sequence[Point]) -> Outcome:
    """Figure, numbers, and a table of what each accuracy costs."""
    by_scene = in_scenes(points)
    best = {id(p) for of_scene in by_scene.values() for p in front(of_scene)}
    return Outcome(
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


def _draw(by_scene: dict[str, list[Point]]) -> "Figure":
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
        "Accuracy against time, one core: filled α_y constant, hollow α_y linear; numbers on the front are plates"
    )
    return figure


def _apart(best: Sequence[Point]) -> list[Point]:
    """Those of the front whose labels do not lie over one another."""
    apart: list[Point] = []

    def near(p: Point, q: Point) -> bool:
        return abs(log10(p.time / q.time)) < 0.35 and abs(log10(shown_error(p) / shown_error(q))) < 0.2

    for point in best:
        if not any(near(point, other) for other in apart):
            apart.append(point)
    return apart


def _draw_scene(axes: "Axes", points: Sequence[Point]) -> None:
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
                    [shown_error(p) for p in chosen],
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
        [shown_error(p) for p in best],
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
            (1e6 * point.time, shown_error(point)),
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

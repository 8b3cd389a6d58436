"""Which modelling choice improves accuracy against simulated grains, and which only costs time."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from statistics import mean
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rft_ros.rft import Integration, Law
from rft_ros.tool import Tool, load_tool
from studies.chart import median_seconds
from studies.dem import (
    ALONG_ITSELF,
    CALIBRATION,
    CYCLE_RUNS,
    DENSITY,
    FAST_RUNS,
    RUNS,
    WALL_SECONDS,
    DemRun,
    cycle_error,
    fitted_zeta,
    median_error,
    read_run,
    settled_error,
)
from studies.learning import learned, model_rows, series_of
from studies.paper import law
from studies.result import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    VERMILION,
    StudyResult,
    TextTable,
    label_axes,
    new_figure,
)

__all__ = ["CHOICES", "GROUPS", "Choice", "Judged", "judged_choices", "study"]

Array = NDArray[np.float64]

GROUPS: dict[str, Callable[[str], bool]] = {
    "plates (5 runs)": lambda name: name.startswith("plate") and name != ALONG_ITSELF,
    "plate along itself": lambda name: name == ALONG_ITSELF,
    "ellipsoid (straight, pitching)": lambda name: name.startswith("ellipsoid"),
    "root tip (straight, helix)": lambda name: name.startswith("root"),
    "fast plates (0.5 and 1 m/s)": lambda name: name in FAST_RUNS and "0p1" not in name,
    "cycles (small retreats, reloads)": lambda name: name in CYCLE_RUNS,
}
"""Groups of runs whose errors are averaged. None contains the penetration that ζ is fitted to."""

PACKINGS = (0.10, 0.15)
"""Difference between two packings of the same grains (README of the runs): smaller errors cannot be resolved."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """One way to model: rule, α_y model, tolerance of the reduced tool (0: full), mobilization length [m] (0: none).

    `lag`: path between a measured force and the first prediction that it may change [m]; 0: nothing is learned.
    `density` of the bed [kg/m³], 0: no inertia.
    """

    name: str
    integration: Integration = "centroid"
    alpha_y: str = "constant"
    tolerance: float = 0.0
    mobilization_length: float = 0.0
    lag: float = 0.0
    law: str = "treers2021"
    density: float = 0.0

    def made(self, zeta: float) -> Law:
        """The law of this choice."""
        length = self.mobilization_length
        return law(self.alpha_y, zeta=zeta, name=self.law, density=self.density, mobilization_length=length)

    def predicted(self, run: DemRun, law: Law) -> Array:
        """The force at each state of a run [N], shape [n, 3]; a learned one uses earlier forces of the same run."""
        if self.lag == 0.0:
            return run.predicted(law, threads=1)
        rows = model_rows(run.tool.plates, law, run.states, run.times)
        series = series_of(run.name, run.tool.plates, run.states, run.times, rows, run.forces, rest=1e-9)
        return learned(series, lag=self.lag).out[:, :3]


_LAG = 0.002  # m

CHOICES = (
    Choice(name="published"),
    Choice(name="published, α_y linear", alpha_y="linear"),
    Choice(name="published, reduced to 5 %", tolerance=0.05),
    Choice(name="refined", integration="refined"),
    Choice(name="refined, α_y linear", integration="refined", alpha_y="linear"),
    Choice(name="refined, reduced to 5 %", integration="refined", tolerance=0.05),
    Choice(name="refined, memory 3 mm", integration="refined", mobilization_length=0.003),
    Choice(name="refined, α_y linear, memory 3 mm", integration="refined", alpha_y="linear", mobilization_length=0.003),
    Choice(name="published, learned", lag=_LAG),
    Choice(name="refined, α_y linear, learned", integration="refined", alpha_y="linear", lag=_LAG),
    Choice(
        name="refined, α_y linear, memory 3 mm, learned",
        integration="refined",
        alpha_y="linear",
        mobilization_length=0.003,
        lag=_LAG,
    ),
    Choice(
        name="refined, α_y linear, memory, inertia",
        integration="refined",
        alpha_y="linear",
        mobilization_length=0.003,
        density=DENSITY,
    ),
    Choice(name="refined, agarwal2023", integration="refined", law="agarwal2023"),
    Choice(
        name="refined, agarwal2023, memory, inertia",
        integration="refined",
        mobilization_length=0.003,
        law="agarwal2023",
        density=DENSITY,
    ),
)
"""The choices compared."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """A choice in one run. `time`: of an evaluation [s]. `states`: their number. `zeta`: fitted for the choice."""

    run: str
    choice: Choice
    plates: int
    error: float
    time: float
    states: int
    zeta: float


def judged_choices() -> list[Judged]:
    """Every choice in every run; ζ is fitted for each choice."""
    runs = [read_run(name) for name in (*RUNS, *FAST_RUNS, *CYCLE_RUNS)]
    cases: list[tuple[Choice, DemRun, float]] = []
    for choice in CHOICES:
        own = [replace(run, tool=_tool(run.tool.file, choice.integration, choice.tolerance)) for run in runs]
        calibration = next(run for run in own if run.name == CALIBRATION)
        zeta = fitted_zeta(calibration, replace(choice, density=0.0).made(1.0))
        cases += [(choice, run, zeta) for run in own]
    calls = [partial(choice.predicted, run, choice.made(zeta)) for choice, run, zeta in cases]
    return [
        Judged(
            run=run.name,
            choice=choice,
            plates=len(run.tool.plates),
            error=_error(run, call()),
            time=seconds / len(run.states),
            states=len(run.states),
            zeta=zeta,
        )
        for (choice, run, zeta), call, seconds in zip(cases, calls, median_seconds(calls), strict=True)
    ]


def _error(run: DemRun, model: Array) -> float:
    if run.name in CYCLE_RUNS:
        return cycle_error(run, model)
    return settled_error(run, model) if run.name in FAST_RUNS else median_error(run.forces, model)


@cache
def _tool(file: str, integration: Integration, tolerance: float) -> Tool:
    return load_tool(file, scale=1.0, integration=integration, tolerance=tolerance)


def _averaged(judged: Sequence[Judged], group: str) -> dict[Choice, tuple[float, float]]:
    """Mean time of a run [s] and mean error of each choice over a group of runs."""
    mine = [j for j in judged if GROUPS[group](j.run)]
    return {
        choice: (
            mean(j.time * j.states for j in mine if j.choice == choice),
            mean(j.error for j in mine if j.choice == choice),
        )
        for choice in dict.fromkeys(j.choice for j in mine)
    }


def _simulated_seconds(group: str) -> tuple[float, float] | None:
    """Shortest and longest wall time of a group's simulations [s]; None if not recorded."""
    spans = [span for name, span in WALL_SECONDS.items() if GROUPS[group](name)]
    if not spans:
        return None
    return min(low for low, _ in spans), max(high for _, high in spans)


def _colour_of(choice: Choice) -> str:
    """Orange: published; blue: refined; green: with memory; vermilion: learned; purple: the law of Agarwal et al."""
    if choice.lag:
        return VERMILION
    if choice.law == "agarwal2023":
        return PURPLE
    if choice.mobilization_length:
        return GREEN
    return ORANGE if choice.integration == "centroid" else BLUE


def study() -> StudyResult:
    """Figure, page, numbers, and a table of errors by choice and group."""
    judged = judged_choices()
    groups = {group: _averaged(judged, group) for group in GROUPS}
    choices = list(dict.fromkeys(j.choice for j in judged))
    rows = tuple(
        (
            choice.name,
            *(f"{100.0 * groups[group][choice][1]:.1f}" for group in GROUPS),
            f"{1e6 * mean(j.time for j in judged if j.choice == choice):.2g} µs",
        )
        for choice in choices
    )
    return StudyResult(
        name="models",
        title="Accuracy of the modelling choices against simulated grains",
        figure=_draw(groups),
        numbers={
            "models": {
                "run": [j.run for j in judged],
                "choice": [j.choice.name for j in judged],
                "law": [j.choice.law for j in judged],
                "density": [j.choice.density for j in judged],
                "integration": [j.choice.integration for j in judged],
                "alpha_y": [j.choice.alpha_y for j in judged],
                "tolerance": [j.choice.tolerance for j in judged],
                "mobilization_length": [j.choice.mobilization_length for j in judged],
                "lag": [j.choice.lag for j in judged],
                "plates": [j.plates for j in judged],
                "zeta": [j.zeta for j in judged],
                "time_us": [1e6 * j.time for j in judged],
                "median_error": [j.error for j in judged],
            }
        },
        table=TextTable(
            header=("errors [%]", *(name.partition(" (")[0] for name in GROUPS), "an evaluation"), rows=rows
        ),
    )


def _draw(groups: dict[str, dict[Choice, tuple[float, float]]]) -> Figure:
    figure = new_figure(18.0, 9.0)
    panels = figure.subplots(2, 4).ravel()
    for axes, (group, found) in zip(panels, groups.items(), strict=False):
        _draw_group(axes, found, _simulated_seconds(group))
        label_axes(axes, x="Time for a run [s]", y="Median error of the force [%]", title=group)
    for axes in panels[len(groups) :]:
        axes.set_axis_off()
    key = panels[len(groups)]
    for place, choice in enumerate(next(iter(groups.values()))):
        y = 0.97 - 0.07 * place
        key.plot(0.03, y, transform=key.transAxes, **_marker(choice))
        key.text(0.07, y, f"{place + 1}   {choice.name}", transform=key.transAxes, va="center", fontsize=10)
    figure.suptitle("Force against simulated grains (discrete elements): accuracy and time of each choice")
    return figure


def _marker(choice: Choice) -> dict[str, Any]:
    colour = _colour_of(choice)
    return {
        "marker": "s" if choice.tolerance else "o",
        "color": colour,
        "mfc": "none" if choice.alpha_y == "linear" else colour,
        "ms": 8,
        "ls": "",
    }


def _draw_group(axes: Axes, found: dict[Choice, tuple[float, float]], simulated: tuple[float, float] | None) -> None:
    axes.set_xscale("log")
    low, high = (100.0 * p for p in PACKINGS)
    axes.axhspan(low, high, color="0.92", zorder=0)
    top = 1.18 * max(100.0 * max(error for _, error in found.values()), high)
    slowest = max(seconds for seconds, _ in found.values())
    numbered = sorted(enumerate(found.items(), start=1), key=lambda item: item[1][1][1])
    gap, last = 0.042 * top, -top
    heights = [last := max(100.0 * error, last + gap) for _, (_, (_, error)) in numbered]
    for k in range(len(heights)):  # labels that would leave the axes move down
        heights[-1 - k] = min(heights[-1 - k], 0.97 * top - k * gap)
    for height, (number, (choice, (seconds, error))) in zip(heights, numbered, strict=True):
        axes.plot(seconds, 100.0 * error, **_marker(choice))
        colour = _colour_of(choice)
        axes.plot([seconds, 4.8 * slowest], [100.0 * error, height], color=colour, lw=0.6, alpha=0.6)
        axes.text(5.0 * slowest, height, f"{number}: {100.0 * error:.1f} %", fontsize=8, va="center")
    axes.set_xlim(0.3 * min(seconds for seconds, _ in found.values()), 3e3)
    axes.set_ylim(0.0, top)
    if simulated is None:
        return
    x = (simulated[0] * simulated[1]) ** 0.5
    axes.errorbar(
        x,
        0.5 * (low + high),
        yerr=0.5 * (high - low),
        xerr=[[x - simulated[0]], [simulated[1] - x]],
        fmt="D",
        color=BLACK,
        capsize=3,
    )
    text = f"discrete elements,\n{simulated[0]:.0f}–{simulated[1]:.0f} s;\ntwo packings"
    axes.annotate(text, (x, high), xytext=(0, 6), textcoords="offset points", ha="center", fontsize=8)
    axes.text(
        0.01,
        0.5 * (low + high),
        " two packings differ",
        transform=axes.get_yaxis_transform(),
        fontsize=7,
        color=GREY,
        va="center",
    )

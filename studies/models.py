"""Which modelling choice improves accuracy against simulated grains, and which only costs time."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from statistics import geometric_mean, mean, median

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import MEDIA, Integration, Law, Plates
from rft_ros.tool import Tool, load_tool
from studies import learning, numpy_rft
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
from studies.learning import Series, bag_series, learned, model_rows, peak_error, series_of
from studies.paper import law
from studies.result import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    VERMILION,
    StudyResult,
    TextTable,
)
from studies.speed_accuracy import Mark, speed_accuracy_figure

__all__ = ["CHOICES", "GROUPS", "Choice", "Judged", "judged_choices", "study"]

Array = NDArray[np.float64]

GROUPS: dict[str, Callable[[str], bool]] = {
    "plates (5 runs)": lambda name: name.startswith("plate") and name != ALONG_ITSELF,
    "plate in its own plane": lambda name: name == ALONG_ITSELF,
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
        series = series_of(run.name, run.tool.plates, law, run.states, run.times, rows, run.forces, rest=1e-9)
        return learned(series, lag=self.lag).out[:, :3]


_LAG = 0.002  # m

CHOICES = (
    Choice(name="published"),
    Choice(name="published, α_y linear", alpha_y="linear"),
    Choice(name="published, reduced to 5 %", tolerance=0.05),
    Choice(name="refined", integration="refined"),
    Choice(name="refined, α_y linear", integration="refined", alpha_y="linear"),
    Choice(name="refined, memory 3 mm", integration="refined", mobilization_length=0.003),
    Choice(name="refined, α_y linear, memory 3 mm", integration="refined", alpha_y="linear", mobilization_length=0.003),
    Choice(
        name="default",
        integration="refined",
        alpha_y="linear",
        mobilization_length=0.003,
        tolerance=0.025,
    ),
    Choice(name="published, learned", lag=_LAG),
    Choice(name="refined, α_y linear, learned", integration="refined", alpha_y="linear", lag=_LAG),
    Choice(
        name="default, learned",
        integration="refined",
        alpha_y="linear",
        mobilization_length=0.003,
        tolerance=0.025,
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


_ROUNDS, _ROUND_SECONDS = 15, 0.003


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


_RELEASED = 485e-9
"""Time of the authors' released code (MATLAB) for a plate and state [s]."""

_NAMES = {
    "published": "paper's model",
    "refined": "refined rule",
    "refined, agarwal2023": "Agarwal 2023",
    "default": "default",
    "published, learned": "paper, learning",
    "default, learned": "default, learning",
}
"""Choices in the figure, by what they are called there."""

_COLOURS = {
    "published": ORANGE,
    "refined": BLUE,
    "refined, agarwal2023": PURPLE,
    "default": GREEN,
    "published, learned": ORANGE,
    "default, learned": VERMILION,
}


def _mark(choice: Choice, seconds: float, error: float) -> Mark:
    return Mark(
        name=_NAMES[choice.name],
        seconds=seconds,
        error=error,
        colour=_COLOURS[choice.name],
        advised=choice.name in ("default", "default, learned"),
        side="right" if choice.lag else "left",
    )


def _peers(published: Mark, *, plates: float, by_numpy: float) -> list[Mark]:
    """The published rule as others compute it: the released code and NumPy; the error is the same."""
    as_published = replace(published, peer=True, side="right")
    return [
        replace(as_published, name="NumPy", seconds=by_numpy),
        replace(as_published, name="released code", seconds=_RELEASED * plates),
    ]


def _simulated_marks(judged: Sequence[Judged]) -> list[Mark]:
    """The figure's choices over the eleven runs, and beside them discrete elements."""
    marks = []
    for choice in (c for c in CHOICES if c.name in _NAMES):
        mine = [j for j in judged if j.choice == choice and j.run in RUNS]
        marks.append(_mark(choice, mean(j.time for j in mine), mean(j.error for j in mine)))
    runs = [read_run(name) for name in RUNS]
    plates = mean(j.plates for j in judged if j.choice.name == "published" and j.run in RUNS)
    by_numpy = mean(_seconds_by_numpy(run.tool.plates, run.states[len(run.states) // 2]) for run in runs)
    marks += _peers(next(m for m in marks if m.name == _NAMES["published"]), plates=plates, by_numpy=by_numpy)
    seconds = mean(mean(WALL_SECONDS[run.name]) / len(run.states) for run in runs)
    elements = Mark(
        name="discrete elements",
        seconds=seconds,
        error=mean(PACKINGS),
        colour=BLACK,
        peer=True,
        side="above",
    )
    return [*marks, elements]


def _seconds_by_numpy(plates: Plates, state: Array) -> float:
    generic = MEDIA["generic"]
    call = partial(numpy_rft.wrench, plates, generic, 1.0, numpy_rft.constant(generic), state)
    return median_seconds([call])[0]


_RECORDED = ("abb", "cmu", "wheel")


def _real_marks() -> list[Mark]:
    """The figure's choices over the recordings: the mean of their groups. [] where the recordings are absent."""
    marks = []
    series_of_choice: dict[Choice, dict[str, list[Series]]] = {}
    for choice in (c for c in CHOICES if c.name in _NAMES):
        modelled = learning.Choice(
            name=choice.name,
            integration=choice.integration,
            alpha_y=choice.alpha_y,
            mobilization_length=choice.mobilization_length,
            law=choice.law,
            tolerance=choice.tolerance,
        )
        groups = {group: bag_series(group, modelled) for group in _RECORDED}
        if not all(groups.values()):
            return []
        series_of_choice[choice] = groups
    for choice, groups in series_of_choice.items():
        errors = []
        for runs in groups.values():
            predicted = [learned(run, lag=choice.lag).out if choice.lag else run.rows for run in runs]
            errors.append(mean(peak_error(run, out) for run, out in zip(runs, predicted, strict=True)))
        calls = [partial(_evaluated, runs[0], choice.lag) for runs in groups.values()]
        states = [len(runs[0].states) for runs in groups.values()]
        times = [seconds / n for seconds, n in zip(median_seconds(calls), states, strict=True)]
        marks.append(_mark(choice, geometric_mean(times), mean(errors)))
    published = next(groups for choice, groups in series_of_choice.items() if choice.name == "published")
    firsts = [runs[0] for runs in published.values()]
    plates = geometric_mean(len(run.plates) for run in firsts)
    by_numpy = geometric_mean(_seconds_by_numpy(run.plates, run.states[run.judged[-1]]) for run in firsts)
    return marks + _peers(marks[0], plates=plates, by_numpy=by_numpy)


def _evaluated(run: Series, lag: float) -> None:
    """A run's evaluations, and its learning with a lag."""
    model_rows(run.plates, run.law, run.states, run.stamps * np.float64(1e-9))
    if lag:
        learned(run, lag=lag)


def study() -> StudyResult:
    """Figure, page, numbers, and a table of errors by choice and group."""
    judged = judged_choices()
    rows = []
    for choice in CHOICES:
        mine = [j for j in judged if j.choice == choice]
        errors = [mean(j.error for j in mine if member(j.run)) for member in GROUPS.values()]
        rows.append((choice.name, *(f"{100.0 * e:.1f}" for e in errors), f"{1e6 * mean(j.time for j in mine):.2g} µs"))
    simulated, real = _simulated_marks(judged), _real_marks()
    return StudyResult(
        name="models",
        title="Accuracy of the modelling choices against simulated grains",
        figure=speed_accuracy_figure(simulated, real),
        table=TextTable(
            header=("errors [%]", *(name.partition(" (")[0] for name in GROUPS), "time of an evaluation"),
            rows=tuple(rows),
        ),
    )

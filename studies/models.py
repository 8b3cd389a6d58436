"""Which modelling choice improves accuracy against simulated grains, and which only costs time."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from statistics import geometric_mean, mean, median

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rft_ros.rft import MEDIA, Law, Plates
from studies import numpy_rft, wheel
from studies.choice import CHOICES, Choice
from studies.dem import (
    ALONG_ITSELF,
    CYCLE_RUNS,
    FAST_RUNS,
    RUNS,
    WALL_SECONDS,
    DemRun,
    modelled,
    read_run,
    run_error,
)
from studies.learning import Series, bag_series, learned, model_rows, peak_error, series_of
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

__all__ = [
    "GROUPS",
    "Judged",
    "Mark",
    "front",
    "judged_choices",
    "median_seconds",
    "predicted",
    "study",
]

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


def predicted(choice: Choice, run: DemRun, law: Law) -> Array:
    """The force at each state of a run [N], shape [n, 3]; a learned one uses earlier forces of the same run."""
    if choice.lag == 0.0:
        return run.predicted(law, threads=1)
    series = series_of(
        run.name, run.tool.plates, law, run.states, run.times, run.forces, rest=1e-9
    )
    return learned(series, lag=choice.lag).out[:, :3]


_ROUNDS, _ROUND_SECONDS = 15, 0.003


def median_seconds(calls: Sequence[Callable[[], object]]) -> list[float]:
    """Median processor time of each warm call [s]. Calls take turns, so that a busy machine slows all alike."""

    def seconds(call: Callable[[], object], times: int) -> float:
        began = time.thread_time()
        for _ in range(times):
            call()
        return (time.thread_time() - began) / times

    times = [
        max(1, int(_ROUND_SECONDS / min(seconds(call, 1) for _ in range(2)))) for call in calls
    ]
    turns = [
        [seconds(call, n) for call, n in zip(calls, times, strict=True)] for _ in range(_ROUNDS)
    ]
    return [median(of_call) for of_call in zip(*turns, strict=True)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """A choice in one run. `time`: of an evaluation [s]."""

    run: str
    choice: Choice
    plates: int
    error: float
    time: float


def judged_choices() -> list[Judged]:
    """Every choice in every run; ζ is fitted for each choice."""
    cases = [
        (choice, run, zeta)
        for choice in CHOICES
        for runs, zeta in [modelled(choice)]
        for run in runs
    ]
    calls = [partial(predicted, choice, run, choice.made(zeta)) for choice, run, zeta in cases]
    return [
        Judged(
            run=run.name,
            choice=choice,
            plates=len(run.tool.plates),
            error=run_error(run, call()),
            time=seconds / len(run.states),
        )
        for (choice, run, _), call, seconds in zip(
            cases, calls, median_seconds(calls), strict=True
        )
    ]


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """A mark of the figure: `seconds` of an evaluation, mean `error`, a share. `peer`: not by this package."""

    name: str
    seconds: float
    error: float
    colour: str
    learns: bool = False
    peer: bool = False


def _mark(choice: Choice, seconds: float, error: float) -> Mark:
    name, colour = _NAMES[choice.name], _COLOURS[choice.name]
    return Mark(name=name, seconds=seconds, error=error, colour=colour, learns=choice.lag > 0.0)


def _peers(published: Mark, *, plates: float, by_numpy: float) -> list[Mark]:
    """The published rule as others compute it: the released code and NumPy; the error is the same."""
    as_published = replace(published, peer=True)
    return [
        replace(as_published, name="paper's model, NumPy", seconds=by_numpy, colour=GREY),
        replace(as_published, name="paper's model, released code", seconds=_RELEASED * plates),
    ]


def _simulated_marks(judged: Sequence[Judged]) -> list[Mark]:
    """The figure's choices over the eleven runs, and beside them discrete elements."""
    marks = []
    for choice in (c for c in CHOICES if c.name in _NAMES):
        mine = [j for j in judged if j.choice == choice and j.run in RUNS]
        marks.append(_mark(choice, mean(j.time for j in mine), mean(j.error for j in mine)))
    runs = [read_run(name) for name in RUNS]
    plates = mean(j.plates for j in judged if j.choice.name == "published" and j.run in RUNS)
    by_numpy = mean(
        _seconds_by_numpy(run.tool.plates, run.states[len(run.states) // 2]) for run in runs
    )
    marks += _peers(
        next(m for m in marks if m.name == _NAMES["published"]), plates=plates, by_numpy=by_numpy
    )
    seconds = mean(mean(WALL_SECONDS[run.name]) / len(run.states) for run in runs)
    elements = Mark(
        name="discrete elements", seconds=seconds, error=mean(PACKINGS), colour=BLACK, peer=True
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
        modelled = replace(choice, lag=0.0)
        groups = {group: bag_series(group, modelled) for group in _RECORDED}
        if not all(groups.values()):
            return []
        series_of_choice[choice] = groups
    for choice, groups in series_of_choice.items():
        errors = []
        for runs in groups.values():
            predicted = [
                learned(run, lag=choice.lag).out if choice.lag else run.rows for run in runs
            ]
            errors.append(
                mean(peak_error(run, out) for run, out in zip(runs, predicted, strict=True))
            )
        calls = [partial(_evaluated, runs[0], choice.lag) for runs in groups.values()]
        states = [len(runs[0].states) for runs in groups.values()]
        times = [seconds / n for seconds, n in zip(median_seconds(calls), states, strict=True)]
        marks.append(_mark(choice, geometric_mean(times), mean(errors)))
    published = next(
        groups for choice, groups in series_of_choice.items() if choice.name == "published"
    )
    firsts = [runs[0] for runs in published.values()]
    plates = geometric_mean(len(run.plates) for run in firsts)
    by_numpy = geometric_mean(
        _seconds_by_numpy(run.plates, run.states[run.judged[-1]]) for run in firsts
    )
    return marks + _peers(marks[0], plates=plates, by_numpy=by_numpy)


def _wheel_marks() -> list[Mark]:
    """The figure's choices that do not learn over the wheel's steady states, with one ζ for all of them.

    [] where the data are absent.
    """
    if not wheel.DATA.is_dir():
        return []
    states = wheel.read_states()
    marks = []
    for choice in (c for c in CHOICES if c.name in _NAMES and not c.lag):
        plates = wheel.wheel(choice.integration, choice.tolerance).plates
        law = choice.made(1.0)
        at_one = wheel.steady_forces(law, states, plates)
        model = wheel.fitted_zeta(law, states, at_one) * at_one
        evaluations = wheel.STEPS * len(states.states) if law.has_memory else len(states.states)
        seconds = (
            median_seconds([partial(wheel.steady_forces, law, states, plates)])[0] / evaluations
        )
        marks.append(_mark(choice, seconds, wheel.median_errors(states, model)["all"]))
    return marks


def _evaluated(run: Series, lag: float) -> None:
    """A run's evaluations, and its learning with a lag."""
    model_rows(run.plates, run.law, run.states)
    if lag:
        learned(run, lag=lag)


def front(marks: Sequence[Mark]) -> list[Mark]:
    """The Pareto front: the marks for which no other is both faster and more accurate, ordered by time."""
    best: list[Mark] = []
    for mark in sorted(marks, key=lambda m: (m.seconds, m.error)):
        if not best or mark.error < best[-1].error:
            best.append(mark)
    return best


_TICKS = {
    1e-6: "1 µs",
    1e-5: "10 µs",
    1e-4: "0.1 ms",
    1e-3: "1 ms",
    1e-2: "10 ms",
    1e-1: "0.1 s",
    1.0: "1 s",
}
_PERIOD_OF_THE_NODE = 2e-3  # s: at 500 Hz


def _draw(axes: Axes, marks: Sequence[Mark], title: str, error: str) -> None:
    axes.set_xscale("log")
    best = front(marks)
    wide = {"color": GREY, "lw": 7.0, "alpha": 0.3, "zorder": 1}
    axes.step(
        [m.seconds for m in best],
        [100.0 * m.error for m in best],
        where="post",
        label="Pareto front",
        **wide,
    )
    for mark in marks:
        shape = "D" if mark.peer else ("s" if mark.learns else "o")
        fill = "white" if mark.peer else mark.colour
        percent = (
            f"{100.0 * mark.error:.0f} %" if mark.error > 0.095 else f"{100.0 * mark.error:.1f} %"
        )
        label = f"{mark.name}: {percent}"
        axes.plot(
            mark.seconds,
            100.0 * mark.error,
            shape,
            color=mark.colour,
            mfc=fill,
            mew=1.8,
            ms=9.0,
            label=label,
            zorder=3,
        )
    axes.axvline(
        _PERIOD_OF_THE_NODE, color=GREY, lw=1.0, ls="--", zorder=0, label="period of 500 Hz"
    )
    axes.set_xticks(list(_TICKS), list(_TICKS.values()))
    axes.minorticks_off()
    axes.set_ylim(0.0, 130.0 * max((m.error for m in marks), default=1.0))
    below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.13), "frameon": False, "ncols": 2}
    label_axes(axes, x="Time of one evaluation on one core", y=error, title=title, legend=below)


def _figure(simulated: Sequence[Mark], real: Sequence[Mark], driven: Sequence[Mark]) -> Figure:
    figure = new_figure(15.0, 5.8)
    figure.suptitle(
        "Without a load cell, choose the default. With one, turn on learning.", weight="bold"
    )
    absent = "the recordings are absent"
    of_peak = "RMS error of the force over its peak [%]"
    median_error = "Median error of the force [%]"
    panels = (
        (simulated, "Simulated grains, 11 runs", median_error),
        (real, f"Real sand, pressed: {'plates and a wheel' if real else absent}", of_peak),
        (
            driven,
            f"Real sand, travelling: {'a wheel dragged, rolled, spun' if driven else absent}",
            median_error,
        ),
    )
    for axes, (marks, title, error) in zip(figure.subplots(1, 3), panels, strict=True):
        _draw(axes, marks, title, error)
    return figure


def study() -> StudyResult:
    """The figure, and a table of errors by choice and group."""
    judged = judged_choices()
    rows = []
    for choice in CHOICES:
        mine = [j for j in judged if j.choice == choice]
        errors = [mean(j.error for j in mine if member(j.run)) for member in GROUPS.values()]
        rows.append(
            (
                choice.name,
                *(f"{100.0 * e:.1f}" for e in errors),
                f"{1e6 * mean(j.time for j in mine):.2g} µs",
            )
        )
    return StudyResult(
        name="models",
        title="Accuracy of the modelling choices against simulated grains",
        figure=_figure(_simulated_marks(judged), _real_marks(), _wheel_marks()),
        table=TextTable(
            header=(
                "errors [%]",
                *(name.partition(" (")[0] for name in GROUPS),
                "time of an evaluation",
            ),
            rows=tuple(rows),
        ),
    )

"""The two laws side by side: slow and fast simulated runs, without and with inertia and learning, and a wheel in sand.

ζ is fitted to one penetration for each column, for the wheel to the wheel. The wheel's data lie outside of the project,
in ``../shared/data``; without them the study has the simulated runs only.
"""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from statistics import mean

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rft_ros.estimator.learning import Learning
from rft_ros.estimator.sigma import is_withdrawn
from rft_ros.rft import ANGULAR_VELOCITY, VELOCITY, Law, Memory, Plates, checked_states, wrenches, wrenches_in_time
from rft_ros.tool import load_tool
from studies.dem import (
    CALIBRATION,
    DENSITY,
    FAST_RUNS,
    RUNS,
    DemRun,
    fitted_zeta,
    median_error,
    read_run,
    settled_error,
)
from studies.paper import law
from studies.result import BLUE, GREY, StudyResult, TextTable, label_axes, new_figure

__all__ = ["COLUMNS", "Column", "LawErrors", "law_errors", "study", "wheel_errors"]

Array = NDArray[np.float64]

LAG = 0.002
"""Path [m] between the last sample that a prediction knows and the prediction."""

_WHEEL = Path(__file__).resolve().parents[2] / "shared" / "data" / "cmu_wheel"


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """A law by the refined rule, α_y linear, with a mobilization length [m]; 0: without memory."""

    name: str
    law: str
    mobilization_length: float = 0.0

    def made(self, zeta: float, density: float = 0.0) -> Law:
        """The law."""
        length = self.mobilization_length
        return law("linear", zeta=zeta, name=self.law, density=density, mobilization_length=length)


COLUMNS = (
    Column(name="treers2021", law="treers2021"),
    Column(name="agarwal2023", law="agarwal2023"),
    Column(name="treers2021, memory 3 mm", law="treers2021", mobilization_length=0.003),
    Column(name="agarwal2023, memory 3 mm", law="agarwal2023", mobilization_length=0.003),
)
"""The columns of the table."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LawErrors:
    """Median relative errors of a column, no unit, by run.

    `plain`: slow and fast runs; `inertia`: the same with the density of the bed; `learned`: fast runs with inertia and
    what was learned `LAG` before.
    """

    column: Column
    zeta: float
    plain: dict[str, float]
    inertia: dict[str, float]
    learned: dict[str, float]


@cache
def law_errors(column: Column) -> LawErrors:
    """The errors of a column in all simulated runs."""
    runs = {name: _refined(name) for name in (*RUNS, *FAST_RUNS)}
    zeta = fitted_zeta(runs[CALIBRATION], column.made(1.0))

    def errors(density: float) -> dict[str, float]:
        found = {name: run.predicted(column.made(zeta, density)) for name, run in runs.items()}
        return {
            name: settled_error(runs[name], model) if name in FAST_RUNS else median_error(runs[name].forces, model)
            for name, model in found.items()
        }

    fast = column.made(zeta, DENSITY)
    return LawErrors(
        column=column,
        zeta=zeta,
        plain=errors(0.0),
        inertia=errors(DENSITY),
        learned={n: settled_error(runs[n], _learned(runs[n], fast)) for n in FAST_RUNS},
    )


@cache
def _refined(name: str) -> DemRun:
    run = read_run(name)
    return replace(run, tool=load_tool(run.tool.file, scale=1.0, integration="refined"))


def _learned(run: DemRun, model: Law) -> Array:
    """The force at each state with what was learned from the samples `LAG` before [N], shape [n, 3]."""
    plates, states = run.tool.plates, run.states
    if model.has_memory:
        durations = np.diff(run.times, prepend=run.times[0])
        rows = wrenches_in_time(plates, model, states, durations, Memory(plates), sensitivities=True)
    else:
        rows = wrenches(plates, model, states, sensitivities=True)
    learning = Learning(lag=LAG, reach=plates.reach)
    out = np.empty((len(states), 3))
    speeds = np.linalg.norm(states[:, VELOCITY], axis=1) + plates.reach * np.linalg.norm(
        states[:, ANGULAR_VELOCITY], axis=1
    )
    for k, time in enumerate(run.times):
        stamp = round(1e9 * (1.0 + time - run.times[0]))
        step = 0.5 * (speeds[k] + speeds[k - 1]) * (time - run.times[k - 1]) if k else 0.0
        fx, fy, fz = rows[k, :3].tolist()
        withdrawn = is_withdrawn(float(states[k, 9]), float(speeds[k]), (fx, fy, fz))
        out[k] = learning.predict(stamp, rows[k], step=step, passing=withdrawn)[:3]
        learning.learn(stamp, run.forces[k])
    return out


def wheel_errors(name: str) -> tuple[float, Array] | None:
    """ζ fitted to the wheel, and the RMS error of its force's components [N], shape [3]; None without the data."""
    if not _WHEEL.is_dir():
        return None
    states = checked_states(np.loadtxt(_WHEEL / "smooth_states.csv", delimiter=",", skiprows=1)[:, 1:])
    measured = np.loadtxt(_WHEEL / "smooth_expected.csv", delimiter=",", skiprows=1)[:, 7:10]
    model = wrenches(_wheel(), law("linear", zeta=1.0, name=name), states)[:, :3]
    zeta = float((model * measured).sum() / (model * model).sum())
    return zeta, np.sqrt(((zeta * model - measured) ** 2).mean(axis=0))


@cache
def _wheel() -> Plates:
    return load_tool(str(_WHEEL / "smooth.stl"), integration="refined").plates


def study() -> StudyResult:
    """Errors by law, run and option."""
    found = [law_errors(column) for column in COLUMNS]
    return StudyResult(
        name="laws",
        title="Two laws, with inertia and learning",
        figure=_figure(found),
        numbers={
            "laws": {
                "column": [e.column.name for e in found for _ in e.plain],
                "zeta": [e.zeta for e in found for _ in e.plain],
                "run": [name for e in found for name in e.plain],
                "median_error": [error for e in found for error in e.plain.values()],
                "median_error_with_inertia": [error for e in found for error in e.inertia.values()],
            }
        },
        table=TextTable(
            header=("law", "the 11 slow runs, mean", *FAST_RUNS.values(), "wheel: sideways, forward, up"),
            rows=tuple(_row(errors) for errors in found if errors.column.mobilization_length == 0.0),
        ),
    )


def _row(found: LawErrors) -> tuple[str, ...]:
    """A column's errors: slow runs plain and with inertia, fast ones also learned; the wheel's by component."""

    def cell(*values: float) -> str:
        return " / ".join(f"{100.0 * value:.1f}" for value in values) + " %"

    slow = cell(*(mean(errors[name] for name in RUNS) for errors in (found.plain, found.inertia)))
    fast = (cell(found.plain[name], found.inertia[name], found.learned[name]) for name in FAST_RUNS)
    wheel = wheel_errors(found.column.law)
    by_component = "" if wheel is None else ", ".join(f"{e:.1f}" for e in wheel[1]) + f" N (ζ = {wheel[0]:.2f})"
    return (f"{found.column.name} (ζ = {found.zeta:.3f})", slow, *fast, by_component)


def _figure(found: list[LawErrors]) -> Figure:
    figure = new_figure(13.0, 5.0)
    axes = figure.subplots()
    names = [*RUNS.values(), *FAST_RUNS.values()]
    place = np.arange(len(names))
    for k, e in enumerate(found):
        offset = (k - 0.5 * (len(found) - 1)) * 0.2
        axes.bar(place + offset, [100.0 * v for v in e.plain.values()], 0.2, color=GREY, alpha=0.3)
        axes.bar(place + offset, [100.0 * v for v in e.inertia.values()], 0.2, color=BLUE, alpha=0.3 + 0.2 * k)
    axes.set_xticks(place, [name.partition(" (")[0] for name in names], rotation=30, ha="right", fontsize=7)
    label_axes(axes, x="", y="Median error [%]")
    figure.suptitle("Light: without inertia; blue, from light to dark: " + ", ".join(e.column.name for e in found))
    return figure

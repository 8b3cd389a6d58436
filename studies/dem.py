"""Simulated runs in glass beads (discrete elements): ζ from one vertical penetration, every other run predicted.

``test/data/dem/README.md`` says how the runs were made and defines the error measure.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from statistics import mean

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.rft import (
    STATE,
    TWIST,
    VELOCITY,
    Law,
    Memory,
    checked_states,
    wrenches,
    wrenches_in_time,
)
from rft_ros.tool import Tool, load_tool
from studies.choice import PUBLISHED, PUBLISHED_LINEAR, REMEMBERED, Choice
from studies.result import (
    BLACK,
    BLUE,
    GREY,
    ORANGE,
    SKY,
    VERMILION,
    StudyResult,
    TextTable,
    label_axes,
    new_figure,
)

__all__ = [
    "ALONG_ITSELF",
    "CALIBRATION",
    "CYCLE_RUNS",
    "FAST_RUNS",
    "PUBLISHED_PLATES",
    "RUNS",
    "WALL_SECONDS",
]
__all__ += [
    "DemRun",
    "cycle_error",
    "errors_of",
    "fitted_zeta",
    "median_error",
    "modelled",
    "read_run",
    "run_error",
]
__all__ += ["settled_error", "smoothed", "study"]

Array = NDArray[np.float64]

CALIBRATION = "pen_plate_seedA"
"""The run that ζ is fitted to."""

RUNS = {
    CALIBRATION: "flat plate, straight down",
    "plate_b30_psi30_phi60": "plate β 30° ψ 30° φ 60°",
    "plate_b60_psi0_phi30": "plate β 60° ψ 0° φ 30°",
    "plate_b60_psi30_phi30": "plate β 60° ψ 30° φ 30°",
    "plate_b90_psi0_phi0": "plate β 90° ψ 0° φ 0°",
    "plate_b90_psi30_phi0": "plate β 90° ψ 30° φ 0°",
    "plate_b90_psi90_phi0": "plate β 90° ψ 90° φ 0° (moves in its own plane: neither face leads)",
    "ellipsoid_straight": "ellipsoid, straight down",
    "ellipsoid_osc9deg_5Hz": "ellipsoid, ±9° of pitch at 5 Hz",
    "root_insert_tilt10": "root tip, pushed in at 10°",
    "root_helix_P40_tilt10": "root tip, helix of 40 mm pitch",
}
"""What each run is, by name."""

FAST_RUNS = {
    "fast_plate_b90_0p1mps_ref": "upright plate, 0.1 m/s",
    "fast_plate_b90_0p5mps": "upright plate, 0.5 m/s",
    "fast_plate_b90_1mps": "upright plate, 1 m/s",
    "fast_pen_plate_1mps": "flat plate down, 1 m/s",
}
"""Runs at several speeds, from rest at full speed within a step; judged by `settled_error`."""

CYCLE_RUNS = {
    "press_cycles": "flat plate down, small retreats and reloads",
    "drag_cycles": "upright plate dragged, small retreats and reloads",
}
"""Runs judged by `cycle_error`; ζ of the other runs holds."""

WALL_SECONDS = {
    "pen_plate_seedA": (119.0, 119.0),
    **{name: (157.0, 424.0) for name in RUNS if name.startswith("plate")},
    "ellipsoid_straight": (279.0, 279.0),
    "ellipsoid_osc9deg_5Hz": (339.0, 339.0),
    "root_insert_tilt10": (95.0, 95.0),
    "root_helix_P40_tilt10": (155.0, 155.0),
}
"""Shortest and longest wall time of each simulation [s]; of the plates only the range is recorded."""

DATA = Path(__file__).resolve().parents[1] / "test" / "data" / "dem"
"""The folder of the runs."""

_MESHES = {
    "ellipsoid": "ellipsoid",
    "root": "paraboloid",
    "cup": "cup",
    "pair9": "pair9",
    "rake": "rake",
}
"""The mesh of a run by the first word of its name; the others have the plate."""
_HEADER = ("t_s", *STATE, "fx", "fy", "fz", "tx", "ty", "tz")

_WINDOW = 9  # samples of the centred mean; the grains' own noise is faster
_FIRST, _LAST = 5, -8  # samples that this mean lacks neighbours for, or nearly
_SHOCK = 0.012  # m
_CYCLE_SPEED = 0.02  # m/s
_STRONG = 0.2  # of the peak: below it, noise decides the relative error


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DemRun:
    """One run.

    `times` [s], shape [n]. `states`: shape [n, 13], columns `rft_ros.rft.STATE`. `forces`: on the tool by the grains
    [N], shape [n, 3], world axes.
    """

    name: str
    tool: Tool
    times: Array
    states: Array
    forces: Array

    def predicted(self, law: Law, *, threads: int | None = None) -> Array:
        """The model's force at each state [N], shape [n, 3]; with memory if the law has a mobilization length."""
        plates = self.tool.plates
        if not law.has_memory:
            return wrenches(plates, law, self.states, threads=threads)[:, :3]
        return wrenches_in_time(plates, law, self.states, Memory(plates))[:, :3]


def read_run(
    name: str,
    choice: Choice = PUBLISHED,
    *,
    rests: bool = False,
    folder: Path = DATA,
    hull: bool = False,
) -> DemRun:
    """A simulated run with the tool of a choice, and the rows in which it rests if asked for, or of `CYCLE_RUNS`.

    `folder`: of the run and of its mesh. `hull`: the tool is the convex hull of its mesh.
    """
    file = folder / f"{name}.csv"
    with file.open(encoding="utf-8") as lines:
        header = tuple(next(lines).strip().split(","))
        rows = np.loadtxt(lines, delimiter=",", ndmin=2)
    if header != _HEADER:
        raise InputError(
            f"'{file}' has the header {','.join(header)}; it must be {','.join(_HEADER)}"
        )
    states = checked_states(rows[:, 1:14])
    used = np.any(states[:, TWIST] != 0.0, axis=1) | (name in CYCLE_RUNS) | rests
    mesh = folder / "meshes" / f"{_MESHES.get(name.split('_')[0], 'plate')}.stl"
    return DemRun(
        name=name,
        tool=load_tool(
            mesh, scale=1.0, hull=hull, integration=choice.integration, tolerance=choice.tolerance
        ),
        times=rows[used, 0],
        states=states[used],
        forces=rows[used, 14:17],
    )


def fitted_zeta(run: DemRun, law_at_one: Law) -> float:
    """ζ by least squares of the force vectors without memory, where the vertical one exceeds a fifth of its maximum."""
    model = run.predicted(replace(law_at_one, mobilization_length=0.0))
    strong = run.forces[:, 2] > _STRONG * run.forces[:, 2].max()
    return float((run.forces[strong] * model[strong]).sum() / (model[strong] ** 2).sum())


def smoothed(forces: Array, window: int = _WINDOW) -> Array:
    """The centred mean of `window` samples, same shape; zeros stand in for neighbours beyond the ends."""
    return np.apply_along_axis(np.convolve, 0, forces, np.full(window, 1.0 / window), "same")


def median_error(measured: Array, model: Array) -> float:
    """Median of abs(model - measured) / abs(measured) of force vectors, shape [n, 3].

    The measured force is smoothed, its ends are dropped, and samples below 20 % of its peak are left out.
    """
    smooth = smoothed(measured)[_FIRST:_LAST]
    size = np.linalg.norm(smooth, axis=1)
    used = size > _STRONG * size.max()
    return float(
        np.median(np.linalg.norm(model[_FIRST:_LAST] - smooth, axis=1)[used] / size[used])
    )


def settled_error(run: DemRun, model: Array) -> float:
    """Median relative error of force vectors past the first 12 mm of path, where the shock of the start is over.

    `model`: shape [n, 3]. The measured force is smoothed; its last four samples are dropped.
    """
    steps = np.linalg.norm(run.states[1:, VELOCITY], axis=1) * np.diff(run.times)
    used = np.flatnonzero(np.concatenate([[0.0], np.cumsum(steps)]) > _SHOCK)[:-4]
    smooth = smoothed(run.forces)[used]
    return float(
        np.median(np.linalg.norm(model[used] - smooth, axis=1) / np.linalg.norm(smooth, axis=1))
    )


def cycle_error(run: DemRun, model: Array) -> float:
    """RMS of the vector error in retreats and reloads over the greatest force in them; `model`: shape [n, 3]."""
    used = np.isclose(np.linalg.norm(run.states[:, VELOCITY], axis=1), _CYCLE_SPEED, rtol=1e-3)
    smooth = smoothed(run.forces, 5)[used]
    rms = np.sqrt(((model[used] - smooth) ** 2).sum(axis=1).mean())
    return float(rms / np.linalg.norm(smooth, axis=1).max())


PUBLISHED_PLATES = (1.2, 18.8)
"""Least and greatest median error of the paper's own plates [%], over its combinations of β, φ and ψ."""

ALONG_ITSELF = "plate_b90_psi90_phi0"
"""The plate neither of whose faces leads. Memory cannot supply the missing force, so means leave it out."""


def run_error(run: DemRun, model: Array) -> float:
    """The error by which a run is judged; `model`: shape [n, 3]."""
    if run.name in CYCLE_RUNS:
        return cycle_error(run, model)
    return settled_error(run, model) if run.name in FAST_RUNS else median_error(run.forces, model)


@cache
def modelled(choice: Choice) -> tuple[tuple[DemRun, ...], float]:
    """Every run with the tool of a choice, and ζ fitted to the calibration run alone."""
    runs = tuple(read_run(name, choice) for name in (*RUNS, *FAST_RUNS, *CYCLE_RUNS))
    calibration = next(run for run in runs if run.name == CALIBRATION)
    return runs, fitted_zeta(calibration, replace(choice, density=0.0).made(1.0))


@cache
def errors_of(choice: Choice) -> dict[str, float]:
    """The error of a choice without learning, by run."""
    runs, zeta = modelled(choice)
    return {run.name: run_error(run, run.predicted(choice.made(zeta))) for run in runs}


_COLUMNS = {
    "published": PUBLISHED,
    "published, α_y linear": PUBLISHED_LINEAR,
    "refined, with memory": REMEMBERED,
}


def study() -> StudyResult:
    """Errors of every slow run and of the cycles by three choices."""
    errors = {title: errors_of(choice) for title, choice in _COLUMNS.items()}

    def row(text: str, names: Sequence[str]) -> tuple[str, ...]:
        return (text, *(f"{100.0 * mean(e[name] for name in names):.1f}" for e in errors.values()))

    rows = [row(what, [name]) for name, what in RUNS.items()]
    others = [name for name in RUNS if name != ALONG_ITSELF]
    rows.append(row("mean, without the plate that moves in its own plane", others))
    rows += [row(f"{what}: error of cycles", [name]) for name, what in CYCLE_RUNS.items()]
    return StudyResult(
        name="dem",
        title="Simulated grains: every run predicted from one penetration",
        figure=_draw(errors),
        table=TextTable(header=("run", *(f"{title} [%]" for title in _COLUMNS)), rows=tuple(rows)),
    )


def _draw(errors: dict[str, dict[str, float]]) -> Figure:
    figure = new_figure(10.5, 11.5)
    panels = figure.subplots(4, 3).ravel()
    for number, (name, axes) in enumerate(zip(RUNS, panels, strict=False), start=1):
        _draw_run(axes, name)
        what = RUNS[name].partition(" (")[0]
        shares = " → ".join(
            f"{100.0 * e[name]:.0f}" for title, e in errors.items() if "linear" not in title
        )
        axes.set_title(f"{number}. {what}: {shares} %", fontsize=9)
    panels[0].legend(fontsize=8)
    last = panels[len(RUNS)]
    last.axhspan(*PUBLISHED_PLATES, color="0.9", label="paper's plates")
    place = np.arange(len(RUNS))
    for shift, (title, of_run), colour in zip(
        (-0.27, 0.0, 0.27), errors.items(), (BLACK, ORANGE, SKY), strict=True
    ):
        last.bar(
            place + shift,
            [100.0 * of_run[name] for name in RUNS],
            width=0.27,
            color=colour,
            label=title,
        )
    last.set_xticks(place, [str(k + 1) for k in place])
    label_axes(last, x="Run", y="Median error [%]", legend={"loc": "upper left"})
    last.set_ylim(0.0, 120.0)
    figure.suptitle(
        "Force on the tool, ζ fitted to run 1 alone. In the titles: error, published → refined with memory"
    )
    return figure


def _draw_run(axes: Axes, name: str) -> None:
    for choice, style, width in ((PUBLISHED, "--", 1.8), (REMEMBERED, ":", 1.2)):
        runs, zeta = modelled(choice)
        run = next(run for run in runs if run.name == name)
        model, measured = run.predicted(choice.made(zeta)), smoothed(run.forces)[4:-4]
        for column, what, colour in ((2, "up", BLUE), (0, "along x", VERMILION)):
            if choice == PUBLISHED:
                axes.plot(
                    run.times[4:-4],
                    measured[:, column],
                    color=colour,
                    lw=0.8,
                    label=f"{what}, simulated",
                )
            label = f"{what}, {choice.name}"
            axes.plot(run.times, model[:, column], color=colour, lw=width, ls=style, label=label)
    axes.axhline(0.0, color=GREY, lw=0.6)
    label_axes(axes, x="Time [s]", y="Force [N]")

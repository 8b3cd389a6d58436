"""Hollow tools in simulated grains: the measured force, and the model's on the facets and on the convex hull.

The runs are the fourth set of ``../shared/data/dem``, whose README says how they were made.
"""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from rft_ros.rft import POSITION, VELOCITY
from studies.choice import REMEMBERED
from studies.dem import DemRun, median_error, read_run, smoothed
from studies.result import BLACK, BLUE, ORANGE, StudyResult, label_axes, new_figure, result_of_rows

__all__ = ["DATA", "RUNS", "errors", "study"]

Array = NDArray[np.float64]

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "dem"
"""The folder of the runs."""

RUNS = {
    "cup_down": "Box pressed mouth first",
    "cup_fwd": "Box dragged mouth first",
    "pair9": "Two plates 9 mm apart, dragged",
    "rake": "Rake of four tines, dragged",
}
"""What each run is, by name."""

_ZETA = 0.24  # of the bed
_LAST = -5  # rows whose smoothed force has neighbours on one side only


def _read(name: str, *, hull: bool) -> tuple[DemRun, Array]:
    """A run with its facets or its hull as the tool, and the model's force at each state [N]."""
    run = read_run(name, REMEMBERED, folder=DATA, hull=hull)
    return run, run.predicted(REMEMBERED.made(_ZETA))


def errors(name: str) -> tuple[float, float]:
    """The error of the model on the facets and on the convex hull, as a share."""
    run, on_facets = _read(name, hull=False)
    _, on_hull = _read(name, hull=True)
    return median_error(run.forces, on_facets), median_error(run.forces, on_hull)


def study() -> StudyResult:
    """Force over the travel of each tool: simulated, on the facets and on the hull."""
    figure = new_figure(9.0, 6.4)
    rows = []
    for axes, (name, title) in zip(figure.subplots(2, 2).flat, RUNS.items(), strict=True):
        found = errors(name)
        _draw(
            axes, name, f"{title}: facets {100.0 * found[0]:.0f} %, hull {100.0 * found[1]:.0f} %"
        )
        rows.append((title, *found))
    figure.axes[0].legend(fontsize=8)
    columns = (("tool", "{}"), ("facets", "{:.0f} %", 100.0), ("convex hull", "{:.0f} %", 100.0))
    return result_of_rows(
        "fails_hollow", "Hollow tools in simulated grains", figure, rows, *columns
    )


def _draw(axes: Axes, name: str, title: str) -> None:
    """The force against the main motion: down, or along x."""
    run, on_facets = _read(name, hull=False)
    _, on_hull = _read(name, hull=True)
    if name == "cup_down":
        axis = 2
        sign = 1.0
        used = run.states[:, VELOCITY][:, axis] < 0.0
        travel = -run.tool.lowest_point(np.eye(3)) - run.states[used, POSITION][:, axis]
        label = "Depth of the rim [mm]"
    else:
        axis = 0
        sign = -1.0
        used = run.states[:, VELOCITY][:, axis] > 0.0
        place = run.states[used, POSITION][:, axis]
        travel = place - place[0]
        label = "Travel [mm]"
    for force, colour, style, name_of_line in (
        (smoothed(run.forces), BLACK, "-", "simulated"),
        (on_facets, ORANGE, "-", "facets"),
        (on_hull, BLUE, "--", "convex hull"),
    ):
        axes.plot(
            1e3 * travel[:_LAST],
            sign * force[used, axis][:_LAST],
            color=colour,
            ls=style,
            label=name_of_line,
        )
    axes.set_ylim(bottom=0.0)
    label_axes(axes, x=label, y="Force against the motion [N]", title=title)

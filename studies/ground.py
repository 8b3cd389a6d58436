"""Four passes of an upright plate through the same place: a level plane, and the ground as a camera sees it.

A height map of the simulated bed before each pass stands for what a camera sees (``test/data/dem/README.md``).
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rft_ros.ground import HeightMap, Support
from rft_ros.rft import QUATERNION, Memory, rotation_matrix, wrenches_in_time
from studies.dem import DATA, read_run
from studies.learning import (
    LAGS,
    MODELS,
    PASSES,
    Series,
    dem_series,
    learned,
    pass_errors,
    passes_of,
)
from studies.result import (
    BLACK,
    BLUE,
    ORANGE,
    VERMILION,
    StudyResult,
    TextTable,
    label_axes,
    new_figure,
)

__all__ = ["four_passes", "seen_before", "study"]

Array = NDArray[np.float64]

CELL = 0.003
"""Cells of the maps [m]: those of the data."""

# m; the highest grain tops lie this far below z = 0 on average (the data's README)
_TOPS = 0.00025


def seen_before(number: int, tool: tuple[Array, Array, Array] | None = None) -> HeightMap:
    """The simulated bed before the drag `number`, 1 to 4, without what belongs to the `tool`."""
    file = DATA / "heights" / f"{PASSES}_height_before_drag{number}.csv"
    x, y, h = np.loadtxt(file, delimiter=",", skiprows=1).T
    return HeightMap.unknown(CELL).with_points(x, y, h + _TOPS, tool)


def four_passes() -> tuple[Series, Series]:
    """The run on a level plane and on the ground seen before each pass; refined, α_y linear, with memory."""
    choice = MODELS[-1]
    level = dem_series(PASSES, choice)
    tool, law, states = read_run(PASSES, choice).tool, level.law, level.states
    support = Support(tool.corners)
    drags = passes_of(level)
    # a map is in force from the end of the drag before it, when the plate leaves
    ends = [0, *(int(drag[-1]) + 1 for drag in drags[:-1]), len(states)]
    rows, memory = np.empty_like(level.rows), Memory(tool.plates)
    for number, ((first, last), drag) in enumerate(
        zip(pairwise(ends), drags, strict=True), start=1
    ):
        at = states[drag[0]]  # the plate stands lowered while the map is taken
        place = at[:3], rotation_matrix(at[QUATERNION]), tool.corners
        ground = HeightMap.unknown(CELL) if number == 1 else seen_before(number, place)
        for k in range(first, last):
            surface = support.local_surface(ground, states[k], default_height=0.0)
            rows[k] = wrenches_in_time(
                tool.plates,
                law,
                states[k : k + 1],
                memory,
                surface_height=surface.height,
                slope=surface.slope,
                sensitivities=True,
            )[0]
    return level, replace(level, rows=rows)


def study() -> StudyResult:
    """Errors of each pass, and the forces along it."""
    level, ground = four_passes()
    cases = {
        "level plane": (level, level.rows),
        "ground seen before each pass": (ground, ground.rows),
    }
    for lag in LAGS:
        for name, series in (("level plane", level), ("ground", ground)):
            cases[f"{name}, learning with lag {1e3 * lag:g} mm"] = (
                series,
                learned(series, lag=lag).out,
            )
    table = []
    for name, (series, out) in cases.items():
        errors = pass_errors(series, out)
        table.append(
            (name, *(f"{100.0 * e:.0f}" for e in errors), f"{100.0 * np.mean(errors):.1f}")
        )
    return StudyResult(
        name="ground",
        title="Four passes in one trench: level plane and ground seen before each pass",
        figure=_draw(level, ground),
        table=TextTable(
            header=("median vector error [%]", "pass 1", "pass 2", "pass 3", "pass 4", "mean"),
            rows=tuple(table),
        ),
    )


def _draw(level: Series, ground: Series) -> Figure:
    figure = new_figure(12.0, 6.4)
    panels = figure.subplots(2, 4, sharex=True)
    applied = learned(ground, lag=LAGS[0]).out
    for number, drag in enumerate(passes_of(level)):
        force, x = panels[0][number], 1e3 * level.states[drag, 0]
        force.plot(x, -level.expected[drag, 0], color=BLACK, lw=1.0, label="simulated")
        force.plot(x, -level.rows[drag, 0], color=VERMILION, ls="--", label="level plane")
        force.plot(x, -ground.rows[drag, 0], color=BLUE, label="ground seen before the pass")
        force.plot(
            x, -applied[drag, 0], color=ORANGE, lw=1.0, label="ground, learning with lag 2 mm"
        )
        force.set_title(f"Pass {number + 1}")
        force.set_ylim(0.0, 1.7)
        cells = seen_before(number + 1).points()
        lane = np.abs(cells[:, 1]) < 0.010
        along = np.unique(cells[lane, 0])
        height = np.array([cells[lane & (cells[:, 0] == at), 2].mean() for at in along])
        near = (along > x.min() * 1e-3 - 0.02) & (along < 0.07)
        panels[1][number].fill_between(
            1e3 * along[near], -30.0, 1e3 * height[near], color="#C2A878", alpha=0.6
        )
        edge = 1e3 * float((level.states[drag[0], 2]) - 0.015)
        panels[1][number].axhline(
            edge, color=BLACK, lw=0.8, ls=":", label="lower edge of the plate"
        )
        panels[1][number].set_ylim(-30.0, 15.0)
        label_axes(
            panels[1][number], x="x [mm]", y="Height before the pass [mm]" if not number else ""
        )
    label_axes(panels[0][0], x="", y="Force against the motion [N]")
    panels[0][0].legend(fontsize=7, loc="upper left")
    panels[1][0].legend(fontsize=7, loc="lower left")
    return figure

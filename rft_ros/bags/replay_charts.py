"""The charts of a replay: force and torque over time and depth, what was learned, the residual, the ground."""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.estimates import PHASES
from rft_ros.bags.phases import Phase
from rft_ros.estimator.quality import QualityFlag, Trust, flag_names, trust
from rft_ros.ground import HeightMap
from rft_ros.report.charts import Panels

__all__ = ["Figure", "ground_chart", "replay_charts"]

_TIME = "Time since the first pose [s]"
_DEPTH = "Depth of the lowest point [mm]"
_BAND = "one standard deviation on each side"
_BINS = 60
_MAP_CELLS = 150
_IN_GRAINS = -1e-3
"""Least depth in charts over depth [m]; negative: above the surface."""
_LEARNED = (
    ("Strength", 1.0, {0: "vertical", 1: "horizontal"}),
    ("Turn [deg]", math.degrees(1.0), {2: "turn"}),
    ("Surface [mm]", 1e3, {3: "surface"}),
    ("Surprise [std. deviations]", 1.0, {8: "surprise"}),
)

Rows = NDArray[np.void]
"""Rows of a replay, shape [n]; columns and units: `rft_ros.bags.estimates.ROW`."""


class Figure(NamedTuple):
    """A plotly figure with its name (for links), a title, and a sentence on what it shows."""

    name: str
    title: str
    sentence: str
    drawn: Any


def replay_charts(rows: Rows, vertical: tuple[str, str]) -> list[Figure]:
    """All charts of a replay, in the order of the page. `rows`: shape [n], units as `ROW`.

    `vertical`: the sensor axis nearest to vertical, and where it points.
    """
    time = (rows["stamp"] - rows["stamp"].min(initial=2**62)) * 1e-9
    spans = [
        (PHASES[rows["phase"][a]].value, begin, end)
        for a, begin, end in _segments(time, rows["phase"])
        if rows["phase"][a] >= 0
    ]
    charts = [_over_time(rows, time, spans, first, vertical) for first in (0, 3)]
    charts += [_over_depth(rows, first) for first in (0, 3)]
    if not np.isnan(rows["learned"]).all():
        charts.append(_learned(rows, time, spans))
    return [*charts, _residual(rows, time, spans)]


def _segments(
    time: NDArray[np.float64], values: "NDArray[np.int64] | NDArray[np.bool_]"
) -> Iterator[tuple[int, float, float]]:
    """First row, begin and end [s] of each run of equal values; a run ends where the next begins."""
    if len(values):
        changes = np.flatnonzero((values[1:] != values[:-1]) | (np.diff(time) < 0.0)) + 1
        starts, ends = [0, *changes.tolist()], [*changes.tolist(), len(time) - 1]
        for a, b in zip(starts, ends, strict=True):
            yield a, float(time[a]), max(float(time[a]), float(time[b]))


def _what(first: int) -> tuple[str, str]:
    return ("Force", "N") if first == 0 else ("Torque", "N m")


def _band(panels: Panels, at: tuple[int, int], rows: Rows, x: NDArray[np.float64], column: int) -> None:
    y, deviation = rows["predicted"][:, column], rows["sigma"][:, column]
    panels.band(at, "± standard deviation", x, y, deviation, colour="predicted")


def _over_time(
    rows: Rows,
    time: NDArray[np.float64],
    spans: list[tuple[str, float, float]],
    first: int,
    vertical: tuple[str, str],
) -> Figure:
    what, unit = _what(first)
    flags = [flag for flag in QualityFlag if first == 0 and (rows["quality_flags"] & int(flag)).any()]
    heights = (1.0, 1.0, 1.0, 0.1 + 0.13 * len(flags)) if flags else ()
    panels = Panels(4 if flags else 3, height=640 + 26 * len(flags), heights=heights)
    for k, axis in enumerate("xyz"):
        at = (k + 1, 1)
        _band(panels, at, rows, time, first + k)
        panels.line(at, "measured", time, rows["compensated"][:, first + k])
        panels.line(at, "predicted", time, rows["predicted"][:, first + k])
        panels.label(at, y=f"{what} {axis} [{unit}]", x=_TIME if k == 2 and not flags else "")
    for place, flag in enumerate(flags):
        raised = (rows["quality_flags"] & int(flag)) != 0
        times = [t for a, begin, end in _segments(time, raised) if raised[a] for t in (begin, end, math.nan)]
        label = "flag: no trust" if trust(flag) is Trust.NO else f"flag: {trust(flag).value.lower()}"
        x, y = np.array(times), np.full(len(times), float(place))
        panels.line((4, 1), label, x, y, colour=trust(flag).value.lower(), width=9.0)
    if flags:
        names = [flag_names(flag)[0] for flag in flags]
        panels.label((4, 1), x=_TIME, y="Quality flags" if len(flags) > 3 else "")  # fewer rows are too low for it
        ticks = {"tickvals": list(range(len(names))), "ticktext": names, "range": [len(names) - 0.5, -0.5]}
        panels.figure.update_yaxes(**ticks, row=4, col=1)
    panels.shade(range(1, 5 if flags else 4), spans)
    flagged = " Below: when the prediction had which quality flag; blue means caution, black do not trust."
    sentence = (
        f"{what} on the tool by the grains, along the axes of the sensor frame ({vertical[0]} points {vertical[1]} or"
        f" nearly so): measured, less bias and tool weight, and predicted by RFT, with a band of {_BAND}. A line breaks"
        f" where there is no estimate.{flagged if flags else ''}"
    )
    return Figure(f"{what.lower()}_over_time", f"{what} over time", sentence, panels.figure)


def _over_depth(rows: Rows, first: int) -> Figure:
    what, unit = _what(first)
    panels = Panels(1, 3, height=440)
    below = rows["depth"] > _IN_GRAINS
    for k, axis in enumerate("xyz"):
        at, column = (1, k + 1), first + k
        for code, phase in enumerate(PHASES):
            used = (rows["phase"] == code) & below & ~np.isnan(rows["predicted"][:, 0])
            if used.sum() > 1:
                x = np.where(used, 1e3 * rows["depth"], math.nan)
                _band(panels, at, rows, x, column)
                y = np.where(used, rows["compensated"][:, column], math.nan)
                panels.line(at, f"measured, {phase.value}", x, y, colour=phase.value, width=2.0)
        panels.line(at, "predicted", np.where(below, 1e3 * rows["depth"], math.nan), rows["predicted"][:, column])
        panels.label(at, x=_DEPTH, y=f"{what} {axis} [{unit}]")
    sentence = (
        f"The same {what.lower()} over the depth of the tool's lowest point below the surface; the measured line has"
        " the colour of the phase, the predicted one a band as above."
    )
    return Figure(f"{what.lower()}_over_depth", f"{what} over depth", sentence, panels.figure)


def _learned(rows: Rows, time: NDArray[np.float64], spans: list[tuple[str, float, float]]) -> Figure:
    panels = Panels(len(_LEARNED), 2)
    inward = np.isin(rows["phase"], [PHASES.index(phase) for phase in (Phase.PENETRATION, Phase.PLOUGHING)])
    depth = np.where(inward & (rows["depth"] > 0.0), 1e3 * rows["depth"], math.nan)
    for row, (label, unit, columns) in enumerate(_LEARNED, start=1):
        for column, x in enumerate((time, depth), start=1):
            for number, name in columns.items():
                value = unit * rows["learned"][:, number]
                if number < 4:
                    error = unit * rows["learned"][:, number + 4]
                    panels.band((row, column), "± standard error", x, value, error, colour=name)
                panels.line((row, column), name, x, value)
            x_label = (_TIME, _DEPTH)[column - 1] if row == len(_LEARNED) else ""
            panels.label((row, column), x=x_label, y=label)
    panels.shade(range(1, len(_LEARNED) + 1), spans)
    sentence = (
        "Strength of the vertical and of the horizontal force over the model's, turn of the horizontal force about the"
        " vertical, and height of the surface above surface_height, each with its standard error, and how surprising"
        " the force was: over time, and over the depth of the lowest point on the way in."
    )
    return Figure("learned", "What is learned of the grains", sentence, panels.figure)


def _residual(rows: Rows, time: NDArray[np.float64], spans: list[tuple[str, float, float]]) -> Figure:
    panels = Panels(2, 2, same_x=False)
    for row, first in ((1, 0), (2, 3)):
        what, unit = _what(first)
        residual = (rows["compensated"] - rows["predicted"])[:, first : first + 3]
        used = residual[(rows["depth"] > 0.0) & ~np.isnan(residual[:, 0])]
        edges = _edges(used)
        for k, axis in enumerate("xyz"):
            panels.line((row, 1), axis, time, residual[:, k], width=1.2)
            counts = np.histogram(np.clip(used[:, k], edges[0], edges[-1]), edges)[0].astype(np.float64)
            panels.bars((row, 2), axis, edges, 100.0 * counts / max(1, len(used)))
        name = f"{what} residual [{unit}]"
        panels.label((row, 1), x=_TIME, y=name)
        panels.label((row, 2), x=name, y="Share in the grains [%]")
    panels.shade((1, 2), spans)
    sentence = (
        "Measured minus predicted, by sensor axis: over time, and how often each size occurs while the tool is in the"
        " grains (the outermost bars hold what lies beyond them)."
    )
    return Figure("residual", "Residual", sentence, panels.figure)


def _edges(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Edges of bins over the central 99 %: rare outliers, such as at the start of a withdrawal, do not widen them."""
    low, high = np.percentile(values, [0.5, 99.5]).tolist() if len(values) else (-1.0, 1.0)
    if not high > low:
        low, high = low - 1.0, high + 1.0
    return np.linspace(low, high, _BINS + 1)


def ground_chart(start: HeightMap, end: HeightMap) -> Figure:
    """The heights of the ground at the start and at the end."""
    panels = Panels(1, 2, height=460, same_x=False)
    for column, (ground, when) in enumerate(((start, "at the start"), (end, "at the end")), start=1):
        k = 1 + max(ground.heights.shape) // _MAP_CELLS
        heights = 1e3 * ground.heights[::k, ::k].astype(np.float64)
        x, y = (
            1e3 * ground.cell * (first + 0.5 + k * np.arange(n))
            for first, n in zip(ground.corner, heights.shape, strict=True)
        )
        panels.map((1, column), x, y, heights)
        panels.label((1, column), x=f"x [mm], {when}", y="y [mm]")
    sentence = "Height of the ground in world axes [mm]; blank where nothing is known."
    return Figure("ground", "Ground", sentence, panels.figure)

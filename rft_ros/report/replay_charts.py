"""The charts of a replay: force and torque over time and depth, and what is left between measured and predicted."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rft_ros.report.charts import Chart, Line, Panel, Span

__all__ = ["ReplaySeries", "replay_charts"]

_Numbers = NDArray[np.float64]

_TIME = "Time since the first pose [s]"
_DEPTH = "Depth of the lowest point [mm]"
_BINS = 60
_IN_GRAINS = -1e-3
"""Charts over depth begin here, a little above the surface [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReplaySeries:
    """A replay, thinned out to what a chart can show: a row for each pose that is drawn.

    `time` [s] from the first pose; `depth` of the tool's lowest point [m]; `phase`: index into `phases`, -1 for none;
    `measured` (less bias and tool weight), `predicted`: wrench on the tool in sensor axes [N, N m], shape [n, 6], NaN
    where there is none. `vertical`: the sensor axis nearest to vertical, and where it points ("up" or "down").
    """

    time: _Numbers
    depth: _Numbers
    phase: NDArray[np.int64]
    phases: tuple[str, ...]
    measured: _Numbers
    predicted: _Numbers
    vertical: tuple[str, str]


def replay_charts(series: ReplaySeries) -> tuple[Chart, ...]:
    """All of them, in the order of the page."""
    spans = _spans(series)
    return (_over_time(series, spans, 0), _over_time(series, spans, 3), *_over_depth(series), _residual(series, spans))


def _what(column: int) -> tuple[str, str]:
    return ("Force", "N") if column < 3 else ("Torque", "N m")


def _over_time(series: ReplaySeries, spans: tuple[Span, ...], first: int) -> Chart:
    what, unit = _what(first)
    rows = []
    for column, axis in zip(range(first, first + 3), "xyz", strict=True):
        lines = _pair(series, series.time, column, slice(None))
        rows.append((Panel(x_label=_TIME, y_label=f"{what} {axis} [{unit}]", lines=lines),))
    return Chart(
        name=f"{what.lower()}_over_time",
        title=f"{what} over time",
        sentence=f"{what} on the tool by the grains, along the axes of the sensor frame{_z_points(series)}: measured,"
        " less bias and tool weight, and predicted by RFT. A line breaks where there is no estimate.",
        panels=tuple(rows),
        spans=spans,
    )


def _z_points(series: ReplaySeries) -> str:
    axis, pointing = series.vertical
    return f" ({axis} points {pointing} or nearly so)"


def _pair(series: ReplaySeries, across: _Numbers, column: int, rows: "slice | NDArray[np.bool_]") -> tuple[Line, ...]:
    return tuple(
        Line(label=name, colour=name, x=across[rows], y=wrench[rows, column])
        for name, wrench in (("measured", series.measured), ("predicted", series.predicted))
    )


def _over_depth(series: ReplaySeries) -> tuple[Chart, ...]:
    """Measured by phase in colour, predicted beside it."""
    charts = []
    depth = 1e3 * series.depth
    for first in (0, 3):
        what, unit = _what(first)
        panels = []
        for column, axis in zip(range(first, first + 3), "xyz", strict=True):
            lines = []
            for code, phase in enumerate(series.phases):
                rows = (series.phase == code) & (series.depth > _IN_GRAINS) & ~np.isnan(series.predicted[:, 0])
                if rows.sum() > 1:
                    x = np.where(rows, depth, math.nan)
                    y = np.where(rows, series.measured[:, column], math.nan)
                    lines.append(Line(label=f"measured, {phase}", colour=phase, x=x, y=y, width=2.0))
            below = series.depth > _IN_GRAINS
            x, y = np.where(below, depth, math.nan), np.where(below, series.predicted[:, column], math.nan)
            lines.append(Line(label="predicted", colour="predicted", x=x, y=y, width=1.2))
            panels.append(Panel(x_label=_DEPTH, y_label=f"{what} {axis} [{unit}]", lines=tuple(lines)))
        charts.append(
            Chart(
                name=f"{what.lower()}_over_depth",
                title=f"{what} over depth",
                sentence=f"The same {what.lower()} over the depth of the tool's lowest point below the surface; the"
                " measured line has the colour of the phase.",
                panels=(tuple(panels),),
                height=440,
            )
        )
    return tuple(charts)


def _residual(series: ReplaySeries, spans: tuple[Span, ...]) -> Chart:
    rows = []
    for first in (0, 3):
        what, unit = _what(first)
        over_time, bars = [], []
        residual = series.measured[:, first : first + 3] - series.predicted[:, first : first + 3]
        edges = _edges(residual)
        for k, axis in enumerate("xyz"):
            over_time.append(Line(label=axis, colour=axis, x=series.time, y=residual[:, k], width=1.2))
            values = residual[~np.isnan(residual[:, k]), k]
            counts = np.histogram(values, edges)[0].astype(np.float64)
            bars.append(Line(label=axis, colour=axis, x=edges, y=100.0 * counts / max(1, len(values)), kind="bars"))
        name = f"{what} residual [{unit}]"
        rows.append(
            (
                Panel(x_label=_TIME, y_label=name, lines=tuple(over_time)),
                Panel(x_label=name, y_label="Share of estimates [%]", lines=tuple(bars)),
            )
        )
    return Chart(
        name="residual",
        title="Residual",
        sentence="Measured minus predicted, by sensor axis: over time, and how often each size occurs.",
        panels=tuple(rows),
        spans=spans,
        same_x=False,
    )


def _edges(values: _Numbers) -> _Numbers:
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (-1.0, 1.0)
    if not high > low:
        low, high = low - 1.0, high + 1.0
    return np.linspace(low, high, _BINS + 1)


def _spans(series: ReplaySeries) -> tuple[Span, ...]:
    """Stretches of one phase, each up to the beginning of the next."""
    if not len(series.time):
        return ()
    changes = np.flatnonzero((np.diff(series.phase) != 0) | (np.diff(series.time) < 0.0)) + 1
    begins = [0, *changes.tolist()]
    ends = [*changes.tolist(), len(series.time) - 1]
    return tuple(
        Span(series.phases[series.phase[a]], float(series.time[a]), float(max(series.time[a], series.time[b])))
        for a, b in zip(begins, ends, strict=True)
        if series.phase[a] >= 0
    )

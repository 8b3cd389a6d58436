"""The charts of a replay: force and torque over time and depth, and the residual."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rft_ros.report.charts import Chart, Line, Panel, Span

__all__ = ["FlaggedRows", "ReplaySeries", "replay_charts"]

_Numbers = NDArray[np.float64]

_TIME = "Time since the first pose [s]"
_DEPTH = "Depth of the lowest point [mm]"
_BINS = 60
_BAND = "one standard deviation on each side"
_IN_GRAINS = -1e-3
"""Least depth in charts over depth [m]; negative: above the surface."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlaggedRows:
    """A quality flag: its `name`, its `trust` ("CAUTION" or "NO") and the `rows` that have it, shape [n], no unit."""

    name: str
    trust: str
    rows: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReplaySeries:
    """A replay, decimated to what a chart can show: n rows, one for each pose drawn.

    `time`: since the first pose [s]. `depth`: of the tool's lowest point [m]. `phase`: index into `phases`, -1 for
    none. `measured` (less bias and tool weight), `predicted`: wrench on the tool in sensor axes [N, N m], shape [n, 6],
    NaN if missing. `deviation`: standard deviation of each predicted component, shape [n, 6]. `quality_flags`: those
    that occur. `vertical`: the sensor axis nearest to vertical, and "up" or "down" for where it points.
    `learned`: s_v, s_h, ρ [rad], δ [m], their standard errors, and the surprise, shape [n, 9]; NaN without learning.
    """

    time: _Numbers
    depth: _Numbers
    phase: NDArray[np.int64]
    phases: tuple[str, ...]
    measured: _Numbers
    predicted: _Numbers
    deviation: _Numbers
    quality_flags: tuple[FlaggedRows, ...]
    vertical: tuple[str, str]
    learned: _Numbers

    def spans(self) -> tuple[Span, ...]:
        """One span for each phase."""
        return tuple(
            Span(self.phases[self.phase[row]], begin, end)
            for row, begin, end in self.segments(self.phase)
            if self.phase[row] >= 0
        )

    def segments(self, values: "NDArray[np.int64] | NDArray[np.bool_]") -> list[tuple[int, float, float]]:
        """First row, begin and end [s] of each run of equal values; a run ends where the next begins.

        `values`: shape [n], a value for each row.
        """
        if not len(values):
            return []
        differs = (values[1:] != values[:-1]) | (np.diff(self.time) < 0.0)
        changes = (np.flatnonzero(differs) + 1).tolist()
        time = self.time.tolist()
        return [
            (a, time[a], max(time[a], time[b]))
            for a, b in zip([0, *changes], [*changes, len(time) - 1], strict=True)
        ]  # fmt: skip


def replay_charts(series: ReplaySeries) -> tuple[Chart, ...]:
    """All charts of a replay, in the order of the page."""
    spans = series.spans()
    charts = (_over_time(series, spans, 0), _over_time(series, spans, 3), *_over_depth(series))
    learned = () if np.isnan(series.learned).all() else (_learned(series, spans),)
    return (*charts, *learned, _residual(series, spans))


def _what(column: int) -> tuple[str, str]:
    return ("Force", "N") if column < 3 else ("Torque", "N m")


def _over_time(series: ReplaySeries, spans: tuple[Span, ...], first: int) -> Chart:
    what, unit = _what(first)
    rows = []
    for column, axis in zip(range(first, first + 3), "xyz", strict=True):
        lines = (
            _band(series, series.time, column),
            _line("measured", series.time, series.measured[:, column]),
            _line("predicted", series.time, series.predicted[:, column]),
        )
        rows.append((Panel(x_label=_TIME, y_label=f"{what} {axis} [{unit}]", lines=lines),))
    flagged, (vertical, pointing) = "", series.vertical
    quality_flags = series.quality_flags if first == 0 else ()
    if quality_flags:
        rows.append((_quality_flags(series),))
        flagged = " Below: when the prediction had which quality flag; blue means caution, black do not trust."
    return Chart(
        name=f"{what.lower()}_over_time",
        title=f"{what} over time",
        sentence=f"{what} on the tool by the grains, along the axes of the sensor frame ({vertical} points {pointing}"
        f" or nearly so): measured, less bias and tool weight, and predicted by RFT, with a band of {_BAND}. A line"
        f" breaks where there is no estimate.{flagged}",
        panels=tuple(rows),
        spans=spans,
        height=640 + 26 * len(quality_flags),
        heights=(1.0, 1.0, 1.0, 0.1 + 0.13 * len(quality_flags)) if quality_flags else (),
    )


def _quality_flags(series: ReplaySeries) -> Panel:
    lines = []
    for place, flag in enumerate(series.quality_flags):
        times = [t for row, begin, end in series.segments(flag.rows) if flag.rows[row] for t in (begin, end, math.nan)]
        x, y = np.array(times), np.full(len(times), float(place))
        label = "flag: no trust" if flag.trust == "NO" else f"flag: {flag.trust.lower()}"
        lines.append(Line(label=label, colour=flag.trust.lower(), x=x, y=y, width=9.0))
    label = "Quality flags" if len(lines) > 3 else ""  # fewer rows are too low for it
    return Panel(x_label=_TIME, y_label=label, lines=tuple(lines), names=tuple(d.name for d in series.quality_flags))


def _line(name: str, x: _Numbers, y: _Numbers) -> Line:
    return Line(label=name, colour=name, x=x, y=y)


def _band(series: ReplaySeries, x: _Numbers, column: int) -> Line:
    middle, deviation = series.predicted[:, column], series.deviation[:, column]
    y = np.stack([middle - deviation, middle + deviation])
    return Line(label="± standard deviation", colour="predicted", x=x, y=y, kind="band")


def _over_depth(series: ReplaySeries) -> tuple[Chart, ...]:
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
                    lines.append(_band(series, x, column))
                    y = np.where(rows, series.measured[:, column], math.nan)
                    lines.append(Line(label=f"measured, {phase}", colour=phase, x=x, y=y, width=2.0))
            below = np.where(series.depth > _IN_GRAINS, depth, math.nan)
            lines.append(_line("predicted", below, series.predicted[:, column]))
            panels.append(Panel(x_label=_DEPTH, y_label=f"{what} {axis} [{unit}]", lines=tuple(lines)))
        charts.append(
            Chart(
                name=f"{what.lower()}_over_depth",
                title=f"{what} over depth",
                sentence=f"The same {what.lower()} over the depth of the tool's lowest point below the surface; the"
                " measured line has the colour of the phase, the predicted one a band as above.",
                panels=(tuple(panels),),
                height=440,
            )
        )
    return tuple(charts)


def _learned(series: ReplaySeries, spans: tuple[Span, ...]) -> Chart:
    """What is believed of the grains with its standard error, over time and over depth on the way in."""
    inward = np.array([phase in ("penetration", "ploughing") for phase in (*series.phases, "none")])[series.phase]
    depth = np.where(inward & (series.depth > 0.0), 1e3 * series.depth, math.nan)
    rows = []
    for label, unit, columns in (
        ("Strength", 1.0, {0: "vertical", 1: "horizontal"}),
        ("Turn [deg]", math.degrees(1.0), {2: "turn"}),
        ("Surface [mm]", 1e3, {3: "surface"}),
        ("Surprise [std. deviations]", 1.0, {8: "surprise"}),
    ):
        panels = []
        for x_label, x in ((_TIME, series.time), (_DEPTH, depth)):
            lines = []
            for column, name in columns.items():
                value = unit * series.learned[:, column]
                if column < 4:
                    error = unit * series.learned[:, column + 4]
                    y = np.stack([value - error, value + error])
                    lines.append(Line(label="± standard error", colour=name, x=x, y=y, kind="band"))
                lines.append(Line(label=name, colour=name, x=x, y=value))
            panels.append(Panel(x_label=x_label, y_label=label, lines=tuple(lines)))
        rows.append(tuple(panels))
    return Chart(
        name="learned",
        title="What is learned of the grains",
        sentence="Strength of the vertical and of the horizontal force over the model's, turn of the horizontal force"
        " about the vertical, and height of the surface above surface_height, each with its standard error, and how"
        " surprising the force was: over time, and over the depth of the lowest point on the way in.",
        panels=tuple(rows),
        spans=spans,
    )


def _residual(series: ReplaySeries, spans: tuple[Span, ...]) -> Chart:
    rows = []
    for first in (0, 3):
        what, unit = _what(first)
        over_time, bars = [], []
        residual = series.measured[:, first : first + 3] - series.predicted[:, first : first + 3]
        used = residual[(series.depth > 0.0) & ~np.isnan(residual[:, 0])]
        edges = _edges(used)
        for k, axis in enumerate("xyz"):
            over_time.append(Line(label=axis, colour=axis, x=series.time, y=residual[:, k], width=1.2))
            counts = np.histogram(np.clip(used[:, k], edges[0], edges[-1]), edges)[0].astype(np.float64)
            bars.append(Line(label=axis, colour=axis, x=edges, y=100.0 * counts / max(1, len(used)), kind="bars"))
        name = f"{what} residual [{unit}]"
        rows.append(
            (
                Panel(x_label=_TIME, y_label=name, lines=tuple(over_time)),
                Panel(x_label=name, y_label="Share in the grains [%]", lines=tuple(bars)),
            )
        )
    return Chart(
        name="residual",
        title="Residual",
        sentence="Measured minus predicted, by sensor axis: over time, and how often each size occurs while the tool"
        " is in the grains (the outermost bars hold what lies beyond them).",
        panels=tuple(rows),
        spans=spans,
        same_x=False,
    )


def _edges(values: _Numbers) -> _Numbers:
    """Edges of bins over the central 99 %: rare outliers, such as at the start of a withdrawal, do not widen them."""
    low, high = np.percentile(values, [0.5, 99.5]).tolist() if len(values) else (-1.0, 1.0)
    if not high > low:
        low, high = low - 1.0, high + 1.0
    return np.linspace(low, high, _BINS + 1)

"""Report and charts of a replay, from its rows, model and summary."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.estimates import LEARNED_COLUMNS, PHASES, Rows
from rft_ros.bags.playback import played_motion
from rft_ros.bags.summary import METRIC_HEADS, Summary, metric_rows
from rft_ros.estimator import Estimator, QualityFlag, sentences, trust
from rft_ros.parameters import PARAMETERS
from rft_ros.report import Figure, Table, tool_figure, write_page
from rft_ros.rft import AXES, FORCE

_Array = NDArray[np.float64]

_BUCKET_COUNT = 500  # about one for each pixel of a panel's width
_MIN_CHART_DEPTH_M = -1e-3
_TIME = "Time since the first pose [s]"
_DEPTH = "Depth of the lowest point [mm]"
_UNITS = ("N", "N m")  # of forces and torques
_LEARNED_PANELS = {  # titles of the panels, with the factor to the title's unit, and lines: fields of `Belief`
    "Strength": (1.0, ("vertical_strength", "horizontal_strength")),
    "Turn [deg]": (math.degrees(1.0), ("turn",)),
    "Surface [mm]": (1e3, ("surface",)),
    "Surprise<br>[std. deviations]": (1.0, ("surprise",)),
}
_COLOURS = {  # Okabe and Ito's palette, distinguishable with any kind of colour vision
    "measured": "#333333",
    "turn": "#333333",
    "surface": "#333333",
    "surprise": "#333333",
    "predicted": "#D55E00",
    "vertical_strength": "#D55E00",
    "horizontal_strength": "#0072B2",
    "approach": "#999999",
    "penetration": "#0072B2",
    "ploughing": "#CC79A7",
    "dwell": "#56B4E9",
    "withdrawal": "#009E73",
    "caution": "#56B4E9",
    "no": "#000000",
}
_BAND_OPACITY_SHARE = 0.22


def draw(summary: Summary, rows: Rows, estimator: Estimator, file: Path) -> None:
    """Write the report of a replay's rows, shape [n], after the estimator's last sample."""
    rows = decimated(rows[rows["stamp"] > 0])
    write_page(
        file,
        [
            *replay_charts(rows),
            *_tables(summary),
            *_animation(rows, estimator),
            _parameters(summary),
        ],
        title=f"Replay of {summary.bag}",
        sentence=f"{summary.verdict}. Force and torque that the grains put on the tool, in the axes and about the"
        " origin of the sensor frame: measured by the load cell, less bias and tool weight, and predicted by 3D"
        " granular Resistive Force Theory,"
        f" at {summary.estimates:,} of {summary.messages['pose']:,} poses in {summary.duration:.1f} s.",
        warnings=[*([f"damage: {summary.damage}"] if summary.damage else []), *summary.warnings],
    )


def decimated(rows: Rows) -> Rows:
    """Thin out rows for charts: of each of 500 buckets, the first row and three others.

    These have the greatest depth, the greatest force and the greatest residual force.
    """
    force = rows["compensated"][:, FORCE]
    residual = rows["residual"][:, FORCE]
    row_numbers = set()
    for size in (rows["depth"], np.linalg.norm(force, axis=1), np.linalg.norm(residual, axis=1)):
        known = np.nan_to_num(size, nan=-math.inf)
        for bucket in np.array_split(np.arange(len(rows)), _BUCKET_COUNT):
            if len(bucket):
                row_numbers |= {bucket[0], bucket[known[bucket].argmax()]}
    return np.array(rows[sorted(row_numbers)])


def _tables(summary: Summary) -> Iterator[Table]:
    sentence = (
        "Of the force vector: greatest measured force; RMS and peak of the residual (measured less predicted); RMS over"
        " peak of the same line; median of the relative error where the measured force is over 20 % of the recording's"
        " peak; share of the force's components within one and two standard deviations. Depth bins are those of"
        " penetration. summary.json has every axis."
    )
    yield Table("Metrics", sentence, ("", *METRIC_HEADS), metric_rows(summary))
    trust_counts = ", ".join(f"{level} {count:,}" for level, count in summary.trust.items())
    flags = []
    for name, share in summary.flag_rows():
        flag = QualityFlag[name.upper()]
        flags.append((name, share, trust(flag).value, sentences(flag)))
    sentence = f"Which share of the {summary.in_grains:,} poses in the grains has each flag"
    sentence = f"{sentence} (trust of all: {trust_counts})."
    yield Table(
        "Quality flags",
        sentence,
        ("flag", "of the poses in the grains", "trust", "meaning"),
        flags or [("none", "0", "", "")],
    )
    reason_rows = [(name, f"{count:,}") for name, count in summary.reasons.items()] or [
        ("none", "0")
    ]
    sentence = (
        "Samples that were not used, poses without an estimate and estimates without a residual."
    )
    yield Table("Not used or unanswered", sentence, ("reason", "count"), reason_rows)


def _parameters(summary: Summary) -> Table:
    """Those that differ from their defaults, and then the others."""
    parameters = {parameter.name: parameter for parameter in PARAMETERS}
    changed_rows: list[tuple[str, str, str]] = []
    default_rows: list[tuple[str, str, str]] = []
    for name, value in summary.parameters.items():
        parameter = parameters[name]
        row = (name, str(value), parameter.unit)
        is_default = np.array_equal(value, parameter.default)
        (default_rows if is_default else changed_rows).append(row)
    sentence = f"The first {len(changed_rows)} differ from the defaults."
    return Table(
        "Parameters", sentence, ("parameter", "value", "unit"), changed_rows + default_rows
    )


def replay_charts(rows: Rows) -> list[Figure]:
    """The charts of a replay, in the order of the page. `rows`: with a stamp, shape [n]."""
    time = (rows["stamp"] - rows["stamp"].min(initial=2**62)) * 1e-9
    depth = np.where(rows["depth"] > _MIN_CHART_DEPTH_M, 1e3 * rows["depth"], math.nan)
    charts = [
        _wrench(rows, time, axis_name="time", x_title=_TIME),
        _wrench(rows, depth, axis_name="depth", x_title=_DEPTH),
    ]
    if rows["quality_flags"].any():
        charts.append(_flags(rows, time))
    if not np.isnan(rows["learned"]["turn"]).all():
        charts.append(_learned(rows, time, depth))
    return charts


def _figure(rows: int, x_titles: Sequence[str], *, height: int = 640) -> Any:
    """A plotly Figure with columns of panels, which share their x axis. `height` [px]."""
    from plotly.subplots import make_subplots

    spacing = {"vertical_spacing": 0.05, "horizontal_spacing": 0.09}
    figure = make_subplots(rows=rows, cols=len(x_titles), shared_xaxes="columns", **spacing)
    for column, title in enumerate(x_titles, start=1):
        figure.update_xaxes(title_text=title, row=rows, col=column)
    return figure.update_layout(
        template="plotly_white",
        font={"family": "system-ui, sans-serif", "size": 13, "color": "#222222"},
        height=height,
        margin={"l": 85, "r": 20, "t": 80, "b": 55},
        legend={"orientation": "h", "x": 0.0, "y": 1.02, "xanchor": "left", "yanchor": "bottom"},
    )


class _Panel(NamedTuple):
    """A panel of a plotly Figure, at a row and a column from 1."""

    figure: Any
    row: int
    column: int

    def label(self, title: str) -> None:
        """Set the title of the y axis."""
        self.figure.update_yaxes(title_text=title, row=self.row, col=self.column)

    def line(self, name: str, x: _Array, y: _Array, *, colour: str, width: float = 1.5) -> None:
        """Draw a line with gaps at NaN; those of a name share a legend entry. `colour`: of `_COLOURS`."""
        self._draw(name, x, y, {"line": {"color": _COLOURS[colour], "width": width}})

    def band(self, name: str, x: _Array, y: _Array, deviation: _Array, *, colour: str) -> None:
        """Draw a band from y - deviation to y + deviation, with gaps at NaN."""
        lower = np.column_stack([x, y - deviation])
        upper = np.column_stack([x, y + deviation])
        gap = np.full((1, 2), math.nan)
        outlines = []
        known = np.ma.masked_invalid(x + y + deviation)
        for part in np.ma.flatnotmasked_contiguous(known):  # type: ignore[no-untyped-call]
            outlines += [lower[part], upper[part][::-1], gap]
        xs, ys = np.concatenate([*outlines, gap]).T
        fill = {"fill": "toself", "fillcolor": _COLOURS[colour], "opacity": _BAND_OPACITY_SHARE}
        self._draw(name, xs, ys, fill | {"line": {"width": 0.0}, "hoverinfo": "skip"})

    def _draw(self, name: str, x: _Array, y: _Array, look: dict[str, Any]) -> None:
        self.figure.add_scatter(
            row=self.row,
            col=self.column,
            name=name,
            legendgroup=name,
            showlegend=all(trace.name != name for trace in self.figure.data),
            x=x.astype(np.float32),  # finer than a screen, half the bytes
            y=y.astype(np.float32),
            mode="lines",
            **look,
        )


def _wrench(rows: Rows, x: _Array, *, axis_name: str, x_title: str) -> Figure:
    figure = _figure(3, [x_title, x_title], height=760)
    for k, axis in enumerate(AXES):
        column, row = divmod(k, 3)
        panel = _Panel(figure, row + 1, column + 1)
        panel.label(f"{axis} [{_UNITS[column]}]")
        measurement = rows["compensated"][:, k]
        prediction = rows["predicted"][:, k]
        panel.band("± standard deviation", x, prediction, rows["sigma"][:, k], colour="predicted")
        for code, phase in enumerate(PHASES):
            y = np.where(rows["phase"] == code, measurement, math.nan)
            if not np.isnan(x + y).all():
                panel.line(f"measured, {phase}", x, y, colour=phase, width=2.0)
        panel.line("predicted", x, prediction, colour="predicted")
    sentence = (
        f"Measured, in the colour of the phase, and predicted, with a band of one standard deviation on each side, over"
        f" {axis_name}. A line breaks where there is no estimate."
    )
    return Figure(
        f"wrench_over_{axis_name}", f"Force and torque over {axis_name}", sentence, figure
    )


def _flags(rows: Rows, time: _Array) -> Figure:
    flags = [flag for flag in QualityFlag if (rows["quality_flags"] & int(flag)).any()]
    figure = _figure(1, [_TIME], height=200 + 26 * len(flags))
    panel = _Panel(figure, 1, 1)
    for place, flag in enumerate(flags):
        is_raised = (rows["quality_flags"] & int(flag)) != 0
        is_raised[1:] |= is_raised[:-1]  # up to the next pose
        level = trust(flag).value.lower()
        y = np.where(is_raised, float(place), math.nan)
        panel.line(f"trust: {level}", time, y, colour=level, width=9.0)
    figure.update_xaxes(range=[time.min(), time.max()])
    figure.update_yaxes(
        tickvals=list(range(len(flags))),
        ticktext=[flag.label for flag in flags],
        range=[len(flags) - 0.5, -0.5],
    )
    sentence = "When the prediction had which flag."
    return Figure("quality_flags", "Quality flags over time", sentence, figure)


def _learned(rows: Rows, time: _Array, depth: _Array) -> Figure:
    figure = _figure(len(_LEARNED_PANELS), [_TIME, _DEPTH], height=900)
    learned = rows["learned"]
    for row, (title, (unit, fields)) in enumerate(_LEARNED_PANELS.items(), start=1):
        for column, x in enumerate([time, depth], start=1):
            panel = _Panel(figure, row, column)
            panel.label(title)
            for name in fields:
                value = unit * learned[name]
                if f"{name}_error" in LEARNED_COLUMNS:
                    error = unit * learned[f"{name}_error"]
                    panel.band("± standard error", x, value, error, colour=name)
                panel.line(name.replace("_", " "), x, value, colour=name)
    sentence = (
        "Strength of the vertical and of the horizontal force over the model's, turn of the horizontal force about the"
        " vertical, and height of the surface above surface_height, each with its standard error, and how surprising"
        " the force was."
    )
    return Figure("learned", "What is learned of the grains", sentence, figure)


def _animation(rows: Rows, estimator: Estimator) -> Iterator[Figure]:
    """The animation of the tool in the grains; none if it never was in the grains."""
    begin = rows["stamp"].min(initial=2**62)
    rows_in_grains = rows[~np.isnan(rows["predicted"][:, 0]) & (rows["depth"] > 0.0)]
    if not len(rows_in_grains):
        return
    yield tool_figure(
        "Tool and traction",
        estimator.model,
        played_motion(rows_in_grains, estimator, begin=begin),
        surface_height=estimator.config.surface_height,
        learned=estimator.config.learning.mode == "apply",
        where="World axes; the surface is the one at the end. The slider selects a moment in the grains.",
    )

"""Report and charts of a replay, from its rows, model and summary."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.phases import PHASES, Phase
from rft_ros.bags.summary import METRIC_HEADS, Summary, metric_rows
from rft_ros.estimator import Estimator
from rft_ros.estimator.quality import QualityFlag, Trust, flag_names, sentences, trust
from rft_ros.parameters import PARAMETERS
from rft_ros.report.animation import animate, animation_figure
from rft_ros.report.charts import Panels
from rft_ros.report.page import Figure, Table, write_page

__all__ = ["decimated", "draw", "replay_charts"]

Rows = NDArray[np.void]
"""Rows of a replay, shape [n]; columns and units: `rft_ros.bags.estimates.ROW`."""

_Array = NDArray[np.float64]
_Spans = list[tuple[str, float, float]]

_BUCKETS = 1500
_MOST_FACES = 4000
_MOMENTS = 8
_IN_GRAINS = -1e-3  # least depth in charts over depth [m]
_TIME, _DEPTH = "Time since the first pose [s]", "Depth of the lowest point [mm]"
_KINDS = (("Force", "N", 0), ("Torque", "N m", 3))  # and the first column of its axes
_LEARNED = (
    ("Strength", 1.0, {0: "vertical", 1: "horizontal"}),
    ("Turn [deg]", math.degrees(1.0), {2: "turn"}),
    ("Surface [mm]", 1e3, {3: "surface"}),
    ("Surprise [std. deviations]", 1.0, {8: "surprise"}),
)


def draw(summary: Summary, rows: Rows, estimator: Estimator, file: Path) -> None:
    """Write the report of a replay's rows, shape [n], after the estimator's last sample."""
    rows = decimated(rows)
    rows = rows[~np.isnan(rows["depth"])]
    minutes, seconds = divmod(summary.duration, 60.0)
    metrics, *tables = _tables(summary)
    write_page(
        file,
        title=f"Replay of {summary.bag}",
        sentence=f"The force and torque that the grains put on the tool, measured by the load cell and predicted by 3D"
        f" granular Resistive Force Theory, at {summary.estimates:,} of {summary.messages['pose']:,} poses in"
        f" {f'{minutes:.0f} min ' if minutes else ''}{seconds:.1f} s of recording. Both are on the tool by the grains,"
        " in the axes and about the origin of the sensor frame.",
        warnings=[*([f"reading stopped early: {summary.damage}"] if summary.damage else []), *summary.warnings],
        sections=[metrics, *replay_charts(rows), *_film(rows, estimator), *tables],
    )


def decimated(rows: Rows) -> Rows:
    """At most some thousand of the rows.

    Of each bucket of successive rows it keeps the first and those with the greatest depth, measured force and residual
    force.
    """
    size = math.ceil(len(rows) / _BUCKETS)
    if size <= 4:
        return np.array(rows)
    force = rows["compensated"][:, :3]
    residual = force - rows["predicted"][:, :3]
    starts = np.arange(0, len(rows), size)
    kept = [starts]
    for values in (rows["depth"], np.linalg.norm(force, axis=1), np.linalg.norm(residual, axis=1)):
        filled = np.pad(np.nan_to_num(values, nan=-math.inf), (0, -len(rows) % size), constant_values=-math.inf)
        kept.append(starts + filled.reshape(-1, size).argmax(axis=1))
    return rows[np.unique(kept)]


def _tables(summary: Summary) -> Iterator[Table]:
    yield Table(
        title="Metrics",
        sentence="Of the force vector: greatest measured force; RMS and peak of the residual (measured less"
        " predicted); RMS over peak of the same line; median of the relative error where the measured force is over"
        f" 20 % of the recording's peak. Depth bins are those of {Phase.PENETRATION}. summary.json has every axis.",
        heads=("", *METRIC_HEADS),
        rows=metric_rows(summary),
    )
    trusted = ", ".join(f"{level} {count:,}" for level, count in summary.trust.items())
    counted = {flag: summary.quality_flags[flag_names(flag)[0]] for flag in QualityFlag}
    flags = [(flag_names(f)[0], f"{n:,}", trust(f).value, sentences(f)) for f, n in counted.items() if n]
    yield Table(
        title="Quality flags",
        sentence=f"How many of the {summary.estimates:,} estimates have each flag (trust: {trusted})."
        " The band in the figures is one standard deviation of the prediction on each side.",
        heads=("flag", "estimates", "trust", "meaning"),
        rows=flags or [("none", "0", "", "")],
        words=True,
    )
    read = [(role, topic, f"{summary.messages[role]:,}") for role, topic in summary.topics.items()]
    yield Table(title="Read", heads=("role", "topic", "messages"), rows=read, words=True)
    yield Table(
        title="Not used or unanswered",
        sentence="Samples that were not used, poses without an estimate and estimates without a residual.",
        heads=("reason", "count"),
        rows=[(name, f"{count:,}") for name, count in summary.reasons.items()] or [("none", "0")],
    )
    units = {parameter.name: parameter.unit for parameter in PARAMETERS}
    values = [(name, _text(value), units.get(name, "")) for name, value in summary.parameters.items()]
    yield Table(title="Parameters", heads=("parameter", "value", "unit"), rows=values, words=True, folded=True)


def _text(value: object) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(_text, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def replay_charts(rows: Rows) -> list[Figure]:
    """The charts of rows with a known depth, shape [n], in the order of the page."""
    time = (rows["stamp"] - rows["stamp"].min(initial=2**62)) * 1e-9
    runs = _runs(time, rows["phase"])
    spans = [(PHASES[rows["phase"][a]].value, begin, end) for a, begin, end in runs if rows["phase"][a] >= 0]
    charts = [_over_time(rows, time, spans, *kind) for kind in _KINDS]
    charts += [_over_depth(rows, *kind) for kind in _KINDS]
    if not np.isnan(rows["learned"]).all():
        charts.append(_learned(rows, time, spans))
    return [*charts, _residual(rows, time, spans)]


def _runs(time: _Array, values: "NDArray[np.int64] | NDArray[np.bool_]") -> Iterator[tuple[int, float, float]]:
    """First row, begin and end [s] of each run of equal values; a run ends where the next begins."""
    if len(values):
        changes = np.flatnonzero((values[1:] != values[:-1]) | (np.diff(time) < 0.0)) + 1
        for a, b in zip([0, *changes.tolist()], [*changes.tolist(), len(time) - 1], strict=True):
            yield a, float(time[a]), max(float(time[a]), float(time[b]))


def _band(panels: Panels, at: tuple[int, int], rows: Rows, x: _Array, column: int) -> None:
    y, deviation = rows["predicted"][:, column], rows["sigma"][:, column]
    panels.band(at, "± standard deviation", x, y, deviation, colour="predicted")


def _over_time(rows: Rows, time: _Array, spans: _Spans, what: str, unit: str, first: int) -> Figure:
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
        times = [t for a, begin, end in _runs(time, raised) if raised[a] for t in (begin, end, math.nan)]
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
        f"{what} on the tool by the grains, along the axes of the sensor frame: measured, less bias and tool weight,"
        " and predicted by RFT, with a band of one standard deviation on each side. A line breaks where there is no"
        f" estimate.{flagged if flags else ''}"
    )
    return Figure(f"{what.lower()}_over_time", f"{what} over time", sentence, panels.figure)


def _over_depth(rows: Rows, what: str, unit: str, first: int) -> Figure:
    panels = Panels(1, 3, height=440)
    below = rows["depth"] > _IN_GRAINS
    depth = np.where(below, 1e3 * rows["depth"], math.nan)
    for k, axis in enumerate("xyz"):
        at, column = (1, k + 1), first + k
        for code, phase in enumerate(PHASES):
            used = (rows["phase"] == code) & below & ~np.isnan(rows["predicted"][:, 0])
            if used.sum() > 1:
                x, y = (np.where(used, values, math.nan) for values in (depth, rows["compensated"][:, column]))
                _band(panels, at, rows, x, column)
                panels.line(at, f"measured, {phase.value}", x, y, colour=phase.value, width=2.0)
        panels.line(at, "predicted", depth, rows["predicted"][:, column])
        panels.label(at, x=_DEPTH, y=f"{what} {axis} [{unit}]")
    sentence = (
        f"The same {what.lower()} over the depth of the tool's lowest point below the surface; the measured line has"
        " the colour of the phase, the predicted one a band as above."
    )
    return Figure(f"{what.lower()}_over_depth", f"{what} over depth", sentence, panels.figure)


def _learned(rows: Rows, time: _Array, spans: _Spans) -> Figure:
    panels = Panels(len(_LEARNED), 2)
    inward = np.isin(rows["phase"], [PHASES.index(phase) for phase in (Phase.PENETRATION, Phase.PLOUGHING)])
    depth = np.where(inward & (rows["depth"] > 0.0), 1e3 * rows["depth"], math.nan)
    for row, (label, unit, columns) in enumerate(_LEARNED, start=1):
        for column, (x, x_label) in enumerate(((time, _TIME), (depth, _DEPTH)), start=1):
            at = (row, column)
            for number, name in columns.items():
                value = unit * rows["learned"][:, number]
                if number < 4:
                    error = unit * rows["learned"][:, number + 4]
                    panels.band(at, "± standard error", x, value, error, colour=name)
                panels.line(at, name, x, value)
            panels.label(at, x=x_label if row == len(_LEARNED) else "", y=label)
    panels.shade(range(1, len(_LEARNED) + 1), spans)
    sentence = (
        "Strength of the vertical and of the horizontal force over the model's, turn of the horizontal force about the"
        " vertical, and height of the surface above surface_height, each with its standard error, and how surprising"
        " the force was: over time, and over the depth of the lowest point on the way in."
    )
    return Figure("learned", "What is learned of the grains", sentence, panels.figure)


def _residual(rows: Rows, time: _Array, spans: _Spans) -> Figure:
    panels = Panels(2)
    residual = rows["compensated"] - rows["predicted"]
    for row, (what, unit, first) in enumerate(_KINDS, start=1):
        for k, axis in enumerate("xyz"):
            panels.line((row, 1), axis, time, residual[:, first + k], width=1.2)
        panels.label((row, 1), x=_TIME if row == 2 else "", y=f"{what} residual [{unit}]")
    panels.shade((1, 2), spans)
    return Figure("residual", "Residual", "Measured minus predicted, by sensor axis, over time.", panels.figure)


def _film(rows: Rows, estimator: Estimator) -> list[Figure]:
    """The tool at its deepest (shown first) and at some other moments; nothing if it was not in the grains."""
    depth, model, ground = rows["depth"], estimator.model, estimator.ground
    used = np.flatnonzero(~np.isnan(rows["predicted"][:, 0]) & (depth > 0.0))
    if not len(used):
        return []
    deepest = used[depth[used].argmax()]
    evenly = used[np.linspace(0, len(used) - 1, _MOMENTS).round().astype(int)]
    moments = np.unique([deepest, *evenly])
    states = np.array(rows["state"][moments])
    if ground is None:
        states[:, :2] = 0.0  # a recording may cross the bed
    scene = animate(
        f"Tool and traction{' (law without memory)' if model.mobilization_length > 0.0 else ''}",
        model.tool,
        model.law,
        states,
        [f"{1e3 * row['depth']:.1f} mm, {PHASES[row['phase']]}" for row in rows[moments]],
        surface_height=estimator.settings.surface_height,
        ground=ground,
        first=int(np.searchsorted(moments, deepest)),
        most_faces=_MOST_FACES,
    )
    sentence = (
        "The tool coloured by the predicted traction on its leading faces, in world axes (x and y from the tool's"
        " origin), the surface of the grains at the end, and the predicted force as an arrow. The slider selects a"
        " moment of the recording."
    )
    return [Figure("tool", scene.title, sentence, animation_figure(scene))]

"""Report and charts of a replay, from its rows, model and summary."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.estimates import AXES, Rows
from rft_ros.bags.phases import PHASES, Phase
from rft_ros.bags.summary import METRIC_HEADS, Summary, metric_rows
from rft_ros.estimator import Estimator
from rft_ros.estimator.quality import QualityFlag, flag_names, sentences, trust
from rft_ros.parameters import PARAMETERS
from rft_ros.report.animation import animate, animation_figure
from rft_ros.report.charts import Panels
from rft_ros.report.page import Figure, Table, write_page

__all__ = ["decimated", "draw", "replay_charts"]

_Array = NDArray[np.float64]

_BUCKETS = 1500
_IN_GRAINS = -1e-3  # least depth in charts over depth [m]
_TIME, _DEPTH = "Time since the first pose [s]", "Depth of the lowest point [mm]"
_LEARNED = (
    ("Strength", 1.0, {0: "vertical", 1: "horizontal"}),
    ("Turn [deg]", math.degrees(1.0), {2: "turn"}),
    ("Surface [mm]", 1e3, {3: "surface"}),
    ("Surprise [std. deviations]", 1.0, {8: "surprise"}),
)


def draw(summary: Summary, rows: Rows, estimator: Estimator, file: Path) -> None:
    """Write the report of a replay's rows, shape [n], after the estimator's last sample."""
    rows = decimated(rows[rows["stamp"] > 0])
    write_page(
        file,
        [*_tables(summary), *replay_charts(rows), *_animation(rows, estimator), _parameters(summary)],
        title=f"Replay of {summary.bag}",
        sentence="Force and torque that the grains put on the tool, in the axes and about the origin of the sensor"
        " frame: measured by the load cell, less bias and tool weight, and predicted by 3D granular Resistive Force"
        f" Theory, at {summary.estimates:,} of {summary.messages['pose']:,} poses in {summary.duration:.1f} s.",
        warnings=[*([f"damage: {summary.damage}"] if summary.damage else []), *summary.warnings],
    )


def decimated(rows: Rows) -> Rows:
    """Of each of 1,500 buckets of rows the first row and those with the greatest depth, force and residual force."""
    force = rows["compensated"][:, :3]
    sizes = [rows["depth"], *(np.linalg.norm(f, axis=1) for f in (force, force - rows["predicted"][:, :3]))]
    sizes = [np.nan_to_num(size, nan=-math.inf) for size in sizes]
    buckets = [part for part in np.array_split(np.arange(len(rows)), _BUCKETS) if len(part)]
    kept = {part[k] for part in buckets for k in (0, *(size[part].argmax() for size in sizes))}
    return np.array(rows[sorted(kept)])


def _tables(summary: Summary) -> Iterator[Table]:
    yield Table(
        "Metrics",
        "Of the force vector: greatest measured force; RMS and peak of the residual (measured less predicted); RMS over"
        " peak of the same line; median of the relative error where the measured force is over 20 % of the recording's"
        f" peak. Depth bins are those of {Phase.PENETRATION}. summary.json has every axis.",
        ("", *METRIC_HEADS),
        metric_rows(summary),
    )
    trusted = ", ".join(f"{level} {count:,}" for level, count in summary.trust.items())
    counted = [(name, QualityFlag[name.upper()], n) for name, n in summary.quality_flags.items() if n]
    flags = [(name, f"{n:,}", trust(flag).value, sentences(flag)) for name, flag, n in counted]
    sentence = f"How many estimates have each flag (trust: {trusted})."
    yield Table("Quality flags", sentence, ("flag", "estimates", "trust", "meaning"), flags or [("none", "0", "", "")])
    unused = [(name, f"{count:,}") for name, count in summary.reasons.items()] or [("none", "0")]
    sentence = "Samples that were not used, poses without an estimate and estimates without a residual."
    yield Table("Not used or unanswered", sentence, ("reason", "count"), unused)


def _parameters(summary: Summary) -> Table:
    units = {parameter.name: parameter.unit for parameter in PARAMETERS}
    values = [(name, str(value), units.get(name, "")) for name, value in summary.parameters.items()]
    return Table("Parameters", "", ("parameter", "value", "unit"), values)


def replay_charts(rows: Rows) -> list[Figure]:
    """The charts of rows with a stamp, shape [n], in the order of the page."""
    time = (rows["stamp"] - rows["stamp"].min(initial=2**62)) * 1e-9
    depth = np.where(rows["depth"] > _IN_GRAINS, 1e3 * rows["depth"], math.nan)
    charts = [_wrench(rows, time, "time", _TIME), _wrench(rows, depth, "depth", _DEPTH), _residual(rows, time)]
    if rows["quality_flags"].any():
        charts.append(_flags(rows, time))
    if not np.isnan(rows["learned"]).all():
        charts.append(_learned(rows, time, depth))
    return charts


def _wrench(rows: Rows, x: _Array, over: str, x_label: str) -> Figure:
    panels = Panels(3, 2, height=760)
    for k, axis in enumerate(AXES):
        at = k % 3 + 1, k // 3 + 1
        measured, predicted, sigma = (rows[name][:, k] for name in ("compensated", "predicted", "sigma"))
        panels.band(at, "± standard deviation", x, predicted, sigma, colour="predicted")
        for code, phase in enumerate(PHASES):
            if (chosen := (rows["phase"] == code) & ~np.isnan(measured + x)).any():
                y = np.where(chosen, measured, math.nan)
                panels.line(at, f"measured, {phase}", x, y, colour=phase.value, width=2.0)
        panels.line(at, "predicted", x, predicted)
        panels.label(at, x=x_label if k % 3 == 2 else "", y=f"{axis} [{'N' if k < 3 else 'N m'}]")
    sentence = (
        f"Measured, in the colour of the phase, and predicted, with a band of one standard deviation on each side, over"
        f" {over}. A line breaks where there is no estimate."
    )
    return Figure(f"wrench_over_{over}", f"Force and torque over {over}", sentence, panels.figure)


def _residual(rows: Rows, time: _Array) -> Figure:
    panels = Panels(2)
    residual = rows["compensated"] - rows["predicted"]
    for k, axis in enumerate("xyzxyz"):
        panels.line((k // 3 + 1, 1), axis, time, residual[:, k], width=1.2)
    panels.label((1, 1), y="Force residual [N]")
    panels.label((2, 1), x=_TIME, y="Torque residual [N m]")
    return Figure("residual", "Residual", "Measured minus predicted, by sensor axis, over time.", panels.figure)


def _flags(rows: Rows, time: _Array) -> Figure:
    flags = [flag for flag in QualityFlag if (rows["quality_flags"] & int(flag)).any()]
    panels = Panels(1, height=200 + 26 * len(flags))
    for place, flag in enumerate(flags):
        raised = (rows["quality_flags"] & int(flag)) != 0
        raised[1:] |= raised[:-1]  # up to the next pose
        level = trust(flag).value.lower()
        y = np.where(raised, float(place), math.nan)
        panels.line((1, 1), f"trust: {level}", time, y, colour=level, width=9.0)
    panels.label((1, 1), x=_TIME)
    panels.figure.update_xaxes(range=[time.min(), time.max()])
    ticks = {"tickvals": list(range(len(flags))), "ticktext": [flag_names(flag)[0] for flag in flags]}
    panels.figure.update_yaxes(**ticks, range=[len(flags) - 0.5, -0.5])
    return Figure("quality_flags", "Quality flags over time", "When the prediction had which flag.", panels.figure)


def _learned(rows: Rows, time: _Array, depth: _Array) -> Figure:
    panels = Panels(len(_LEARNED), 2)
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
    sentence = (
        "Strength of the vertical and of the horizontal force over the model's, turn of the horizontal force about the"
        " vertical, and height of the surface above surface_height, each with its standard error, and how surprising"
        " the force was."
    )
    return Figure("learned", "What is learned of the grains", sentence, panels.figure)


def _animation(rows: Rows, estimator: Estimator) -> Iterator[Figure]:
    """The tool in the grains; nothing if it was not there."""
    model, begin = estimator.model, rows["stamp"].min(initial=2**62)
    rows = rows[~np.isnan(rows["predicted"][:, 0]) & (rows["depth"] > 0.0)]
    if not len(rows):
        return
    scene = animate(
        f"Tool and traction{' (law without memory)' if model.mobilization_length > 0.0 else ''}",
        model.tool,
        model.law,
        1e-9 * (rows["stamp"] - begin),
        rows["state"],
        surface_height=estimator.settings.surface_height,
        ground=estimator.ground,
    )
    sentence = (
        "The tool coloured by the predicted traction on its leading faces, in world axes, the surface of the grains at"
        " the end, and the predicted force as a line from the tool's middle. The slider selects a moment in the grains."
    )
    yield Figure("tool", scene.title, sentence, animation_figure(scene))

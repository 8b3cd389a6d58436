"""Report and charts of a replay, from its rows, model and summary."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.estimates import LEARNED_COLUMNS, PHASES, Rows
from rft_ros.bags.playback import world_forces
from rft_ros.bags.summary import METRIC_HEADS, Summary, metric_rows
from rft_ros.estimator import Estimator, QualityFlag, sentences, trust
from rft_ros.parameters import PARAMETERS
from rft_ros.report import Figure, Table, animate, animation_figure, what_is_shown, write_page
from rft_ros.rft import AXES, FORCE, TORQUE

_Array = NDArray[np.float64]
_Place = tuple[int, int]  # row and column of a panel, from 1

_BUCKETS = 500  # about one for each pixel of a panel's width
_IN_GRAINS = -1e-3  # least depth in charts over depth [m]
_TIME = "Time since the first pose [s]"
_DEPTH = "Depth of the lowest point [mm]"


class _Panel(NamedTuple):
    """A panel of what is learned. `unit`: factor to the label's unit. `lines`: of `LEARNED_COLUMNS`, with names."""

    label: str
    unit: float
    lines: dict[str, str]


_LEARNED = (
    _Panel(
        "Strength", 1.0, {"vertical_strength": "vertical", "horizontal_strength": "horizontal"}
    ),
    _Panel("Turn [deg]", math.degrees(1.0), {"turn": "turn"}),
    _Panel("Surface [mm]", 1e3, {"surface": "surface"}),
    _Panel("Surprise<br>[std. deviations]", 1.0, {"surprise": "surprise"}),
)
_COLOURS = {  # Okabe and Ito's palette, distinguishable with any kind of colour vision
    **dict.fromkeys(("measured", "turn", "surface", "surprise"), "#333333"),
    **dict.fromkeys(("predicted", "vertical"), "#D55E00"),
    **dict.fromkeys(("x", "horizontal", "penetration"), "#0072B2"),
    "y": "#E69F00",
    **dict.fromkeys(("z", "withdrawal"), "#009E73"),
    **dict.fromkeys(("dwell", "caution"), "#56B4E9"),
    "ploughing": "#CC79A7",
    "approach": "#999999",
    "no": "#000000",
}
_BAND = 0.22  # opacity


def draw(summary: Summary, rows: Rows, estimator: Estimator, file: Path) -> None:
    """Write the report of a replay's rows, shape [n], after the estimator's last sample."""
    rows = decimated(rows[rows["stamp"] > 0])
    write_page(
        file,
        [
            *_tables(summary),
            *replay_charts(rows),
            *_animation(rows, estimator),
            _parameters(summary),
        ],
        title=f"Replay of {summary.bag}",
        sentence="Force and torque that the grains put on the tool, in the axes and about the origin of the sensor"
        " frame: measured by the load cell, less bias and tool weight, and predicted by 3D granular Resistive Force"
        f" Theory, at {summary.estimates:,} of {summary.messages['pose']:,} poses in {summary.duration:.1f} s.",
        warnings=[*([f"damage: {summary.damage}"] if summary.damage else []), *summary.warnings],
    )


def decimated(rows: Rows) -> Rows:
    """Thin out rows for charts: of each of 500 buckets, the first row and three others.

    These have the greatest depth, the greatest force and the greatest residual force.
    """
    force = rows["compensated"][:, FORCE]
    residual = force - rows["predicted"][:, FORCE]
    kept = set()
    for size in (rows["depth"], np.linalg.norm(force, axis=1), np.linalg.norm(residual, axis=1)):
        known = np.nan_to_num(size, nan=-math.inf)
        for bucket in np.array_split(np.arange(len(rows)), _BUCKETS):
            if len(bucket):
                kept |= {bucket[0], bucket[known[bucket].argmax()]}
    return np.array(rows[sorted(kept)])


def _tables(summary: Summary) -> Iterator[Table]:
    sentence = (
        "Of the force vector: greatest measured force; RMS and peak of the residual (measured less predicted); RMS over"
        " peak of the same line; median of the relative error where the measured force is over 20 % of the recording's"
        " peak. Depth bins are those of penetration. summary.json has every axis."
    )
    yield Table("Metrics", sentence, ("", *METRIC_HEADS), metric_rows(summary))
    trusted = ", ".join(f"{level} {count:,}" for level, count in summary.trust.items())
    flags = []
    for name, count in summary.quality_flags.items():
        if count:
            flag = QualityFlag[name.upper()]
            flags.append((name, f"{count:,}", trust(flag).value, sentences(flag)))
    sentence = f"How many estimates have each flag (trust: {trusted})."
    yield Table(
        "Quality flags",
        sentence,
        ("flag", "estimates", "trust", "meaning"),
        flags or [("none", "0", "", "")],
    )
    unused = [(name, f"{count:,}") for name, count in summary.reasons.items()] or [("none", "0")]
    sentence = (
        "Samples that were not used, poses without an estimate and estimates without a residual."
    )
    yield Table("Not used or unanswered", sentence, ("reason", "count"), unused)


def _parameters(summary: Summary) -> Table:
    units = {parameter.name: parameter.unit for parameter in PARAMETERS}
    values = [
        (name, str(value), units.get(name, "")) for name, value in summary.parameters.items()
    ]
    return Table("Parameters", "", ("parameter", "value", "unit"), values)


def replay_charts(rows: Rows) -> list[Figure]:
    """The charts of a replay, in the order of the page. `rows`: with a stamp, shape [n]."""
    time = (rows["stamp"] - rows["stamp"].min(initial=2**62)) * 1e-9
    depth = np.where(rows["depth"] > _IN_GRAINS, 1e3 * rows["depth"], math.nan)
    charts = [
        _wrench(rows, time, over="time", x_label=_TIME),
        _wrench(rows, depth, over="depth", x_label=_DEPTH),
        _residual(rows, time),
    ]
    if rows["quality_flags"].any():
        charts.append(_flags(rows, time))
    if not np.isnan(rows["learned"]).all():
        charts.append(_learned(rows, time, depth))
    return charts


def _panels(rows: int, columns: int = 1, *, height: int = 640) -> Any:
    """A plotly Figure of panels; those of a column share their x axis. `height` [px]."""
    from plotly.subplots import make_subplots

    spacing = {"vertical_spacing": 0.05, "horizontal_spacing": 0.09}
    return make_subplots(rows=rows, cols=columns, shared_xaxes="columns", **spacing).update_layout(
        template="plotly_white",
        font={"family": "system-ui, sans-serif", "size": 13, "color": "#222222"},
        height=height,
        margin={"l": 85, "r": 20, "t": 80, "b": 55},
        legend={"orientation": "h", "x": 0.0, "y": 1.02, "xanchor": "left", "yanchor": "bottom"},
    )


def _label(panels: Any, at: _Place, *, x: str = "", y: str = "") -> None:
    panels.update_xaxes(title_text=x, row=at[0], col=at[1])
    panels.update_yaxes(title_text=y, row=at[0], col=at[1])


def _line(
    panels: Any,
    at: _Place,
    name: str,
    x: _Array,
    y: _Array,
    *,
    colour: str = "",
    width: float = 1.5,
    **look: Any,
) -> None:
    """Draw a line with gaps at NaN; those of a name share a legend entry. `colour`: of `_COLOURS` (default: `name`)."""
    panels.add_scatter(
        row=at[0],
        col=at[1],
        name=name,
        legendgroup=name,
        showlegend=all(trace.name != name for trace in panels.data),
        x=x.astype(np.float32),  # finer than a screen, half the bytes
        y=y.astype(np.float32),
        mode="lines",
        line={"color": _COLOURS[colour or name], "width": width},
        connectgaps=False,
        **look,
    )


def _band(
    panels: Any, at: _Place, name: str, x: _Array, y: _Array, deviation: _Array, *, colour: str
) -> None:
    """Draw a band from y - deviation to y + deviation, with gaps at NaN."""
    from plotly.colors import hex_to_rgb

    known = np.flatnonzero(~np.isnan(x + y + deviation))
    xs = [np.empty(0)]
    ys = [np.empty(0)]
    for part in np.split(
        known, np.flatnonzero(np.diff(known) > 1) + 1
    ):  # closed around each unbroken segment
        xs += [x[part], x[part[::-1]], np.array([np.nan])]
        ys += [(y - deviation)[part], (y + deviation)[part[::-1]], np.array([np.nan])]
    red, green, blue = hex_to_rgb(_COLOURS[colour])
    fill = f"rgba({red}, {green}, {blue}, {_BAND})"
    look = {"fill": "toself", "fillcolor": fill, "hoverinfo": "skip"}
    _line(
        panels, at, name, np.concatenate(xs), np.concatenate(ys), colour=colour, width=0.0, **look
    )


def _wrench(rows: Rows, x: _Array, *, over: str, x_label: str) -> Figure:
    panels = _panels(3, 2, height=760)
    for k, axis in enumerate(AXES):
        is_torque = k >= 3
        at = (k % 3 + 1, 2 if is_torque else 1)
        measured = rows["compensated"][:, k]
        predicted = rows["predicted"][:, k]
        _band(
            panels,
            at,
            "± standard deviation",
            x,
            predicted,
            rows["sigma"][:, k],
            colour="predicted",
        )
        for code, phase in enumerate(PHASES):
            chosen = (rows["phase"] == code) & ~np.isnan(measured + x)
            if chosen.any():
                y = np.where(chosen, measured, math.nan)
                _line(panels, at, f"measured, {phase}", x, y, colour=phase, width=2.0)
        _line(panels, at, "predicted", x, predicted)
        _label(
            panels,
            at,
            x=x_label if at[0] == 3 else "",
            y=f"{axis} [{'N m' if is_torque else 'N'}]",
        )
    sentence = (
        f"Measured, in the colour of the phase, and predicted, with a band of one standard deviation on each side, over"
        f" {over}. A line breaks where there is no estimate."
    )
    return Figure(f"wrench_over_{over}", f"Force and torque over {over}", sentence, panels)


def _residual(rows: Rows, time: _Array) -> Figure:
    panels = _panels(2)
    residual = rows["compensated"] - rows["predicted"]
    for k, axis in enumerate("xyz"):
        _line(panels, (1, 1), axis, time, residual[:, FORCE][:, k], width=1.2)
        _line(panels, (2, 1), axis, time, residual[:, TORQUE][:, k], width=1.2)
    _label(panels, (1, 1), y="Force residual [N]")
    _label(panels, (2, 1), x=_TIME, y="Torque residual [N m]")
    return Figure(
        "residual", "Residual", "Measured minus predicted, by sensor axis, over time.", panels
    )


def _flags(rows: Rows, time: _Array) -> Figure:
    flags = [flag for flag in QualityFlag if (rows["quality_flags"] & int(flag)).any()]
    panels = _panels(1, height=200 + 26 * len(flags))
    for place, flag in enumerate(flags):
        raised = (rows["quality_flags"] & int(flag)) != 0
        raised[1:] |= raised[:-1]  # up to the next pose
        level = trust(flag).value.lower()
        y = np.where(raised, float(place), math.nan)
        _line(panels, (1, 1), f"trust: {level}", time, y, colour=level, width=9.0)
    _label(panels, (1, 1), x=_TIME)
    panels.update_xaxes(range=[time.min(), time.max()])
    labels = [flag.label for flag in flags]
    panels.update_yaxes(
        tickvals=list(range(len(flags))), ticktext=labels, range=[len(flags) - 0.5, -0.5]
    )
    return Figure(
        "quality_flags", "Quality flags over time", "When the prediction had which flag.", panels
    )


def _learned(rows: Rows, time: _Array, depth: _Array) -> Figure:
    panels = _panels(len(_LEARNED), 2, height=900)
    for row, panel in enumerate(_LEARNED, start=1):
        is_last = row == len(_LEARNED)
        _draw_learned(panels, (row, 1), panel, rows, time)
        _label(panels, (row, 1), x=_TIME if is_last else "", y=panel.label)
        _draw_learned(panels, (row, 2), panel, rows, depth)
        _label(panels, (row, 2), x=_DEPTH if is_last else "", y=panel.label)
    sentence = (
        "Strength of the vertical and of the horizontal force over the model's, turn of the horizontal force about the"
        " vertical, and height of the surface above surface_height, each with its standard error, and how surprising"
        " the force was."
    )
    return Figure("learned", "What is learned of the grains", sentence, panels)


def _draw_learned(panels: Any, at: _Place, panel: _Panel, rows: Rows, x: _Array) -> None:
    """Draw what is learned over `x`, with bands of the standard errors."""
    for key, name in panel.lines.items():
        value = panel.unit * rows["learned"][:, LEARNED_COLUMNS.index(key)]
        if f"{key}_error" in LEARNED_COLUMNS:
            error = panel.unit * rows["learned"][:, LEARNED_COLUMNS.index(f"{key}_error")]
            _band(panels, at, "± standard error", x, value, error, colour=name)
        _line(panels, at, name, x, value)


def _animation(rows: Rows, estimator: Estimator) -> Iterator[Figure]:
    """The animation of the tool in the grains; none if it never was in the grains."""
    begin = rows["stamp"].min(initial=2**62)
    shown = rows[~np.isnan(rows["predicted"][:, 0]) & (rows["depth"] > 0.0)]
    if not len(shown):
        return
    model = estimator.model
    states = np.array(shown["state"])
    title = "Tool and traction"
    drawn = animate(
        title,
        model.tool,
        model.law,
        1e-9 * (shown["stamp"] - begin),
        states,
        world_forces(shown["predicted"], states, estimator.load_cell),
        surface_height=estimator.settings.surface_height,
        ground=estimator.ground,
    )
    colours = what_is_shown(model.law, learned=estimator.settings.learning_mode == "apply")
    where = (
        "World axes; the surface is the one at the end. The slider selects a moment in the grains."
    )
    yield Figure("tool", title, f"{colours} {where}", animation_figure(drawn))

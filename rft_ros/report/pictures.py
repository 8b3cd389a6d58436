"""PNG files by matplotlib: charts, the tool in the grains, force over depth."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rft_ros.report.animation import Animation, draw_moment
from rft_ros.report.charts import BAND, COLOURS, SHADE, Chart, Line

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["DepthTrace", "draw_chart", "draw_force_over_depth", "draw_tool", "legend_below"]

Row = tuple[float, float, float, float]
"""Depth of the tool's lowest point below the surface [m] and force on the tool [N]: d, fx, fy, fz."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthTrace:
    """Forces in the sensor frame over time. `swap`: depth at which the model of α_y changed [m]."""

    measured: list[Row]
    predicted: list[Row]
    residual: list[Row]
    swap: float | None = None


def legend_below(figure: "Figure", entries: Mapping[str, Any], **style: Any) -> None:
    """Put a legend below the panels of a figure with constrained layout. `entries`: handles by label."""
    import matplotlib as mpl

    place = "outside lower center"
    if mpl.__version_info__ < (3, 7):  # 3.6, in Ubuntu 24.04, reserves no space for the legend
        place = "lower center"
        figure.set_layout_engine("constrained", rect=(0.0, 0.06, 1.0, 0.94))
    figure.legend(entries.values(), entries.keys(), loc=place, frameon=False, **style)


def draw_chart(chart: Chart, file: Path, *, title: str) -> None:
    """Draw a chart to a PNG."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    rows, columns = len(chart.panels), len(chart.panels[0])
    figure = Figure(figsize=(12.0, max(3.8, chart.height / 90.0)), layout="constrained")
    grid = figure.subplots(
        rows,
        columns,
        squeeze=False,
        sharex="col" if chart.same_x else "none",
        gridspec_kw={"height_ratios": chart.heights} if chart.heights else None,
    )
    legend: dict[str, Any] = {}
    for row, panels in enumerate(chart.panels):
        for column, panel in enumerate(panels):
            axes = grid[row][column]
            for line in panel.lines:
                drawn = _draw(axes, line)
                if line.kind == "map":
                    figure.colorbar(drawn, ax=axes, label=line.label)
                else:
                    legend.setdefault(line.label, drawn)
            for span in () if column else chart.spans:
                axes.axvspan(span.begin, span.end, color=COLOURS[span.name], alpha=SHADE, lw=0)
                legend.setdefault(f"{span.name} ", Patch(color=COLOURS[span.name], alpha=2 * SHADE))
            axes.set_ylabel(panel.y_label)
            if row == rows - 1 or not chart.same_x:
                axes.set_xlabel(panel.x_label)
            axes.grid(alpha=0.3)
            if panel.names:
                axes.set_yticks(range(len(panel.names)), panel.names)
                axes.set_ylim(len(panel.names) - 0.5, -0.5)
            else:
                axes.axhline(0.0, color="0.6", lw=0.6)
    legend_below(figure, legend, ncols=7)
    figure.suptitle(f"{chart.title}: {title}")
    figure.savefig(file, dpi=110, metadata={"Software": None})


def _draw(axes: Any, line: Line) -> Any:
    colour = COLOURS[line.colour]
    if line.kind == "bars":
        return axes.stairs(line.y, line.x, color=colour, fill=True, alpha=0.5)
    if line.values is not None:
        return axes.pcolormesh(line.x, line.y, line.values.T, shading="nearest")
    if line.kind == "band":
        return axes.fill_between(line.x, line.y[0], line.y[1], color=colour, alpha=BAND, lw=0)
    return axes.plot(line.x, line.y, color=colour, lw=line.width, solid_capstyle="butt")[0]


def draw_tool(scene: Animation, file: Path, *, title: str) -> None:
    """Draw an animation's first moment to a PNG."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 7.0), layout="constrained")
    # view the loaded faces: the force points into the tool
    elevation = -15.0 if scene.forces[scene.first, 2] > 0.0 else 30.0
    draw_moment(figure, figure.add_subplot(projection="3d", computed_zorder=False), scene, elevation=elevation)
    figure.suptitle(f"{scene.title}: {title}, {scene.labels[scene.first]}")
    figure.savefig(file, dpi=110, metadata={"Software": None})


def draw_force_over_depth(trace: DepthTrace, file: Path, *, title: str, scene: Animation) -> None:
    """Draw the demo's figure to a PNG: the scene's first moment, and beside it force and residual over depth."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.6, 5.6), layout="constrained")
    parts: Any = figure.subfigures(1, 2, width_ratios=(1.0, 1.15))
    left, right = parts
    draw_moment(left, left.add_subplot(projection="3d", computed_zorder=False), scene)
    axes = right.subplots(3, 1, sharex=True, gridspec_kw={"height_ratios": (1.0, 1.0, 0.6)})
    for axis, component, name in ((axes[0], 3, "z (down)"), (axes[1], 1, "x (sideways)")):
        for rows, label, style in (
            (trace.measured, "virtual load cell, less bias and weight", {"color": "0.65", "lw": 1.0}),
            (trace.predicted, "predicted by RFT", {"color": "tab:red", "lw": 1.5}),
        ):
            data = np.array(rows)
            axis.plot(data[:, 0] * 1e3, data[:, component], label=label, **style)
        axis.set_ylabel(f"Force along\nsensor {name} [N]")
    data = np.array(trace.residual)
    for component, label in ((1, "x"), (2, "y"), (3, "z")):
        axes[2].plot(data[:, 0] * 1e3, data[:, component], lw=0.7, label=label)
    axes[2].set_ylabel("Residual [N]")
    drawn = 1e3 * float(scene.surface_height - scene.placed[scene.first, :, 2].min())
    for axis in axes:
        if trace.swap is not None:
            axis.axvline(trace.swap * 1e3, color="tab:blue", ls="--", lw=1.0, label="α_y model swapped")
        axis.axvline(drawn, color="0.3", ls=":", lw=1.2, label="the moment on the left")
        axis.grid(alpha=0.3)
    axes[2].set_xlabel("Depth of the tool's lowest point [mm]")
    axes[0].legend(loc="lower left", fontsize=8)
    axes[2].legend(*(handles[:3] for handles in axes[2].get_legend_handles_labels()), fontsize=8, ncols=3)
    figure.suptitle(title)
    figure.savefig(file, dpi=110, metadata={"Software": None})

"""PNG files by matplotlib: charts, the tool in the grains, force over depth."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.report.animation import Animation, draw_moment
from rft_ros.report.charts import BAND, COLOURS, SHADE, Chart, Line

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw_chart", "draw_force_over_depth", "draw_tool", "legend_below"]

_Array = NDArray[np.float64]


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


def draw_force_over_depth(
    file: Path,
    *,
    title: str,
    scene: Animation,
    measured: _Array,
    fixed: _Array,
    learned: _Array,
    surprise: _Array,
    layer: float,
) -> None:
    """Draw the demo's figure to a PNG: the scene's first moment, and beside it force and surprise over depth.

    First column of each array: depth of the tool's lowest point [m], increasing. `measured`, `fixed` (the model without
    learning): then the force [N], sensor axes, shape [n, 4]. `learned`: the same, then its standard deviations, shape
    [n, 7]. `surprise`: then the surprise in standard deviations, shape [n, 2]. `layer`: depth of the hard layer [m].
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.6, 6.0), layout="constrained")
    parts: Any = figure.subfigures(1, 2, width_ratios=(1.0, 1.25))
    left, right = parts
    draw_moment(left, left.add_subplot(projection="3d", computed_zorder=False), scene)
    left.suptitle("Traction and force by the fixed model", fontsize=10)
    axes = right.subplots(3, 1, sharex=True, gridspec_kw={"height_ratios": (1.2, 0.9, 0.6)})
    for axis, component, name in ((axes[0], 3, "z (down)"), (axes[1], 1, "x (sideways)")):
        low, high = (learned[:, component] + k * learned[:, component + 3] for k in (-1.0, 1.0))
        for rows, label, style in (
            (measured, "virtual load cell, less bias and weight", {"color": "0.6", "lw": 1.0}),
            (fixed, "predicted by the fixed model", {"color": "tab:blue", "lw": 1.4, "ls": "--"}),
            (learned, "predicted by the node, which learns", {"color": "tab:red", "lw": 1.5}),
        ):
            axis.plot(rows[:, 0] * 1e3, rows[:, component], label=label, **style)
        axis.fill_between(
            learned[:, 0] * 1e3, low, high, color="tab:red", alpha=BAND, lw=0, label="± standard deviation"
        )
        axis.set_ylabel(f"Force along\nsensor {name} [N]")
    axes[2].plot(surprise[:, 0] * 1e3, surprise[:, 1], color="0.3", lw=1.0)
    axes[2].set_ylabel("Surprise\n[std. deviations]")
    axes[2].set_xlabel("Depth of the tool's lowest point [mm]")
    drawn = 1e3 * float(scene.surface_height - scene.placed[scene.first, :, 2].min())
    for axis in axes:
        axis.axvline(layer * 1e3, color="tab:green", lw=1.2, label="hard layer begins")
        axis.axvline(drawn, color="0.3", ls=":", lw=1.2, label="the moment on the left")
        axis.grid(alpha=0.3)
    handles, labels = axes[0].get_legend_handles_labels()
    legend_below(figure, dict(zip(labels, handles, strict=True)), ncols=3, fontsize=9)
    figure.suptitle(title)
    figure.savefig(file, dpi=110, metadata={"Software": None})

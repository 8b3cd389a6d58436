"""Charts as PNG, by matplotlib."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rft_ros.report.charts import BAND, COLOURS, SHADE, Chart, Line, ToolView
from rft_ros.report.legend import legend_below

__all__ = ["draw_chart", "draw_tool"]


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
                legend.setdefault(line.label, _draw(axes, line))
            for span in chart.spans if column in chart.shaded else ():
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
    if line.kind == "band":
        return axes.fill_between(line.x, line.y[0], line.y[1], color=colour, alpha=BAND, lw=0)
    return axes.plot(line.x, line.y, color=colour, lw=line.width, solid_capstyle="butt")[0]


def draw_tool(view: ToolView, file: Path, *, title: str) -> None:
    """Draw the tool at its chosen moment to a PNG."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

    moment = view.moments[view.chosen]
    corners = 1e3 * moment.vertices[view.faces]
    scale = Normalize(0.0, max(1e-9, 1e-3 * float(moment.traction.max(initial=0.0))))
    figure = Figure(figsize=(8.0, 7.0), layout="constrained")
    axes: Any = figure.add_subplot(projection="3d")
    colours = colormaps["viridis"](scale(1e-3 * moment.traction))
    axes.add_collection3d(Poly3DCollection(corners, facecolors=colours, edgecolors=(0, 0, 0, 0.1), linewidths=0.2))
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    reach = 0.6 * float((high - low).max())
    middle = (low + high) / 2.0
    for setter, at in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), middle, strict=True):
        setter(at - reach, at + reach)
    _surface(axes, 1e3 * view.surface_height, middle, reach)
    axes.set_xlabel("x [mm]")
    axes.set_ylabel("y [mm]")
    axes.set_zlabel("z [mm]")
    axes.set_box_aspect((1, 1, 1))
    axes.view_init(elev=30.0 if view.from_above else -30.0)
    figure.colorbar(ScalarMappable(scale, "viridis"), ax=axes, label="Traction [kPa]", shrink=0.6)
    figure.suptitle(f"{view.title}: {title}, {moment.label}")
    figure.savefig(file, dpi=110, metadata={"Software": None})


def _surface(axes: Any, height: float, middle: Sequence[float], reach: float) -> None:
    if abs(height - middle[2]) <= reach:
        x, y = np.meshgrid(*(np.array([m - reach, m + reach]) for m in middle[:2]))
        axes.plot_surface(x, y, np.full_like(x, height), color="#C2A878", alpha=0.25)

"""PNG files by matplotlib: charts, and the tool in the grains."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rft_ros.report.animation import Animation, draw_moment
from rft_ros.report.charts import BAND, COLOURS, SHADE, Chart, Line

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw_chart", "draw_tool", "legend_below"]


def legend_below(figure: "Figure", entries: Mapping[str, Any], **style: Any) -> None:
    """Put a legend below the panels of a figure with constrained layout. `entries`: handles by label."""
    import matplotlib as mpl

    place = "outside lower center"
    if mpl.__version_info__ < (3, 7):  # 3.6, in Ubuntu 24.04, reserves no space for the legend
        place = "lower center"
        figure.set_layout_engine("constrained", rect=(0.0, 0.06, 1.0, 0.94))
    figure.legend(entries.values(), entries.keys(), loc=place, frameon=False, **style)


def draw_chart(chart: Chart, file: Path, *, title: str, scene: Animation | None = None) -> None:
    """Draw a chart to a PNG; left of it the first moment of `scene`."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    rows, columns = len(chart.panels), len(chart.panels[0])
    figure: Any = Figure(figsize=(12.0 if scene is None else 13.6, max(3.8, chart.height / 90.0)), layout="constrained")
    part = figure
    if scene is not None:
        left, part = figure.subfigures(1, 2, width_ratios=(1.0, 1.25))
        draw_moment(left, left.add_subplot(projection="3d", computed_zorder=False), scene)
        left.suptitle(scene.title, fontsize=10)
    grid = part.subplots(
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
    legend_below(figure, legend, ncols=7 if scene is None else 4)
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

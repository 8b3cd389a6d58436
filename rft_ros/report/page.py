"""HTML pages without external files: a replay's report, a single figure, an animation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.files import whole
from rft_ros.report.animation import Animation, animation_figure
from rft_ros.report.charts import BAND, COLOURS, SHADE, Chart, Line

__all__ = ["Table", "chart_figure", "figure_page", "write_figure", "write_page"]

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 1180px; margin: 2em auto; padding: 0 1.2em; }
h1 { font-size: 1.6em; margin-bottom: .2em; } h2 { font-size: 1.2em; margin: 2em 0 .2em; }
p { margin: .2em 0 .6em; color: #444; max-width: 60em; }
p.warning { color: #a33b00; font-weight: 600; }
table { border-collapse: collapse; font-size: .93em; font-variant-numeric: tabular-nums; }
th, td { padding: .22em .8em; text-align: right; border-bottom: 1px solid #e4e4e4; }
th { color: #555; font-weight: 600; } th:first-child, td:first-child { text-align: left; white-space: pre; }
table.words th, table.words td { text-align: left; } table.words td { word-break: break-word; }
details { margin: .5em 0; } summary { cursor: pointer; }
"""

_TOOL = (
    "The tool coloured by the predicted traction on its leading faces, in world axes (x and y from the tool's origin),"
    " the surface of the grains, and the predicted force as an arrow. The slider selects a moment of the recording."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table of text. `words`: align cells as text, not as numbers. `folded`: a click opens it."""

    title: str
    sentence: str = ""
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: bool = False
    folded: bool = False


def write_page(
    file: Path,
    *,
    title: str,
    sentence: str,
    warnings: Sequence[str],
    tables: Mapping[str, Table],
    charts: Sequence[Chart],
    tool: Animation | None,
) -> None:
    """Write a report: title, table ``metrics``, charts, tool, other tables. The same content gives the same bytes."""
    from plotly.io import to_html
    from plotly.offline import get_plotlyjs

    figures = [(chart.name, chart.title, chart.sentence, chart_figure(chart)) for chart in charts]
    if tool is not None:
        figures.append(("tool", tool.title, _TOOL, animation_figure(tool)))
    parts = [
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{escape(title)}</title><style>{_STYLE}</style>",
        f'<link rel="icon" href="data:,"><script>{get_plotlyjs()}</script></head><body>',
        f"<h1>{escape(title)}</h1><p>{escape(sentence)}</p>",
        *(f'<p class="warning">{escape(warning[:1].upper() + warning[1:])}.</p>' for warning in warnings),
        _table(tables["metrics"]),
    ]
    for name, heading, text, figure in figures:
        drawn = to_html(
            figure,
            include_plotlyjs=False,
            full_html=False,
            auto_play=False,
            div_id=f"figure-{name}",
            config={"responsive": True, "displaylogo": False},
        )
        parts += [f"<section><h2>{escape(heading)}</h2><p>{escape(text)}</p>", drawn, "</section>"]
    parts += [_table(table) for name, table in tables.items() if name != "metrics"]
    # paths may hold bytes that are not UTF-8
    file.write_text("\n".join([*parts, "</body></html>\n"]), encoding="utf-8", errors="backslashreplace")


def _table(table: Table) -> str:
    def cells(tag: str, row: Sequence[str]) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in row) + "</tr>"

    kind = ' class="words"' if table.words else ""
    body = f"<table{kind}>{cells('th', table.heads)}{''.join(cells('td', row) for row in table.rows)}</table>"
    text = f"<p>{escape(table.sentence)}</p>" if table.sentence else ""
    if table.folded:
        return f"<details><summary>{escape(table.title)}</summary>{text}{body}</details>"
    return f"<section><h2>{escape(table.title)}</h2>{text}{body}</section>"


def chart_figure(chart: Chart) -> Any:
    """A chart as a plotly Figure."""
    import plotly.graph_objects as go
    from plotly.subplots import make_subplots

    rows, columns = len(chart.panels), len(chart.panels[0])
    figure = make_subplots(
        rows=rows,
        cols=columns,
        row_heights=chart.heights or None,
        shared_xaxes="columns" if chart.same_x else False,
        vertical_spacing=0.04 if chart.same_x else 0.14,
        horizontal_spacing=0.09,
    )
    named: set[str] = set()
    shapes: list[dict[str, Any]] = []
    for r, panels in enumerate(chart.panels, start=1):
        for c, panel in enumerate(panels, start=1):
            for line in panel.lines:
                figure.add_trace(_trace(line, new=line.label not in named), row=r, col=c)
                named.add(line.label)
            if c == 1:
                shapes += _shades(chart, (r - 1) * columns + c)
            figure.update_yaxes(title_text=panel.y_label, row=r, col=c)
            if panel.names:
                ticks = {"tickvals": list(range(len(panel.names))), "ticktext": list(panel.names)}
                figure.update_yaxes(**ticks, range=[len(panel.names) - 0.5, -0.5], row=r, col=c)
            if r == rows or not chart.same_x:
                figure.update_xaxes(title_text=panel.x_label, row=r, col=c)
    for name in dict.fromkeys(span.name for span in chart.spans):
        marker = {"symbol": "square", "size": 13, "color": COLOURS[name], "opacity": 2.5 * SHADE}
        figure.add_trace(go.Scatter(x=[None], y=[None], mode="markers", marker=marker, name=name))
    figure.update_layout(
        template="plotly_white",
        font={"family": "system-ui, sans-serif", "size": 13, "color": "#222222"},
        height=chart.height,
        margin={"l": 70, "r": 20, "t": 80, "b": 55},
        legend={"orientation": "h", "x": 0.0, "y": 1.0, "xanchor": "left", "yanchor": "bottom"},
        shapes=shapes,
        barmode="overlay",
        bargap=0.0,
        coloraxis={"colorscale": "Viridis"},
    )
    return figure


def _shades(chart: Chart, panel: int) -> list[dict[str, Any]]:
    """Rectangles for the spans in a panel, counted from 1. Plotly's `add_vrect` gets slower with each span."""
    number = "" if panel == 1 else str(panel)
    axes = {"xref": f"x{number}", "yref": f"y{number} domain", "y0": 0, "y1": 1}
    look = {"type": "rect", "opacity": SHADE, "line": {"width": 0}, "layer": "below"}
    return [{**axes, **look, "x0": s.begin, "x1": s.end, "fillcolor": COLOURS[s.name]} for s in chart.spans]


def _trace(line: Line, *, new: bool) -> Any:
    import plotly.graph_objects as go
    from plotly.colors import hex_to_rgb

    shared = {"name": line.label, "legendgroup": line.label, "showlegend": new}
    colour = COLOURS[line.colour]
    if line.kind == "bars":
        return go.Bar(x=_short((line.x[:-1] + line.x[1:]) / 2.0), y=_short(line.y), marker_color=colour, opacity=0.5,
                      marker_line_width=0, **shared)  # fmt: skip
    if line.values is not None:
        return go.Heatmap(x=_short(line.x), y=_short(line.y), z=_short(line.values.T), coloraxis="coloraxis")
    if line.kind == "band":
        x, y = _outline(line)
        filled = {"fill": "toself", "fillcolor": f"rgba{(*hex_to_rgb(colour), BAND)}", "hoverinfo": "skip"}
        return go.Scatter(x=x, y=y, mode="lines", line_width=0, **filled, **shared)
    style = {"color": colour, "width": line.width}
    return go.Scatter(x=_short(line.x), y=_short(line.y), mode="lines", line=style, connectgaps=False, **shared)


def _outline(line: Line) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """A closed line around each unbroken segment of a band, with gaps between them."""
    rows = np.flatnonzero(~np.isnan(line.x + line.y[0]))
    x, y = [np.empty(0)], [np.empty(0)]
    for part in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
        x += [line.x[part], line.x[part[::-1]], np.array([np.nan])]
        y += [line.y[0][part], line.y[1][part[::-1]], np.array([np.nan])]
    return _short(np.concatenate(x)), _short(np.concatenate(y))


def _short(values: NDArray[np.float64]) -> NDArray[np.float32]:
    """Single precision: it halves the file and resolves more than a screen shows."""
    return values.astype(np.float32)


def figure_page(figure: Any, *, title: str, name: str) -> str:
    """A page with one plotly figure as HTML. `title`: of its tab. `name`: the figure's id (repeatable bytes)."""
    page: str = figure.to_html(
        include_plotlyjs=True, full_html=True, div_id=name, auto_play=False, config={"displaylogo": False}
    )
    head = f'<head><title>{escape(title)}</title><link rel="icon" href="data:,">'
    return page.replace("<html>", '<html lang="en">', 1).replace("<head>", head, 1)


def write_figure(file: Path, figure: Any, *, title: str) -> None:
    """Write a `figure_page`. Raises InputError if this fails."""
    with whole(file) as part:
        part.write_text(figure_page(figure, title=title, name="figure"), encoding="utf-8")

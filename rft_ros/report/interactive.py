"""Charts and the tool as plotly figures for a web page."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.report.charts import BAND, COLOURS, SHADE, Chart, Line, ToolView, TractionMoment

__all__ = ["chart_figure", "tool_figure"]

_FONT = {"family": "system-ui, sans-serif", "size": 13, "color": "#222222"}
_SURFACE = "#C2A878"


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
            if c - 1 in chart.shaded:
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
        font=_FONT,
        height=chart.height,
        margin={"l": 70, "r": 20, "t": 80, "b": 55},
        legend={"orientation": "h", "x": 0.0, "y": 1.0, "xanchor": "left", "yanchor": "bottom"},
        shapes=shapes,
        barmode="overlay",
        bargap=0.0,
    )
    return figure


def _shades(chart: Chart, panel: int) -> list[dict[str, Any]]:
    """The spans in a panel, counted from 1; in one list, since plotly's `add_vrect` slows down with their number."""
    number = "" if panel == 1 else str(panel)
    axes = {"xref": f"x{number}", "yref": f"y{number} domain", "y0": 0, "y1": 1}
    look = {"type": "rect", "opacity": SHADE, "line": {"width": 0}, "layer": "below"}
    return [{**axes, **look, "x0": s.begin, "x1": s.end, "fillcolor": COLOURS[s.name]} for s in chart.spans]


def _trace(line: Line, *, new: bool) -> Any:
    import plotly.graph_objects as go

    shared = {"name": line.label, "legendgroup": line.label, "showlegend": new}
    colour = COLOURS[line.colour]
    if line.kind == "bars":
        return go.Bar(x=_short((line.x[:-1] + line.x[1:]) / 2.0), y=_short(line.y), marker_color=colour, opacity=0.5,
                      marker_line_width=0, **shared)  # fmt: skip
    if line.kind == "band":
        x, y = _outline(line)
        filled = {"fill": "toself", "fillcolor": _faint(colour), "hoverinfo": "skip"}
        return go.Scatter(x=x, y=y, mode="lines", line_width=0, **filled, **shared)
    style = {"color": colour, "width": line.width}
    return go.Scatter(x=_short(line.x), y=_short(line.y), mode="lines", line=style, connectgaps=False, **shared)


def _outline(line: Line) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """A closed line around each unbroken stretch of a band, with gaps between them."""
    rows = np.flatnonzero(~np.isnan(line.x + line.y[0]))
    x, y = [np.empty(0)], [np.empty(0)]
    for part in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
        x += [line.x[part], line.x[part[::-1]], np.array([np.nan])]
        y += [line.y[0][part], line.y[1][part[::-1]], np.array([np.nan])]
    return _short(np.concatenate(x)), _short(np.concatenate(y))


def _faint(colour: str) -> str:
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},{BAND})"


def _short(values: NDArray[np.float64]) -> NDArray[np.float32]:
    """Seven digits are more than a screen shows, and half the file."""
    return values.astype(np.float32)


def tool_figure(view: ToolView) -> Any:
    """The tool as a plotly Figure, with a slider over the moments."""
    import plotly.graph_objects as go

    highest = 1e-3 * max(float(m.traction.max(initial=0.0)) for m in view.moments)
    traces, steps = [], []
    count = len(view.moments)
    for k, moment in enumerate(view.moments):
        traces += [_mesh(view, moment, max(highest, 1e-9)), _arrow(moment)]
        visible = [i // 2 == k for i in range(2 * count)] + [True]
        steps.append({"label": moment.label, "method": "update", "args": [{"visible": visible}]})
    traces.append(_surface(view))
    for i, trace in enumerate(traces[:-1]):
        trace.visible = i // 2 == view.chosen
    figure = go.Figure(traces)
    height = 0.7 if view.from_above else -0.7
    names = {f"{axis}axis": {"title": {"text": f"{axis} [mm]"}} for axis in "xyz"}
    figure.update_layout(
        template="plotly_white",
        font=_FONT,
        height=640,
        margin={"l": 10, "r": 10, "t": 20, "b": 20},
        scene={**names, "aspectmode": "data", "camera": {"eye": {"x": 1.5, "y": -1.5, "z": height}}},
        sliders=[
            {
                "active": view.chosen,
                "steps": steps,
                "currentvalue": {"prefix": "Moment: "},
                "pad": {"t": 10, "l": 70, "r": 70},
            }
        ],
        showlegend=False,
    )
    return figure


def _mesh(view: ToolView, moment: TractionMoment, highest: float) -> Any:
    import plotly.graph_objects as go

    x, y, z = (_short(1e3 * moment.vertices[:, k]) for k in range(3))
    i, j, k = (view.faces[:, n].astype(np.int32) for n in range(3))
    return go.Mesh3d(
        x=x,
        y=y,
        z=z,
        i=i,
        j=j,
        k=k,
        intensity=_short(1e-3 * moment.traction),
        intensitymode="cell",
        colorscale="Viridis",
        cmin=0.0,
        cmax=highest,
        colorbar={"title": {"text": "Traction [kPa]"}, "len": 0.7},
        flatshading=True,
        lighting={"ambient": 0.75, "diffuse": 0.4, "specular": 0.05},
        hovertemplate="%{intensity:.2f} kPa<extra></extra>",
    )


def _arrow(moment: TractionMoment) -> Any:
    """The total force, from the middle of the tool, as long as the tool."""
    import plotly.graph_objects as go

    low, high = moment.vertices.min(axis=0), moment.vertices.max(axis=0)
    force = np.array(moment.force)
    size = float(np.linalg.norm(force))
    begin = 1e3 * (low + high) / 2.0
    end = begin + 1e3 * float((high - low).max()) * force / (size or 1.0)
    x, y, z = zip(begin.tolist(), end.tolist(), strict=True)
    text = f"force on the tool: {size:.2f} N"
    return go.Scatter3d(
        x=x,
        y=y,
        z=z,
        mode="lines+markers",
        line={"color": COLOURS["predicted"], "width": 7},
        marker={"color": COLOURS["predicted"], "size": [0, 6]},
        hovertemplate=f"{text}<extra></extra>",
    )


def _surface(view: ToolView) -> Any:
    import plotly.graph_objects as go

    vertices = np.concatenate([m.vertices for m in view.moments])
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    margin = 0.3 * float((high - low).max())
    x = 1e3 * np.array([low[0] - margin, high[0] + margin, high[0] + margin, low[0] - margin])
    y = 1e3 * np.array([low[1] - margin, low[1] - margin, high[1] + margin, high[1] + margin])
    z = np.full(4, 1e3 * view.surface_height)
    return go.Mesh3d(x=x, y=y, z=z, i=[0, 0], j=[1, 2], k=[2, 3], color=_SURFACE, opacity=0.35, hoverinfo="skip")

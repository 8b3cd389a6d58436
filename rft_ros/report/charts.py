"""Panels of lines and bands as a plotly figure."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["COLOURS", "Panels"]

COLOURS = dict.fromkeys(("measured", "turn", "surface", "surprise"), "#333333") | {
    "predicted": "#D55E00",
    "residual": "#0072B2",
    "x": "#0072B2",
    "y": "#E69F00",
    "z": "#009E73",
    "vertical": "#D55E00",
    "horizontal": "#0072B2",
    "approach": "#999999",
    "penetration": "#0072B2",
    "ploughing": "#CC79A7",
    "dwell": "#F0E442",
    "withdrawal": "#E69F00",
    "caution": "#56B4E9",
    "no": "#000000",
}
"""Okabe and Ito's palette, distinguishable with any kind of colour vision."""

_SHADE, _BAND = 0.13, 0.22  # opacity

Place = tuple[int, int]
"""Row and column of a panel, from 1."""

_Numbers = NDArray[np.float64]


class Panels:
    """Panels in rows and columns; `figure` is the plotly Figure. Lines with the same name share a legend entry.

    `heights`: relative heights of the rows. `same_x`: the panels of a column share their x axis. `height` [px].
    """

    def __init__(
        self, rows: int, columns: int = 1, *, height: int = 640, heights: Sequence[float] = (), same_x: bool = True
    ) -> None:
        from plotly.subplots import make_subplots

        self.figure: Any = make_subplots(
            rows=rows,
            cols=columns,
            row_heights=list(heights) or None,
            shared_xaxes="columns" if same_x else False,
            vertical_spacing=0.04 if same_x else min(0.14, 0.5 / rows),
            horizontal_spacing=0.09,
        )
        self.figure.update_layout(
            template="plotly_white",
            font={"family": "system-ui, sans-serif", "size": 13, "color": "#222222"},
            height=height,
            margin={"l": 70, "r": 20, "t": 80, "b": 55},
            legend={"orientation": "h", "x": 0.0, "y": 1.0, "xanchor": "left", "yanchor": "bottom"},
        )
        self._columns = columns

    def _add(self, at: Place, name: str, **look: Any) -> None:
        look |= {"mode": "lines", "legendgroup": name, "showlegend": all(t.name != name for t in self.figure.data)}
        self.figure.add_scatter(row=at[0], col=at[1], name=name, **look)

    def label(self, at: Place, *, x: str = "", y: str = "") -> None:
        """Label the axes of a panel."""
        self.figure.update_xaxes(title_text=x, row=at[0], col=at[1])
        self.figure.update_yaxes(title_text=y, row=at[0], col=at[1])

    def line(self, at: Place, name: str, x: _Numbers, y: _Numbers, *, colour: str = "", width: float = 1.5) -> None:
        """A line, shape [n] each, any unit; NaN for a gap. `colour`: a key of `COLOURS`, else the name."""
        look = {"line": {"color": COLOURS[colour or name], "width": width}, "connectgaps": False}
        self._add(at, name, x=_short(x), y=_short(y), **look)

    def band(self, at: Place, name: str, x: _Numbers, y: _Numbers, deviation: _Numbers, *, colour: str) -> None:
        """A band from y - deviation to y + deviation, shape [n] each, any unit; NaN for a gap."""
        from plotly.colors import hex_to_rgb

        rows = np.flatnonzero(~np.isnan(x + y + deviation))
        outline = [np.empty((2, 0))]
        for part in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):  # closed around each unbroken segment
            there, back = (x[part], y[part] - deviation[part]), (x[part[::-1]], (y + deviation)[part[::-1]])
            outline += [np.array(there), np.array(back), np.full((2, 1), np.nan)]
        across, up = np.hstack(outline)
        fill = {"fill": "toself", "fillcolor": f"rgba{(*hex_to_rgb(COLOURS[colour]), _BAND)}", "hoverinfo": "skip"}
        self._add(at, name, x=_short(across), y=_short(up), line_width=0, **fill)

    def shade(self, rows: Iterable[int], spans: Sequence[tuple[str, float, float]]) -> None:
        """Shade spans of the x axis, each a key of `COLOURS`, its begin and end, in the first panel of some rows."""
        shapes = []  # plotly's `add_vrect` gets slower with each
        for row in rows:
            panel = (row - 1) * self._columns + 1
            number = "" if panel == 1 else str(panel)
            look = {"xref": f"x{number}", "yref": f"y{number} domain", "y0": 0, "y1": 1, "type": "rect"}
            look |= {"opacity": _SHADE, "line": {"width": 0}, "layer": "below"}
            shapes += [{**look, "x0": a, "x1": b, "fillcolor": COLOURS[name]} for name, a, b in spans]
        self.figure.update_layout(shapes=shapes)
        for name in dict.fromkeys(name for name, _, _ in spans):
            marker = {"symbol": "square", "size": 13, "color": COLOURS[name], "opacity": 2.5 * _SHADE}
            self.figure.add_scatter(x=[None], y=[None], mode="markers", marker=marker, name=name)


def _short(values: _Numbers) -> NDArray[np.float32]:
    """Single precision: it halves the file and resolves more than a screen shows."""
    return values.astype(np.float32)

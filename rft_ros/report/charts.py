"""Panels of lines with bands as a plotly figure."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Panels"]

_NAMES = {  # Okabe and Ito's palette, distinguishable with any kind of colour vision
    "#333333": ("measured", "turn", "surface", "surprise"),
    "#D55E00": ("predicted", "vertical"),
    "#0072B2": ("x", "horizontal", "penetration"),
    "#E69F00": ("y",),
    "#009E73": ("z", "withdrawal"),
    "#56B4E9": ("dwell", "caution"),
    "#CC79A7": ("ploughing",),
    "#999999": ("approach",),
    "#000000": ("no",),
}
_COLOURS = {name: colour for colour, names in _NAMES.items() for name in names}

_BAND = 0.22  # opacity

Place = tuple[int, int]
"""Row and column of a panel, from 1."""

_Numbers = NDArray[np.float64]


class Panels:
    """Panels in rows and columns; `figure` is the plotly Figure. Lines with the same name share a legend entry.

    The panels of a column share their x axis. `height` [px].
    """

    def __init__(self, rows: int, columns: int = 1, *, height: int = 640) -> None:
        from plotly.subplots import make_subplots

        self.figure: Any = make_subplots(
            rows=rows, cols=columns, shared_xaxes="columns", vertical_spacing=0.04, horizontal_spacing=0.09
        )
        self.figure.update_layout(
            template="plotly_white",
            font={"family": "system-ui, sans-serif", "size": 13, "color": "#222222"},
            height=height,
            margin={"l": 70, "r": 20, "t": 80, "b": 55},
            legend={"orientation": "h", "x": 0.0, "y": 1.0, "xanchor": "left", "yanchor": "bottom"},
        )

    def label(self, at: Place, *, x: str = "", y: str = "") -> None:
        """Label the axes of a panel."""
        self.figure.update_xaxes(title_text=x, row=at[0], col=at[1])
        self.figure.update_yaxes(title_text=y, row=at[0], col=at[1])

    def line(self, at: Place, name: str, x: _Numbers, y: _Numbers, *, colour: str = "", width: float = 1.5) -> None:
        """A line, shape [n] each, any unit; NaN for a gap. `colour`: a name of `_NAMES`, else the line's."""
        self._add(at, name, x, y, line={"color": _COLOURS[colour or name], "width": width}, connectgaps=False)

    def band(self, at: Place, name: str, x: _Numbers, y: _Numbers, deviation: _Numbers, *, colour: str) -> None:
        """A band from y - deviation to y + deviation, shape [n] each, any unit; NaN for a gap."""
        from plotly.colors import hex_to_rgb

        rows = np.flatnonzero(~np.isnan(x + y + deviation))
        outline = [np.empty((2, 0))]
        for part in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):  # closed around each unbroken segment
            there, back = (x[part], y[part] - deviation[part]), (x[part[::-1]], (y + deviation)[part[::-1]])
            outline += [np.array(there), np.array(back), np.full((2, 1), np.nan)]
        fill = f"rgba{(*hex_to_rgb(_COLOURS[colour]), _BAND)}"
        self._add(at, name, *np.hstack(outline), fill="toself", fillcolor=fill, line_width=0, hoverinfo="skip")

    def _add(self, at: Place, name: str, x: _Numbers, y: _Numbers, **look: Any) -> None:
        look |= {"x": x.astype(np.float32), "y": y.astype(np.float32)}  # finer than a screen, half the bytes
        look |= {"mode": "lines", "legendgroup": name, "showlegend": all(t.name != name for t in self.figure.data)}
        self.figure.add_scatter(row=at[0], col=at[1], name=name, **look)

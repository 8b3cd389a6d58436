"""A chart as data, which `page` draws."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["BAND", "COLOURS", "SHADE", "Chart", "Line", "Panel", "Span"]

COLOURS = {
    "measured": "#333333",
    "predicted": "#D55E00",
    "residual": "#0072B2",
    "x": "#0072B2",
    "y": "#E69F00",
    "z": "#009E73",
    "vertical": "#D55E00",
    "horizontal": "#0072B2",
    "turn": "#333333",
    "surface": "#333333",
    "surprise": "#333333",
    "approach": "#999999",
    "penetration": "#0072B2",
    "ploughing": "#CC79A7",
    "dwell": "#F0E442",
    "withdrawal": "#E69F00",
    "caution": "#56B4E9",
    "no": "#000000",
}
"""Okabe and Ito's palette, distinguishable with any kind of colour vision."""

SHADE, BAND = 0.13, 0.22
"""Opacity of spans and of bands."""

_Numbers = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Line:
    """`y` over `x`, shape [n], NaN for a gap; of the kind "map" `values` over `x` and `y`, shape [n, m]. Any units.

    `kind`: "line"; "band" from y[0] to y[1], `y` of shape [2, n]; "bars" with heights `y` between the edges `x`, shape
    [n + 1]. `colour`: a key of `COLOURS`. Lines with the same label share a legend entry.
    """

    label: str
    colour: str
    x: _Numbers
    y: _Numbers
    kind: Literal["line", "band", "bars", "map"] = "line"
    width: float = 1.5
    values: _Numbers | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Panel:
    """One pair of axes. `names`: tick labels of y = 0, 1, 2 ..., from the top down."""

    x_label: str
    y_label: str
    lines: tuple[Line, ...]
    names: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Span:
    """A shaded part of the x axis from `begin` to `end`; `name`: a key of `COLOURS`."""

    name: str
    begin: float
    end: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chart:
    """Panels in rows, with a title and one sentence on what they show.

    `name`: for files and links. `panels`: rows of equal length. `spans`: shaded in the panels of the first column.
    `same_x`: the panels of a column share their x axis. `height` [px]; `heights`: relative heights of the rows.
    """

    name: str
    title: str
    sentence: str = ""
    panels: tuple[tuple[Panel, ...], ...]
    spans: tuple[Span, ...] = ()
    same_x: bool = True
    height: int = 640
    heights: tuple[float, ...] = ()

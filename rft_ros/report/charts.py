"""What a chart shows, in numbers and words, whatever draws it: `page` on a web page, `pictures` as PNG."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = ["BAND", "COLOURS", "SHADE", "Chart", "Line", "Panel", "Span", "ToolView", "TractionMoment"]

COLOURS = {
    "measured": "#333333",
    "predicted": "#D55E00",
    "residual": "#0072B2",
    "x": "#0072B2",
    "y": "#E69F00",
    "z": "#009E73",
    "approach": "#999999",
    "penetration": "#0072B2",
    "ploughing": "#CC79A7",
    "dwell": "#F0E442",
    "withdrawal": "#E69F00",
    "caution": "#56B4E9",
    "no": "#000000",
}
"""Okabe and Ito's palette, which people with any kind of colour vision can tell apart."""

SHADE, BAND = 0.13, 0.22
"""Opacity of spans, and of bands."""

_Numbers = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Line:
    """`y` over `x`, shape [n], NaN for a gap, and what is drawn of them is the `kind`.

    "line"; "band": from y[0] to y[1], shape [2, n]; "bars": heights between the edges `x`, shape [n + 1].

    `colour`: a key of `COLOURS`. Lines of one label share a place in the legend.
    """

    label: str
    colour: str
    x: _Numbers
    y: _Numbers
    kind: str = "line"
    width: float = 1.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Panel:
    """One pair of axes; `names`: of y = 0, 1, 2 ..., from the top down, in place of numbers."""

    x_label: str
    y_label: str
    lines: tuple[Line, ...]
    names: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Span:
    """A stretch of the x axis to be shaded: `name`, a key of `COLOURS`, from `begin` to `end`."""

    name: str
    begin: float
    end: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chart:
    """Panels in rows, with a title and one sentence on what they show.

    `name`: for files and links. `panels`: rows of equal length. `heights`: of the rows, by comparison. `spans`: shaded
    in the panels of the columns `shaded`.
    `same_x`: the panels of a column share their x axis.
    """

    name: str
    title: str
    sentence: str
    panels: tuple[tuple[Panel, ...], ...]
    spans: tuple[Span, ...] = ()
    shaded: tuple[int, ...] = (0,)
    same_x: bool = True
    height: int = 640
    heights: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TractionMoment:
    """The tool at one moment.

    `vertices`: world axes, x and y from the tool's origin [m], shape [n, 3]. `traction` of each face [Pa], shape [m].
    `force` on the tool [N], world axes.
    """

    label: str
    vertices: _Numbers
    traction: _Numbers
    force: tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToolView:
    """The tool in the grains at some moments, `chosen` the one shown first; `faces`: shape [m, 3]."""

    title: str
    sentence: str
    faces: NDArray[np.int64]
    moments: tuple[TractionMoment, ...]
    chosen: int
    surface_height: float
    name: str = field(default="tool")

    @property
    def from_above(self) -> bool:
        """Whether the faces that the grains push are seen from above: those that the force points away from."""
        return self.moments[self.chosen].force[2] <= 0.0

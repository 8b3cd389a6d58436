"""A figure's legend, below all of its panels."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["legend_below"]


def legend_below(figure: "Figure", entries: Mapping[str, Any], **style: Any) -> None:
    """Handles by label, under the panels of a figure with constrained layout."""
    import matplotlib as mpl

    place = "outside lower center"
    if mpl.__version_info__ < (3, 7):  # as on Ubuntu 24.04: it keeps no room for a legend by itself
        place = "lower center"
        figure.set_layout_engine("constrained", rect=(0.0, 0.06, 1.0, 0.94))
    figure.legend(entries.values(), entries.keys(), loc=place, frameon=False, **style)

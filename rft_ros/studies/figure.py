"""How the studies' figures look, and how they become the same bytes every time."""

import io
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["BLACK", "BLUE", "GREEN", "GREY", "ORANGE", "PURPLE", "SKY", "VERMILION"]
__all__ += ["label_axes", "new_figure", "picture"]

# Okabe and Ito's palette: told apart with every kind of colour vision. Line styles and markers repeat what colour says.
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILION, PURPLE, GREY = "#0072B2", "#D55E00", "#CC79A7", "#8C8C8C"

_DPI = 100


def new_figure(width: float, height: float) -> "Figure":
    """An empty figure, width and height in inches, that lays itself out."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def label_axes(axes: "Axes", *, x: str, y: str, title: str = "", legend: dict[str, Any] | None = None) -> None:
    """Label both axes (with units), add a light grid, and a legend if its options are given."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    if title:
        axes.set_title(title, fontsize=10)
    axes.grid(alpha=0.3)
    if legend is not None:
        axes.legend(fontsize=8, **legend)


def picture(figure: "Figure", kind: str) -> bytes:
    """The figure as "png" (256 colours, small enough for docs) or "svg"; no dates, versions or random names in it."""
    import matplotlib as mpl
    from PIL import Image

    out = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "rft_ros", "svg.fonttype": "path"}):
        nothing = {"Software": None} if kind == "png" else {"Date": None, "Creator": None}
        figure.savefig(out, format=kind, dpi=_DPI, metadata=nothing)
    if kind != "png":
        return out.getvalue()
    small = io.BytesIO()
    with Image.open(out) as image:
        image.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(small, format="png", optimize=True)
    return small.getvalue()

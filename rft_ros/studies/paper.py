"""What the studies take from the paper: its grains, its bodies, and where they are held (Treers, Cao, Stuart 2021)."""

from pathlib import Path

from rft_ros.rft import MEDIA, Law, alpha_y_model, treers2021
from rft_ros.tool import Tool, load_tool

__all__ = ["ALPHA_Y", "NOT_STATED", "ZETA", "ellipsoid", "law", "plate", "root_tip"]

ZETA = 0.33
"""Scale factor of the paper's glass beads: the mean of five vertical penetrations."""

ALPHA_Y = ("constant", "linear")
"""The paper's two models of α_y (IV-B)."""

NOT_STATED = "not stated here"
"""In place of a published number that this project does not know."""


def law(alpha_y: str, *, zeta: float = ZETA) -> Law:
    """The paper's model on Li's generic coefficients, with α_y `constant` or `linear`."""
    generic = MEDIA["generic"]
    return treers2021(generic, alpha_y_model(alpha_y, generic), zeta=zeta)


def plate() -> Tool:
    """The plate of Fig. 3: 51 mm square. Its thickness, 3.2 mm, is this project's own."""
    return load_tool("plate")


def ellipsoid(data: Path | None = None) -> Tool:
    """The ellipsoid of Fig. 7, 36 x 19 x 19 mm, origin at its centre: the authors' file from `data`, or ours."""
    if data is None:
        return load_tool("ellipsoid")
    return load_tool(str(data / "paper" / "ellipsoid-exp.stl"), origin=(9.6, 9.6, 18.05))


def root_tip(data: Path | None = None) -> Tool:
    """The root tip of Fig. 8, 20 mm wide, 34.5 mm long: the authors' file from `data`, or the shipped one.

    It is held 1.25 mm above its base, which is where the released code's centre of rotation lies in the authors' file.
    """
    if data is None:
        return load_tool("root_tip", origin=(0.0, 0.0, 1.25))
    return load_tool(str(data / "paper" / "root-tip.stl"), origin=(0.0, 0.0, 35.5))

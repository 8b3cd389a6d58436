"""The picture of a cell's frames in docs/node.md: world, tool frame, load cell, mesh file and surface.

python -m studies.frames docs/images/frames.png
"""

import sys
from pathlib import Path
from typing import Any

__all__ = ["draw_frames"]

_X, _Z = "#D55E00", "#0072B2"
_METAL, _CELL, _TOOL, _SAND, _TEXT = "#c9ced6", "#8f99a8", "#e3e6ea", "#C2A878", "#222222"
_SCOOP = ((-9, 0), (9, 0), (9, -46), (26, -46), (26, -78), (-26, -78), (-26, -46), (-9, -46))  # mm, file coordinates

_OF_TOOL = """the pose's frame, such as UR's tool0_controller:
z points out of the flange, here down;
the pose's qx, qy, qz, qw are 1, 0, 0, 0"""
_OF_MESH = """In the file z points up; in tool_frame it points down.
So turn the mesh by 180° about x:
mesh.quaternion: [1.0, 0.0, 0.0, 0.0]  (--rotate 1 0 0 0).
With it rft check-mesh says: z: 26 to 104 mm.
If both z axes point the same way: [0.0, 0.0, 0.0, 1.0]."""


def draw_frames(file: Path) -> None:
    """Draw an arm that points down at the grains, and beside it the tool's mesh as its file has it."""
    from matplotlib.figure import Figure

    figure: Any = Figure(figsize=(12.0, 6.4), layout="constrained")
    cell, mesh = figure.subplots(1, 2, gridspec_kw={"width_ratios": (1.75, 1.0)})
    _cell(cell)
    _mesh_file(mesh)
    for axes in (cell, mesh):
        axes.set_aspect("equal")
        axes.axis("off")
    figure.savefig(file, dpi=110, bbox_inches="tight")


def _axes_of(panel: Any, x: float, z: float, *, down: bool, size: float = 30.0) -> None:
    """Arrows of x, to the right, and z of a frame at a place [mm]."""
    way = -1.0 if down else 1.0
    for (dx, dz), name, colour in (((size, 0.0), "x", _X), ((0.0, way * size), "z", _Z)):
        arrow = {"arrowstyle": "-|>", "color": colour, "lw": 2.4, "shrinkA": 0, "shrinkB": 0}
        panel.annotate("", (x + dx, z + dz), (x, z), arrowprops=arrow, zorder=6)
        panel.text(x + 1.17 * dx, z + 1.17 * dz, name, color=colour, ha="center", va="center", weight="bold", zorder=6)
    panel.plot(x, z, "o", color=_TEXT, ms=4.5, zorder=7)


def _note(panel: Any, x: float, z: float, title: str, text: str, *, to: tuple[float, float] | None = None) -> None:
    panel.text(x, z, title, color=_TEXT, weight="bold", va="bottom", fontsize=10)
    panel.text(x, z - 1.5, text, color=_TEXT, va="top", fontsize=9, linespacing=1.35)
    if to is not None:
        panel.plot([x - 3.0, to[0]], [z, to[1]], color="#999999", lw=0.9, ls=":", zorder=2)


def _cell(panel: Any) -> None:
    from matplotlib.patches import Polygon, Rectangle

    flange, surface = 60.0, -66.0  # height of the flange's face and of the grains [mm]
    panel.add_patch(Rectangle((-175, -140), 420, surface + 140, facecolor=_SAND, alpha=0.45, lw=0))
    panel.plot([-175, 245], [surface, surface], color="#7a6640", lw=1.6)
    panel.add_patch(Rectangle((-24, flange + 26), 48, 64, facecolor=_METAL, edgecolor="#777777"))
    panel.add_patch(Rectangle((-32, flange), 64, 26, facecolor=_METAL, edgecolor="#777777"))
    panel.add_patch(Rectangle((-28, flange - 26), 56, 26, facecolor=_CELL, edgecolor="#666666"))
    points = [(x, z + flange - 26) for x, z in _SCOOP]
    panel.add_patch(Polygon(points, closed=True, facecolor=_TOOL, edgecolor="#666666", zorder=3))
    panel.text(0, flange + 58, "arm", ha="center", va="center", color=_TEXT)
    panel.text(-17, flange - 13, "load\ncell", ha="center", va="center", color="white", fontsize=8)
    panel.text(0, flange - 92, "tool", ha="center", va="center", color=_TEXT, zorder=4)

    _axes_of(panel, 0.0, flange, down=True)
    _note(panel, 62, 74, "tool_frame", _OF_TOOL, to=(4.0, flange))
    _axes_of(panel, -62.0, flange - 13, down=True, size=22.0)
    panel.plot([-62, -28], [flange - 13, flange - 13], color="#999999", lw=0.9, ls=":")
    _note(panel, -172, 92, "sensor_frame", "sensor.position, sensor.quaternion:\nits place in tool_frame")
    _axes_of(panel, -150.0, -128.0, down=False)
    _note(panel, -108, -108, "world_frame", "such as the arm's base: z up")
    panel.annotate("", (-165.0, surface), (-165.0, -128.0), arrowprops={"arrowstyle": "<->", "color": "#7a6640"})
    panel.text(-168, surface + 4, "surface_height", color="#7a6640", weight="bold", fontsize=10)
    panel.set(xlim=(-178, 248), ylim=(-142, 152))


def _mesh_file(panel: Any) -> None:
    from matplotlib.patches import Polygon

    panel.add_patch(Polygon(_SCOOP, closed=True, facecolor=_TOOL, edgecolor="#666666"))
    _axes_of(panel, 0.0, 0.0, down=False, size=46.0)
    panel.plot(0, 26, "s", color=_TEXT, ms=6, zorder=7)
    _note(panel, 12, 27, "mesh.origin: [0.0, 0.0, 26.0]", "where tool_frame's origin lies")
    panel.text(0, 72, "The mesh file, in its own axes", ha="center", weight="bold", color=_TEXT)
    text = {"ha": "center", "va": "top", "color": _TEXT, "fontsize": 9.5, "linespacing": 1.4}
    panel.text(0, -88, _OF_MESH, **text)
    panel.set(xlim=(-85, 85), ylim=(-160, 80))


if __name__ == "__main__":
    draw_frames(Path(sys.argv[1]))

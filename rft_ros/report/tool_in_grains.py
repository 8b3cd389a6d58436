"""One moment of a tool in the grains, drawn with matplotlib: traction on its faces, the surface, the net force."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.report.moving_tool import FORCE, SURFACE, TRACTION, MovingTool

__all__ = ["draw_tool_in_grains"]

_LOOK = {"elev": 7.0, "azim": -62.0}
"""Nearly level: the faces that carry traction look down or forwards, and the surface is still seen to be one."""


def draw_tool_in_grains(figure: Any, axes: Any, scene: MovingTool, moment: int = 0) -> None:
    """Draw a moment of a scene into 3D axes, in millimetres, with a colour bar and the force's numbers."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, Normalize
    from matplotlib.ticker import MaxNLocator
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

    points = 1e3 * scene.placed[moment]
    level = 1e3 * scene.surface_height
    kilopascals = 1e-3 * scene.traction[moment]
    force = scene.forces[moment]
    low, high = _box(points, level)

    colours = LinearSegmentedColormap.from_list("traction", TRACTION)
    scale = Normalize(0.0, float(kilopascals.max(initial=0.0)) or 1.0)
    triangles = points[scene.faces]
    _grains(axes, low, high, level)
    above = triangles[:, :, 2].mean(axis=1) > level
    for shown, order in ((~above, 2), (above, 4)):  # the surface, between them, veils what is below it alone
        if shown.any():
            axes.add_collection3d(
                Poly3DCollection(
                    triangles[shown],
                    facecolors=colours(scale(kilopascals[shown])),
                    edgecolors=(0.0, 0.0, 0.0, 0.12),
                    linewidths=0.25,
                    zorder=order,
                )
            )
    axes.text(low[0] + 1.0, low[1], level - 0.06 * (high - low)[2], "grains", color="#7a6640", fontsize=10, zorder=6)
    middle = points.mean(axis=0)
    size = float(np.linalg.norm(force))
    if size > 0.0:
        reach = 0.62 * float((high - low)[2])
        axes.quiver(*middle, *(reach * force / size), color=FORCE, lw=3.0, arrow_length_ratio=0.16, zorder=5)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(4))
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
    axes.grid(visible=False)
    axes.set_box_aspect(high - low, zoom=1.0)
    axes.view_init(**_LOOK)
    x, y, z = (f"{v:.2f}".replace("-0.00", "0.00") for v in force)
    told = f"net force on the tool (x, y, z) = ({x}, {y}, {z}) N"
    axes.text2D(0.5, 0.98, told, transform=axes.transAxes, color=FORCE, ha="center", va="top", size=11, weight="bold")
    figure.colorbar(ScalarMappable(scale, colours), ax=axes, label="Traction [kPa]", shrink=0.6, pad=0.02, aspect=20)


def _box(points: NDArray[np.float64], level: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Corners of what is drawn: the tool and as much again of grains around it, the surface, room for the arrow."""
    low, high = points.min(axis=0), points.max(axis=0)
    around = 0.45 * float((high - low).max())
    low, high = low - around, high + around
    low[2], high[2] = min(low[2] + 0.4 * around, level), max(high[2], level + around)
    return low, high


def _grains(axes: Any, low: NDArray[np.float64], high: NDArray[np.float64], level: float) -> None:
    """The surface, and the grains' far sides below it."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    (x0, y0, z0), (x1, y1, _) = low, high
    surface = [(x0, y0, level), (x1, y0, level), (x1, y1, level), (x0, y1, level)]
    walls = [
        [(x0, y1, z0), (x1, y1, z0), (x1, y1, level), (x0, y1, level)],
        [(x0, y0, z0), (x0, y1, z0), (x0, y1, level), (x0, y0, level)],
    ]
    axes.add_collection3d(Poly3DCollection(walls, facecolors=SURFACE, edgecolors="none", alpha=0.3, zorder=1))
    axes.add_collection3d(
        Poly3DCollection([surface], facecolors=SURFACE, edgecolors="#7a6640", linewidths=1.0, alpha=0.35, zorder=3)
    )

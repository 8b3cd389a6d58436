"""A tool on its way through the grains, coloured by traction: a page that plays it, and a film."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError, reason_of
from rft_ros.report.figure_page import figure_page

__all__ = ["FILMS", "FORCE", "SURFACE", "TRACTION", "MovingTool", "write_film", "write_moving_page"]

Array = NDArray[np.float64]

FILMS = (".gif", ".mp4")
"""Suffixes of films; .mp4 needs the program ffmpeg."""

SURFACE = "#C2A878"
FORCE = "#0072B2"
"""Colours of the surface and of the force, wherever a tool is drawn."""

_PATH = "#555555"
TRACTION = ((0.0, "#dfe3e8"), (0.25, "#f9d48b"), (0.6, "#e8743b"), (1.0, "#8c0d25"))
"""Colours of the traction over its share of the greatest."""

_FRAMES_A_SECOND = 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MovingTool:
    """What is drawn at each moment, in world axes.

    `times` [s], shape [k]. `placed`: vertices [m], shape [k, n, 3]; `faces`: indices, shape [m, 3]. `traction`: on each
    face [N/m²], shape [k, m]. `origins` [m] and `forces` [N]: shape [k, 3]. `surface_height` [m].
    """

    title: str
    times: Array
    placed: Array
    faces: NDArray[np.int64]
    traction: Array
    origins: Array
    forces: Array
    surface_height: float

    def only(self, moment: int) -> "MovingTool":
        """The scene of one moment, by its number."""
        names = ("times", "placed", "traction", "origins", "forces")
        return replace(self, **{name: getattr(self, name)[[moment]] for name in names})

    def box(self) -> tuple[Array, Array]:
        """Corners of what is ever drawn [m], with the surface in it, and at least half as wide as it is high."""
        points = self.placed.reshape(-1, 3)
        low, high = points.min(axis=0), points.max(axis=0)
        low[2], high[2] = min(low[2], self.surface_height), max(high[2], self.surface_height)
        narrow = np.maximum(0.5 * (high[2] - low[2]) - (high - low)[:2], 0.0)
        low[:2], high[:2] = low[:2] - 0.5 * narrow, high[:2] + 0.5 * narrow
        margin = 0.05 * (high - low).max()
        return low - margin, high + margin

    def arrows(self) -> Array:
        """Ends of the force arrows [m], shape [k, 3]: the longest is 0.4 of the scene."""
        low, high = self.box()
        strongest = np.linalg.norm(self.forces, axis=1).max()
        scale = 0.4 * float((high - low).max()) / strongest if strongest > 0.0 else 0.0
        return self.middles() + scale * self.forces

    def middles(self) -> Array:
        """The tool's middle at each moment [m], shape [k, 3]: where the arrows begin."""
        return np.asarray(self.placed.mean(axis=1))


def _in_millimetres(scene: MovingTool) -> MovingTool:
    """As people read it: all lengths times 1,000."""
    lengths = {name: 1e3 * getattr(scene, name) for name in ("placed", "origins", "surface_height")}
    return replace(scene, **lengths)


def _caption(scene: MovingTool, k: int) -> str:
    return f"{scene.title}   t = {scene.times[k]:.2f} s   |F| = {np.linalg.norm(scene.forces[k]):.2f} N"


def write_moving_page(scene: MovingTool, file: Path) -> None:
    """One HTML file that needs nothing beside it; the same scene gives the same bytes."""
    import plotly.graph_objects as go

    scene = _in_millimetres(scene)
    low, high = scene.box()
    strongest = float(scene.traction.max()) or 1.0
    starts, ends, middles = scene.middles(), scene.arrows(), scene.middles()
    i, j, k = scene.faces.T

    def moving(n: int) -> list[Any]:
        x, y, z = scene.placed[n].astype(np.float32).T
        arrow = np.array([starts[n], ends[n]]).T
        so_far = middles[: n + 1].T
        return [
            go.Mesh3d(
                x=x, y=y, z=z, i=i, j=j, k=k, flatshading=True, lighting={"ambient": 0.75, "diffuse": 0.4},
                colorscale=[list(c) for c in TRACTION], cmin=0.0, cmax=strongest / 1e3,
                intensity=(scene.traction[n] / 1e3).astype(np.float32), intensitymode="cell", name="tool",
                colorbar={"title": {"text": "Traction [kPa]"}, "len": 0.6},
            ),
            go.Scatter3d(
                x=arrow[0], y=arrow[1], z=arrow[2], mode="lines+markers", line={"color": FORCE, "width": 8},
                marker={"size": [0, 5], "color": FORCE}, name="force on the tool",
            ),
            go.Scatter3d(
                x=so_far[0], y=so_far[1], z=so_far[2], mode="lines", line={"color": _PATH, "width": 3}, name="path"
            ),
        ]  # fmt: skip

    ground = go.Surface(
        x=[low[0], high[0]],
        y=[low[1], high[1]],
        z=np.full((2, 2), scene.surface_height),
        colorscale=[[0, SURFACE], [1, SURFACE]],
        showscale=False,
        opacity=0.35,
        name="surface",
        hoverinfo="skip",
    )
    count = len(scene.times)
    figure = go.Figure(
        data=[*moving(0), ground],
        frames=[
            go.Frame(data=moving(n), traces=[0, 1, 2], name=str(n), layout={"title": {"text": _caption(scene, n)}})
            for n in range(count)
        ],
    )
    each = {"frame": {"duration": 1000 // _FRAMES_A_SECOND, "redraw": True}, "fromcurrent": True, "mode": "immediate"}
    axis = {"backgroundcolor": "white", "gridcolor": "#dddddd"}
    figure.update_layout(
        title=_caption(scene, 0),
        font={"family": "system-ui, sans-serif", "size": 13},
        scene={
            "xaxis": {"title": {"text": "x [mm]"}, "range": [low[0], high[0]], **axis},
            "yaxis": {"title": {"text": "y [mm]"}, "range": [low[1], high[1]], **axis},
            "zaxis": {"title": {"text": "z [mm]"}, "range": [low[2], high[2]], **axis},
            "aspectmode": "manual",  # "data" lets a wide scene, seen from the side, fill more than the page
            "aspectratio": dict(zip("xyz", (1.05 * (high - low) / (high - low).max()).tolist(), strict=True)),
            "camera": {"eye": {"x": 1.15, "y": -1.35, "z": 0.5}},
        },
        legend={"orientation": "h", "x": 0.03, "y": 1.0, "yanchor": "top"},
        updatemenus=[
            {
                "type": "buttons",
                "direction": "left",
                "x": 0.0,
                "y": -0.02,
                "yanchor": "top",
                "buttons": [
                    {"label": "Play", "method": "animate", "args": [None, each]},
                    {"label": "Pause", "method": "animate", "args": [[None], {"mode": "immediate"}]},
                ],
            }
        ],
        sliders=[
            {
                "x": 0.14,
                "len": 0.84,
                "currentvalue": {"prefix": "t = ", "suffix": " s"},
                "steps": [
                    {"label": f"{t:.2f}", "method": "animate", "args": [[str(n)], {"mode": "immediate"}]}
                    for n, t in enumerate(scene.times)
                ],
            }
        ],
        margin={"l": 0, "r": 0, "t": 50, "b": 100},
        height=760,
    )
    _written(file, figure_page(figure, title=scene.title, name="moving-tool"))


def _written(file: Path, text: str) -> None:
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write '{file}': {error.strerror}") from None


def write_film(scene: MovingTool, file: Path) -> None:
    """A .gif or .mp4; InputError if ffmpeg is missing for the latter."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import animation
    from matplotlib import pyplot as plt
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.ticker import MaxNLocator
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

    if file.suffix == ".mp4" and not animation.writers.is_available("ffmpeg"):
        raise InputError(f"'{file}' needs the program ffmpeg (apt install ffmpeg), or write a .gif")
    writer = animation.writers["ffmpeg" if file.suffix == ".mp4" else "pillow"](fps=_FRAMES_A_SECOND)
    scene = _in_millimetres(scene)
    low, high = scene.box()
    strongest = float(scene.traction.max()) or 1.0
    colours = LinearSegmentedColormap.from_list("traction", TRACTION)
    ends, middles = scene.arrows(), scene.middles()
    figure = plt.figure(figsize=(6.4, 6.0), dpi=90)
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    corners = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    ground = np.column_stack([corners, np.full(4, scene.surface_height)])
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with writer.saving(figure, str(file), dpi=90):
            for n in range(len(scene.times)):
                axes.clear()
                triangles = scene.placed[n][scene.faces]
                shades = colours(scene.traction[n] / strongest)
                axes.add_collection3d(Poly3DCollection(triangles, facecolors=shades, edgecolors="none", zorder=1))
                axes.add_collection3d(Poly3DCollection([ground], facecolors=SURFACE, alpha=0.3, zorder=2))
                axes.plot(*middles[: n + 1].T, color=_PATH, lw=1.0, zorder=3)
                axes.plot(*np.array([middles[n], ends[n]]).T, color=FORCE, lw=3.0, zorder=4)
                axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
                axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]", title=_caption(scene, n))
                for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
                    axis.set_major_locator(MaxNLocator(3))
                axes.set_box_aspect(high - low, zoom=0.9)
                axes.view_init(elev=14.0, azim=-55.0)
                writer.grab_frame()
    except OSError as error:
        raise InputError(f"cannot write '{file}': {reason_of(error)}") from None
    finally:
        plt.close(figure)

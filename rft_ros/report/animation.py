"""A tool that moves through the grains, coloured by traction, as a plotly figure."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.ground import HeightMap, LocalSurface, Support
from rft_ros.rft import LEVEL, Law, plate_forces, rotation_matrix
from rft_ros.tool import Tool, drawable

__all__ = ["TRACTION", "Animation", "animate", "animate_evenly", "animation_figure"]

Array = NDArray[np.float64]

_SURFACE, _FORCE, _PATH = "#C2A878", "#0072B2", "#555555"
TRACTION = ((0.0, "#dfe3e8"), (0.25, "#f9d48b"), (0.6, "#e8743b"), (1.0, "#8c0d25"))
"""Colour scale of the traction, relative to the greatest."""

_FRAMES_A_SECOND = 12
_MOMENTS = 60
_MOST_FACES = 1500


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Animation:
    """k moments of a tool with n vertices and m faces, in world axes.

    `labels`: one for each moment. `placed`: vertices [m], shape [k, n, 3]. `faces`: indices of vertices, shape [m, 3].
    `traction`: on each face [N/m²], shape [k, m]. `forces`: on the tool [N], shape [k, 3]. `surface_height` [m].
    `first`: index of the moment shown first. `ground`: x [n], y [m] and heights [n, m] of a map of the ground [m].
    """

    title: str
    labels: tuple[str, ...]
    placed: Array
    faces: NDArray[np.int64]
    traction: Array
    forces: Array
    surface_height: float
    first: int = 0
    ground: tuple[Array, Array, Array] | None = None

    def box(self) -> tuple[Array, Array]:
        """Lowest and highest corner of tool and surface [m], shape [3], with margin; at least half as wide as high."""
        points = self.placed.reshape(-1, 3)
        low, high = points.min(axis=0), points.max(axis=0)
        low[2], high[2] = min(low[2], self.surface_height), max(high[2], self.surface_height)
        narrow = np.maximum(0.5 * (high[2] - low[2]) - (high - low)[:2], 0.0)
        low[:2], high[:2] = low[:2] - 0.5 * narrow, high[:2] + 0.5 * narrow
        margin = 0.05 * (high - low).max()
        return low - margin, high + margin

    def arrows(self) -> tuple[Array, Array]:
        """Starts (the tool's centre) and ends of the force arrows [m], shape [k, 3]; the longest is 0.4 of the box."""
        low, high = self.box()
        strongest = np.linalg.norm(self.forces, axis=1).max()
        scale = 0.4 * float((high - low).max()) / strongest if strongest > 0.0 else 0.0
        starts = np.asarray(self.placed.mean(axis=1))
        return starts, starts + scale * self.forces

    def caption(self, k: int) -> str:
        """Title, label and force of a moment."""
        return f"{self.title}   {self.labels[k]}   |F| = {np.linalg.norm(self.forces[k]):.2f} N"

    def in_millimetres(self) -> "Animation":
        """The same with lengths in mm, for drawing."""
        ground = self.ground and (1e3 * self.ground[0], 1e3 * self.ground[1], 1e3 * self.ground[2])
        return replace(self, placed=1e3 * self.placed, surface_height=1e3 * self.surface_height, ground=ground)


def animate(
    title: str,
    tool: Tool,
    law: Law,
    states: Array,
    labels: Sequence[str],
    *,
    surface_height: float,
    ground: HeightMap | None = None,
    first: int = 0,
    most_faces: int = _MOST_FACES,
) -> Animation:
    """The animation of states, shape [k, 13]. The traction does not include memory.

    `surface_height` [m] where `ground` knows nothing.
    """
    vertices, faces, plates = drawable(tool, most_faces=most_faces)
    support, level = Support(tool.corners), LocalSurface(surface_height, LEVEL, 0.0, 0.0)
    surfaces = [support.local_surface(ground, s, level=surface_height) if ground else level for s in states]
    forces = np.array(
        [
            plate_forces(plates, law, state, surface_height=surface.height, slope=surface.slope)
            for state, surface in zip(states, surfaces, strict=True)
        ]
    )
    return Animation(
        title=title,
        labels=tuple(labels),
        placed=np.array([vertices @ rotation_matrix(state[3:7]).T + state[:3] for state in states]),
        faces=faces,
        traction=np.linalg.norm(forces, axis=2) / plates.packed[6],
        forces=forces.sum(axis=1),
        surface_height=surface_height,
        first=first,
        ground=None if ground is None else _grid(ground, states, 3.0 * tool.plates.reach),
    )


def animate_evenly(
    title: str,
    tool: Tool,
    law: Law,
    times: Array,
    states: Array,
    *,
    surface_height: float = 0.0,
    ground: HeightMap | None = None,
) -> Animation:
    """The animation of at most 60 of the states, evenly spaced by index. `states`: shape [n, 13]. `times` [s]."""
    used = np.unique(np.linspace(0, len(states) - 1, min(len(states), _MOMENTS)).round().astype(int))
    labels = [f"t = {time:.2f} s" for time in times[used]]
    return animate(title, tool, law, states[used], labels, surface_height=surface_height, ground=ground)


def _grid(ground: HeightMap, states: Array, around: float) -> tuple[Array, Array, Array]:
    """x, y and heights [m] of the ground around the tool's path, at most 100 x 100."""
    low, high = states[:, :2].min(axis=0) - around, states[:, :2].max(axis=0) + around
    x, y = (np.linspace(a, b, 100) for a, b in zip(low, high, strict=True))
    across, along = np.meshgrid(x, y, indexing="ij")
    return x, y, ground.heights_at(across, along)


def animation_figure(scene: Animation) -> Any:
    """A plotly Figure with a slider over the moments, and play and pause buttons."""
    import plotly.graph_objects as go

    scene = scene.in_millimetres()
    low, high = scene.box()
    strongest = float(scene.traction.max()) or 1.0
    starts, ends = scene.arrows()
    i, j, k = scene.faces.T

    def moving(n: int) -> list[Any]:
        x, y, z = scene.placed[n].astype(np.float32).T
        arrow, path = np.array([starts[n], ends[n]]).T, starts[: n + 1].T
        return [
            go.Mesh3d(
                x=x, y=y, z=z, i=i, j=j, k=k, flatshading=True, lighting={"ambient": 0.75, "diffuse": 0.4},
                colorscale=[list(c) for c in TRACTION], cmin=0.0, cmax=strongest / 1e3, name="tool",
                intensity=(scene.traction[n] / 1e3).astype(np.float32), intensitymode="cell",
                colorbar={"title": {"text": "Traction [kPa]"}, "len": 0.6},
            ),
            go.Scatter3d(
                x=arrow[0], y=arrow[1], z=arrow[2], mode="lines+markers", line={"color": _FORCE, "width": 8},
                marker={"size": [0, 5], "color": _FORCE}, name="force on the tool",
            ),
            go.Scatter3d(
                x=path[0], y=path[1], z=path[2], mode="lines", line={"color": _PATH, "width": 3}, name="path"
            ),
        ]  # fmt: skip

    x, y, heights = scene.ground or (*np.array([low, high]).T[:2], np.full((2, 2), scene.surface_height))
    ground = go.Surface(
        x=x, y=y, z=heights.T, name="surface",
        colorscale=[[0, _SURFACE], [1, _SURFACE]], showscale=False, opacity=0.35, hoverinfo="skip",
    )  # fmt: skip
    frames = [
        go.Frame(data=moving(n), traces=[0, 1, 2], name=str(n), layout={"title": {"text": scene.caption(n)}})
        for n in range(len(scene.labels))
    ]
    figure = go.Figure(data=[*moving(scene.first), ground], frames=frames)
    each = {"frame": {"duration": 1000 // _FRAMES_A_SECOND, "redraw": True}, "fromcurrent": True, "mode": "immediate"}
    at_once = {"mode": "immediate"}
    play = {"label": "Play", "method": "animate", "args": [None, each]}
    pause = {"label": "Pause", "method": "animate", "args": [[None], at_once]}
    steps = [{"label": label, "method": "animate", "args": [[str(n)], at_once]} for n, label in enumerate(scene.labels)]
    axes = {
        f"{axis}axis": {
            "title": {"text": f"{axis} [mm]"}, "range": [low[n], high[n]],
            "backgroundcolor": "white", "gridcolor": "#dddddd",
        }
        for n, axis in enumerate("xyz")
    }  # fmt: skip
    figure.update_layout(
        title=scene.caption(scene.first),
        font={"family": "system-ui, sans-serif", "size": 13},
        scene={
            **axes,
            "aspectmode": "manual",  # with "data", a wide scene is larger than the page
            "aspectratio": dict(zip("xyz", (1.05 * (high - low) / (high - low).max()).tolist(), strict=True)),
            # view the loaded faces: the force points into the tool
            "camera": {"eye": {"x": 1.15, "y": -1.35, "z": 0.5 if scene.forces[scene.first, 2] <= 0.0 else -0.5}},
        },
        legend={"orientation": "h", "x": 0.03, "y": 1.0, "yanchor": "top"},
        updatemenus=[
            {"type": "buttons", "direction": "left", "x": 0.0, "y": -0.02, "yanchor": "top", "buttons": [play, pause]}
        ],
        sliders=[{"x": 0.14, "len": 0.84, "active": scene.first, "steps": steps}],
        margin={"l": 0, "r": 0, "t": 50, "b": 100},
        height=760,
    )
    return figure

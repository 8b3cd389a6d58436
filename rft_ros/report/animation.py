"""A tool that moves through the grains, coloured by traction, as a plotly figure."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.ground import HeightMap, Support
from rft_ros.parameters import Model
from rft_ros.report.page import Figure
from rft_ros.rft import POSITION, QUATERNION, Law, plate_forces, rotation_matrix
from rft_ros.tool import Tool

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_MAX_FACE_COUNT = 10_000  # of a mesh that is drawn as it is
_FACE_COUNTS = (5000, 20_000, 80_000)  # numbers of faces that are tried for a finer one
_EXTENT_ERROR_RATIO = 0.01  # of the largest extent: how far a face of the bounding box may move
_AREA_ERROR_RATIO = 0.02  # of the area
# of the largest extent: a distance as bad as an error of the normal by 1 rad
_NORMAL_ERROR_RATIO = 0.1


class DrawnMesh(NamedTuple):
    """Vertices in the tool frame [m], shape [n, 3]; faces, shape [m, 3].

    `facet`: for each face the index of the tool's facet whose traction colours it, shape [m].
    """

    vertices: Array
    faces: Indices
    facet: Indices


def drawn_mesh(tool: Tool, *, most_faces: int = _MAX_FACE_COUNT) -> DrawnMesh:
    """The mesh with which a tool is drawn. Up to `most_faces` faces, it is the tool's own mesh.

    For a finer mesh it is the coarsest simplification that keeps the extent and the area. If none keeps them, as with
    thin blades, the full mesh is drawn.
    """
    import trimesh
    from scipy.spatial import KDTree

    full = trimesh.Trimesh(tool.vertices, tool.faces)  # whose faces share vertices, as in no STL
    extent = full.extents.max()

    def places(mesh: Any) -> Array:
        """Centres and scaled normals of faces [m], shape [n, 6]: errors of normals count as distance."""
        return np.hstack([mesh.triangles_center, _NORMAL_ERROR_RATIO * extent * mesh.face_normals])

    for count in _FACE_COUNTS:
        if max(count, most_faces) < len(full.faces):
            fewer = full.simplify_quadric_decimation(face_count=count)
            fewer.update_faces(fewer.area_faces > 0.0)
            if not len(fewer.faces):
                continue
            extent_error = np.abs(full.bounds - fewer.bounds).max()
            area_error = abs(full.area - fewer.area)
            if (
                extent_error <= _EXTENT_ERROR_RATIO * extent
                and area_error <= _AREA_ERROR_RATIO * full.area
            ):
                nearest = np.asarray(KDTree(places(full)).query(places(fewer))[1], np.int64)
                return DrawnMesh(np.array(fewer.vertices), np.array(fewer.faces), nearest)
    return DrawnMesh(np.array(full.vertices), np.array(full.faces), np.arange(len(full.faces)))


_SURFACE = "#C2A878"
_FORCE = "#0072B2"
_PATH = "#555555"
TRACTION = ((0.0, "#dfe3e8"), (0.25, "#f9d48b"), (0.6, "#e8743b"), (1.0, "#8c0d25"))
"""Colour scale of the traction, relative to the greatest."""

_ZOOM_FACTOR = 1.2  # size at which a scene fills the figure
_PERIOD_MS = 83  # ms from frame to frame
_MAX_MOMENT_COUNT = 60
_MIN_MOMENT_COUNT = 3
_MAX_NUMBER_COUNT = (
    400_000  # coordinates and tractions in all moments, 2 MB; a finer mesh gets fewer moments
)


class DrawnMotion(NamedTuple):
    """n states of a tool in the order of time, with the predicted forces.

    `times` [s], shape [n]. `states`: shape [n, 13]. `forces`: on the tool, world axes [N], shape [n, 3]. `ground`: the
    map at the end; None: a level plane.
    """

    times: Array
    states: Array
    forces: Array
    ground: HeightMap | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Animation:
    """k moments of a tool with n vertices and m faces, in world axes.

    `labels`: one for each moment. `positions`: of vertices [mm], shape [k, n, 3]. `faces`: indices of these, [m, 3].
    `traction`: by the law, on each face [kPa], shape [k, m]. `forces`: the predicted forces on the tool [N], shape
    [k, 3]; they may include memory and learned corrections. `surface_height` [mm].
    `ground`: x [n], y [m] and heights [n, m] of a map of the ground [mm]. `first`: index of the moment shown first.
    """

    title: str
    labels: tuple[str, ...]
    positions: Array
    faces: NDArray[np.int64]
    traction: Array
    forces: Array
    surface_height: float
    ground: tuple[Array, Array, Array] | None
    first: int


def animate(title: str, model: Model, motion: DrawnMotion, *, surface_height: float) -> Animation:
    """The animation of at most 60 states, evenly spaced by index. It includes the state of the greatest force.

    `surface_height` [m]: where the heights of the ground are unknown. The traction is that of the law on the tool's own
    facets, without memory and without learned corrections.
    """
    tool = model.tool
    vertices, faces, facet = drawn_mesh(tool)
    moments = max(_MAX_NUMBER_COUNT // (vertices.size + len(faces)), _MIN_MOMENT_COUNT)
    moments = min(len(motion.states), _MAX_MOMENT_COUNT, moments)
    greatest = np.linalg.norm(motion.forces, axis=1).argmax()
    rows = np.linspace(0, len(motion.states) - 1, moments).round().astype(int)
    first = int(np.abs(rows - greatest).argmin())
    rows[first] = greatest
    states = motion.states[rows]
    support = Support(tool.corners)
    traction = []
    positions = []
    for state in states:
        surface = support.local_surface(motion.ground, state, default_height=surface_height)
        facet_forces = plate_forces(
            tool.facets, model.law, state, surface_height=surface.height, slope=surface.slope
        )
        traction.append((np.linalg.norm(facet_forces, axis=1) / tool.facets.areas)[facet])
        positions.append(vertices @ rotation_matrix(state[QUATERNION]).T + state[POSITION])
    grid = None
    if motion.ground is not None:  # around the tool's path
        border = 3.0 * tool.plates.reach
        places = states[:, POSITION][:, :2]
        x, y = np.linspace(places.min(axis=0) - border, places.max(axis=0) + border, 100).T
        heights = motion.ground.heights_at(*np.meshgrid(x, y, indexing="ij"))
        grid = (1e3 * x, 1e3 * y, 1e3 * heights)
    return Animation(
        title=title,
        labels=tuple(f"t = {time:.2f} s" for time in motion.times[rows]),
        positions=1e3 * np.array(positions),
        faces=faces,
        traction=1e-3 * np.array(traction),
        forces=motion.forces[rows],
        surface_height=1e3 * surface_height,
        ground=grid,
        first=first,
    )


def tool_figure(
    title: str,
    model: Model,
    motion: DrawnMotion,
    *,
    surface_height: float,
    learned: bool,
    where: str = "",
) -> Figure:
    """The section of a page with the animation of a tool.

    `surface_height` [m]: where the heights of the ground are unknown. `learned`: whether the mode of learning is apply.
    `where`: further sentences on what is shown.
    """
    animation = animate(title, model, motion, surface_height=surface_height)
    sentence = f"{_what_is_shown(model.law, learned=learned)} {where}".rstrip()
    return Figure("tool", title, sentence, animation_figure(animation))


def _what_is_shown(law: Law, *, learned: bool) -> str:
    """Sentences that say what the line and the colours of an animation show. `learned`: the mode of learning is apply.

    The line is the whole predicted force. The colours are the law's traction without memory and learned corrections.
    """
    parts = {"memory": law.has_memory, "learned corrections": learned}
    effects = " and ".join(name for name, present in parts.items() if present)
    force = "The line from the tool's middle shows the predicted force on the tool, and |F| is its magnitude"
    colours = "The colours show the law's traction on the facets"
    if effects:
        return f"{force}, both with {effects}. {colours}, without {effects}."
    return f"{force}. {colours}."


def animation_figure(animation: Animation) -> Any:
    """A plotly Figure with a slider over the moments, and play and pause buttons.

    A frame has only what moves: plotly takes the rest from the figure's own tool and line.
    """
    import plotly.graph_objects as go

    low, high = _limits(animation)
    sizes = np.linalg.norm(animation.forces, axis=1)
    starts = animation.positions.mean(axis=1)
    ends = starts + 0.4 * (high - low).max() / (sizes.max() or 1.0) * animation.forces
    frames = []
    for n, (label, size) in enumerate(zip(animation.labels, sizes, strict=True)):
        with np.errstate(over="ignore"):  # poses may lie anywhere
            vertices = animation.positions[n].astype(np.float32)
        intensity = animation.traction[n].astype(np.float32)
        tool = {"type": "mesh3d", **_points(vertices), "intensity": intensity}
        line = {"type": "scatter3d", **_points([starts[n], ends[n]])}
        title = {"text": f"{animation.title}   {label}   |F| = {size:.2f} N"}
        frames.append(
            {"data": [tool, line], "traces": [0, 1], "name": str(n), "layout": {"title": title}}
        )
    first_frame: Any = frames[animation.first]
    i, j, k = animation.faces.astype(np.int32).T
    tool = go.Mesh3d(
        first_frame["data"][0],
        i=i,
        j=j,
        k=k,
        name="tool",
        flatshading=True,
        lighting={"ambient": 0.75, "diffuse": 0.4},
        colorscale=TRACTION,
        cmin=0.0,
        cmax=animation.traction.max() or 1.0,
        intensitymode="cell",
        colorbar={"title": {"text": "Traction [kPa]"}, "len": 0.6},
    )
    force = go.Scatter3d(
        first_frame["data"][1],
        name="force on the tool",
        mode="lines",
        line={"color": _FORCE, "width": 8},
    )
    path = go.Scatter3d(
        _points(starts), name="path", mode="lines", line={"color": _PATH, "width": 3}
    )
    level = np.full((2, 2), animation.surface_height)
    x, y, heights = animation.ground or (*np.array([low, high]).T[:2], level)
    ground = go.Surface(
        x=x,
        y=y,
        z=heights.T,
        name="surface",
        colorscale=[[0, _SURFACE], [1, _SURFACE]],
        showscale=False,
        opacity=0.35,
        hoverinfo="skip",
    )
    return go.Figure(data=[tool, force, path, ground], frames=frames).update_layout(
        template="plotly_white",
        title=first_frame["layout"]["title"],
        font={"family": "system-ui, sans-serif", "size": 13},
        scene=_scene(low, high, force_points_up=animation.forces[animation.first, 2] > 0.0),
        legend={"orientation": "h", "x": 0.03, "y": 1.0, "yanchor": "top"},
        margin={"l": 0, "r": 0, "t": 50, "b": 100},
        height=760,
        **_controls(animation),
    )


def _limits(animation: Animation) -> tuple[Array, Array]:
    """The lowest and the highest point of the scene, with a margin, so that a deep scene is no narrow column."""
    low = animation.positions.min(axis=(0, 1))
    high = animation.positions.max(axis=(0, 1))
    low[2] = min(low[2], animation.surface_height)
    high[2] = max(high[2], animation.surface_height)
    margin = (high - low).max() * np.array([0.2, 0.2, 0.06])
    return low - margin, high + margin


def _points(points: Any) -> dict[str, Array]:
    return dict(zip("xyz", np.array(points).T, strict=True))


def _scene(low: Array, high: Array, *, force_points_up: bool) -> dict[str, Any]:
    """The axes, their proportions and the camera of a scene between two points."""
    size = high - low
    axes = {
        f"{a}axis": {"title": {"text": f"{a} [mm]"}, "range": [low[n], high[n]]}
        for n, a in enumerate("xyz")
    }
    return {
        **axes,
        "aspectmode": "manual",  # with "data", a wide scene is larger than the page
        "aspectratio": dict(zip("xyz", (_ZOOM_FACTOR * size / size.max()).tolist(), strict=True)),
        # view from the side of the loaded faces: the force points from them into the tool
        "camera": {"eye": {"x": 1.15, "y": -1.35, "z": -0.75 if force_points_up else 0.5}},
    }


def _controls(animation: Animation) -> dict[str, Any]:
    """The slider over the moments, and the buttons."""
    each = {
        "frame": {"duration": _PERIOD_MS, "redraw": True},
        "fromcurrent": True,
        "mode": "immediate",
    }
    at_once = {"mode": "immediate"}

    def button(label: str, *arguments: object) -> dict[str, object]:
        return {"label": label, "method": "animate", "args": arguments}

    steps = [button(label, [str(n)], at_once) for n, label in enumerate(animation.labels)]
    menu = {"type": "buttons", "direction": "left", "x": 0.0, "y": -0.02, "yanchor": "top"}
    return {
        "updatemenus": [
            {**menu, "buttons": [button("Play", None, each), button("Pause", [None], at_once)]}
        ],
        "sliders": [{"x": 0.14, "len": 0.84, "active": animation.first, "steps": steps}],
    }

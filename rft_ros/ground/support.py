"""Fits the plane of the ground that resists a tool.

A tool that moves sideways shears a wedge of grains ahead of it, about twice as long as the tool is deep. The resistance
depends on the mean height of that wedge, so a plane is fitted to the ground over a disc. The radius of the disc is the
tool's depth, but at least half of its width. In horizontal motion the disc lies ahead of the tool by its radius or by
twice the depth, whichever is less; in vertical motion it lies under the tool (docs/ground.md).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.ground.height_map import HeightMap
from rft_ros.rft import LEVEL, STATE
from rft_ros.rft.frames import attitude, from_frame, parts_of_state
from rft_ros.rft.kernel.compilation import compiled, inlined

Array = NDArray[np.float64]

LAST_SURFACE = np.dtype(
    [
        # 0 or 1; a Boolean would leave padding bytes, which a copy does not set
        ("known", np.int64),
        ("position", float, 3),  # of the body, where the surface was found
        ("quaternion", float, 4),
        ("default_height", float),
        ("height", float),  # these three as in `LocalSurface`
        ("slope", float, 2),
        ("roughness", float),
    ]
)
"""The last surface of one body; zeros: none is known."""

_MIN_RADIUS_CELLS = 2.0  # so that a slope can be fitted
_WEDGE_RATIO = (
    2.0  # over the tool's depth: length of the wedge, and how far the disc lies ahead at most
)
_ROUND_COUNT = 4  # radius and depth depend on each other; the fourth round changes the height by less than 1 %
_DIRECTION_COUNT = 96  # in which the outermost corners of a tool are kept
_MIN_MOTION_M = 1e-4  # a body that has moved less keeps its surface


class LocalSurface(NamedTuple):
    """The plane of the ground at a tool: world z = height + slope · (x, y). Without a map it is level.

    `height` at x = y = 0 [m]; `slope`: dz/dx, dz/dy; `roughness`: RMS distance of the ground from the plane [m];
    `depth`: of the tool's deepest point below it [m], negative above; NaN without a map.
    """

    height: float
    slope: tuple[float, float] = LEVEL
    roughness: float = 0.0
    depth: float = math.nan


def _spiral(n: int) -> tuple[Array, Array, Array]:
    """Points that are spread evenly over a disc or sphere: the share of the area within each, 0 to 1; cosine; sine."""
    k = np.arange(n)
    angle = k * (np.pi * (3.0 - np.sqrt(5.0)))
    return (k + 0.5) / n, np.cos(angle), np.sin(angle)


_AREA, _COS, _SIN = _spiral(37)
_DISC = np.column_stack([np.sqrt(_AREA) * _COS, np.sqrt(_AREA) * _SIN])
"""Places at which a plane is fitted, in a disc of radius 1."""


class _Grid(NamedTuple):
    """What the compiled fit takes of a map: heights [m], the first cell's corner [cells], the side of a cell [m].

    `default_height`: height where nothing is known [m].
    """

    heights: NDArray[np.float32]
    i0: float
    j0: float
    cell: float
    default_height: float


@inlined
def _known(heights, u, v):
    """Bilinear interpolation of the known cells around a place: the height, and the weight of these cells, 0 to 1.

    `u`, `v`: the place, in cells from the centre of the first one.
    """
    n, m = heights.shape
    if not (-1.0 < u < n and -1.0 < v < m):
        return 0.0, 0.0
    i = int(np.floor(u))
    j = int(np.floor(v))
    total = 0.0
    weight = 0.0
    for a in range(max(i, 0), min(i + 2, n)):
        for b in range(max(j, 0), min(j + 2, m)):
            height = heights[a, b]
            if not np.isnan(height):
                w = (1.0 - abs(u - a)) * (1.0 - abs(v - b))
                total += w * height
                weight += w
    return (total / weight if weight > 0.0 else 0.0), weight


@inlined
def _fit(grid, x, y, radius):
    """Fit a plane to the known cells of a disc by least squares: height at its centre, slopes, RMS distance.

    If no cell is known, the plane at `default_height`.
    """
    whole = u_sum = v_sum = h_sum = 0.0
    uu = uv = vv = uh = vh = hh = 0.0
    heights = grid.heights
    for k in range(len(_DISC)):
        u = _DISC[k, 0]
        v = _DISC[k, 1]
        i = (x + radius * u) / grid.cell - 0.5 - grid.i0
        j = (y + radius * v) / grid.cell - 0.5 - grid.j0
        height, weight = _known(heights, i, j)
        h = height - grid.default_height
        whole += weight
        u_sum += weight * u
        v_sum += weight * v
        h_sum += weight * h
        uu += weight * u * u
        uv += weight * u * v
        vv += weight * v * v
        uh += weight * u * h
        vh += weight * v * h
        hh += weight * h * h
    if not whole > 1e-9:
        return grid.default_height, 0.0, 0.0, 0.0
    mean_u = u_sum / whole
    mean_v = v_sum / whole
    mean_h = h_sum / whole
    uu -= mean_u * u_sum
    uv -= mean_u * v_sum
    vv -= mean_v * v_sum
    uh -= mean_u * h_sum
    vh -= mean_v * h_sum
    hh -= mean_h * h_sum
    determinant = uu * vv - uv * uv
    slope_u = 0.0
    slope_v = 0.0
    # it is 0.06 of the square of `whole` for a disc that is known everywhere
    if determinant > 0.01 * whole * whole:
        slope_u = (vv * uh - uv * vh) / determinant
        slope_v = (uu * vh - uv * uh) / determinant
    rest = max(hh - slope_u * uh - slope_v * vh, 0.0) / whole
    centre = grid.default_height + mean_h - slope_u * mean_u - slope_v * mean_v
    return centre, slope_u / radius, slope_v / radius, np.sqrt(rest)


@inlined
def _placed(corners, quaternion):
    """The corners from the tool frame's origin, in world axes."""
    axes = attitude(quaternion)
    world_corners = np.empty_like(corners)
    for k in range(len(corners)):
        # number by number: for an assignment of arrays numba also compiles an error message, which takes 2 s
        x, y, z = from_frame(axes, corners[k, 0], corners[k, 1], corners[k, 2])
        world_corners[k, 0] = x
        world_corners[k, 1] = y
        world_corners[k, 2] = z
    return world_corners


@inlined
def _way(last, position, quaternion, reach):
    """An upper bound on how far any point of the body is from its place at the last surface [m]."""
    square = 0.0
    for k in range(3):
        square += (position[k] - last.position[k]) ** 2
    cosine = 0.0
    for k in range(4):
        cosine += quaternion[k] * last.quaternion[k]
    return np.sqrt(square) + reach * np.sqrt(8.0 * max(1.0 - abs(cosine), 0.0))


@inlined
def _submerged_region(world_corners, height, slope_x, slope_y, bottom):
    """The part of a tool in the grains: mean place by depth, from the tool frame's origin; depth; radius [m].

    The surface is at `height` there, but over z = `bottom` everywhere.
    """
    whole = mx = my = mz = square = deepest = 0.0
    for k in range(len(world_corners)):
        x, y, z = world_corners[k, 0], world_corners[k, 1], world_corners[k, 2]
        surface = max(height + slope_x * x + slope_y * y, bottom)
        depth = max(surface - z, 0.0)
        deepest = max(deepest, depth)
        whole += depth
        mx += depth * x
        my += depth * y
        mz += depth * z
        square += depth * (x * x + y * y)
    mx /= whole
    my /= whole
    mz /= whole
    # half of the squared radius of an even disc
    spread = max(square / whole - mx * mx - my * my, 0.0)
    return mx, my, mz, deepest, np.sqrt(2.0 * spread)


@inlined
def _horizontal_direction(velocity, spin, x, y, z):
    """The horizontal part of the direction in which a place of the body moves; 0 at rest.

    Shorter where travel and spin cancel: under a wheel that rolls, whose place hardly moves, no wedge is sheared. The
    direction of the little slip there would jump, and the surface with it.
    """
    turn_x = spin[1] * z - spin[2] * y
    turn_y = spin[2] * x - spin[0] * z
    turn_z = spin[0] * y - spin[1] * x
    fastest = max(
        max(abs(velocity[0]), abs(velocity[1]), abs(velocity[2])),
        max(abs(turn_x), abs(turn_y), abs(turn_z)),
    )
    if not fastest > 1e-290:
        return 0.0, 0.0
    vx = (velocity[0] + turn_x) / fastest
    vy = (velocity[1] + turn_y) / fastest
    vz = (velocity[2] + turn_z) / fastest
    travel = _length(velocity[0] / fastest, velocity[1] / fastest, velocity[2] / fastest)
    rotation_size = _length(turn_x / fastest, turn_y / fastest, turn_z / fastest)
    size = max(_length(vx, vy, vz), travel, rotation_size)
    return vx / size, vy / size


@inlined
def _length(x, y, z):
    return np.sqrt(x * x + y * y + z * z)


@inlined
def _find_plane(grid, world_corners, state, last):
    """Fit the plane that resists a tool, and write it to the last surface. `world_corners`: its corners."""
    position, quaternion, velocity, spin = parts_of_state(state)
    px, py, pz = position[0], position[1], position[2]
    lowest = 0
    for k in range(len(world_corners)):
        if world_corners[k, 2] < world_corners[lowest, 2]:
            lowest = k
    x = world_corners[lowest, 0]
    y = world_corners[lowest, 1]
    least = _MIN_RADIUS_CELLS * grid.cell
    plane_height, slope_x, slope_y, roughness = _fit(grid, px + x, py + y, least)
    height = plane_height - slope_x * x - slope_y * y  # at the tool frame's origin
    # in the air the disc is placed by the lowest part of the tool
    bottom = world_corners[lowest, 2] + least
    for _ in range(_ROUND_COUNT):
        mx, my, mz, deepest, wide = _submerged_region(
            world_corners, height - pz, slope_x, slope_y, bottom
        )
        radius = max(wide, deepest, least)
        along_x, along_y = _horizontal_direction(velocity, spin, mx, my, mz)
        ahead = min(radius, max(_WEDGE_RATIO * deepest, least))
        x = px + mx + ahead * along_x
        y = py + my + ahead * along_y
        plane_height, slope_x, slope_y, roughness = _fit(grid, x, y, radius)
        # fitted ahead of the tool, but its height at the tool's middle is used
        height = plane_height - slope_x * mx - slope_y * my
    last.known = 1
    last.default_height = grid.default_height
    for k in range(3):
        last.position[k] = position[k]
    for k in range(4):
        last.quaternion[k] = quaternion[k]
    last.height = height - slope_x * px - slope_y * py
    last.roughness = roughness
    last.slope[0] = slope_x
    last.slope[1] = slope_y


@compiled
def _local_plane(grid, corners, reach, state, lasts):
    """Update the last surface, one record of `LAST_SURFACE`, if the body has moved; returns the `LocalSurface`."""
    last = lasts[0]
    position, quaternion, _, _ = parts_of_state(state)
    world_corners = _placed(corners, quaternion)
    rests = (
        last.known == 1
        and last.default_height == grid.default_height
        and _way(last, position, quaternion, reach) <= _MIN_MOTION_M
    )
    if not rests:
        _find_plane(grid, world_corners, state, last)
    slope = last.slope[0], last.slope[1]
    deepest = -np.inf
    for k in range(len(world_corners)):
        x = position[0] + world_corners[k, 0]
        y = position[1] + world_corners[k, 1]
        surface = last.height + slope[0] * x + slope[1] * y
        deepest = max(deepest, surface - position[2] - world_corners[k, 2])
    return LocalSurface(last.height, slope, last.roughness, deepest)


class Support:
    """Finds the surface at one tool. `corners`: of its convex hull, in the tool frame [m], shape [k, 3]."""

    def __init__(self, corners: Array) -> None:
        # Only the outermost corners in many directions are kept, since a fine hull has thousands.
        area, x, y = _spiral(_DIRECTION_COUNT)
        z = 1.0 - 2.0 * area
        flat = np.sqrt(1.0 - z * z)
        directions = np.column_stack([flat * x, flat * y, z])
        self._corners = np.ascontiguousarray(
            corners[np.unique((directions @ corners.T).argmax(axis=1))]
        )
        self._reach = float(np.linalg.norm(self._corners, axis=1).max())

    def local_surface(
        self,
        ground: HeightMap | None,
        state: Array,
        *,
        default_height: float,
        last: NDArray[np.void] | None = None,
    ) -> LocalSurface:
        """The surface at a state, shape [13], columns `rft_ros.rft.STATE`; `default_height` [m] without a map.

        Where all cells of the map are unknown it is exactly (default_height, 0, 0). `last`: the last surface of one
        body on one map, shape [1] of `LAST_SURFACE`, which is updated. It is used again until the body has moved by
        0.1 mm: at rest the direction of the velocity is noise, and the disc would jump about.
        """
        if ground is None:
            return LocalSurface(default_height)
        if last is None:
            last = np.zeros(1, LAST_SURFACE)
        i0, j0 = map(float, ground.corner)  # numba compiles once more for each type of argument
        grid = _Grid(ground.heights, i0, j0, ground.cell, default_height)
        surface: LocalSurface = _local_plane(grid, self._corners, self._reach, state, last)
        # a pose so far away that its squares overflow
        if not math.isfinite(surface.height + sum(surface.slope) + surface.roughness):
            return LocalSurface(
                default_height, depth=default_height - float(state[STATE.index("pz")])
            )
        return surface


class Footing:
    """The surface at one tool from pose to pose. `corners`: of its convex hull, in the tool frame [m], shape [k, 3]."""

    def __init__(self, corners: Array) -> None:
        self._support = Support(corners)
        self._last = np.zeros(1, LAST_SURFACE)
        self._ground: HeightMap | None = None

    def surface(self, ground: HeightMap, state: Array, *, default_height: float) -> LocalSurface:
        """The surface at the next state; arguments as for `Support.local_surface`."""
        if ground is not self._ground:
            self._ground = ground
            self._last[:] = 0
        return self._support.local_surface(
            ground, state, default_height=default_height, last=self._last
        )

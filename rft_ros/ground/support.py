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

__all__ = ["LAST_SURFACE", "Footing", "LocalSurface", "Support"]

Array = NDArray[np.float64]

LAST_SURFACE = np.dtype(
    [
        ("known", np.int64),  # 0 or 1; a Boolean would leave padding bytes, which a copy does not set
        ("position", float, 3),  # of the body, where the surface was found
        ("quaternion", float, 4),
        ("level", float),
        ("height", float),  # these three as in `LocalSurface`
        ("slope", float, 2),
        ("roughness", float),
    ]
)
"""The last surface of one body; zeros: none is known."""

_LEAST_RADIUS = 2.0  # cells, so that a slope can be fitted
_WEDGE = 2.0  # over the tool's depth: length of the wedge, and how far the disc lies ahead at most
_ROUNDS = 4  # radius and depth depend on each other; the fourth round changes the height by less than 1 %
_DIRECTIONS = 96  # in which the outermost corners of a tool are kept
_MOVED = 1e-4  # m; a body that has moved less keeps its surface


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


@inlined
def _known(heights, i0, j0, cell, x, y):
    """Bilinear interpolation of the known cells around a place: the height, and the weight of these cells, 0 to 1."""
    u, v = x / cell - 0.5 - i0, y / cell - 0.5 - j0
    n, m = heights.shape
    if not (-1.0 < u < n and -1.0 < v < m):
        return 0.0, 0.0
    i, j = int(np.floor(u)), int(np.floor(v))
    total = weight = 0.0
    for a in range(max(i, 0), min(i + 2, n)):
        for b in range(max(j, 0), min(j + 2, m)):
            if not np.isnan(heights[a, b]):
                w = (1.0 - abs(u - a)) * (1.0 - abs(v - b))
                total += w * heights[a, b]
                weight += w
    return (total / weight if weight > 0.0 else 0.0), weight


@inlined
def _fit(heights, i0, j0, cell, level, disc, x, y, radius):
    """Fit a plane to the known cells of a disc by least squares: height at its centre, slopes, RMS distance.

    If no cell is known, the plane at `level`.
    """
    s = su = sv = suu = suv = svv = sh = suh = svh = shh = 0.0
    for k in range(disc.shape[0]):
        u, v = disc[k, 0], disc[k, 1]
        h, w = _known(heights, i0, j0, cell, x + radius * u, y + radius * v)
        h -= level
        s, su, sv, sh = s + w, su + w * u, sv + w * v, sh + w * h
        suu, suv, svv = suu + w * u * u, suv + w * u * v, svv + w * v * v
        suh, svh, shh = suh + w * u * h, svh + w * v * h, shh + w * h * h
    if not s > 1e-9:
        return level, 0.0, 0.0, 0.0
    uu, uv, vv = suu - su * su / s, suv - su * sv / s, svv - sv * sv / s
    uh, vh, hh = suh - su * sh / s, svh - sv * sh / s, shh - sh * sh / s
    det = uu * vv - uv * uv
    gu = gv = 0.0
    if det > 0.01 * s * s:  # 0.06 s² for a disc that is known everywhere
        gu, gv = (vv * uh - uv * vh) / det, (uu * vh - uv * uh) / det
    rest = max(hh - gu * uh - gv * vh, 0.0) / s
    return level + (sh - gu * su - gv * sv) / s, gu / radius, gv / radius, np.sqrt(rest)


@compiled
def _local_plane(heights, i0, j0, cell, level, disc, corners, reach, state, lasts):
    """Update the last surface if the body has moved; returns the depth of the body's deepest point below it.

    `lasts`: one record of `LAST_SURFACE`.
    """
    last = lasts[0]
    position, quaternion, velocity, angular_velocity = parts_of_state(state)
    px, py, pz = position[0], position[1], position[2]
    ux, uy, uz = velocity[0], velocity[1], velocity[2]
    wx, wy, wz = angular_velocity[0], angular_velocity[1], angular_velocity[2]
    axes = attitude(quaternion)
    placed, lowest = np.empty_like(corners), 0  # the corners in world axes
    for k in range(corners.shape[0]):
        # number by number: for an assignment of arrays numba also compiles an error message, which takes 2 s
        placed[k, 0], placed[k, 1], placed[k, 2] = from_frame(axes, corners[k, 0], corners[k, 1], corners[k, 2])
        lowest = k if placed[k, 2] < placed[lowest, 2] else lowest
    x, y, z = px - last.position[0], py - last.position[1], pz - last.position[2]
    product = 0.0
    for k in range(4):
        product += quaternion[k] * last.quaternion[k]
    cosine = abs(product)
    moved = np.sqrt(x * x + y * y + z * z) + reach * np.sqrt(8.0 * max(1.0 - cosine, 0.0))  # most of any point [m]
    if not (last.known == 1 and moved <= _MOVED and last.level == level):
        x, y = placed[lowest, 0], placed[lowest, 1]  # relative to the tool frame's origin
        least = _LEAST_RADIUS * cell
        h, sx, sy, rough = _fit(heights, i0, j0, cell, level, disc, px + x, py + y, least)
        h -= sx * x + sy * y
        bottom = placed[lowest, 2] + least  # in the air the disc is placed by the lowest part of the tool
        for _ in range(_ROUNDS):
            total = mx = my = mz = square = deepest = 0.0
            for k in range(corners.shape[0]):
                x, y, z = placed[k, 0], placed[k, 1], placed[k, 2]
                depth = max(max(h + sx * x + sy * y - pz, bottom) - z, 0.0)
                deepest = max(deepest, depth)
                total, square = total + depth, square + depth * (x * x + y * y)
                mx, my, mz = mx + depth * x, my + depth * y, mz + depth * z
            mx, my, mz = mx / total, my / total, mz / total
            spread = max(square / total - mx * mx - my * my, 0.0)  # half of the squared radius of an even disc
            radius = max(np.sqrt(2.0 * spread), deepest, least)
            vx, vy, vz = ux + wy * mz - wz * my, uy + wz * mx - wx * mz, uz + wx * my - wy * mx
            fastest = max(abs(vx), abs(vy), abs(vz))
            ahead = 0.0
            if fastest > 1e-290:
                vx, vy, vz = vx / fastest, vy / fastest, vz / fastest
                ahead = min(radius, max(_WEDGE * deepest, least)) / np.sqrt(vx * vx + vy * vy + vz * vz)
            x, y = px + mx + ahead * vx, py + my + ahead * vy
            h, sx, sy, rough = _fit(heights, i0, j0, cell, level, disc, x, y, radius)
            h -= sx * mx + sy * my  # fitted ahead of the tool, but its height at the tool's middle is used
        last.known, last.level = 1, level
        for k in range(3):
            last.position[k] = position[k]
        for k in range(4):
            last.quaternion[k] = quaternion[k]
        last.height, last.roughness = h - sx * px - sy * py, rough
        last.slope[0], last.slope[1] = sx, sy
    deepest, height, sx, sy = -1e300, last.height, last.slope[0], last.slope[1]
    for k in range(corners.shape[0]):
        x, y = px + placed[k, 0], py + placed[k, 1]
        deepest = max(deepest, height + sx * x + sy * y - pz - placed[k, 2])
    return deepest


class Support:
    """Finds the surface at one tool. `corners`: of its convex hull, in the tool frame [m], shape [k, 3]."""

    def __init__(self, corners: Array) -> None:
        # Only the outermost corners in many directions are kept, since a fine hull has thousands.
        area, x, y = _spiral(_DIRECTIONS)
        z = 1.0 - 2.0 * area
        flat = np.sqrt(1.0 - z * z)
        directions = np.column_stack([flat * x, flat * y, z])
        self._corners = np.ascontiguousarray(corners[np.unique((directions @ corners.T).argmax(axis=1))])
        self._reach = float(np.linalg.norm(self._corners, axis=1).max())

    def local_surface(
        self, ground: HeightMap | None, state: Array, *, level: float, last: NDArray[np.void] | None = None
    ) -> LocalSurface:
        """The surface at a state, shape [13], columns `rft_ros.rft.STATE`; `level` [m] without a map.

        Where all cells of the map are unknown it is exactly (level, 0, 0). `last`: the last surface of one body on one
        map, shape [1] of `LAST_SURFACE`, which is updated. It is used again until the body has moved by 0.1 mm: at rest
        the direction of the velocity is noise, and the disc would jump about.
        """
        if ground is None:
            return LocalSurface(level)
        if last is None:
            last = np.zeros(1, LAST_SURFACE)
        i0, j0 = map(float, ground.corner)  # numba compiles once more for each type of argument
        place = ground.heights, i0, j0, ground.cell, level, _DISC
        depth = _local_plane(*place, self._corners, self._reach, state, last)
        found = last[0]
        height, roughness = float(found["height"]), float(found["roughness"])
        sx, sy = found["slope"].tolist()
        if not math.isfinite(height + sx + sy + roughness):  # a pose so far away that its squares overflow
            return LocalSurface(level, depth=level - float(state[STATE.index("pz")]))
        return LocalSurface(height, (sx, sy), roughness, depth)


class Footing:
    """The surface at one tool from pose to pose. `corners`: of its convex hull, in the tool frame [m], shape [k, 3]."""

    def __init__(self, corners: Array) -> None:
        self._support = Support(corners)
        self._last = np.zeros(1, LAST_SURFACE)
        self._ground: HeightMap | None = None

    def surface(self, ground: HeightMap | None, state: Array, *, level: float) -> LocalSurface:
        """The surface at the next state; arguments as for `Support.local_surface`."""
        if ground is not self._ground:
            self._ground = ground
            self._last[:] = 0
        return self._support.local_surface(ground, state, level=level, last=self._last)

"""Which surface resists a tool: the plane that fits the ground over a disc ahead of it.

A tool that moves sideways shears a wedge of grains ahead of it, about twice as long as the tool is deep, so neither the
hole that the tool is in nor a single crest decides, but the mean height of that wedge. The disc's radius is the
tool's depth, at least half of its width; it lies ahead by its radius or twice the depth, the smaller, in horizontal
motion, under the tool in vertical motion, and between in between. docs/ground.md shows this against simulated grains.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.ground.height_map import HeightMap
from rft_ros.rft import LEVEL
from rft_ros.rft.compilation import compiled, inlined
from rft_ros.rft.frames import from_frame, rotation

__all__ = ["LocalSurface", "Support"]

Array = NDArray[np.float64]

_LEAST_RADIUS = 2.0  # cells, so that a slope can be fitted
_WEDGE = 2.0  # length of the wedge over depth: the disc of a tool that is wider than deep lies no further ahead
_ROUNDS = 4  # radius and depth depend on each other; the fourth round changes the height by less than 1 %
_DIRECTIONS = 96


class LocalSurface(NamedTuple):
    """A plane: world z = height + slope · (x, y).

    `height` at x = y = 0 [m]; `slope`: dz/dx, dz/dy; `roughness`: RMS distance of the ground from the plane [m];
    `depth`: of the tool's deepest point below it [m], negative above.
    """

    height: float
    slope: tuple[float, float]
    roughness: float
    depth: float


def _rings() -> Array:
    """Points of the unit disc of about equal area each, shape [37, 2]."""
    points = [(0.0, 0.0)]
    for ring in (1, 2, 3):
        angle = np.arange(6 * ring) * (np.pi / (3 * ring))
        radius = np.sqrt((3 * ring * ring + 0.25) / 37.0)  # area of the inner rings and half of this one
        points += [(radius * np.cos(a), radius * np.sin(a)) for a in angle]
    return np.array(points)


_DISC = _rings()


@inlined
def _known(heights, i0, j0, cell, x, y):  # type: ignore[no-untyped-def]
    """Bilinear height at a place from the known cells around it, and their weight, 0 to 1."""
    u, v = x / cell - 0.5 - i0, y / cell - 0.5 - j0
    n, m = heights.shape
    if not (-1.0 < u < n and -1.0 < v < m):
        return 0.0, 0.0
    i, j = int(np.floor(u)), int(np.floor(v))
    a, b = u - i, v - j
    total = weight = 0.0
    for di in range(2):
        for dj in range(2):
            if 0 <= i + di < n and 0 <= j + dj < m:
                h = heights[i + di, j + dj]
                w = (a if di else 1.0 - a) * (b if dj else 1.0 - b)
                if not np.isnan(h):
                    total += w * h
                    weight += w
    return (total / weight if weight > 0.0 else 0.0), weight


@inlined
def _fit(heights, i0, j0, cell, level, disc, x, y, radius):  # type: ignore[no-untyped-def]
    """Least squares of a plane over a disc: height at its centre, slopes, RMS distance.

    Unknown cells do not count; `level` where all are unknown.
    """
    s = su = sv = suu = suv = svv = sh = suh = svh = shh = 0.0
    for k in range(disc.shape[0]):
        u, v = disc[k, 0], disc[k, 1]
        h, w = _known(heights, i0, j0, cell, x + radius * u, y + radius * v)
        h -= level
        s += w
        su += w * u
        sv += w * v
        suu += w * u * u
        suv += w * u * v
        svv += w * v * v
        sh += w * h
        suh += w * u * h
        svh += w * v * h
        shh += w * h * h
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
def _local_plane(heights, i0, j0, cell, level, disc, corners, state, placed, out):  # type: ignore[no-untyped-def]
    """Write height at x = y = 0, slopes, roughness and depth to `out`; `placed`: work space for the corners."""
    axes = rotation(state[3], state[4], state[5], state[6])
    lowest = 0
    for k in range(corners.shape[0]):
        x, y, z = from_frame(axes, corners[k, 0], corners[k, 1], corners[k, 2])
        placed[k, 0], placed[k, 1], placed[k, 2] = x, y, z
        lowest = k if z < placed[lowest, 2] else lowest
    px, py, pz = state[0], state[1], state[2]
    x, y = placed[lowest, 0], placed[lowest, 1]  # relative to the tool frame's origin
    h, sx, sy, rough = _fit(heights, i0, j0, cell, level, disc, px + x, py + y, _LEAST_RADIUS * cell)
    h -= sx * x + sy * y
    bottom = placed[lowest, 2] + _LEAST_RADIUS * cell  # in the air the tool's lowest part decides where to look
    for _ in range(_ROUNDS):
        total = mx = my = mz = square = deepest = 0.0
        for k in range(corners.shape[0]):
            x, y, z = placed[k, 0], placed[k, 1], placed[k, 2]
            depth = max(h + sx * x + sy * y - pz, bottom) - z
            depth = max(depth, 0.0)
            total += depth
            mx += depth * x
            my += depth * y
            mz += depth * z
            square += depth * (x * x + y * y)
            deepest = max(deepest, depth)
        mx /= total
        my /= total
        mz /= total
        spread = max(square / total - mx * mx - my * my, 0.0)  # half of the squared radius of an even disc
        radius = max(np.sqrt(2.0 * spread), deepest, _LEAST_RADIUS * cell)
        vx, vy = state[7] + state[11] * mz - state[12] * my, state[8] + state[12] * mx - state[10] * mz
        vz = state[9] + state[10] * my - state[11] * mx
        fastest = max(abs(vx), abs(vy), abs(vz))
        ahead = 0.0
        if fastest > 1e-290:
            vx, vy, vz = vx / fastest, vy / fastest, vz / fastest
            ahead = min(radius, max(_WEDGE * deepest, _LEAST_RADIUS * cell)) / np.sqrt(vx * vx + vy * vy + vz * vz)
        x, y = px + mx + ahead * vx, py + my + ahead * vy
        h, sx, sy, rough = _fit(heights, i0, j0, cell, level, disc, x, y, radius)
        h -= sx * mx + sy * my  # what lies ahead of the tool's middle acts there
    deepest = -1e300
    for k in range(corners.shape[0]):
        deepest = max(deepest, h + sx * placed[k, 0] + sy * placed[k, 1] - pz - placed[k, 2])
    out[0], out[1], out[2], out[3], out[4] = h - sx * px - sy * py, sx, sy, rough, deepest


class Support:
    """Finds the local surface of one tool, `corners` of its convex hull in the tool frame [m], shape [k, 3]."""

    def __init__(self, corners: Array) -> None:
        # the points furthest out in many directions: a fine hull has thousands of corners
        turn = np.arange(_DIRECTIONS) * (np.pi * (3.0 - np.sqrt(5.0)))
        z = 1.0 - (2.0 * np.arange(_DIRECTIONS) + 1.0) / _DIRECTIONS
        flat = np.sqrt(1.0 - z * z)
        directions = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])
        self._corners = np.ascontiguousarray(corners[np.unique((directions @ corners.T).argmax(axis=1))])
        self._placed, self._out = np.empty_like(self._corners), np.zeros(5)

    def local_surface(self, ground: HeightMap, state: Array, *, level: float) -> LocalSurface:
        """The surface at a state, shape [13], columns `rft_ros.rft.STATE`; `level` [m] where the map knows nothing.

        Where the map knows nothing it is exactly (level, 0, 0).
        """
        i0, j0 = map(float, ground.corner)  # one machine code for all maps
        _local_plane(
            ground.heights, i0, j0, ground.cell, level, _DISC, self._corners, state, self._placed, self._out
        )  # fmt: skip
        h, sx, sy, rough, depth = self._out.tolist()
        if not math.isfinite(h + sx + sy + rough):  # a pose so far away that its squares overflow
            return LocalSurface(level, LEVEL, 0.0, level - float(state[2]))
        return LocalSurface(h, (sx, sy), rough, depth)

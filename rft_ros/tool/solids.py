"""Triangles of primitive solids, the convex hull of points, and which points a surface surrounds.

The grid of a primitive has cells of an eighth of its longest side: velocity and depth vary little over a triangle.
Triangles face outward and have shape [n, 3, 3]; lengths [m].
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import rotation_matrix

if TYPE_CHECKING:
    import trimesh

Array = NDArray[np.float64]

CELLS = 8
"""Cells along the longest side of a solid."""

_OBLIQUE = rotation_matrix(np.array([0.1, 0.3, 0.5, math.sqrt(0.65)]))


def box(half_sides: Sequence[float]) -> Array:
    """A box about the origin."""
    longest = max(half_sides)
    return _box([_line(half, longest) for half in half_sides])


def ellipsoid(half_axes: Sequence[float]) -> Array:
    """An ellipsoid about the origin."""
    line = _line(1.0, 1.0)
    return np.asarray(_rounded(_box([line, line, line])) * np.array(half_axes))


def cylinder(radius: float, half_length: float) -> Array:
    """A cylinder about the origin whose axis is z."""
    side = _line(radius, radius)
    triangles = _box([side, side, _line(half_length, max(radius, half_length))])
    triangles[..., :2] = _rounded(triangles[..., :2])
    return triangles


def capsule(radius: float, half_length: float) -> Array:
    """A cylinder of this half length about the origin, whose axis is z, with a half sphere at each end."""
    side = _line(radius, radius)
    lower = side[side < 0.0] - half_length
    middle = _line(half_length, radius + half_length)
    upper = side[side > 0.0] + half_length
    triangles = _box([side, side, np.concatenate([lower, middle, upper])])
    on_axis = triangles.clip(-half_length, half_length) * (0.0, 0.0, 1.0)
    return np.asarray(on_axis + _rounded(triangles - on_axis))


def _line(half: float, longest: float) -> Array:
    """Places from -half to half in an even number of cells; `longest` is half of the side that has `CELLS`."""
    pairs = math.ceil(0.5 * CELLS * half / longest - 1e-9)
    return np.linspace(-half, half, 2 * pairs + 1)


def _box(lines: Sequence[Array]) -> Array:
    """A box whose faces have grid lines at these x, y and z. The diagonals alternate.

    All in one direction, they would turn a body that moves straight.
    """
    faces = []
    for k in range(3):
        u, v = np.meshgrid(lines[k - 2], lines[k - 1], indexing="ij")
        for end in (0, -1):
            grid = np.empty((*u.shape, 3))
            grid[..., k] = lines[k][end]
            grid[..., k - 2] = u
            grid[..., k - 1] = v
            outward = _halves(grid)
            faces.append(outward if end else outward[:, ::-1])
    return np.concatenate(faces)


def _halves(grid: Array) -> Array:
    """Two triangles for each cell of a grid of points, shape [u, v, 3]."""
    u, v = np.indices(grid.shape[:2])[:, :-1, :-1]
    is_odd = ((u + v) % 2 == 1)[..., None]
    around = [grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]]
    a, b, c, d = (np.where(is_odd, around[(i + 1) % 4], around[i]) for i in range(4))
    first = np.stack([a, b, c], axis=-2)
    second = np.stack([a, c, d], axis=-2)
    return np.concatenate([first, second]).reshape(-1, 3, 3)


def _rounded(points: Array) -> Array:
    """Points on nested cubes, or squares, moved onto the spheres, or circles, within these."""
    wanted = np.abs(points).max(axis=-1, keepdims=True)
    size = np.linalg.norm(points, axis=-1, keepdims=True)
    return np.asarray(points * wanted / size.clip(1e-300))


def convex_hull(points: Array) -> "trimesh.Trimesh":
    """The convex hull of points, shape [n, 3]. Raises scipy's QhullError for points in a plane."""
    import trimesh
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    faces = hull.simplices.copy()
    mesh = trimesh.Trimesh(points, faces, process=False)
    outward = hull.equations[:, :3]
    is_inward = (mesh.triangles_cross * outward).sum(axis=1) < 0.0
    faces[is_inward] = faces[is_inward, ::-1]
    oriented = trimesh.Trimesh(points, faces, process=False)
    oriented.remove_unreferenced_vertices()
    return oriented


def are_inside(points: Array, triangles: Array) -> NDArray[np.bool_]:
    """Whether a closed surface surrounds each point, shape [n, 3]: whether its winding number is over 0.

    Where a ray from the point leaves the surface, the number rises by 1, and where it enters, it falls by 1. So it is 0
    in a cavity. The ray is oblique: it meets no edge of a grid.
    """
    corners = triangles @ _OBLIQUE
    low = np.ascontiguousarray(corners.min(axis=1).T)
    high = np.ascontiguousarray(corners.max(axis=1).T)
    return np.array(
        [_winding_number(point, corners, low, high) > 0 for point in points @ _OBLIQUE]
    )


def _winding_number(point: Array, triangles: Array, low: Array, high: Array) -> int:
    """`low`, `high`: bounds of the triangles, shape [3, n]. The ray goes along +z."""
    x, y, z = point
    is_near = (low[0] <= x) & (x <= high[0])
    is_near &= (low[1] <= y) & (y <= high[1])
    is_near &= high[2] > z
    heights, turns = crossings(triangles[is_near] - point)
    return int(turns[heights > 0.0].sum())


def crossings(triangles: Array) -> tuple[Array, Array]:
    """Where the z axis crosses triangles: its heights, and 1 where it leaves their surface or -1 where it enters."""
    a, b, c = triangles.transpose(1, 0, 2)
    weights = np.stack([_doubled_area(b, c), _doubled_area(c, a), _doubled_area(a, b)])
    turns = np.sign(weights).sum(axis=0) / 3.0
    is_met = np.abs(turns) == 1.0
    met = weights[:, is_met]
    heights = (met * triangles[is_met, :, 2].T).sum(axis=0) / met.sum(axis=0)
    return heights, turns[is_met]


def _doubled_area(p: Array, q: Array) -> Array:
    """Twice the area of triangles of the origin and two points, seen from above."""
    return np.asarray(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])

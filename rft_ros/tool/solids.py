"""Triangles of primitive solids, the convex hull of points, and which points a surface surrounds.

A primitive's edges have an eighth of its longest side, or less: velocity and depth vary little over a triangle.
Triangles face outward and have shape [n, 3, 3]; lengths [m].
"""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import rotation_matrix

if TYPE_CHECKING:
    import trimesh

Array = NDArray[np.float64]

EDGE_COUNT = 8
"""Edges along the longest side of a solid."""

_OBLIQUE = rotation_matrix(np.array([0.1, 0.3, 0.5, math.sqrt(0.65)]))


def box(half_sides: Sequence[float]) -> Array:
    """A box about the origin."""
    from trimesh.creation import box as box_of

    mesh = box_of(2.0 * np.array(half_sides))
    for _ in range(3):  # which makes `EDGE_COUNT` edges of each
        mesh = mesh.subdivide()
    return np.asarray(mesh.triangles)


def ellipsoid(half_axes: Sequence[float]) -> Array:
    """An ellipsoid about the origin."""
    from trimesh.creation import icosphere

    return np.asarray(icosphere(subdivisions=3).triangles * half_axes)


def cylinder(radius: float, half_length: float) -> Array:
    """A cylinder about the origin whose axis is z."""
    return _turned(
        np.linspace(0.0, radius, EDGE_COUNT // 2 + 1), np.zeros(EDGE_COUNT // 2 + 1), half_length
    )


def capsule(radius: float, half_length: float) -> Array:
    """A cylinder of this half length about the origin, whose axis is z, with a half sphere at each end."""
    angle = np.linspace(0.0, 0.5 * np.pi, EDGE_COUNT // 2 + 1)
    return _turned(radius * np.sin(angle), radius * np.cos(angle), half_length)


def _turned(radii: Array, heights: Array, half_length: float) -> Array:
    """A cylinder about the z axis with a cap at each end: its radii from 0 outwards, and heights above the end."""
    from trimesh.creation import revolve

    side = np.linspace(-half_length, half_length, EDGE_COUNT + 1)[1:-1]
    axial = np.concatenate([-half_length - heights, side, half_length + heights[::-1]])
    radial = np.concatenate([radii, np.full(len(side), radii[-1]), radii[::-1]])
    return np.asarray(revolve(np.column_stack([radial, axial]), sections=4 * EDGE_COUNT).triangles)


def convex_hull(points: Array) -> "trimesh.Trimesh":
    """The convex hull of points, shape [n, 3]. Raises scipy's QhullError for points in a plane."""
    import trimesh
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    mesh = trimesh.Trimesh(points, hull.simplices, process=False)
    is_inward = (mesh.triangles_cross * hull.equations[:, :3]).sum(axis=1) < 0.0
    mesh.faces[is_inward] = mesh.faces[is_inward, ::-1]
    mesh.remove_unreferenced_vertices()
    return mesh


def are_inside(points: Array, triangles: Array) -> NDArray[np.bool_]:
    """Whether a closed surface surrounds each point, shape [n, 3]: whether its winding number is over 0.

    Where a ray from the point leaves the surface, the number rises by 1, and where it enters, it falls by 1. So it is 0
    in a cavity. The ray is oblique: it meets no edge of a grid.
    """
    lines = crossings(points @ _OBLIQUE, triangles @ _OBLIQUE)
    return np.array([turns[heights > 0.0].sum() for heights, turns in lines]) > 0.0


def crossings(points: Array, triangles: Array) -> Iterator[tuple[Array, Array]]:
    """For each point, shape [n, 3], where the line through it along z crosses triangles.

    Heights above the point, and 1 where it leaves their surface upwards or -1 where it enters.
    """
    low_x, low_y, _ = triangles.min(axis=1).T.copy()
    high_x, high_y, _ = triangles.max(axis=1).T.copy()
    for point in points:
        x, y, _ = point
        is_near = (low_x <= x) & (x <= high_x)
        is_near &= (low_y <= y) & (y <= high_y)
        yield _crossings_of_axis(triangles[is_near] - point)


def _crossings_of_axis(triangles: Array) -> tuple[Array, Array]:
    next_corners = np.roll(triangles, -1, axis=1)
    opposite = np.roll(triangles, -2, axis=1)
    # twice the areas of the axis and each edge, seen from above
    weights = np.cross(next_corners, opposite)[..., 2]
    turns = np.sign(weights).sum(axis=1) / 3.0
    is_met = np.abs(turns) == 1.0
    crossing_weights = weights[is_met]
    heights = (crossing_weights * triangles[is_met, :, 2]).sum(axis=1) / crossing_weights.sum(
        axis=1
    )
    return heights, turns[is_met]

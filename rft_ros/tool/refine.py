"""Triangles for the refined rule, with the area of the curved surface that the facets of the mesh are inscribed in.

The curvature of a facet's patch comes from the normals at its corners, which are averaged by area and angle over the
facets that join smoothly: a large flat face beside a narrow fillet stays flat. The tip of a cone does not move: its
facets join smoothly, but the surface has no normal there.
"""

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import Plates

__all__ = ["FLAT_HALF_ANGLE", "refined_plates", "welded"]

FLAT_HALF_ANGLE = np.deg2rad(1.0)
"""Half angle [rad] over which a flat facet begins to lead: the smallest of any facet."""

_CREASE = np.deg2rad(50.0)  # facets at a larger angle meet at an edge of the tool, not within a curved surface
_SPAN = 0.85  # half angle of a curved facet over the mean angle between its normal and those at its corners
_TIP, _POINTED = 0.7, np.sin(np.deg2rad(10.0))
"""Limits that distinguish a tip from a curved surface, by the tilt of the normal at a point against the facets there.

On a curved surface the normals at a facet's other corners tilt the opposite way and balance it. A point is a tip if
more than `_TIP` of the squared tilt is left over, and if the sine of the tilt exceeds `_POINTED`.
"""

_STEEPEST = 0.1  # divisions take a smaller cosine between a facet's normal and those at its corners as this

_ROUNDING = 1e-9  # of the greatest growth of area by a corner's shift: a smaller one is zero

_WELD = 1e-6  # of the tool's size: closer corners become one

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def refined_plates(vertices: Array, faces: Indices) -> Plates:
    """Plates of a mesh in the tool frame [m] for the refined rule, one per face, in the same order.

    `vertices`: shape [n, 3]; `faces`: indices of vertices, shape [m, 3].
    """
    points, corners = welded(vertices, faces)
    normals, group, tips = _corner_normals(points, corners)
    facet = _unit(_doubled_areas(points[corners]))
    angles = np.arccos(np.clip(np.einsum("fck,fk->fc", normals, facet), -1.0, 1.0))
    half_angles = np.clip(_SPAN * angles.mean(axis=1), FLAT_HALF_ANGLE, 0.5 * np.pi)
    triangles = _with_area_of_surface(points, corners, normals, group, tips)
    lost = ~(np.linalg.norm(_doubled_areas(triangles), axis=1) > 0.0)  # smaller than the welding distance
    triangles[lost] = vertices[faces[lost]]
    return Plates.from_triangles(triangles, half_angles)


def welded(vertices: Array, faces: Indices) -> tuple[Array, Indices]:
    """Merge coincident vertices, which STL files repeat for each facet: points, shape [k, 3], faces, shape [m, 3]."""
    size = float(np.ptp(vertices[faces.ravel()], axis=0).max())
    with np.errstate(invalid="ignore"):  # a vertex that no face uses may lie anywhere
        place = np.round(vertices / (_WELD * size)).astype(np.int64)
    _, first, point = np.unique(place, axis=0, return_index=True, return_inverse=True)
    return vertices[first], point.reshape(-1)[faces]


def _doubled_areas(triangles: Array) -> Array:
    return np.asarray(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]))


def _unit(vectors: Array) -> Array:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0))


def _corner_normals(points: Array, faces: Indices) -> tuple[Array, Indices, NDArray[np.bool_]]:
    """The surface's unit normal at each corner of each facet, shape [m, 3, 3], and two arrays of shape [m, 3].

    A normal is the mean, by area and angle, over the facets around the corner that join this one smoothly. At a tip it
    is the facet's own. The arrays: the number of the normal, which several corners share, and whether it is a tip.
    """
    import trimesh
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    mesh = trimesh.Trimesh(points, faces, process=False)
    doubled = _doubled_areas(points[faces])
    facet = _unit(doubled)
    left, right = mesh.face_adjacency.T
    smooth = np.einsum("ij,ij->i", facet[left], facet[right]) > np.cos(_CREASE)
    pairs, ends = mesh.face_adjacency[smooth], mesh.face_adjacency_edges[smooth]

    # corners of smooth neighbours that lie at the same point share a normal
    def corner(facets: Indices, point: Indices) -> Indices:
        return np.asarray(3 * facets + (faces[facets] == point[:, None]).argmax(axis=1))

    i, j = (np.concatenate([corner(side, end) for end in ends.T]) for side in pairs.T)
    graph = coo_array((np.ones(len(i), dtype=np.int8), (i, j)), shape=(faces.size, faces.size))
    count, group = connected_components(graph, directed=False)
    # by area alone, the two triangles of a quad would count more than one triangle beside them
    total = np.zeros((count, 3))
    np.add.at(total, group, (mesh.face_angles[:, :, None] * doubled[:, None]).reshape(-1, 3))
    normals = _unit(total)[group].reshape(-1, 3, 3)

    lean = normals - np.einsum("fck,fk->fc", normals, facet)[:, :, None] * facet[:, None]
    left_over = np.einsum("fck,fk->fc", lean, lean.sum(axis=1))
    areas = np.repeat(np.linalg.norm(doubled, axis=1), 3)
    total_area, squared, one_sided = (
        np.bincount(group, areas * w) for w in (1.0, (lean**2).sum(axis=2).ravel(), left_over.ravel())
    )
    pointed = (one_sided > _TIP * squared) & (squared > _POINTED**2 * total_area)
    tips = pointed[group].reshape(-1, 3)
    return np.where(tips[:, :, None], facet[:, None], normals), group.reshape(-1, 3).astype(np.int64), tips


def _with_area_of_surface(
    points: Array, faces: Indices, normals: Array, group: Indices, tips: NDArray[np.bool_]
) -> Array:
    """Triangles with the surface's area, shape [m, 3, 3]: all corners but tips move along their normals."""
    moved = points[faces]
    target, sagitta = _surface_areas(moved, normals)
    numbers, first = np.unique(group, return_index=True)
    place, normal = faces.ravel()[first], normals.reshape(-1, 3)[first]
    limit = np.zeros(len(numbers))
    np.maximum.at(limit, group, sagitta[:, None])
    for _ in range(3):
        doubled = _doubled_areas(moved)
        lacking = target - 0.5 * np.linalg.norm(doubled, axis=1)
        # gradient of the area by a corner: half of (opposite edge) x (unit normal)
        opposite = np.roll(moved, -2, axis=1) - np.roll(moved, -1, axis=1)
        growth = np.einsum("fck,fck->fc", 0.5 * np.cross(_unit(doubled)[:, None], opposite), normals)
        need, rate = np.bincount(group.ravel(), np.repeat(lacking / 3.0, 3)), np.bincount(group.ravel(), growth.ravel())
        # between two creases a normal lies in the facets beside it: its rate is rounding, and the corner stays
        grows = np.abs(rate) > _ROUNDING * np.abs(rate).max()
        shift = np.clip(np.divide(need, rate, out=np.zeros(len(need)), where=grows), -limit, limit)
        by_point = np.zeros(points.shape)
        np.add.at(by_point, place, shift[:, None] * normal)
        by_point[faces[tips]] = 0.0
        moved = moved + by_point[faces]
    return moved


def _surface_areas(triangles: Array, normals: Array) -> tuple[Array, Array]:
    """Area of the curved patch over each triangle [m²], and the greatest height of the arcs over its edges [m].

    To second order in the angles: the slopes at the corners vary linearly in between, and the arcs over the edges lean
    outwards, so that the patch is larger than the triangle below it.
    """
    doubled = _doubled_areas(triangles)
    facet = _unit(doubled)
    upright = np.maximum(np.einsum("fck,fk->fc", normals, facet), _STEEPEST)
    slopes = normals / upright[:, :, None] - facet[:, None]
    squared_slope = ((slopes**2).sum(axis=(1, 2)) + (slopes.sum(axis=1) ** 2).sum(axis=1)) / 12.0
    after = np.roll(normals, -1, axis=1)
    edges = np.roll(triangles, -1, axis=1) - triangles
    heights = (edges * (after - normals)).sum(axis=2) / 8.0
    outwards = np.cross(edges, facet[:, None])  # as long as the edge
    beyond = (2.0 / 3.0 * heights * (_unit(normals + after) * outwards).sum(axis=2)).sum(axis=1)
    below = 0.5 * np.linalg.norm(doubled, axis=1) + beyond
    return below * np.sqrt(1.0 + squared_slope), np.abs(heights).max(axis=1)

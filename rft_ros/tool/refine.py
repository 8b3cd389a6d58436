"""Triangles for the refined rule, with the area of the curved surface that the facets of the mesh are inscribed in.

The curvature of a facet's patch comes from the normals at its corners, which are averaged by area and angle over the
facets that join smoothly: a large flat face beside a narrow fillet stays flat. The tip of a cone does not move: its
facets join smoothly, but the surface has no normal there.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import Plates

if TYPE_CHECKING:
    import trimesh

FLAT_HALF_ANGLE = np.deg2rad(1.0)
"""Half angle [rad] over which a flat facet begins to lead: the smallest of any facet."""

# facets at a larger angle meet at an edge of the tool, not within a curved surface
_CREASE = np.deg2rad(50.0)
_HALF_ANGLE_RATIO = 0.85  # half angle of a curved facet over the mean angle between its normal and those at its corners
_TIP_SHARE = 0.7
"""A point is a tip if more of its squared tilt than this is left over, and if the tilt exceeds `_MIN_TIP_SINE`.

The tilt is that of the normal at the point against a facet there. On a curved surface the normals at a facet's other
corners tilt the opposite way and balance it.
"""

_MIN_TIP_SINE = np.sin(np.deg2rad(10.0))
"""Least sine of the tilt at a tip."""

_MIN_COSINE_RATIO = 0.1  # divisions take a smaller cosine between a facet's normal and those at its corners as this

_ROUNDING_RATIO = 1e-9  # of the greatest growth of area by a corner's shift: a smaller one is zero

_WELD_RATIO = 1e-6  # of the tool's size: closer corners become one

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def refined_plates(vertices: Array, faces: Indices) -> Plates:
    """Plates of a mesh in the tool frame [m] for the refined rule, one per face, in the same order.

    `vertices`: shape [n, 3]; `faces`: indices of vertices, shape [m, 3].
    """
    points, corners = welded(vertices, faces)
    surface = _corner_normals(points, corners)
    facet = _unit(doubled_areas(points[corners]))
    angles = np.arccos(np.clip(_dot(surface.normals, facet[:, None]), -1.0, 1.0))
    half_angles = np.clip(_HALF_ANGLE_RATIO * angles.mean(axis=1), FLAT_HALF_ANGLE, 0.5 * np.pi)
    triangles = _with_area_of_surface(points, corners, surface)
    # smaller than the welding distance
    is_lost = ~(np.linalg.norm(doubled_areas(triangles), axis=1) > 0.0)
    triangles[is_lost] = vertices[faces[is_lost]]
    return Plates.from_triangles(triangles, half_angles)


def welded(vertices: Array, faces: Indices) -> tuple[Array, Indices]:
    """Merge coincident vertices, which STL files repeat for each facet: points, shape [k, 3], faces, shape [m, 3]."""
    corner_points = vertices[faces.ravel()]
    size = float(np.ptp(corner_points, axis=0).max())
    with np.errstate(invalid="ignore"):  # a vertex that no face uses may lie anywhere
        place = np.round((vertices - corner_points.min(axis=0)) / (_WELD_RATIO * size)).astype(
            np.int64
        )
    _, first, point = np.unique(place, axis=0, return_index=True, return_inverse=True)
    return vertices[first], point.reshape(-1)[faces]


def doubled_areas(triangles: Array) -> Array:
    """Area vectors of triangles, shape [m, 3], times two."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    return np.cross(b - a, c - a)


def _unit(vectors: Array) -> Array:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...k,...k->...", a, b))


class _CornerNormals(NamedTuple):
    """The surface's unit normal at each corner of each facet, shape [m, 3, 3], and two arrays of shape [m, 3].

    `group`: the number of the normal, which several corners share. `is_tip`: there the normal is the facet's own.
    """

    normals: Array
    group: Indices
    is_tip: NDArray[np.bool_]


def _corner_normals(points: Array, faces: Indices) -> _CornerNormals:
    """The mean, by area and angle, over the facets around each corner that join smoothly."""
    import trimesh

    mesh = trimesh.Trimesh(points, faces, process=False)
    double_areas = doubled_areas(points[faces])
    facet = _unit(double_areas)
    group = _smooth_groups(mesh, facet)
    # by area alone, the two triangles of a quad would count more than one triangle beside them
    weighted_normals = mesh.face_angles[:, :, None] * double_areas[:, None]
    total = np.zeros((group.max() + 1, 3))
    np.add.at(total, group.ravel(), weighted_normals.reshape(-1, 3))
    normals = _unit(total)[group]
    is_tip = _tips(normals, facet, group, np.linalg.norm(double_areas, axis=1))
    return _CornerNormals(np.where(is_tip[:, :, None], facet[:, None], normals), group, is_tip)


def _smooth_groups(mesh: "trimesh.Trimesh", facet: Array) -> Indices:
    """For each corner of each facet the number of its normal: corners of smooth neighbours at one point share it."""
    from trimesh.graph import connected_component_labels

    faces = mesh.faces
    left, right = mesh.face_adjacency.T
    is_smooth = _dot(facet[left], facet[right]) > np.cos(_CREASE)
    pairs = mesh.face_adjacency[is_smooth]
    ends = mesh.face_adjacency_edges[is_smooth]

    def corners_of(facets: Indices) -> Indices:
        """The corners of facets at both ends of the edge that they share."""
        places = [(faces[facets] == end[:, None]).argmax(axis=1) for end in ends.T]
        return np.concatenate([3 * facets + place for place in places])

    shared_corners = np.stack([corners_of(side) for side in pairs.T], axis=1)
    group = connected_component_labels(shared_corners, node_count=faces.size)
    return np.asarray(group, dtype=np.int64).reshape(-1, 3)


def _tips(
    normals: Array,
    facet: Array,
    group: Indices,
    areas: Array,
) -> NDArray[np.bool_]:
    """Whether each corner is a tip, shape [m, 3]. `facet`: unit normals; `areas` of the facets, in any unit."""
    lean = normals - _dot(normals, facet[:, None])[:, :, None] * facet[:, None]
    unbalanced_tilt = _dot(lean, lean.sum(axis=1)[:, None])
    numbers = group.ravel()
    weights = np.repeat(areas, 3)
    squared_tilt = np.bincount(numbers, weights * _dot(lean, lean).ravel())
    is_one_sided = (
        np.bincount(numbers, weights * unbalanced_tilt.ravel()) > _TIP_SHARE * squared_tilt
    )
    is_pointed = squared_tilt > _MIN_TIP_SINE**2 * np.bincount(numbers, weights)
    is_tip: NDArray[np.bool_] = (is_one_sided & is_pointed)[group]
    return is_tip


def _with_area_of_surface(points: Array, faces: Indices, surface: _CornerNormals) -> Array:
    """Triangles with the surface's area, shape [m, 3, 3]: all corners but tips move along their normals."""
    moved_triangles = points[faces]
    target, sagitta = _surface_areas(moved_triangles, surface.normals)
    group = surface.group
    numbers, first = np.unique(group, return_index=True)
    place = faces.ravel()[first]
    normal = surface.normals.reshape(-1, 3)[first]
    limit = np.zeros(len(numbers))
    np.maximum.at(limit, group, sagitta[:, None])
    for _ in range(3):
        double_areas = doubled_areas(moved_triangles)
        lacking = target - 0.5 * np.linalg.norm(double_areas, axis=1)
        # gradient of the area by a corner: half of (opposite edge) x (unit normal)
        opposite = np.roll(moved_triangles, -2, axis=1) - np.roll(moved_triangles, -1, axis=1)
        growth = _dot(0.5 * np.cross(_unit(double_areas)[:, None], opposite), surface.normals)
        need = np.bincount(group.ravel(), np.repeat(lacking / 3.0, 3))
        rate = np.bincount(group.ravel(), growth.ravel())
        # between two creases a normal lies in the facets beside it: its rate is rounding, and the corner stays
        grows = np.abs(rate) > _ROUNDING_RATIO * np.abs(rate).max()
        full_shift = np.divide(need, rate, out=np.zeros(len(need)), where=grows)
        shift = np.clip(full_shift, -limit, limit)
        point_shift = np.zeros(points.shape)
        np.add.at(point_shift, place, shift[:, None] * normal)
        point_shift[faces[surface.is_tip]] = 0.0
        moved_triangles = moved_triangles + point_shift[faces]
    return moved_triangles


def _surface_areas(triangles: Array, normals: Array) -> tuple[Array, Array]:
    """Area of the curved patch over each triangle [m²], and the greatest height of the arcs over its edges [m].

    To second order in the angles: the slopes at the corners vary linearly in between, and the arcs over the edges lean
    outwards, so that the patch is larger than the triangle below it.
    """
    double_areas = doubled_areas(triangles)
    facet = _unit(double_areas)[:, None]
    upright = np.maximum(_dot(normals, facet), _MIN_COSINE_RATIO)
    slopes = normals / upright[:, :, None] - facet
    mean_slope = slopes.sum(axis=1)
    squared_slope = (_dot(slopes, slopes).sum(axis=1) + _dot(mean_slope, mean_slope)) / 12.0
    next_normals = np.roll(normals, -1, axis=1)
    edges = np.roll(triangles, -1, axis=1) - triangles
    heights = _dot(edges, next_normals - normals) / 8.0
    outwards = np.cross(edges, facet)  # as long as the edge
    arc_areas = 2.0 / 3.0 * heights * _dot(_unit(normals + next_normals), outwards)
    flat_areas = 0.5 * np.linalg.norm(double_areas, axis=1) + arc_areas.sum(axis=1)
    return flat_areas * np.sqrt(1.0 + squared_slope), np.abs(heights).max(axis=1)

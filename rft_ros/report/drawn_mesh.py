"""Chooses the mesh with which a tool is drawn: the tool's own, or a simplification if that has too many faces."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.tool import Tool

__all__ = ["DrawnMesh", "drawn_mesh"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_MOST_FACES = 10_000  # of a mesh that is drawn as it is
_FEWER = 5000, 20_000, 80_000  # numbers of faces that are tried for a finer one
_EXTENT_ERROR = 0.01  # of the largest extent: how far a face of the bounding box may move
_AREA_ERROR = 0.02  # of the area: error of the area that faces +x, -x, ..., -z
_GAP = 0.05  # of the largest extent: how far the drawn surface may be from a facet
_TURN = 0.1  # of the largest extent: the distance that is as bad as an error of the normal by 1 rad
_SAMPLES = 20_000  # points on the drawn surface


class DrawnMesh(NamedTuple):
    """Vertices in the tool frame [m], shape [n, 3]; faces, shape [m, 3].

    `facet`: for each face the index of the tool's facet whose traction colours it, shape [m].
    """

    vertices: Array
    faces: Indices
    facet: Indices


def drawn_mesh(tool: Tool, *, most_faces: int = _MOST_FACES) -> DrawnMesh:
    """The mesh with which a tool is drawn. Up to `most_faces` faces, it is the tool's own mesh.

    For a finer mesh it is the coarsest simplification that keeps the extent, the area and the place of the surface. If
    no simplification keeps them, as with thin blades, the full mesh is drawn.
    """
    import trimesh

    if len(tool.faces) > most_faces:
        mesh = trimesh.Trimesh(tool.vertices, tool.faces, process=True)
        for count in _FEWER:
            if count >= len(tool.faces):
                break
            fewer = mesh.simplify_quadric_decimation(face_count=count)
            vertices, faces = np.asarray(fewer.vertices, dtype=np.float64), np.asarray(fewer.faces, dtype=np.int64)
            faces = faces[np.linalg.norm(_area_vectors(vertices, faces), axis=1) > 0.0]
            if len(faces) and _keeps_shape(tool, vertices, faces):
                return DrawnMesh(vertices, faces, _nearest_facets(tool, vertices, faces))
    vertices, merged = np.unique(tool.vertices, axis=0, return_inverse=True)  # each face of an STL file has its own
    return DrawnMesh(vertices, merged.reshape(-1)[tool.faces], np.arange(len(tool.faces)))


def _area_vectors(vertices: Array, faces: Indices) -> Array:
    a, b, c = vertices[faces.T]
    return np.asarray(0.5 * np.cross(b - a, c - a))


def _keeps_shape(tool: Tool, vertices: Array, faces: Indices) -> bool:
    size, used = tool.size, vertices[np.unique(faces)]
    ends, drawn_ends = ([p.min(axis=0), p.max(axis=0)] for p in (tool.corners, used))
    if np.abs(np.subtract(ends, drawn_ends)).max() > _EXTENT_ERROR * size:
        return False
    vectors, drawn = _area_vectors(tool.vertices, tool.faces), _area_vectors(vertices, faces)
    sides, drawn_sides = (np.maximum([v, -v], 0.0).sum(axis=1) for v in (vectors, drawn))
    if np.abs(sides - drawn_sides).max() > _AREA_ERROR * np.linalg.norm(vectors, axis=1).sum():
        return False
    return _largest_gap(tool, vertices, faces) <= _GAP * size


def _largest_gap(tool: Tool, vertices: Array, faces: Indices) -> float:
    """Largest distance of a facet from points spread over the faces [m]. Errors of normals count as distance."""
    from scipy.spatial import KDTree

    random, vectors = np.random.default_rng(0), _area_vectors(vertices, faces)
    area = np.linalg.norm(vectors, axis=1)
    face_of = random.choice(len(faces), _SAMPLES, p=area / area.sum())
    weights = random.dirichlet((1.0, 1.0, 1.0), _SAMPLES)
    points = np.einsum("nk,nkd->nd", weights, vertices[faces[face_of]])
    there = np.hstack([points, _TURN * tool.size * vectors[face_of] / area[face_of, None]])
    gaps = np.asarray(KDTree(there).query(_places_of_facets(tool))[0])
    return float(gaps.max())


def _places_of_facets(tool: Tool) -> Array:
    """Centroid and scaled normal of each facet [m], shape [n, 6]."""
    vectors = _area_vectors(tool.vertices, tool.faces)
    normals = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    return np.hstack([tool.vertices[tool.faces].mean(axis=1), _TURN * tool.size * normals])


def _nearest_facets(tool: Tool, vertices: Array, faces: Indices) -> Indices:
    """The facet nearest to each face, by its middle and its normal."""
    from scipy.spatial import KDTree

    vectors = _area_vectors(vertices, faces)
    normals = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    there = np.hstack([vertices[faces].mean(axis=1), _TURN * tool.size * normals])
    return np.asarray(KDTree(_places_of_facets(tool)).query(there)[1], dtype=np.int64)

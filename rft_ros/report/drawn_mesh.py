"""Chooses the mesh with which a tool is drawn: the tool's own, or a simplification if that has too many faces."""

from typing import Any, NamedTuple

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
    from scipy.spatial import KDTree

    vertices, merged = np.unique(tool.vertices, axis=0, return_inverse=True)  # each face of an STL file has its own
    full = trimesh.Trimesh(vertices, merged.reshape(-1)[tool.faces], process=False)
    for count in _FEWER if len(full.faces) > most_faces else ():
        if count < len(full.faces):
            fewer = full.simplify_quadric_decimation(face_count=count)
            fewer.update_faces(fewer.area_faces > 0.0)
            if len(fewer.faces) and _keeps_shape(full, fewer):
                facets = _places(full, full.triangles_center, full.face_normals)
                nearest = KDTree(facets).query(_places(full, fewer.triangles_center, fewer.face_normals))[1]
                return DrawnMesh(np.array(fewer.vertices), np.array(fewer.faces), np.asarray(nearest, dtype=np.int64))
    return DrawnMesh(vertices, np.array(full.faces), np.arange(len(full.faces)))


def _places(full: Any, points: Array, normals: Array) -> Array:
    """Points and scaled normals [m], shape [n, 6], of a surface, so that errors of normals count as distance."""
    return np.hstack([points, _TURN * full.extents.max() * normals])


def _keeps_shape(full: Any, fewer: Any) -> bool:
    """Whether a simplified mesh keeps the full one's extent, its area towards each side, and its surface."""
    from scipy.spatial import KDTree
    from trimesh.sample import sample_surface

    size = full.extents.max()
    if np.abs(full.bounds - fewer.bounds).max() > _EXTENT_ERROR * size:
        return False
    vectors = [mesh.face_normals * mesh.area_faces[:, None] for mesh in (full, fewer)]
    sides, drawn_sides = (np.maximum([v, -v], 0.0).sum(axis=1) for v in vectors)
    if np.abs(sides - drawn_sides).max() > _AREA_ERROR * full.area:
        return False
    points, faces = sample_surface(fewer, _SAMPLES, seed=0)
    drawn = KDTree(_places(full, points, fewer.face_normals[faces]))
    gaps = drawn.query(_places(full, full.triangles_center, full.face_normals))[0]
    return bool(np.max(gaps) <= _GAP * size)

"""A tool's mesh as it is drawn: of no more faces than a page can turn."""

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import Plates
from rft_ros.tool.tool import Tool, centroid_plates

__all__ = ["drawable"]


def drawable(tool: Tool, *, most_faces: int) -> tuple[NDArray[np.float64], NDArray[np.int64], Plates]:
    """Vertices [m], shape [n, 3]; faces with an area, shape [m, 3], m about `most_faces` at most; a plate for each."""
    import trimesh

    mesh = trimesh.Trimesh(tool.vertices, tool.faces, process=True)
    vertices, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
    if len(faces) > most_faces:
        import fast_simplification  # type: ignore[import-untyped]

        fewer = fast_simplification.simplify(
            vertices.astype(np.float32), faces.astype(np.int32), target_count=most_faces
        )
        vertices, faces = (np.asarray(fewer[0], dtype=np.float64), np.asarray(fewer[1], dtype=np.int64))
    a, b, c = vertices[faces.T]
    faces = faces[np.linalg.norm(np.cross(b - a, c - a), axis=1) > 0.0]
    return vertices, faces, centroid_plates(vertices, faces)

"""A tool's mesh for drawing: few enough faces for a browser to turn."""

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import Plates
from rft_ros.tool.tool import Tool, centroid_plates

__all__ = ["drawable"]


def drawable(tool: Tool, *, most_faces: int) -> tuple[NDArray[np.float64], NDArray[np.int64], Plates]:
    """Vertices [m], shape [n, 3], faces, shape [m, 3], and a plate for each face; m is about `most_faces` at most."""
    import trimesh

    mesh = trimesh.Trimesh(tool.vertices, tool.faces, process=True)
    if len(mesh.faces) > most_faces:
        mesh = mesh.simplify_quadric_decimation(face_count=most_faces)
    vertices, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
    faces = faces[np.linalg.norm(np.asarray(mesh.triangles_cross), axis=1) > 0.0]
    return vertices, faces, centroid_plates(vertices, faces)

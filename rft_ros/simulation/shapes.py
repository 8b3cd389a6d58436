"""The shape of a body of a MuJoCo model, from its geoms: meshes and primitives."""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.rft import rotation_matrix
from rft_ros.simulation.mechanism import import_mujoco
from rft_ros.tool import Tool, tool_of_mesh

__all__ = ["check_size", "tool_of_body"]

Array = NDArray[np.float64]

_FINEST = 3  # times that each face of an icosahedron is divided into four: a sphere of 1,280 triangles
_MISTAKEN = 100.0  # times the size of the body's geoms: units are mistaken by 1,000
_SMALLEST = 1.0 / 30.0  # of the mobilization length


def tool_of_body(model: Any, body: int, tolerance: float) -> Tool:
    """The body's geoms as one tool in the body frame; those that collide, if there are any, else all.

    `tolerance`: as for `load_tool`. Raises InputError if there is none of a known shape.
    """
    first, count = model.body_geomadr[body], model.body_geomnum[body]
    geoms = range(first, first + count)
    colliding = [g for g in geoms if model.geom_contype[g] or model.geom_conaffinity[g]]
    triangles = [placed for g in colliding or geoms if (placed := _triangles(model, g)) is not None]
    if not triangles:
        kinds = "a mesh, box, sphere, capsule, cylinder or ellipsoid"
        raise InputError(f"body '{model.body(body).name}' has no geoms of {kinds}; give its shape as mesh=FILE")
    return _tool_of_triangles(np.concatenate(triangles).tobytes(), tolerance)


def _triangles(model: Any, geom: int) -> Array | None:
    """A geom's triangles in the body frame [m], shape [n, 3, 3]; None for a shape without a volume."""
    import trimesh

    kinds = import_mujoco().mjtGeom
    kind, (a, b, c) = model.geom_type[geom], model.geom_size[geom].tolist()
    make = trimesh.creation
    if kind == kinds.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first, faces = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
        vertices = np.array(model.mesh_vert[first : first + model.mesh_vertnum[mesh]], dtype=np.float64)
        corners = vertices[model.mesh_face[faces : faces + model.mesh_facenum[mesh]]]
    elif kind == kinds.mjGEOM_BOX:
        corners = make.box(extents=(2.0 * a, 2.0 * b, 2.0 * c)).triangles
    elif kind == kinds.mjGEOM_SPHERE:
        corners = make.icosphere(subdivisions=_FINEST, radius=a).triangles
    elif kind == kinds.mjGEOM_ELLIPSOID:
        corners = make.icosphere(subdivisions=_FINEST).triangles * (a, b, c)
    elif kind == kinds.mjGEOM_CYLINDER:
        corners = make.cylinder(radius=a, height=2.0 * b).triangles
    elif kind == kinds.mjGEOM_CAPSULE:
        mesh = make.capsule(radius=a, height=2.0 * b)
        corners = mesh.triangles - (mesh.bounds.mean(axis=0))
    else:
        return None
    axes = rotation_matrix(np.roll(model.geom_quat[geom], -1))
    return np.asarray(corners @ axes.T + model.geom_pos[geom])


def check_size(tool: Tool, model: Any, body: int, length: float) -> None:
    """Refuse a tool of a file in other units than its `scale` says; `length`: the mobilization length [m]."""
    size = float(np.ptp(tool.corners, axis=0).max())
    what = f"the mesh of body '{model.body(body).name}' is {size:.3g} m long"
    if size < _SMALLEST * length:
        raise InputError(f"{what}, too small for grains; check scale, in metres per unit of the file")
    first, count = model.body_geomadr[body], model.body_geomnum[body]
    own = 2.0 * float(max((model.geom_rbound[g] for g in range(first, first + count)), default=0.0))
    if own > 0.0 and not 1.0 / _MISTAKEN < size / own < _MISTAKEN:
        raise InputError(f"{what}, and its geoms {own:.3g} m; check scale, in metres per unit of the file")


@lru_cache(maxsize=8)
def _tool_of_triangles(triangles: bytes, tolerance: float) -> Tool:
    """Bodies of one shape share a tool: to reduce it takes up to a second."""
    import trimesh

    corners = np.frombuffer(triangles).reshape(-1, 3)
    mesh = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3))  # which merges the corners
    return tool_of_mesh(mesh, name="body", tolerance=tolerance)

"""The shape of a body of a MuJoCo model, from its geoms: meshes and primitives; and ground from its height field."""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.ground import MAX_CELL_COUNT, HeightMap
from rft_ros.simulation.mechanism import import_mujoco
from rft_ros.tool import Tool, solids, tool_of_mesh

Array = NDArray[np.float64]

MAX_SIZE_RATIO = 100.0
"""Greatest ratio of the sizes of a mesh and of its body's geoms: mistaken units differ by 1,000."""

MIN_SIZE_RATIO = 1.0 / 30.0
"""Least size of a mesh, in mobilization lengths."""

PROBE_DISTANCE_SHARE = 1e-3
"""Distance from a face of the two points that say whether another geom covers it, over the body's size."""


def tool_of_body(
    model: Any, body: int, tolerance: float, apart: frozenset[int] = frozenset()
) -> Tool:
    """The geoms of the body, and of its jointless children that are not `apart`, as one tool in the body frame.

    Those geoms that collide, if there are any, else all; without the faces that lie within another geom. `tolerance`:
    as for `load_tool`. Raises InputError if there is none of a known shape.
    """
    shapes = _shapes(model, body, apart)
    colliding_shapes = [shape for geom, shape in shapes.items() if _collides(model, geom)]
    used_shapes = colliding_shapes or list(shapes.values())
    if not used_shapes:
        kinds = "a mesh, box, sphere, capsule, cylinder or ellipsoid"
        name = model.body(body).name or body
        raise InputError(f"body '{name}' has no geoms of {kinds}; give its shape as mesh=FILE")
    return _tool_of_triangles(np.concatenate(_uncovered(used_shapes)).tobytes(), tolerance)


def geometry_of(model: Any, bodies: list[int]) -> Array:
    """The numbers that give the shapes of these bodies, but for the vertices of meshes, to see whether one changed."""
    roots = model.body_weldid[bodies]
    geoms = np.isin(model.body_weldid[model.geom_bodyid], roots)
    is_child = np.isin(model.body_weldid, roots) & (model.body_jntnum == 0)
    geom_arrays = (
        model.geom_type,
        model.geom_dataid,
        model.geom_size,
        model.geom_pos,
        model.geom_quat,
    )
    parts = [array[geoms] for array in geom_arrays] + [
        model.body_pos[is_child],
        model.body_quat[is_child],
    ]
    return np.concatenate([part.ravel() for part in parts])


def bodies_fixed_to(model: Any, body: int, apart: frozenset[int]) -> list[int]:
    """The body and its jointless children that are not `apart`, each after its parent."""
    bodies = [body]
    for child in range(body + 1, model.nbody):
        if (
            model.body_parentid[child] in bodies
            and not model.body_jntnum[child]
            and child not in apart
        ):
            bodies.append(child)
    return bodies


def _shapes(model: Any, body: int, apart: frozenset[int]) -> dict[int, Array]:
    """The triangles of each geom of the body and of its jointless children that are not `apart`, in its frame."""
    from trimesh.transformations import transform_points

    places = {body: np.eye(4)}
    for child in bodies_fixed_to(model, body, apart)[1:]:  # each after its parent
        parent = int(model.body_parentid[child])
        places[child] = places[parent] @ _pose(model.body_pos[child], model.body_quat[child])
    shapes = {}
    for geom, owner in enumerate(model.geom_bodyid.tolist()):
        triangles = _triangles(model, geom) if owner in places else None
        if triangles is not None:
            place = places[owner] @ _pose(model.geom_pos[geom], model.geom_quat[geom])
            points = transform_points(triangles.reshape(-1, 3), place)
            shapes[geom] = np.asarray(points).reshape(-1, 3, 3)
    return shapes


def _pose(position: Array, quaternion: Array) -> Array:
    """The homogeneous matrix of a pose. `quaternion`: wxyz, as in MuJoCo."""
    from trimesh.transformations import quaternion_matrix

    pose = np.asarray(quaternion_matrix(quaternion))
    pose[:3, 3] = position
    return pose


def _collides(model: Any, geom: int) -> bool:
    has_pair = geom in model.pair_geom1 or geom in model.pair_geom2
    return bool(has_pair or model.geom_contype[geom] or model.geom_conaffinity[geom])


def _triangles(model: Any, geom: int) -> Array | None:
    """A geom's triangles in its own frame [m], shape [n, 3, 3]; None for a shape without a volume."""
    kinds = import_mujoco().mjtGeom
    a, b, c = model.geom_size[geom].tolist()
    match model.geom_type[geom]:
        case kinds.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
            faces = model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]
            return np.asarray(vertices[faces], dtype=np.float64)
        case kinds.mjGEOM_BOX:
            return solids.box((a, b, c))
        case kinds.mjGEOM_SPHERE:
            return solids.ellipsoid((a, a, a))
        case kinds.mjGEOM_ELLIPSOID:
            return solids.ellipsoid((a, b, c))
        case kinds.mjGEOM_CYLINDER:
            return solids.cylinder(a, b)
        case kinds.mjGEOM_CAPSULE:
            return solids.capsule(a, b)
    return None


def _uncovered(shapes: list[Array]) -> list[Array]:
    """The triangles of each shape that lie on the surface of all shapes together: not within another one.

    Of two faces that lie on each other, back to back, none does; of two that face the same way, the first.
    """
    from trimesh.triangles import cross

    corners = np.concatenate(shapes).reshape(-1, 3)
    probe_distance = PROBE_DISTANCE_SHARE * float(np.ptp(corners, axis=0).max())
    outer_shapes = []
    for k, triangles in enumerate(shapes):
        normals = cross(triangles)
        sizes = np.linalg.norm(normals, axis=1, keepdims=True)
        outward = probe_distance * normals / sizes.clip(1e-300)
        middle = triangles.mean(axis=1)
        is_covered = np.zeros(len(triangles), dtype=bool)
        for j, other_shape in enumerate(shapes):
            if j != k:
                is_covered |= solids.are_inside(middle + outward, other_shape)
            if j < k:
                is_covered |= solids.are_inside(middle - outward, other_shape)
        outer_shapes.append(triangles[~is_covered])
    return outer_shapes


def ground_of_field(model: Any, name: str, tools: list[Tool]) -> HeightMap:
    """The height map of a geom of type hfield, for bodies of these shapes.

    The surface at a body is fitted over at least two cells of the map. So a field of larger cells is divided, as far as
    `MAX_CELL_COUNT` allows. Raises InputError for another geom, and for one that moves or leans.
    """
    from scipy.interpolate import RegularGridInterpolator

    mujoco = import_mujoco()
    geom = int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name))
    if geom < 0 or model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_HFIELD:
        raise InputError(
            f"ground '{name}' is not a geom of type hfield; name one, or give a HeightMap"
        )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    axes = data.geom_xmat[geom].reshape(3, 3)
    middle = data.geom_xpos[geom]
    if model.body_weldid[model.geom_bodyid[geom]] or axes[2, 2] < 1.0 - 1e-9:
        raise InputError(
            f"ground '{name}' moves, or is not level; the grains need a fixed height field whose z is up"
        )
    field = model.geom_dataid[geom]
    rows = model.hfield_nrow[field]
    columns = model.hfield_ncol[field]
    half_x, half_y, height, _ = model.hfield_size[field]
    values = model.hfield_data[model.hfield_adr[field] :][: rows * columns]
    surface = RegularGridInterpolator(
        (np.linspace(-half_y, half_y, rows), np.linspace(-half_x, half_x, columns)),
        middle[2] + height * values.reshape(rows, columns).astype(np.float64),
        bounds_error=False,
    )
    finest = 2.0 * np.sqrt(half_x * half_y / MAX_CELL_COUNT)
    smallest = min(tool.size for tool in tools) / solids.EDGE_COUNT
    own_cell = min(2.0 * half_x / (columns - 1), 2.0 * half_y / (rows - 1))
    cell = max(min(own_cell, smallest), finest)
    turn = axes[:2, :2]
    reach = np.abs(turn) @ (half_x, half_y)
    low_x, low_y = np.floor((middle[:2] - reach) / cell)
    high_x, high_y = np.floor((middle[:2] + reach) / cell)
    cells = np.mgrid[low_x : high_x + 1, low_y : high_y + 1]
    places = cell * (cells + 0.5) - middle[:2, None, None]
    field_x, field_y = np.tensordot(turn.T, places, axes=1)
    heights = surface((field_y, field_x))
    return HeightMap(cell=float(cell), corner=(float(low_x), float(low_y)), heights=heights)


def check_size(tool: Tool, model: Any, body: int, length: float) -> None:
    """Refuse a tool of a file in other units than its `scale` says; `length`: the mobilization length [m]."""
    what = f"the mesh of body '{model.body(body).name}' is {tool.size:.3g} m long"
    if tool.size < MIN_SIZE_RATIO * length:
        raise InputError(
            f"{what}, too small for grains; check scale, in metres per unit of the file"
        )
    geoms_size = 2.0 * float(model.geom_rbound[model.geom_bodyid == body].max(initial=0.0))
    if geoms_size > 0.0 and not 1.0 / MAX_SIZE_RATIO < tool.size / geoms_size < MAX_SIZE_RATIO:
        raise InputError(
            f"{what}, and its geoms {geoms_size:.3g} m; check scale, in metres per unit of the file"
        )


@lru_cache(maxsize=8)
def _tool_of_triangles(triangles: bytes, tolerance: float) -> Tool:
    """Bodies of one shape share a tool: to reduce it takes up to a second."""
    import trimesh

    corners = np.frombuffer(triangles).reshape(-1, 3)
    # which merges the corners
    mesh = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3))
    return tool_of_mesh(mesh, name="body", tolerance=tolerance)

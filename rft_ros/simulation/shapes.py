"""The shape of a body of a MuJoCo model, from its geoms: meshes and primitives; and ground from its height field."""

from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.ground import MOST_CELLS, HeightMap
from rft_ros.rft import rotation_matrix
from rft_ros.simulation.mechanism import import_mujoco
from rft_ros.tool import Tool, solids, tool_of_mesh

Array = NDArray[np.float64]

_MISTAKEN = 100.0  # times the size of the body's geoms: units are mistaken by 1,000
_SMALLEST = 1.0 / 30.0  # of the mobilization length
_BESIDE = 1e-3  # of the body's size: distance from a face of the two points that say whether another geom covers it


def tool_of_body(
    model: Any, body: int, tolerance: float, apart: frozenset[int] = frozenset()
) -> Tool:
    """The geoms of the body, and of its jointless children that are not `apart`, as one tool in the body frame.

    Those geoms that collide, if there are any, else all; without the faces that lie within another geom. `tolerance`:
    as for `load_tool`. Raises InputError if there is none of a known shape.
    """
    placed = list(_geoms(model, body, apart, np.zeros(3), np.eye(3)))
    shapes = [
        triangles
        for one in placed
        if _collides(model, one.geom)
        for triangles in _triangles(model, one)
    ]
    if not shapes:
        shapes = [triangles for one in placed for triangles in _triangles(model, one)]
    if not shapes:
        kinds = "a mesh, box, sphere, capsule, cylinder or ellipsoid"
        name = model.body(body).name or body
        raise InputError(f"body '{name}' has no geoms of {kinds}; give its shape as mesh=FILE")
    return _tool_of_triangles(np.concatenate(_uncovered(shapes)).tobytes(), tolerance)


def geometry_of(model: Any, bodies: list[int]) -> Array:
    """The numbers that give the shapes of these bodies, but for the vertices of meshes, to see whether one changed."""
    roots = model.body_weldid[bodies]
    geoms = np.isin(model.body_weldid[model.geom_bodyid], roots)
    fixed = np.isin(model.body_weldid, roots) & (model.body_jntnum == 0)
    of_geoms = model.geom_type, model.geom_dataid, model.geom_size, model.geom_pos, model.geom_quat
    parts = [array[geoms] for array in of_geoms] + [model.body_pos[fixed], model.body_quat[fixed]]
    return np.concatenate([part.ravel() for part in parts])


class _Placed(NamedTuple):
    """A geom, and the place [m] and axes of the body that it is fixed to, in the frame of the tool."""

    geom: int
    position: Array
    axes: Array


def _geoms(
    model: Any, body: int, apart: frozenset[int], position: Array, axes: Array
) -> Iterator[_Placed]:
    """Each geom of a body at this place, and of its jointless children that are not `apart`."""
    for geom in np.flatnonzero(model.geom_bodyid == body).tolist():
        yield _Placed(geom, position, axes)
    for child in np.flatnonzero((model.body_parentid == body) & (model.body_jntnum == 0)).tolist():
        if child not in apart:
            turn = rotation_matrix(np.roll(model.body_quat[child], -1))
            yield from _geoms(
                model, child, apart, position + axes @ model.body_pos[child], axes @ turn
            )


def _collides(model: Any, geom: int) -> bool:
    paired = geom in model.pair_geom1 or geom in model.pair_geom2
    return bool(paired or model.geom_contype[geom] or model.geom_conaffinity[geom])


def _triangles(model: Any, placed: _Placed) -> Iterator[Array]:
    """A geom's triangles in the frame of the tool [m], shape [n, 3, 3]; none for a shape without a volume."""
    kinds = import_mujoco().mjtGeom
    geom = placed.geom
    kind = model.geom_type[geom]
    a, b, c = model.geom_size[geom].tolist()
    if kind == kinds.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        vertices = np.array(
            model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]],
            dtype=np.float64,
        )
        triangles = vertices[
            model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]
        ]
    elif kind == kinds.mjGEOM_BOX:
        triangles = solids.box((a, b, c))
    elif kind == kinds.mjGEOM_SPHERE:
        triangles = solids.ellipsoid((a, a, a))
    elif kind == kinds.mjGEOM_ELLIPSOID:
        triangles = solids.ellipsoid((a, b, c))
    elif kind == kinds.mjGEOM_CYLINDER:
        triangles = solids.cylinder(a, b)
    elif kind == kinds.mjGEOM_CAPSULE:
        triangles = solids.capsule(a, b)
    else:
        return
    axes = rotation_matrix(np.roll(model.geom_quat[geom], -1))
    in_body = triangles @ axes.T + model.geom_pos[geom]
    yield in_body @ placed.axes.T + placed.position


def _uncovered(shapes: list[Array]) -> list[Array]:
    """The triangles of each shape that lie on the surface of all shapes together: not within another one.

    Of two faces that lie on each other, back to back, none does; of two that face the same way, the first.
    """
    corners = np.concatenate(shapes).reshape(-1, 3)
    beside = _BESIDE * float(np.ptp(corners, axis=0).max())
    kept = []
    for k, triangles in enumerate(shapes):
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        out = beside * normals / np.linalg.norm(normals, axis=1, keepdims=True).clip(1e-300)
        middle = triangles.mean(axis=1)
        covered = np.zeros(len(triangles), dtype=bool)
        for j, other in enumerate(shapes):
            if j != k:
                covered |= solids.are_inside(middle + out, other)
            if j < k:
                covered |= solids.are_inside(middle - out, other)
        kept.append(triangles[~covered])
    return kept


def ground_of_field(model: Any, name: str, tools: list[Tool]) -> HeightMap:
    """The height map of a geom of type hfield, for bodies of these shapes.

    The surface at a body is fitted over at least two cells of the map. So a field of larger cells is divided, as far as
    `MOST_CELLS` allows. Raises InputError for another geom, and for one that moves or leans.
    """
    from scipy.ndimage import map_coordinates

    mujoco = import_mujoco()
    geom = int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name))
    if geom < 0 or model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_HFIELD:
        raise InputError(
            f"ground '{name}' is not a geom of type hfield; name one, or give a HeightMap"
        )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    axes = data.geom_xmat[geom].reshape(3, 3)
    x, y, z = data.geom_xpos[geom]
    if model.body_weldid[model.geom_bodyid[geom]] != 0 or axes[2, 2] < 1.0 - 1e-9:
        raise InputError(
            f"ground '{name}' moves, or is not level; the grains need a fixed height field whose z is up"
        )
    field = model.geom_dataid[geom]
    rows = model.hfield_nrow[field]
    columns = model.hfield_ncol[field]
    half_x, half_y, height, _ = model.hfield_size[field]
    data_of_field = model.hfield_data[model.hfield_adr[field] :][: rows * columns]
    heights = z + height * data_of_field.reshape(rows, columns).astype(np.float64)
    finest = 2.0 * np.sqrt(half_x * half_y / MOST_CELLS)
    smallest = min(tool.size for tool in tools) / solids.CELLS
    cell = max(min(2.0 * half_x / (columns - 1), 2.0 * half_y / (rows - 1), smallest), finest)
    reach = np.abs(axes[:2, :2]) @ (half_x, half_y)
    low_x, low_y = np.floor((np.array([x, y]) - reach) / cell)
    high_x, high_y = np.floor((np.array([x, y]) + reach) / cell)
    u, v = np.meshgrid(np.arange(low_x, high_x + 1), np.arange(low_y, high_y + 1), indexing="ij")
    along, across = np.tensordot(
        axes[:2, :2].T, [cell * (u + 0.5) - x, cell * (v + 0.5) - y], axes=1
    )
    row = (across / half_y + 1.0) * (rows - 1) / 2.0
    column = (along / half_x + 1.0) * (columns - 1) / 2.0
    found = map_coordinates(heights, (row, column), order=1, cval=np.nan)
    return HeightMap(cell=float(cell), corner=(float(low_x), float(low_y)), heights=found)


def check_size(tool: Tool, model: Any, body: int, length: float) -> None:
    """Refuse a tool of a file in other units than its `scale` says; `length`: the mobilization length [m]."""
    size = tool.size
    what = f"the mesh of body '{model.body(body).name}' is {size:.3g} m long"
    if size < _SMALLEST * length:
        raise InputError(
            f"{what}, too small for grains; check scale, in metres per unit of the file"
        )
    own = 2.0 * float(model.geom_rbound[model.geom_bodyid == body].max(initial=0.0))
    if own > 0.0 and not 1.0 / _MISTAKEN < size / own < _MISTAKEN:
        raise InputError(
            f"{what}, and its geoms {own:.3g} m; check scale, in metres per unit of the file"
        )


@lru_cache(maxsize=8)
def _tool_of_triangles(triangles: bytes, tolerance: float) -> Tool:
    """Bodies of one shape share a tool: to reduce it takes up to a second."""
    import trimesh

    corners = np.frombuffer(triangles).reshape(-1, 3)
    # which merges the corners
    mesh = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3))
    return tool_of_mesh(mesh, name="body", tolerance=tolerance)

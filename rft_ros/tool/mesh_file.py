"""Reads a mesh file, or a link of a robot, and places it in the tool frame."""

import io
import json
import logging
import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.files import read_file
from rft_ros.rft import rotation_matrix, unit_quaternion
from rft_ros.rft.arguments import number, numbers
from rft_ros.tool.check import with_area
from rft_ros.tool.locate import checked_mesh
from rft_ros.tool.urdf import ROBOT_SUFFIXES, shapes_of_link

if TYPE_CHECKING:
    import trimesh

Array = NDArray[np.float64]

_DEFAULT_UNIT_M = 0.001  # unit of a mesh file that declares none
_SUFFIXES = ".stl", ".obj", ".ply", ".glb", ".dae"
_POLYGONS = ".obj", ".ply", ".dae"
_MAX_FACET_COUNT = 2_000_000
_MAX_PART_COUNT = 10_000  # of a scene; trimesh takes a millisecond to read each
_FOLD_ANGLE_RAD = math.pi - 1e-3  # neighbours whose normals differ by more lie on each other
_SLIVER_AREA_RATIO = (
    1e-6  # of the largest facet's area; rounding may have turned a smaller facet over
)
# greatest |origin| over the farthest vertex; further away, rounding deforms the mesh
_MAX_ORIGIN_RATIO = 1e6
_MAX_SIZE_M = 1e60  # squared areas of larger tools overflow

# Without a handler, Python prints trimesh's warnings (of textures, for example) on stderr with a traceback.
logging.getLogger("trimesh").addHandler(logging.NullHandler())


@dataclass(frozen=True, slots=True, eq=False)
class MeshFrame:
    """A point p of the file lies at rotation (p - origin) scale in the tool frame [m].

    `scale`: metres per mesh unit; 0 until a file's own unit is known. `origin`: where the tool frame's origin lies, in
    mesh-file coordinates and units, shape [3]. `rotation`: columns are the file's axes in the tool frame, shape [3, 3].
    """

    scale: float
    origin: Array
    rotation: Array

    @classmethod
    def checked(
        cls, scale: float, origin: Sequence[float], quaternion: Sequence[float]
    ) -> "MeshFrame":
        """From `mesh.scale`, `mesh.origin` and `mesh.quaternion`. Raises ValueError that names the parameter."""
        unit = number("mesh.scale", scale, least=0.0)
        shift = numbers("mesh.origin", origin, rows=3)
        components = numbers("mesh.quaternion", quaternion, rows=4)
        turn = unit_quaternion(*components.tolist())
        if turn is None:
            raise InputError(
                f"mesh.quaternion is {components.tolist()}, of norm {np.linalg.norm(components):g}; it must be 1"
            )
        return cls(unit, shift, rotation_matrix(turn))

    def for_file(self, declared_unit: float | None) -> "MeshFrame":
        """The frame with the unit [m] that a file declares, or None, in place of a scale of 0."""
        return self if self.scale > 0.0 else replace(self, scale=declared_unit or _DEFAULT_UNIT_M)

    def placed(self, points: Array) -> Array:
        """Points of the file, shape [n, 3], in the tool frame [m]."""
        return (points - self.origin) * self.scale @ self.rotation.T


IN_TOOL_FRAME = MeshFrame(1.0, np.zeros(3), np.eye(3))
"""The frame of a mesh whose vertices are in the tool frame [m] already."""


def read_mesh(
    path: Path, frame: MeshFrame, *, link: str = ""
) -> tuple["trimesh.Trimesh", MeshFrame]:
    """Read an STL (binary, ASCII), OBJ, PLY, GLB or DAE file, or a link of a URDF, and place it in the tool frame.

    The coordinates of a link are those of its frame, in metres. A frame without a scale takes the unit that the file
    declares; the second result has the scale that was used. Up-axes declared in the file are ignored. A scene becomes
    one mesh with its transforms applied. Facets keep their winding. Raises InputError that names the file or
    `mesh.origin`.
    """
    loaded = _load_link(path, link) if path.suffix.lower() in ROBOT_SUFFIXES else _load(path)
    frame = frame.for_file(_declared_unit(loaded))
    return _in_tool_frame(loaded.vertices, loaded.faces, path, frame), frame


def _declared_unit(mesh: "trimesh.Trimesh") -> float | None:
    """The unit [m] that a COLLADA or glTF file declares; None if a file declares none, or one without a length."""
    from trimesh.units import unit_conversion

    try:
        unit = unit_conversion(mesh.units or "", "meters")
    except (KeyError, ValueError):
        return None
    return unit if math.isfinite(unit) and unit > 0.0 else None


def _load_link(urdf: Path, link: str) -> "trimesh.Trimesh":
    """The shapes of a link as one mesh, in the link's frame [m]."""
    import trimesh

    parts = []
    for shape in shapes_of_link(urdf, link):
        if isinstance(shape.source, Path):
            part = _load(shape.source)
            # files that declare no unit are in metres, as in RViz and Gazebo
            part.apply_scale(_declared_unit(part) or 1.0)
        else:
            part = trimesh.Trimesh(**trimesh.triangles.to_kwargs(shape.source))
        parts.append(part.apply_transform(shape.to_link))  # a mirror keeps the facets outward
    link_mesh = trimesh.util.concatenate(parts)
    link_mesh.units = "meters"
    return link_mesh


def _parts_of_glb(data: bytes) -> int:
    """Number of nodes in the scene of a GLB file; many nodes may repeat one mesh. 0 for a damaged file."""
    try:
        end = 20 + int.from_bytes(data[12:16], "little")
        return len(json.loads(data[20:end])["nodes"])
    except (ValueError, LookupError, TypeError, RecursionError):
        return 0


def _load(path: Path) -> "trimesh.Trimesh":
    """The mesh of a file, in the file's coordinates and units. Raises InputError that names the file."""
    name = f"mesh file '{path}'"
    suffix = path.suffix.lower()
    data = read_file(checked_mesh(path), "mesh file")
    if suffix not in _SUFFIXES:
        suffixes = ", ".join([*_SUFFIXES, ".urdf#LINK"])
        raise InputError(f"{name} has no supported suffix; these are {suffixes}")
    parts = _parts_of_glb(data) if suffix == ".glb" else 0
    if parts > _MAX_PART_COUNT:
        raise InputError(
            f"{name} has {parts:,} parts; the limit is {_MAX_PART_COUNT:,}; export it as one mesh"
        )
    try:
        mesh = _parsed(data, suffix)
    except ImportError as error:
        raise InputError(
            f"{name} needs a package ({error}; for .dae: pip install pycollada)"
        ) from None
    except Exception:  # each reader raises its own errors, and some quote the file
        raise InputError(
            f"{name} is not a valid {suffix[1:].upper()} file: "
            "it may be empty, cut short or without facets"
        ) from None
    if len(mesh.faces) > _MAX_FACET_COUNT:
        raise InputError(
            f"{name} has {len(mesh.faces):,} facets; the limit is {_MAX_FACET_COUNT:,}"
        )
    folds = _folds(mesh) if suffix in _POLYGONS else 0
    if folds > 0:
        raise InputError(
            f"{name} "
            f"has facets folded onto each other at {folds:,} edges, as readers divide concave polygons; "
            "export it with triangles only"
        )
    return mesh


def _parsed(data: bytes, suffix: str) -> "trimesh.Trimesh":
    """The mesh in a file's bytes. Raises what its reader raises, and ValueError for facets without vertices."""
    import trimesh

    is_binary_stl = len(data) == 84 + 50 * int.from_bytes(data[80:84], "little")
    if suffix in (".obj", ".stl") and not is_binary_stl:
        # trimesh needs another package for text that is not UTF-8, such as a name or a comment
        data = data.decode(errors="replace").encode()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        # numpy before 2.3 only warns about a word among the numbers
        warnings.filterwarnings("error", message="string or file could not be read")
        mesh = trimesh.load(
            io.BytesIO(data),
            file_type=suffix[1:],
            force="mesh",
            process=False,
            skip_materials=True,
            maintain_order=True,
        )
    are_vertices = mesh.faces.min() >= 0 and mesh.faces.max() < len(mesh.vertices)
    if mesh.vertices.shape[1] != 3 or not are_vertices:
        raise ValueError
    return mesh


def _folds(mesh: "trimesh.Trimesh") -> int:
    """Number of edges at which a facet lies on its neighbour, without slivers and the two sides of a sheet."""
    a, b = mesh.face_adjacency.T
    corners = np.sort(mesh.faces, axis=1)
    is_sheet = (corners[a] == corners[b]).all(axis=1)
    smaller = np.minimum(mesh.area_faces[a], mesh.area_faces[b])
    is_sliver = smaller < _SLIVER_AREA_RATIO * mesh.area_faces.max()
    is_folded = mesh.face_adjacency_angles > _FOLD_ANGLE_RAD
    return int((is_folded & ~is_sheet & ~is_sliver).sum())


def _in_tool_frame(
    corners: Array, faces: NDArray[np.int64], path: Path, frame: MeshFrame
) -> "trimesh.Trimesh":
    import trimesh

    is_bad = ~(np.abs(corners) < _MAX_SIZE_M / frame.scale).all(axis=1)  # NaN, too
    if is_bad.any():
        raise InputError(
            f"mesh file '{path}' has {is_bad.sum():,} of {len(corners):,} vertices that are NaN or infinite"
        )
    farthest = _MAX_ORIGIN_RATIO * np.abs(corners).max()
    if not (np.abs(frame.origin) <= farthest).all():
        raise InputError(
            f"mesh.origin is {frame.origin.tolist()}; it must be "
            f"near mesh file '{path}', in its units (within {_MAX_ORIGIN_RATIO:,.0f} times its farthest vertex)"
        )
    mesh = trimesh.Trimesh(frame.placed(corners), faces, process=False)
    with_area(mesh, f"mesh file '{path}' at mesh.scale {frame.scale}")
    return mesh

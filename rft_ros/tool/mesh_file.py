"""Mesh files: find the file, read its mesh, and place it in the tool frame, in metres."""

import io
import logging
import math
import re
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote, urlsplit

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError, file_errors
from rft_ros.files import checked_file, read_file
from rft_ros.installation import share_directory
from rft_ros.tool.check import degenerate_facets
from rft_ros.tool.reduced_file import SUFFIX as REDUCED
from rft_ros.tool.reduced_file import read_reduced

if TYPE_CHECKING:
    import trimesh

__all__ = ["MAX_FACETS", "is_mesh_path", "locate_mesh", "read_mesh"]

MAX_FACETS = 2_000_000
"""The most facets that a mesh may have."""

_SUFFIXES = (".stl", ".obj", ".ply", ".glb", ".dae")
# trimesh starts another mesh at these lines, which reorders the facets and drops those with NaN.
_SEAMS = {".obj": rb"usemtl [^\n]*", ".stl": rb"(?i)endsolid[^\n]*\n\s*solid[^\n]*"}

_PLY_CORNERS = ("vertex_indices", "vertex_index")
_FLAT = 1e-6  # of a polygon's largest triangle: the area of an inverted one that rounding may explain
_TOO_BIG = 1e60  # beyond this, squared areas overflow

_SCHEMES = "package://", "file://"

# Without a handler, Python prints trimesh's warnings (of textures, for example) on stderr with a traceback.
logging.getLogger("trimesh").addHandler(logging.NullHandler())


def is_mesh_path(file: str) -> bool:
    """Whether `mesh.file` is a path: neither a package:// or file:// URI nor a shipped mesh's name."""
    return not file.startswith(_SCHEMES) and file != Path(file).stem


def locate_mesh(file: str) -> Path:
    """The mesh file that `mesh.file` means: a path, a package://PACKAGE/PATH or file:///PATH URI or a shipped mesh.

    A bare word, without folder or suffix, is always a shipped mesh. `read_mesh` checks that the file exists.
    Raises InputError for an unknown package or name.
    """
    if file.startswith(_SCHEMES):
        uri = urlsplit(file)
        if uri.scheme == "package":
            with file_errors(f"mesh.file '{file}'", "read"):
                return share_directory(uri.netloc) / unquote(uri.path[1:])
        if uri.netloc not in ("", "localhost"):
            raise InputError(f"mesh.file '{file}' is on another machine, '{uri.netloc}'; write file:///PATH")
        return Path(unquote(uri.path))
    if not is_mesh_path(file):
        shipped = {p.stem: p for p in sorted((share_directory("rft_ros") / "meshes").glob("*.stl"))}
        if file in shipped:
            return shipped[file]
        raise InputError(
            f"mesh.file '{file}' is not a shipped mesh ({', '.join(shipped)}); "
            f"give one of these, a path with suffix or a {' or '.join(_SCHEMES)} URI"
        )
    with file_errors(f"mesh.file '{file}'", "read"):
        return Path(file).expanduser()


def read_mesh(path: Path, *, scale: float, origin: Sequence[float]) -> "trimesh.Trimesh":
    """Read an STL (binary, ASCII), OBJ, PLY, GLB or DAE file, or a reduced tool's full mesh.

    Vertices become (vertices - origin) * scale.

    `scale`: metres per mesh unit; units and up-axes declared in the file are ignored. `origin`: where the tool
    frame's origin lies, in mesh-file coordinates and units, shape [3]. A scene becomes one mesh with its transforms
    applied. Facets keep their order and winding; none is dropped or repaired (but pycollada reads NaN in DAE as 0).
    Raises InputError that names the file, or `mesh.scale` or `mesh.origin` with its value.
    """
    _check_placement(scale, origin)
    if path.suffix.lower() == REDUCED:
        reduced = read_reduced(path)
        return _in_tool_frame(reduced.vertices, reduced.faces, path, scale, origin)
    checked_file(path, "mesh file")  # a folder has no suffix either
    if path.suffix.lower() not in _SUFFIXES:
        raise InputError(f"mesh file '{path}' has no supported suffix; these are {', '.join((*_SUFFIXES, REDUCED))}")
    data = read_file(path, "mesh file")
    if not data:
        raise InputError(f"mesh file '{path}' is empty")
    loaded = _load(data, path)
    if len(getattr(loaded, "faces", ())) == 0:  # a point cloud has no attribute `faces`
        raise InputError(
            f"mesh file '{path}' has no facets: it is empty, cut short or not a valid {path.suffix[1:].upper()} file"
        )
    if len(loaded.faces) > MAX_FACETS:
        raise InputError(f"mesh file '{path}' has {len(loaded.faces):,} facets; the limit is {MAX_FACETS:,}")
    if loaded.vertices.shape[1] != 3:
        raise InputError(f"mesh file '{path}' has vertices with {loaded.vertices.shape[1]} coordinates instead of 3")
    if loaded.faces.min() < 0 or loaded.faces.max() >= len(loaded.vertices):
        raise InputError(f"mesh file '{path}' has facets with vertices that are not in it")
    if overlapping := sum(map(_overlapping_fans, _polygons(data, path, loaded))):
        raise InputError(
            f"mesh file '{path}' has {overlapping:,} concave polygons, which would become facets that overlap;"
            " export it with triangles only"
        )
    return _in_tool_frame(loaded.vertices, loaded.faces, path, scale, origin)


def _polygons(data: bytes, path: Path, loaded: "trimesh.Trimesh") -> Iterator[NDArray[np.float64]]:
    """Corners of the polygons with n corners that a file has, for each n over 3; shape [k, n, 3], any unit."""
    groups: list[tuple[Any, Any]] = []  # points and indices
    suffix = path.suffix.lower()
    if suffix == ".obj":
        text = data.replace(b"\\\n", b"")
        lines = re.findall(rb"(?m)^\s*f((?:[ \t]+[^\s#]+){4,})", text)
        rows = re.findall(rb"(?m)^\s*v\s+(\S+\s+\S+\s+\S+)", text) if lines else []
        points = np.array(b" ".join(rows).split(), dtype=np.float64).reshape(-1, 3)
        groups = [(points, [[int(corner.split(b"/")[0]) - 1 for corner in line.split()] for line in lines])]
    elif suffix == ".ply":
        face = loaded.metadata["_ply_raw"]["face"]["data"]
        name = next(name for name in _PLY_CORNERS if name in (face if isinstance(face, dict) else face.dtype.names))
        groups = [(loaded.vertices, face[name] if isinstance(face, dict) else face[name]["f1"])]
    elif suffix == ".dae" and re.search(b"<(polylist|polygons)[ >]", data):
        import collada  # type: ignore[import-untyped]

        meshes = collada.Collada(io.BytesIO(data), ignore=[collada.DaeError]).geometries
        lists = [p for mesh in meshes for p in mesh.primitives if isinstance(p, collada.polylist.Polylist) and len(p)]
        groups = [(p.vertex, np.split(p.vertex_index, p.polystarts[1:])) for p in lists]
    for points, polygons in groups:
        sizes = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
        for n in np.unique(sizes[sizes > 3]):
            yield points[np.array([polygons[k] for k in np.flatnonzero(sizes == n)], dtype=np.int64)]


def _overlapping_fans(corners: NDArray[np.float64]) -> int:
    """How many polygons are concave so that a fan from their first corner overlaps; corners: shape [k, n, 3]."""
    spokes = corners[:, 1:] - corners[:, :1]
    doubled = np.cross(spokes[:, :-1], spokes[:, 1:])
    along = np.einsum("kni,ki->kn", doubled, doubled.sum(axis=1))
    return int((along.min(axis=1) < -_FLAT * np.abs(along).max(axis=1)).sum())


def _check_placement(scale: float, origin: Sequence[float]) -> None:
    if not 0.0 < scale < math.inf:
        raise InputError(f"mesh.scale is {scale}; it must be a positive number")
    shift = np.asarray(origin, dtype=np.float64)
    if shift.shape != (3,) or not np.isfinite(shift).all():
        raise InputError(f"mesh.origin is {shift.tolist()}; it must be three finite numbers")


def _load(data: bytes, path: Path) -> "trimesh.Trimesh":
    import trimesh

    suffix = path.suffix.lower()
    binary_stl = len(data) == 84 + 50 * int.from_bytes(data[80:84], "little")
    if suffix in _SEAMS and not binary_stl:
        # trimesh needs another package for text that is not UTF-8, such as a name or a comment
        data = re.sub(_SEAMS[suffix], b"", data.decode(errors="replace").encode())
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            # numpy before 2.3 only warns about a word among the numbers
            warnings.filterwarnings("error", message="string or file could not be read")
            return trimesh.load(
                io.BytesIO(data),
                file_type=suffix[1:],
                force="mesh",
                process=False,
                skip_materials=True,
                maintain_order=True,
            )
    except ImportError as error:
        raise InputError(f"mesh file '{path}' needs a package ({error}; for .dae: pip install pycollada)") from None
    except Exception:  # each reader raises its own errors, and some quote the file
        raise InputError(f"mesh file '{path}' is not a valid {path.suffix[1:].upper()} file") from None


def _in_tool_frame(
    corners: NDArray[np.float64], faces: NDArray[np.int64], path: Path, scale: float, origin: Sequence[float]
) -> "trimesh.Trimesh":
    import trimesh

    with np.errstate(over="ignore", invalid="ignore"):
        vertices = (np.asarray(corners, dtype=np.float64) - np.asarray(origin, dtype=np.float64)) * scale
    bad = int((~(np.abs(vertices) < _TOO_BIG)).any(axis=1).sum())
    if bad:
        raise InputError(f"mesh file '{path}' has {bad:,} of {len(vertices):,} vertices that are NaN or infinite")
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    if degenerate_facets(mesh).all():
        raise InputError(f"mesh file '{path}' has no facet with an area, at mesh.scale {scale}")
    return mesh

"""Reduced tools as files (.npz, no pickle), which are taken wherever a mesh file is.

Arrays: `vertices` [n, 3] and `faces` [m, 3], the full mesh, for drawing and for what touches the surface first;
`plates` [7 or 14, k], `rows` of `rft_ros.rft.Plates`, with areas; `about`: JSON with the keys of `About`. Lengths are
in the mesh file's units and coordinates, so that `mesh.scale` and `mesh.origin` mean what they mean for the mesh.
"""

import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.rft import Integration, Plates
from rft_ros.tool.reduce import Reduction

__all__ = ["SUFFIX", "About", "ReducedMesh", "placed", "read_reduced", "write_reduced"]

Array = NDArray[np.float64]

SUFFIX = ".npz"
"""Of the file of a reduced tool."""

_FORMAT = "rft_ros reduced tool 1"


@dataclass(frozen=True, slots=True, kw_only=True)
class About:
    """Where a reduced tool comes from: mesh file and its SHA-256, rule, placement, scene, and what it came to."""

    mesh: str
    sha256: str
    integration: Integration
    scale: float
    origin: tuple[float, float, float]
    reduction: Reduction
    format: str = _FORMAT


@dataclass(frozen=True, slots=True, eq=False)
class ReducedMesh:
    """What the file holds, in its own units: full mesh, rows of plates, provenance."""

    vertices: Array
    faces: NDArray[np.int64]
    plates: Array
    about: About


def placed(rows: Array, scale: float, origin: Sequence[float] | Array) -> Array:
    """Rows of plates whose places p become (p - origin) * scale, as a mesh's vertices do."""
    out = rows.copy()
    out[:3] = (out[:3] - np.asarray(origin, dtype=np.float64)[:, None]) * scale
    out[6] *= scale * scale
    out[7:13] *= scale
    return out


def write_reduced(file: Path, reduced: ReducedMesh) -> None:
    """Write the file; the same content gives the same bytes. Raises InputError where it cannot be written."""
    if file.suffix.lower() != SUFFIX:
        raise InputError(f"output '{file}' must end in {SUFFIX}, so that it is known for a reduced tool")
    data = io.BytesIO()
    np.savez(
        data,
        vertices=reduced.vertices,
        faces=reduced.faces,
        plates=reduced.plates,
        about=np.array(json.dumps(asdict(reduced.about))),
    )
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data.getvalue())
    except OSError as error:
        raise InputError(f"output '{file}' cannot be written: {error.strerror}") from None


def read_reduced(file: Path) -> ReducedMesh:
    """Read what `write_reduced` wrote. Raises InputError that names the file and what is wrong with it."""
    try:
        with np.load(file, allow_pickle=False) as arrays:
            found: dict[str, Any] = {name: arrays[name] for name in ("vertices", "faces", "plates", "about")}
        about = json.loads(str(found["about"]))
        if about.get("format") != _FORMAT:
            raise ValueError(f"its format is '{about.get('format')}', not '{_FORMAT}'")
        reduction = Reduction(**about.pop("reduction"))
        about = About(**{**about, "origin": tuple(about["origin"]), "reduction": reduction})
        Plates.from_rows(found["plates"])
        return ReducedMesh(*_surface(found["vertices"], found["faces"]), found["plates"], about)
    except FileNotFoundError:
        raise InputError(f"mesh file '{file}' does not exist") from None
    except OSError as error:
        raise InputError(f"mesh file '{file}' cannot be read: {error.strerror or error}") from None
    except Exception as error:  # zip, numpy's header and JSON each fail in their own ways
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"mesh file '{file}' is no reduced tool that rft reduce wrote: {reason}") from None


def _surface(vertices: Array, faces: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    for name, array, kind in (("vertices", vertices, np.float64), ("faces", faces, np.int64)):
        if array.ndim != 2 or array.shape[1] != 3 or array.dtype != kind or not len(array):
            raise ValueError(f"{name} of shape {array.shape} and type {array.dtype} are not as they must be")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError("faces have vertices that are not in it")
    return vertices, faces

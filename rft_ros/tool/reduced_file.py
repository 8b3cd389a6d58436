"""Files of reduced tools (.npz without pickle), accepted wherever a mesh file is.

Arrays: `vertices` [n, 3] and `faces` [m, 3], the full mesh, for drawing and for the depth of the lowest point;
`plates` [7 or 14, k], as `rft_ros.rft.Plates.rows`; `about`: JSON with the format, the integration rule and the
`Reduction`, and for the record the mesh file, its SHA-256 and its placement. Lengths are in the mesh file's units and
coordinates, so `mesh.scale` and `mesh.origin` mean the same as for the mesh.
"""

import hashlib
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError, reason_of
from rft_ros.files import read_arrays, whole
from rft_ros.rft import Integration, Plates
from rft_ros.tool.reduce import Reduction

if TYPE_CHECKING:
    from rft_ros.tool.tool import Tool

__all__ = ["SUFFIX", "ReducedMesh", "placed", "read_reduced", "save_reduced"]

Array = NDArray[np.float64]

SUFFIX = ".npz"
"""Suffix of a reduced tool's file."""

_FORMAT = "rft_ros reduced tool 1"


@dataclass(frozen=True, slots=True, eq=False)
class ReducedMesh:
    """Content of a reduced tool's file, in its own units.

    `vertices`: of the full mesh, shape [n, 3]; `faces`: shape [m, 3]; `plates`: rows as `rft_ros.rft.Plates.rows`.
    """

    vertices: Array
    faces: NDArray[np.int64]
    plates: Array
    integration: Integration
    reduction: Reduction


def placed(rows: Array, scale: float, origin: Sequence[float] | Array) -> Array:
    """Rows of plates, shape [7 or 14, n], placed as `read_mesh` places vertices: (p - origin) * scale.

    `scale`: metres per mesh unit; `origin`: in mesh units, shape [3].
    """
    out = rows.copy()
    out[:3] = (out[:3] - np.asarray(origin, dtype=np.float64)[:, None]) * scale
    out[6] *= scale * scale
    out[7:13] *= scale
    return out


def save_reduced(
    file: Path, tool: "Tool", plates: Plates, reduction: Reduction, *, scale: float, origin: Sequence[float]
) -> None:
    """Write a reduced tool for `load_tool`; `scale` and `origin` are those that `tool` was loaded with.

    The same content gives the same bytes. Raises InputError where the file cannot be written.
    """
    shift = np.array(origin, dtype=np.float64)
    about = {
        "format": _FORMAT,
        "mesh": Path(tool.file).name,
        "sha256": hashlib.sha256(Path(tool.file).read_bytes()).hexdigest(),
        "integration": plates.integration,
        "scale": scale,
        "origin": shift.tolist(),
        "reduction": asdict(reduction),
    }
    data = io.BytesIO()
    np.savez(
        data,
        vertices=tool.vertices / scale + shift,
        faces=tool.faces,
        plates=placed(plates.rows, 1.0 / scale, -shift * scale),
        about=np.array(json.dumps(about)),
    )
    with whole(file) as part:
        part.write_bytes(data.getvalue())


def read_reduced(file: Path) -> ReducedMesh:
    """Read what `save_reduced` wrote. Raises InputError that names the file and what is wrong with it."""
    vertices, faces, plates, text = read_arrays(file, "mesh file", ("vertices", "faces", "plates", "about"))
    try:
        about = json.loads(str(text))
        if about.get("format") != _FORMAT:
            raise ValueError(f"its format is '{about.get('format')}', not '{_FORMAT}'")
        rule = about["integration"]
        if rule != Plates(plates).integration:
            raise ValueError(f"its plates are not for integration '{rule}'")
        return ReducedMesh(*_checked_surface(vertices, faces), plates, rule, Reduction(**about["reduction"]))
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        why = reason_of(error)
        raise InputError(f"mesh file '{file}' is not a reduced tool written by rft reduce: {why}") from None


def _checked_surface(vertices: Array, faces: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    for name, array, kind in (("vertices", vertices, np.float64), ("faces", faces, np.int64)):
        if array.ndim != 2 or array.shape[1] != 3 or array.dtype != kind or not len(array):
            raise ValueError(f"{name} of shape {array.shape} and type {array.dtype} are not [n, 3], {np.dtype(kind)}")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError("faces refer to vertices that are missing")
    return vertices, faces

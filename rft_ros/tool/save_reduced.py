"""From a tool in its frame [m] back to a file in the mesh's own units."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rft_ros.rft import Plates
from rft_ros.tool.reduce import Reduction
from rft_ros.tool.reduced_file import About, ReducedMesh, placed, write_reduced
from rft_ros.tool.tool import Tool

__all__ = ["save_reduced"]


def save_reduced(
    file: Path, tool: Tool, plates: Plates, reduction: Reduction, *, scale: float, origin: Sequence[float]
) -> None:
    """Write a tool that was loaded with `scale` and `origin`, with fewer plates, for `load_tool` to read.

    Raises InputError where the file cannot be written.
    """
    x, y, z = (float(value) for value in origin)
    shift = np.array([x, y, z])
    about = About(
        mesh=Path(tool.file).name,
        sha256=hashlib.sha256(Path(tool.file).read_bytes()).hexdigest(),
        integration=plates.integration,
        scale=scale,
        origin=(x, y, z),
        reduction=reduction,
    )
    rows = placed(plates.rows, 1.0 / scale, -shift * scale)
    write_reduced(file, ReducedMesh(tool.vertices / scale + shift, tool.faces, rows, about))

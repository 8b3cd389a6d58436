"""The union of a mesh's bodies: a surface of which grains touch all."""

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.files import whole
from rft_ros.tool.refine import welded
from rft_ros.tool.tool import Tool

if TYPE_CHECKING:
    import trimesh


def union_of(tool: Tool) -> "trimesh.Trimesh":
    """The union of the bodies of a tool's mesh, in its file's units and axes. Raises InputError."""
    named = f"mesh file '{tool.file}'"
    bodies = _bodies(tool)
    if not all(body.is_watertight and body.is_winding_consistent for body in bodies):
        raise InputError(
            f"{named} has a body whose surface is not closed, or is wound both ways; close it first"
        )
    solids = [body for body in bodies if body.volume > 0.0]
    cavities = [body for body in bodies if body.volume <= 0.0]
    for body in cavities:
        body.invert()
    if not solids:
        raise InputError(
            f"{named} is not closed, or inside out; turn its facets before the union is made"
        )
    try:
        from trimesh.boolean import difference, union

        solid = union(solids, engine="manifold")
        return difference([solid, *cavities], engine="manifold") if cavities else solid
    except ImportError:
        raise InputError("the union of bodies needs manifold3d: pip install manifold3d") from None


def _bodies(tool: Tool) -> "list[trimesh.Trimesh]":
    """The bodies of a mesh, in its file's units and axes; none if it stays open."""
    import trimesh

    points, faces = welded(tool.frame.inverse.placed(tool.vertices), tool.faces)
    bodies: list[trimesh.Trimesh] = []
    for part in _closed_parts(faces):
        bodies += trimesh.Trimesh(points, part).split(only_watertight=False, repair=False)
    return bodies


def _closed_parts(faces: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Facets from one after which the surface is closed to the next; none if it stays open.

    Files hold the bodies one after the other. Where two of them touch, four facets meet at an edge, and the order
    tells which two of these are of one body.
    """
    open_edges: Counter[tuple[int, int]] = Counter()
    ends = []
    for k, (a, b, c) in enumerate(faces.tolist(), start=1):
        for start, end in ((a, b), (b, c), (c, a)):
            edge = (min(start, end), max(start, end))
            open_edges[edge] += 1 if start < end else -1
            if open_edges[edge] == 0:
                del open_edges[edge]
        if not open_edges:
            ends.append(k)
    *closed, rest = np.split(faces, ends)
    return [] if len(rest) else closed


def write_union(file: Path, tool: Tool) -> int:
    """Write the union as STL, in the coordinates and units of the tool's file; returns its number of facets."""
    mesh = union_of(tool)
    with whole(file) as part:
        part.write_bytes(mesh.export(file_type="stl"))
    return len(mesh.faces)

"""Finds issues of a usable mesh, such as holes, winding, hollows, overlapping bodies and units, and describes each."""

from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from rft_ros.tool.refine import welded
from rft_ros.tool.solids import are_inside

if TYPE_CHECKING:
    import trimesh

__all__ = ["LARGEST", "SMALLEST", "MeshIssue", "check_mesh", "degenerate_facets"]

SMALLEST, LARGEST = 1e-3, 10.0
"""Plausible largest extents of a tool [m]: one as small as a grain, and more than the 7 m of a bulldozer's blade."""

_SMALLEST_USUAL, _LARGEST_USUAL = 5e-3, 5.0  # m; beyond them the check proposes a scale

_COLLINEAR = 1e-12  # of the longest edge squared: rounding error of the cross product of parallel edges
_CLOSED = 0.01  # greatest sum of the area vectors, over the area, of a surface that counts as closed; 0 without holes
_HOLLOW = 0.02  # of the largest extent: how far other parts may reach beyond a facet's plane
_CONCAVE_SHARE = 0.05  # of the area: a tool with a larger share in hollows is concave
_SAMPLED = 2000  # facets, and points, in the check for hollows
_COVERED_SHARE = 0.005  # of the area: more of it inside other bodies is no rounding at an edge
_COVERED_SAMPLES = 400  # points in the check for bodies in each other
_MOST_PAIRS = 10_000_000  # of a point and a facet in that check
_OUTSIDE = 1e-4  # of the largest extent: distance in front of a facet at which another body covers it

_Surface = Literal["not_closed", "inconsistent_winding", "inside_out", "duplicate_facets", "degenerate_facets"]
MeshIssue = Literal[_Surface, "overlap", "concave", "size", "far"]
"""The kinds of issues of a mesh."""


def degenerate_facets(mesh: "trimesh.Trimesh") -> NDArray[np.bool_]:
    """True for facets without area, which have no normal; shape [m]."""
    triangles = np.asarray(mesh.triangles)
    longest = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2).max(axis=1)
    return np.asarray(np.linalg.norm(np.asarray(mesh.triangles_cross), axis=1) <= _COLLINEAR * longest**2)


def check_mesh(mesh: "trimesh.Trimesh", *, scale: float = 1.0) -> dict[MeshIssue, str]:
    """Issues of a mesh in metres: a sentence by kind. At least one of its facets must have an area.

    `scale`: metres per unit of the mesh's file, which the sentence on an unusual size corrects.
    """
    import trimesh

    issues: dict[MeshIssue, str] = {}
    degenerate, volume = degenerate_facets(mesh), _volume_if_closed(mesh)
    if degenerate.any():
        issues["degenerate_facets"] = f"{degenerate.sum():,} of {len(mesh.faces):,} facets have no area: dropped"
    joined = trimesh.Trimesh(*welded(np.asarray(mesh.vertices), np.asarray(mesh.faces)), process=False)
    a, b, c = joined.faces.T
    joined.update_faces((a != b) & (b != c) & (c != a))
    open_edges = int((np.bincount(joined.edges_unique_inverse) == 1).sum())
    if open_edges:
        issues["not_closed"] = f"the surface is not closed (open edges: {open_edges:,})"
    if not joined.is_winding_consistent:
        issues["inconsistent_winding"] = "the winding is inconsistent: some facets face outward, others inward"
    elif volume < 0.0:
        volume_cm3 = f"volume {volume * 1e6:.3g} cm³"
        issues["inside_out"] = f"the surface is inside out ({volume_cm3}): its trailing facets are taken as leading"
    first = joined.faces.argmin(axis=1)[:, None]
    same_start = np.take_along_axis(joined.faces, (first + np.arange(3)) % 3, axis=1)
    repeated = len(same_start) - len(np.unique(same_start, axis=0))
    if repeated:
        issues["duplicate_facets"] = f"repeated facets, whose force counts more than once: {repeated:,}"
    covered = 0.0 if volume < 0.0 or not joined.is_winding_consistent else _covered_share(joined)
    if covered > _COVERED_SHARE:
        counted = "whose force counts although no grains touch it"
        inside = f"{100 * covered:.0f} % of the surface lies in or on other bodies of the mesh, {counted}"
        issues["overlap"] = f"{inside}; rft check-mesh --union OUT.stl writes the union of the bodies"
    share = _hollow_share(mesh, ~degenerate, outward=-1.0 if volume < 0.0 else 1.0)
    if share > _CONCAVE_SHARE:
        hollow = f"{100 * share:.0f} % of the surface lies in hollows, whose shielding the method ignores"
        issues["concave"] = f"{hollow}; rft check-mesh says whether the convex hull (mesh.hull, --hull) is better"
    extent = float(mesh.extents.max())
    step, factor = (1e-3 if extent > _LARGEST_USUAL else 1e3), 1.0
    while not _SMALLEST_USUAL <= extent * factor <= _LARGEST_USUAL:
        factor *= step
    if factor != 1.0:
        meant = f"if {extent * factor:.3g} m is meant, set mesh.scale (--scale) to {scale * factor:g}"
        issues["size"] = f"the largest extent is {extent:.3g} m at mesh.scale {scale:g}; {meant}"
    away = float(np.linalg.norm(np.clip(0.0, *mesh.bounds)))
    if away > LARGEST:
        nearer = "set mesh.origin (--origin) to the place of the tool frame's origin in the mesh file"
        issues["far"] = f"the mesh lies {away:.3g} m from the tool frame's origin; {nearer}"
    return issues


def _covered_share(mesh: "trimesh.Trimesh") -> float:
    """Share of the area that lies in or on other bodies of a mesh whose facets share vertices.

    Just in front of a facet, the winding number of the whole surface is 0 in the open, and 1 or more in another body.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from trimesh.sample import sample_surface

    pairs, facets = mesh.face_adjacency, len(mesh.faces)
    graph = coo_array((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(facets, facets))
    if connected_components(graph, directed=False)[0] < 2:
        return 0.0
    count = max(1, min(_COVERED_SAMPLES, _MOST_PAIRS // facets))
    points, sampled = sample_surface(mesh, count, seed=0)[:2]
    places = points + _OUTSIDE * float(mesh.extents.max()) * np.asarray(mesh.face_normals)[sampled]
    return float(are_inside(places, np.asarray(mesh.triangles)).mean())


def _volume_if_closed(mesh: "trimesh.Trimesh") -> float:
    """Signed volume [m³] of a closed surface, even if its facets share no vertices; 0 if it is open."""
    triangles = mesh.triangles - mesh.triangles.mean(axis=(0, 1))
    area_vectors = np.asarray(mesh.triangles_cross) / 2.0
    closed = np.linalg.norm(area_vectors.sum(axis=0)) < _CLOSED * np.linalg.norm(area_vectors, axis=1).sum()
    return float((triangles.mean(axis=1) * area_vectors).sum()) / 3.0 if closed else 0.0


def _hollow_share(mesh: "trimesh.Trimesh", used: NDArray[np.bool_], outward: float) -> float:
    """Share of the area that has other parts of the tool in front of it, whose shielding RFT ignores."""
    keep = np.flatnonzero(used)
    keep = keep[:: 1 + len(keep) // _SAMPLED]
    points = np.unique(np.asarray(mesh.vertices)[np.unique(mesh.faces)], axis=0)
    points = points[:: 1 + len(points) // _SAMPLED]
    doubled = np.asarray(mesh.triangles_cross)[keep]
    area = np.linalg.norm(doubled, axis=1)
    normal = outward * doubled / area[:, None]
    # in chunks of 64 facets: the system clears new memory, and 32 MB at once would delay the node on the same core
    farthest = np.concatenate([(part @ points.T).max(axis=1) for part in np.array_split(normal, 1 + len(normal) // 64)])
    beyond = farthest - (normal * mesh.triangles_center[keep]).sum(axis=1)
    return float(area[beyond > _HOLLOW * mesh.extents.max()].sum() / area.sum())

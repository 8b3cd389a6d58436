"""Finds issues of a usable mesh, such as holes, winding, hollows, overlapping bodies and units, and describes each."""

from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.tool.refine import welded
from rft_ros.tool.solids import are_inside

if TYPE_CHECKING:
    import trimesh

MIN_TOOL_SIZE_M = 1e-3
"""Least plausible extent of a tool: as small as a grain."""

MAX_TOOL_SIZE_M = 10.0
"""Greatest plausible extent of a tool: more than the 7 m of a bulldozer's blade."""

INCH_MM = 25.4
_MIN_USUAL_SIZE_M = 5e-3  # below, and above a thousand times as much, the check proposes a scale
_ROUNDING = np.finfo(np.float64).eps  # of the farthest coordinate

# of a facet's longest extent: rounding error of the cross product of parallel edges
_COLLINEAR_RATIO = 1e-12
# greatest sum of the area vectors, over the area, of a surface that counts as closed; 0 without holes
_OPEN_AREA_SHARE = 0.01
_HOLLOW_DEPTH_SHARE = (
    0.02  # of the largest extent: how far other parts may reach beyond a facet's plane
)
_CONCAVE_SHARE = 0.05  # of the area: a tool with a larger share in hollows is concave
_SAMPLE_COUNT = 2000  # facets, and points, in the check for hollows
_COVERED_SHARE = 0.005  # of the area: more of it inside other bodies is no rounding at an edge
_COVERED_SAMPLE_COUNT = 400  # points in the check for bodies in each other
_MAX_PAIR_COUNT = 10_000_000  # of a point and a facet in that check
# of the largest extent: distance in front of a facet at which another body covers it
_OUTSIDE_DISTANCE_SHARE = 1e-4

HULL_ADVICE = "; rft check-mesh says whether the convex hull (mesh.hull, --hull) is better"
"""The end of the sentence on a hollow tool, for all readers but that of ``rft check-mesh``."""

MeshIssue = Literal[
    "not_closed",
    "inconsistent_winding",
    "inside_out",
    "duplicate_facets",
    "degenerate_facets",
    "overlap",
    "concave",
    "size",
    "far",
]
"""The kinds of issues of a mesh."""


def with_area(mesh: "trimesh.Trimesh", named: str = "the mesh") -> NDArray[np.bool_]:
    """True for facets with an area over rounding, which have a normal; shape [m].

    Raises InputError, which calls the mesh `named`, if there is none.
    """
    triangles = mesh.triangles
    longest = np.ptp(triangles, axis=1).max(axis=1)
    doubled_areas = np.linalg.norm(mesh.triangles_cross, axis=1)
    height = _COLLINEAR_RATIO * longest + _ROUNDING * np.abs(triangles).max(axis=(1, 2))
    has_area = doubled_areas > height * longest
    if not has_area.any():
        raise InputError(
            f"{named} has no facet with an area over the rounding of its coordinates; "
            "check its unit and its distance from the origin"
        )
    return np.asarray(has_area)


def check_mesh(mesh: "trimesh.Trimesh", *, scale: float = 1.0) -> dict[MeshIssue, str]:
    """Issues of a mesh in metres: a sentence by kind. Raises InputError if no facet has an area.

    `scale`: metres per unit of the mesh's file, which the sentence on an unusual size corrects.
    """
    has_area = with_area(mesh)
    welded_mesh = _joined(mesh)
    is_consistent = welded_mesh.is_winding_consistent
    volume = _volume_if_closed(mesh)
    is_inside_out = volume < 0.0
    issues: dict[MeshIssue, str] = {}
    if not has_area.all():
        issues["degenerate_facets"] = (
            f"{(~has_area).sum():,} of {len(has_area):,} facets have no area: dropped"
        )
    open_edges = int((np.bincount(welded_mesh.edges_unique_inverse) == 1).sum())
    if open_edges:
        issues["not_closed"] = f"the surface is not closed (open edges: {open_edges:,})"
    if not is_consistent:
        issues["inconsistent_winding"] = (
            "the winding is inconsistent: some facets face outward, others inward"
        )
    elif is_inside_out:
        issues["inside_out"] = (
            f"the surface is inside out (volume {1e6 * volume:.3g} cm³): "
            "its trailing facets are taken as leading"
        )
    repeat_count = _repeated_facets(welded_mesh)
    if repeat_count:
        issues["duplicate_facets"] = (
            f"repeated facets, whose force counts more than once: {repeat_count:,}"
        )
    covered_share = _covered_share(welded_mesh) if is_consistent and not is_inside_out else 0.0
    if covered_share > _COVERED_SHARE:
        issues["overlap"] = (
            f"{100 * covered_share:.0f} % of the surface lies in or on other bodies of the mesh, "
            "whose force counts although no grains touch it; join the bodies, in CAD or as docs/where-it-fails.md does"
        )
    hollow = _HollowShare() if is_inside_out else _hollow_share(mesh, has_area)
    if hollow.of_all > _CONCAVE_SHARE:
        issues["concave"] = (
            f"{100 * hollow.of_all:.0f} % of the surface lies in hollows ({100 * hollow.below:.0f} % below"
            f" z = {1e3 * hollow.middle:.3g} mm, {100 * hollow.above:.0f} % above), whose shielding the method"
            f" ignores{HULL_ADVICE}"
        )
    unusual = _unusual_size(float(mesh.extents.max()), scale)
    if unusual:
        issues["size"] = unusual
    away = float(np.linalg.norm(np.clip(0.0, *mesh.bounds)))
    if away > MAX_TOOL_SIZE_M:
        issues["far"] = (
            f"the mesh lies {away:.3g} m from the tool frame's origin; "
            "set mesh.origin (--origin) to the place of the tool frame's origin in the mesh file"
        )
    return issues


def _joined(mesh: "trimesh.Trimesh") -> "trimesh.Trimesh":
    """The mesh with coincident vertices merged, and without the facets of which two corners become one."""
    import trimesh

    vertices, faces = welded(mesh.vertices, mesh.faces)
    is_whole = (np.diff(np.sort(faces, axis=1), axis=1) > 0).all(axis=1)
    return trimesh.Trimesh(vertices, faces[is_whole], process=False)


def _volume_if_closed(mesh: "trimesh.Trimesh") -> float:
    """Signed volume [m³] of a closed surface, even if its facets share no vertices; 0 if it is open."""
    doubled_areas = mesh.triangles_cross
    open_area = np.linalg.norm(doubled_areas.sum(axis=0))
    if open_area >= _OPEN_AREA_SHARE * np.linalg.norm(doubled_areas, axis=1).sum():
        return 0.0
    centres = mesh.triangles_center
    return float(((centres - centres.mean(axis=0)) * doubled_areas).sum()) / 6.0


def _repeated_facets(mesh: "trimesh.Trimesh") -> int:
    """Number of facets with the corners of another one, in the same order: the two sides of a sheet are not."""
    first = mesh.faces.argmin(axis=1)[:, None]
    sorted_faces = np.take_along_axis(mesh.faces, (first + np.arange(3)) % 3, axis=1)
    return len(sorted_faces) - len(np.unique(sorted_faces, axis=0))


def missing_factor(extent: float) -> float:
    """The factor by which a tool of this largest extent [m] is too small if its mesh is in another unit; 1 if usual."""
    if MIN_TOOL_SIZE_M <= extent < _MIN_USUAL_SIZE_M:
        return INCH_MM
    return float(1000.0 ** -np.floor(np.log10(extent / _MIN_USUAL_SIZE_M) / 3.0))


def _unusual_size(extent: float, scale: float) -> str:
    """A sentence on a tool of an unusual largest extent [m], with the scale that is probably meant; or ""."""
    factor = missing_factor(extent)
    if factor == 1.0:
        return ""
    return (
        f"the largest extent is {extent:.3g} m at mesh.scale {scale:g}; "
        f"if {extent * factor:.3g} m is meant, set mesh.scale (--scale) to {scale * factor:g}"
    )


def _covered_share(mesh: "trimesh.Trimesh") -> float:
    """Share of the area that lies in or on other bodies of a mesh whose facets share vertices.

    Just in front of a facet, the winding number of the whole surface is 0 in the open, and 1 or more in another body.
    """
    from trimesh.graph import connected_component_labels
    from trimesh.sample import sample_surface

    facets = len(mesh.faces)
    if not facets:  # all collapsed as their vertices were joined
        return 0.0
    if connected_component_labels(mesh.face_adjacency, node_count=facets).max() == 0:
        return 0.0
    count = max(1, min(_COVERED_SAMPLE_COUNT, _MAX_PAIR_COUNT // facets))
    points, faces = sample_surface(mesh, count, seed=0)[:2]
    distance = _OUTSIDE_DISTANCE_SHARE * float(mesh.extents.max())
    places = points + distance * mesh.face_normals[faces]
    return float(are_inside(places, mesh.triangles).mean())


class _HollowShare(NamedTuple):
    """Share of the area that lies in hollows: of all, and of that below and above the `middle` of the heights [m].

    Also a shank lies in a hollow if the tool's end is wider. The share of the end says what the grains meet.
    """

    of_all: float = 0.0
    below: float = 0.0
    above: float = 0.0
    middle: float = 0.0


def _hollow_share(mesh: "trimesh.Trimesh", is_used: NDArray[np.bool_]) -> _HollowShare:
    """Share of the area that has other parts of the tool in front of it, whose shielding RFT ignores."""
    used_facets = np.flatnonzero(is_used)
    keep = used_facets[:: 1 + len(used_facets) // _SAMPLE_COUNT]
    vertices = np.unique(mesh.vertices[np.unique(mesh.faces)], axis=0)
    points = vertices[:: 1 + len(vertices) // _SAMPLE_COUNT]
    normal = mesh.face_normals[keep]
    area = mesh.area_faces[keep]
    # in chunks of 64 facets: the system clears new memory, and 32 MB at once would delay the node on the same core
    chunks = np.array_split(normal, 1 + len(normal) // 64)
    farthest = np.concatenate([(chunk @ points.T).max(axis=1) for chunk in chunks])
    center = mesh.triangles_center[keep]
    protrusion = farthest - (normal * center).sum(axis=1)
    is_hollow = protrusion > _HOLLOW_DEPTH_SHARE * mesh.extents.max()
    middle = float(mesh.bounds[:, 2].mean())
    is_below = center[:, 2] < middle

    def share_of(part: NDArray[np.bool_]) -> float:
        whole = area[part].sum()
        return float(area[part & is_hollow].sum() / whole) if whole > 0.0 else 0.0

    return _HollowShare(
        of_all=share_of(np.ones_like(is_below)),
        below=share_of(is_below),
        above=share_of(~is_below),
        middle=middle,
    )

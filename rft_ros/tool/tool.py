"""A tool: the plates of a mesh, and the mesh to draw it."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.rft import (
    INTEGRATIONS,
    LEVEL,
    QUATERNION,
    STATE,
    Integration,
    Plates,
    frames,
)
from rft_ros.rft.arguments import number
from rft_ros.tool.check import HULL_ADVICE, MeshIssue, check_mesh, with_area
from rft_ros.tool.locate import link_in, locate_mesh
from rft_ros.tool.mesh_file import IN_TOOL_FRAME, MeshFrame, read_mesh
from rft_ros.tool.reduction_cache import reduced_once
from rft_ros.tool.refine import doubled_areas, refined_plates
from rft_ros.tool.solids import convex_hull

if TYPE_CHECKING:
    import trimesh

_MAX_HEIGHT_COUNT = 1_000_000  # of corners that are computed at once: 8 MB
_AREA_ROUNDING_RATIO = 1e-4  # relative difference of areas that is rounding


@dataclass(frozen=True, slots=True, eq=False)
class Tool:
    """A rigid tool in its own frame [m].

    `name`: the mesh file's name without suffix. `file`: its path. `frame`: where its coordinates lie. `plates`: the
    plates whose wrenches are summed. `facets`: one plate for each face, in the same order; if the tool was not reduced,
    this is the same object as `plates`. `vertices`: shape [n, 3]. `faces`: indices of vertices, shape [m, 3],
    counter-clockwise seen from outside. `issues`: what is wrong with the mesh, a sentence for each kind. `corners`:
    vertices of the convex hull, shape [k, 3]. `reduction`: a sentence that says how `plates` were made from `facets`;
    "" if the tool was not reduced.
    """

    name: str
    file: str
    plates: Plates
    facets: Plates
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    issues: dict[MeshIssue, str]
    corners: NDArray[np.float64]
    frame: MeshFrame = IN_TOOL_FRAME
    reduction: str = ""

    @property
    def faults(self) -> list[str]:
        """The sentences on what is wrong with the mesh. Concavity is no fault: many good tools are concave."""
        return [issue for kind, issue in self.issues.items() if kind != "concave"]

    @property
    def bounds(self) -> NDArray[np.float64]:
        """The least and the greatest coordinates [m], shape [2, 3]."""
        return np.array([self.corners.min(axis=0), self.corners.max(axis=0)])

    @property
    def size(self) -> float:
        """Largest extent along an axis of the tool frame [m]."""
        return float(np.ptp(self.corners, axis=0).max())

    @property
    def width(self) -> float:
        """Middle extent along an axis of the tool frame [m]: the diameter of a rod, the shorter side of a plate."""
        return float(np.median(np.ptp(self.corners, axis=0)))

    @property
    def middle(self) -> frames.Vector:
        """Middle of the tool's extents, in the tool frame [m]."""
        x, y, z = self.bounds.mean(axis=0).tolist()
        return x, y, z

    def reduced(self, tolerance: float) -> "Tool":
        """The same with as few plates as a `tolerance` over 0 allows, as for `load_tool`; itself if it was reduced."""
        if self.reduction:
            return self
        plates, reduction = reduced_once(self.facets, self.corners, tolerance)
        return replace(self, plates=plates, reduction=reduction)

    def lowest_point(
        self, rotation: NDArray[np.float64], slope: tuple[float, float] = LEVEL
    ) -> float:
        """Height of the tool's lowest point above the tool frame's origin [m], along world z; negative if below.

        `rotation`: from the tool to the world frame, shape [3, 3]. `slope`: dz/dx and dz/dy of a plane through the
        origin. Heights are measured from this plane, and the lowest point is the one of least height.
        """
        x, y, z = rotation
        return float((self.corners @ (z - slope[0] * x - slope[1] * y)).min())

    def lowest_points(
        self, states: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """World z of the lowest point [m] and its downward velocity [m/s], shape [n] each.

        `states`: shape [n, 13], columns `rft_ros.rft.STATE`.
        """
        parts = 1 + len(states) * len(self.corners) // _MAX_HEIGHT_COUNT
        blocks = [self._lowest(part) for part in np.array_split(states, parts)]
        heights, sinking = np.concatenate(blocks, axis=1)
        return heights, sinking

    def _lowest(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """World z and downward velocity of the lowest point, shape [2, n]."""
        column = dict(zip(STATE, states.T, strict=True))
        axes = np.array(frames.rotation(*states[:, QUATERNION].T)).T.reshape(-1, 3, 3)
        lowest = self.corners[(axes[:, 2] @ self.corners.T).argmin(axis=1)]
        x, y, z = np.einsum("nij,nj->in", axes, lowest)
        sinking = column["wy"] * x - column["wx"] * y - column["vz"]
        return np.array([column["pz"] + z, sinking])


def load_tool(
    file: str | PathLike[str],
    *,
    scale: float = 0.0,
    origin: Sequence[float] = (0.0, 0.0, 0.0),
    quaternion: Sequence[float] = (0.0, 0.0, 0.0, 1.0),
    hull: bool = False,
    integration: Integration = "refined",
    tolerance: float = 0.0,
) -> Tool:
    """Load a tool from a mesh file or a link of a robot (``robot.urdf#link``).

    `file`: a path, package:// URI or name of a shipped mesh. `scale`: metres per mesh unit; 0 takes the unit that the
    file declares (COLLADA, glTF), and a millimetre for other files. `origin`: where the tool frame's origin lies, in
    mesh-file coordinates and units. `quaternion`: orientation of the mesh file's axes in the tool frame, xyzw. `hull`:
    take the convex hull of the mesh. `integration`: the integration rule. `tolerance`: 0 keeps all plates. Over 0, a
    mesh is reduced to the fewest plates whose wrench deviates from that of the full tool by at most this share, in
    95 % of random motions. Normals come from the winding of the facets. Facets without area are dropped. Raises
    InputError or ValueError, with one sentence, for a file or a value that cannot be used.
    """
    from scipy.spatial import QhullError

    if integration not in INTEGRATIONS:
        raise InputError(
            f"integration is '{integration}'; it must be one of {', '.join(INTEGRATIONS)}"
        )
    path = locate_mesh(file)
    frame = MeshFrame.checked(scale, origin, quaternion)
    link = link_in(file)
    name = Path(link or path.stem).name
    source = f"{path}#{link}" if link else str(path)
    mesh, frame_of_file = read_mesh(path, frame, link=link)
    if hull:
        name = f"{name} (convex hull)"
        try:
            mesh = convex_hull(mesh.vertices[np.unique(mesh.faces)])
        except QhullError:
            raise InputError(
                f"mesh file '{path}' lies in a plane and has no convex hull; unset mesh.hull"
            ) from None
    return tool_of_mesh(
        mesh,
        name=name,
        file=source,
        frame=frame_of_file,
        integration=integration,
        tolerance=tolerance,
    )


def tool_of_mesh(
    mesh: "trimesh.Trimesh",
    *,
    name: str,
    file: str = "",
    frame: MeshFrame = IN_TOOL_FRAME,
    integration: Integration = "refined",
    tolerance: float = 0.0,
) -> Tool:
    """Make a tool from a mesh in memory, whose vertices are in the tool frame [m]; arguments as for `load_tool`.

    `frame`: where the coordinates of `file` lie.
    """
    from scipy.spatial import ConvexHull, QhullError

    if not 0.0 <= number("tolerance", tolerance) <= 1.0:
        raise InputError(
            f"tolerance is {tolerance:g}; it must lie between 0 (the full tool) and 1"
        )
    vertices = np.array(mesh.vertices, dtype=np.float64)
    faces = np.array(mesh.faces, dtype=np.int64)[with_area(mesh)]
    plates_of = refined_plates if integration == "refined" else centroid_plates
    facets = plates_of(vertices, faces)
    corners = np.unique(vertices[np.unique(faces)], axis=0)
    with suppress(QhullError):  # they span no volume
        corners = corners[ConvexHull(corners).vertices]
    whole_tool = Tool(
        name=name,
        file=file,
        plates=facets,
        facets=facets,
        vertices=vertices,
        faces=faces,
        issues=check_mesh(mesh, scale=frame.scale),
        corners=corners,
        frame=frame,
    )
    return whole_tool.reduced(tolerance) if tolerance > 0.0 else whole_tool


def centroid_plates(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> Plates:
    """Plates for the published rule, one per face. `vertices` [m]: shape [n, 3]. `faces`: indices of them, [m, 3]."""
    triangles = vertices[faces]
    double_areas = doubled_areas(triangles)
    areas = 0.5 * np.linalg.norm(double_areas, axis=1)
    return Plates.from_arrays(triangles.sum(axis=1) / 3.0, double_areas, areas)


def describe_tool(tool: Tool) -> list[str]:
    """Lines of text that describe a tool: file, extent in the tool frame, reduction, area, volume, issues."""
    lines = [f"{tool.name} ({tool.file})", f"facets: {len(tool.facets):,}"]
    if tool.reduction:
        lines.append(f"reduced: {tool.reduction}")
    for axis, (low, high) in zip("xyz", 1e3 * tool.bounds.T, strict=True):
        lines.append(f"{axis}: {low:.3f} to {high:.3f} mm (extent {high - low:.3f} mm)")
    drop = -1e3 * tool.lowest_point(np.eye(3))
    side = "below" if drop >= 0.0 else "above"
    lines.append(
        f"lowest point: {abs(drop):.3f} mm {side} the tool frame's origin (mesh.origin, --origin)"
    )
    lines.append(f"mesh unit: {tool.frame.scale:g} m (mesh.scale, --scale)")
    facet_area = centroid_plates(tool.vertices, tool.faces).area
    area = f"area: {1e6 * facet_area:.1f} mm²"
    if abs(tool.facets.area - facet_area) > _AREA_ROUNDING_RATIO * facet_area:
        area += (
            " of facets; forces are computed with the "
            f"{1e6 * tool.facets.area:.1f} mm² of the curved surface that they approximate"
        )
    lines.append(area)
    if not {"not_closed", "inconsistent_winding"} & tool.issues.keys():
        heights = (tool.facets.centroids * tool.facets.normals).sum(axis=0)
        volume = float(heights @ tool.facets.areas) / 3.0
        lines.append(f"volume: {1e9 * volume:.1f} mm³")
    lines += [f"warning: {fault}" for fault in tool.faults]
    if "concave" in tool.issues:
        lines.append(f"note: {tool.issues['concave'].removesuffix(HULL_ADVICE)}")
    return lines

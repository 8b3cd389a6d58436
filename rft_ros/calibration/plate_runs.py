"""A plate dragged level through the grains: its forces along e1 and in the e2-E3 plane (Treers et al. 2021, IV).

A real plate has thin edges, and the one in front ploughs. As in the paper's §IV-A the force on the edges is taken off:
here it is the model's own, on all facets that are not one of the two faces.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.findings import CannotTell
from rft_ros.calibration.load_cell_weight import grain_forces
from rft_ros.calibration.regression import error_of_mean
from rft_ros.calibration.track import Track
from rft_ros.estimator import LoadCell
from rft_ros.rft import Law, Plates, wrenches
from rft_ros.rft.traction import FLAT

__all__ = ["PlateRun", "Sheet", "plate_run", "sheet_of"]

_ALIKE = np.cos(np.deg2rad(5.0))
_FACES = 0.6
"""Share of the surface that the two faces of a plate must have."""

_STEADY = 0.5
"""The last part of a run that is used: before it the grains in front are still being set in motion."""

_SHORTEST = 0.01
_SHALLOWEST = 0.005
_LEADING = np.sin(np.deg2rad(1.0))
_SIDEWAYS = np.sin(np.deg2rad(5.0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sheet:
    """A plate-like tool: outward `normal` of one face, both faces' facets, and its edges as plates of their own.

    `centers` [m], shape [n, 3], and `areas` [m²], shape [n]: of the facets of both faces, areas halved, so that they
    add up to one face.
    """

    normal: NDArray[np.float64]
    centers: NDArray[np.float64]
    areas: NDArray[np.float64]
    edges: Plates | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PlateRun:
    """Steady state of one level run.

    `beta`, `psi` [deg]: attack angle; angle between the horizontal motion and e2. `depth` of the face's centre [m];
    `load`: depth integrated over the submerged part of one face [m³], so that α = force / (ζ load). `along`: force
    against the motion's part along e1, `across`: against its part along e2, `up` [N], edges taken off; `edges`: what
    was taken off along e1 and e2 [N]. `along_error`, `across_error`: standard errors of `along` and `across`, that of
    the load cell's zero included.
    """

    bag: str
    beta: float
    psi: float
    depth: float
    load: float
    along: float
    across: float
    up: float
    along_error: float
    across_error: float
    edges: tuple[float, float]


def sheet_of(plates: Plates, name: str) -> Sheet:
    """The faces and edges of a plate; CannotTell if two parallel faces do not make up most of the tool's surface."""
    normals, areas = plates.packed[3:6].T, plates.packed[6]
    # the direction that most of the area faces, one way or the other
    largest = np.argsort(-areas, kind="stable")[:64]
    normal = normals[largest[np.argmax(areas @ (np.abs(normals @ normals[largest].T) > _ALIKE))]]
    cosines = normals @ normal
    face, back = cosines > _ALIKE, cosines < -_ALIKE
    share = float(areas[face | back].sum() / areas.sum())
    if share < _FACES:
        raise CannotTell(
            f"{name} is no plate: its two largest parallel faces make up {100 * share:.0f} % of its surface;"
            f" α_y and f1, f23 need a plate with {100 * _FACES:.0f} %"
        )
    edge = ~(face | back)
    centers = plates.packed[:3].T
    return Sheet(
        normal=normal,
        centers=centers[~edge],
        areas=0.5 * areas[~edge],
        edges=Plates.from_arrays(centers[edge], normals[edge], areas[edge]) if edge.any() else None,
    )


def _leading(edges: Plates | None, velocity: NDArray[np.float64]) -> Plates | None:
    """Those edges that clearly lead at a velocity in tool axes, shape [3]; None without any.

    Along the others the plate slides, and by the leading-edge rule rounding would decide whether they push.
    """
    if edges is None:
        return None
    rows = edges.packed[:, velocity @ edges.packed[3:6] > _LEADING * np.linalg.norm(velocity)]
    return Plates.from_arrays(rows[:3].T, rows[3:6].T, rows[6]) if rows.size else None


def plate_run(
    track: Track,
    rows: NDArray[np.int64],
    sheet: Sheet,
    cell: LoadCell,
    law: Law,
    *,
    surface: float,
    force_error: float = 0.0,
) -> PlateRun:
    """The steady forces of one level run; `law` with the ζ that the edges' force is computed with.

    Raises CannotTell for a run that is too short or shallow, and for a horizontal plate, which has no e1 of its own.
    """
    path = np.linalg.norm(np.diff(track.states[rows, :2], axis=0), axis=1).cumsum()
    length = float(path[-1])
    steady = rows[1:][path >= (1.0 - _STEADY) * length]
    rotation = track.rotations()[steady]
    depths = surface - track.states[steady, 2, None] - rotation[:, 2] @ sheet.centers.T
    depth = float((depths @ sheet.areas).mean() / sheet.areas.sum())
    if length < _SHORTEST or depth < _SHALLOWEST or len(steady) < 20:
        raise CannotTell(
            f"{track.name}: a level run of {1e3 * length:.1f} mm, {1e3 * depth:.1f} mm deep, in {len(steady)} steady"
            f" samples; it needs {1e3 * _SHORTEST:g} mm, {1e3 * _SHALLOWEST:g} mm and 20"
        )
    velocity = track.smooth_twists()[steady, :3].mean(axis=0)
    normal = (rotation @ sheet.normal).mean(axis=0)
    normal /= np.linalg.norm(normal)
    facing = float(normal[:2] @ velocity[:2] / np.linalg.norm(velocity))
    # the face in front; of a plate that moves along itself the one that looks down, so that β is 90° at most
    if (normal[2] > 0.0) if abs(facing) < _SIDEWAYS else (facing < 0.0):
        normal = -normal
    if abs(normal[2]) >= FLAT:
        raise CannotTell(f"{track.name}: the plate is horizontal (β = 0) and has no e1; tilt it")
    e2 = np.append(normal[:2], 0.0) / np.hypot(*normal[:2])
    e1 = np.array([e2[1], -e2[0], 0.0])
    ahead = np.sign(velocity @ e1) or 1.0

    measured = grain_forces(track, cell)[steady]
    edges = np.zeros_like(measured)
    ahead_of = _leading(sheet.edges, rotation.mean(axis=0).T @ velocity)
    if ahead_of is not None:
        edges = wrenches(ahead_of, law, track.smooth_states()[steady], surface_height=surface, threads=1)[:, :3]
    force = measured - edges
    along, across = -ahead * (force @ e1), -(force @ e2)
    taken_off = -float(ahead * (edges.mean(axis=0) @ e1)), -float(edges.mean(axis=0) @ e2)
    return PlateRun(
        bag=track.name,
        beta=float(np.degrees(np.arctan2(normal[2], normal[:2] @ e2[:2]) + 0.5 * np.pi)),
        psi=float(np.degrees(np.arctan2(abs(velocity @ e1), abs(velocity @ e2)))),
        depth=depth,
        load=float((np.maximum(depths, 0.0) @ sheet.areas).mean()),
        along=float(along.mean()),
        across=float(across.mean()),
        up=float(force[:, 2].mean()),
        along_error=float(np.hypot(error_of_mean(along), force_error)),
        across_error=float(np.hypot(error_of_mean(across), force_error)),
        edges=taken_off,
    )

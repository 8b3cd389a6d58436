"""α_y from a plate dragged level along e1, at several β: constant, linear in β, or a table (Treers et al. 2021, IV-B).

The force along e1 is ζ α_y f1 d A with f1(1) = 1; A is the area of one face, as in the paper. The leading edge of a
real plate also pushes grains. As in the paper's §IV-A the force on the edges is subtracted; here the model predicts it,
on all facets outside the two faces.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import (
    FittedValue,
    NotIdentifiable,
    error_of_mean,
    fit_each,
    fit_measurements,
    mean_of,
)
from rft_ros.calibration.segments import level_runs
from rft_ros.calibration.tool_weight import Sensor
from rft_ros.calibration.track import Track
from rft_ros.rft import Law, Medium, Plates, alpha_y_model, wrenches
from rft_ros.rft.traction import FLAT
from rft_ros.rft.velocity_weights import exact_f1

__all__ = ["AlphaYFit", "AlphaYModel", "PlateRun", "faces_of", "fit_alpha_y", "plate_runs"]

AlphaYModel = Literal["auto", "constant", "linear", "table"]
"""Which model of α_y to fit; "auto": linear where the slope over β is significant, else constant."""

_ALIKE = np.cos(np.deg2rad(5.0))
_FACES = 0.6  # least share of a plate's surface that its two faces make up
_STEADY = 0.5  # share of a run, at its end, that is used: earlier the force is still building up
_SHORTEST = 0.01
_SHALLOWEST = 0.005  # shortest level run, and least depth of the face's centre [m]
_LEADING = np.sin(np.deg2rad(1.0))
_SIDEWAYS = np.sin(np.deg2rad(5.0))

_ALONG = 80.0  # least ψ [deg] of a run along e1: f1 is within 1 % of 1 there
_SAME_BETA = 5.0
_BETA_SPAN = 20.0
_SURE = 3.0  # standard errors by which a slope in β must differ from 0 to be used
_LINE_ROWS = np.arange(0.0, 91.0, 15.0)  # β [deg] at which a line is written to a table


@dataclass(frozen=True, slots=True, kw_only=True)
class PlateRun:
    """Steady state of one level run.

    `beta`, `psi` [deg]: attack angle; angle between the horizontal motion and e2. `depth` of the face's centre [m].
    `load`: depth integrated over the submerged part of one face [m³], so that α = force / (ζ load). `along`: force on
    the faces along e1, against the motion [N]. `error`: its standard error [N], the load cell's zero included.
    """

    beta: float
    psi: float
    depth: float
    load: float
    along: float
    error: float


@dataclass(frozen=True, slots=True, kw_only=True)
class AlphaYFit:
    """α_y as fitted.

    `values` of the `model` with standard `errors`: α_y [N/cm³], or intercept [N/cm³] and slope [N/cm³/deg], or α_y at
    each β of `rows`. `rows`: β [deg] and α_y [N/cm³] for the node's table. `published`: the published model of the same
    form agrees within two standard errors at each measured β, so that no table is needed.
    """

    model: Literal["constant", "linear", "table"]
    values: tuple[float, ...]
    errors: tuple[float, ...]
    rows: tuple[tuple[float, float], ...]
    published: bool
    goodness: str
    runs: int

    def value(self) -> FittedValue:
        """For the record; the node takes `rows` or `model`."""
        unit = "N/cm³, N/cm³/deg" if self.model == "linear" else "N/cm³"
        goodness = self.goodness + ("; agrees with the published model" if self.published else "")
        source = f"{self.runs} level runs along e1"
        return FittedValue(f"alpha_y ({self.model})", self.values, self.errors, unit, goodness, source)


def faces_of(plates: Plates, name: str) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Outward unit normal of one face of a plate-like tool, shape [3], and which of its n facets form the faces.

    Raises NotIdentifiable, naming the tool, if two parallel faces do not make up most of its surface.
    """
    normals, areas = plates.packed[3:6].T, plates.packed[6]
    # the direction, of either sign, that most of the area faces
    largest = np.argsort(-areas, kind="stable")[:64]
    normal = normals[largest[np.argmax(areas @ (np.abs(normals @ normals[largest].T) > _ALIKE))]]
    faces = np.abs(normals @ normal) > _ALIKE
    share = float(areas[faces].sum() / areas.sum())
    if share < _FACES:
        raise NotIdentifiable(
            f"{name} is not a plate: its two largest parallel faces make up {100 * share:.0f} % of its surface;"
            f" α_y needs a plate with {100 * _FACES:.0f} %"
        )
    return normal, faces


def _plate_run(track: Track, rows: NDArray[np.int64], sensor: Sensor, law: Law, surface: float) -> PlateRun:
    """The steady force of one level run.

    Raises NotIdentifiable for a tool that is not a plate, a run that is too short or shallow, and a horizontal plate,
    which has no e1.
    """
    packed = track.tool.plates.packed
    normal, faces = faces_of(track.tool.plates, track.tool.name)
    centers, areas = packed[:3, faces], 0.5 * packed[6, faces]  # areas of both faces add up to one
    path = np.linalg.norm(np.diff(track.states[rows, :2], axis=0), axis=1).cumsum()
    length = float(path[-1])
    steady = rows[1:][path >= (1.0 - _STEADY) * length]
    rotation = track.rotations()[steady]
    depths = surface - track.states[steady, 2, None] - rotation[:, 2] @ centers
    depth = float((depths @ areas).mean() / areas.sum())
    if length < _SHORTEST or depth < _SHALLOWEST or len(steady) < 20:
        raise NotIdentifiable(
            f"{track.name}: a level run of {1e3 * length:.1f} mm, {1e3 * depth:.1f} mm deep, in {len(steady)} steady"
            f" samples; it needs {1e3 * _SHORTEST:g} mm, {1e3 * _SHALLOWEST:g} mm and 20"
        )
    velocity = track.smooth_twists()[steady, :3].mean(axis=0)
    normal = (rotation @ normal).mean(axis=0)
    normal /= np.linalg.norm(normal)
    facing = float(normal[:2] @ velocity[:2] / np.linalg.norm(velocity))
    # take the leading face; if the plate moves along itself, the face that looks down, so that β is at most 90°
    if (normal[2] > 0.0) if abs(facing) < _SIDEWAYS else (facing < 0.0):
        normal = -normal
    if abs(normal[2]) >= FLAT:
        raise NotIdentifiable(f"{track.name}: the plate is horizontal (β = 0) and has no e1; tilt it")
    e2 = np.append(normal[:2], 0.0) / np.hypot(*normal[:2])
    e1 = np.array([e2[1], -e2[0], 0.0])

    force = track.grain_forces(sensor.cell)[steady]
    velocity_in_tool = rotation.mean(axis=0).T @ velocity
    # the plate slides along its other edges, and rounding would decide whether they lead
    edges = packed[:, ~faces & (velocity_in_tool @ packed[3:6] > _LEADING * np.linalg.norm(velocity_in_tool))]
    if edges.size:
        leading = Plates.from_arrays(edges[:3].T, edges[3:6].T, edges[6])
        force = force - wrenches(leading, law, track.smooth_states()[steady], surface_height=surface, threads=1)[:, :3]
    along = -(np.sign(velocity @ e1) or 1.0) * (force @ e1)
    return PlateRun(
        beta=float(np.degrees(np.arctan2(normal[2], normal[:2] @ e2[:2]) + 0.5 * np.pi)),
        psi=float(np.degrees(np.arctan2(abs(velocity @ e1), abs(velocity @ e2)))),
        depth=depth,
        load=float((np.maximum(depths, 0.0) @ areas).mean()),
        along=float(along.mean()),
        error=float(np.hypot(error_of_mean(along), sensor.level_error())),
    )


def plate_runs(tracks: Sequence[Track], sensor: Sensor, law: Law, *, surface: float) -> list[PlateRun]:
    """The steady forces of all level runs. `law`: at the grains' ζ. `surface`: height [m].

    Raises NotIdentifiable if no run is usable.
    """
    return fit_each(
        lambda track, rows: _plate_run(track, rows, sensor, law, surface),
        [(track, rows) for track in tracks for rows in level_runs(track, surface)],
        none=f"no level run of a plate along e1 (ψ of {_ALONG:g}° or more); ψ of the runs: none",
    )


def fit_alpha_y(
    runs: Sequence[PlateRun],
    medium: Medium,
    *,
    zeta: float,
    zeta_error: float = 0.0,
    surface_error: float = 0.0,
    model: AlphaYModel = "auto",
) -> AlphaYFit:
    """Fit α_y to the runs along e1.

    `zeta_error`, `surface_error`: standard errors of ζ and of the surface height [m]; they widen the result's errors.
    `model`: "auto" is linear if β spans 20° in three or more steps and the slope is significant, else constant.

    Raises NotIdentifiable for too few runs or directions, and for an α_y that is not positive.
    """
    used = [run for run in runs if run.psi >= _ALONG]
    if not used:
        angles = ", ".join(f"{run.psi:.0f}°" for run in runs)
        raise NotIdentifiable(f"no level run of a plate along e1 (ψ of {_ALONG:g}° or more); ψ of the runs: {angles}")
    beta = np.array([run.beta for run in used])
    factor = np.array([1e-6 / (zeta * run.load * exact_f1(np.sin(np.deg2rad(run.psi)))) for run in used])
    alpha = (factor * [run.along for run in used])[:, None]
    errors = (factor * [run.error for run in used])[:, None]
    order = np.argsort(beta, kind="stable")
    steps = np.split(order, np.flatnonzero(np.diff(beta[order]) > _SAME_BETA) + 1)
    span = float(np.ptp(beta))
    if model in ("linear", "table") and (len(steps) < 2 or span < _BETA_SPAN):
        raise NotIdentifiable(
            f"the {len(used)} runs along e1 span {span:.0f}° of β in {len(steps)} steps; α_y {model} in β needs"
            f" {_BETA_SPAN:g}° and two steps"
        )
    if float(alpha.mean()) <= 0.0:
        raise NotIdentifiable(
            f"the mean α_y is {alpha.mean():.4f} N/cm³, but the grains oppose the motion; check sensor.sign,"
            " sensor.quaternion and medium.zeta (it scales the edges' force, which is subtracted)"
        )

    ones = np.ones_like(beta)
    line, r2 = fit_measurements(np.column_stack([ones, beta]), alpha, errors)
    if model == "auto":
        sure = len(steps) >= 3 and span >= _BETA_SPAN and abs(line.coefficients[1]) > _SURE * line.errors[1]
        model = "linear" if sure else "constant"
    if model == "table":
        means = [mean_of(alpha[step, 0].tolist(), errors[step, 0].tolist()) for step in steps]
        values, cov = np.array([a for a, _ in means]), np.diag([e**2 for _, e in means])
        rows = tuple(
            (round(float(beta[step].mean()), 1), max(a, 0.0)) for step, (a, _) in zip(steps, means, strict=True)
        )
        goodness = f"{len(used)} runs at {len(steps)} β"
    elif model == "linear":
        values, cov = line.coefficients, line.covariance
        rows = tuple((float(b), max(float(values[0] + values[1] * b), 0.0)) for b in _LINE_ROWS)
        goodness = f"R² {r2:.3f} over {len(used)} runs"
    else:
        flat, _ = fit_measurements(ones[:, None], alpha, errors)
        values, cov = flat.coefficients, flat.covariance
        rows = ((90.0, float(values[0])),)
        goodness = f"scatter {100 * flat.rms / values[0]:.1f} % over {len(used)} runs"
    # errors of ζ and of the surface scale all values by the same factor
    shared = float(np.hypot(zeta_error / zeta, surface_error / np.mean([run.depth for run in used])))
    cov = cov + shared**2 * np.outer(values, values)
    published = False
    if model != "table":
        at = np.column_stack([ones, beta])[:, : len(values)]
        differences = at @ (values - np.array(alpha_y_model(model, medium)))
        published = bool(np.all(np.abs(differences) <= 2.0 * np.sqrt(np.einsum("ni,ij,nj->n", at, cov, at))))
    return AlphaYFit(
        model=model,
        values=tuple(values.tolist()),
        errors=tuple(np.sqrt(np.diag(cov)).tolist()),
        rows=rows,
        published=published,
        goodness=goodness,
        runs=len(used),
    )

"""α_y from a plate dragged level along e1, at several β: constant, linear in β, or a table (Treers et al. 2021, IV-B).

The force on the faces is linear in α_y, so each run gives the α_y with which the model's force along e1 is the measured
one. Under the refined rule each face of a plate that slides along itself leads by half: together they count as the one
face of the paper. The leading edge of a real plate also pushes grains; as in §IV-A its force is subtracted, here the
model's.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import FittedValue, NotIdentifiable, fit_each, fit_linear, fit_measurements
from rft_ros.calibration.track import FEWEST, Indices, Track, level_runs
from rft_ros.rft import FORCE, POSITION, STATE, VELOCITY, Constant, Medium, Plates, Treers2021, alpha_y_model, wrenches
from rft_ros.rft.traction import FLAT
from rft_ros.tool.refine import refined_plates

__all__ = ["AlphaYFit", "AlphaYModel", "PlateRun", "faces_of", "fit_alpha_y", "plate_runs"]

AlphaYModel = Literal["auto", "constant", "linear", "table"]
"""The model of α_y to fit. "auto": linear if the slope over β is significant, otherwise constant."""

_ALIKE = np.cos(np.deg2rad(5.0))
_FACES = 0.6  # least share of a plate's surface that its two faces make up
_LEADING = np.sin(np.deg2rad(1.0))
_STEADY = 0.5  # share of a run, at its end, that is used: earlier the force is still building up
_SHORTEST, _SHALLOWEST = 0.01, 0.005  # shortest level run, and least mean depth of the plate [m]

_ALONG = 80.0  # least ψ [deg] of a run along e1: f1 is within 1 % of 1 there
_NEEDED = f"α_y needs a level run along e1, ψ of {_ALONG:g}° or more"
_SAME_BETA, _BETA_SPAN = 5.0, 20.0  # [deg]
_SURE = 3.0  # standard errors by which a slope in β must differ from 0 to be used
_LINE_ROWS = np.arange(0.0, 91.0, 15.0)  # β [deg] at which a line is written to a table


class PlateRun(NamedTuple):
    """Attack angle [deg], mean depth of the plate [m], α_y and its standard error [N/cm³] of one level run along e1."""

    beta: float
    depth: float
    alpha: float
    error: float


class AlphaYFit(NamedTuple):
    """α_y [N/cm³], or intercept and slope [N/cm³/deg], or α_y at each measured β, as fitted; and what the node takes.

    `rows`: β [deg] and α_y [N/cm³] of the node's table; empty where the published `model` agrees within two standard
    errors at each measured β.
    """

    value: FittedValue
    model: Literal["constant", "linear", "table"]
    rows: tuple[tuple[float, float], ...]


def faces_of(plates: Plates, name: str) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Outward unit normal of one face of a plate, shape [3], and which of its n facets form both.

    Raises NotIdentifiable, naming the tool, if two parallel faces do not make up most of its surface.
    """
    normals, areas = plates.normals.T, plates.areas
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


def _plate_run(track: Track, rows: Indices, law: Treers2021, surface: float, zero_error: float) -> PlateRun:
    plates = track.tool.plates
    if plates.integration != "refined":
        plates = refined_plates(track.tool.vertices, track.tool.faces)
    normal, faces = faces_of(plates, track.tool.name)
    path = np.linalg.norm(np.diff(track.states[rows, POSITION][:, :2], axis=0), axis=1).cumsum()
    steady = rows[1:][path >= (1.0 - _STEADY) * path[-1]]
    states, rotation = track.smooth[steady], track.rotations[steady].mean(axis=0)
    center = plates.centroids @ plates.areas / plates.area
    depth = surface - float(states[:, STATE.index("pz")].mean() + rotation[2] @ center)
    normal = rotation @ normal
    if abs(normal[2]) >= FLAT:
        raise NotIdentifiable(f"{track.name}: the plate is horizontal (β = 0) and has no e1; tilt it")
    e2, velocity = normal[:2] / np.hypot(*normal[:2]), states[:, VELOCITY].mean(axis=0)
    e1, speed = np.array([e2[1], -e2[0], 0.0]), float(np.linalg.norm(velocity))
    psi = float(np.degrees(np.arccos(min(abs(velocity[:2] @ e2) / speed, 1.0))))
    if path[-1] < _SHORTEST or depth < _SHALLOWEST or len(steady) < FEWEST or psi < _ALONG:
        raise NotIdentifiable(
            f"{track.name}: a level run of {1e3 * path[-1]:.1f} mm, {1e3 * depth:.1f} mm deep, at ψ = {psi:.0f}°"
            f" to the face's normal, in {len(steady)} steady samples; it needs {1e3 * _SHORTEST:g} mm,"
            f" {1e3 * _SHALLOWEST:g} mm, {_ALONG:g}° and {FEWEST}"
        )
    # the plate slides along its other edges, which the paper does not count
    edges = ~faces & (velocity @ rotation @ plates.normals > _LEADING * speed)

    def force(which: NDArray[np.bool_], law: Treers2021) -> NDArray[np.float64]:
        some = Plates(plates.rows[:, which])
        return np.asarray(wrenches(some, law, states, surface_height=surface, threads=1)[:, FORCE] @ e1)

    measured = track.forces[steady] @ e1 - (force(edges, law) if edges.any() else 0.0)
    fit = fit_linear(force(faces, replace(law, alpha_y=Constant(1.0)))[:, None, None], measured[:, None])
    return PlateRun(
        beta=float(np.degrees(np.arccos(abs(normal[2])))),
        depth=depth,
        alpha=float(fit.coefficients[0]),
        error=float(np.hypot(fit.error, fit.influence.sum() * zero_error)),
    )


def plate_runs(tracks: Sequence[Track], law: Treers2021, *, surface: float, zero_error: float) -> list[PlateRun]:
    """The usable level runs, for `law` at the grains' ζ. Raises NotIdentifiable if there are none.

    `surface`: its height [m]. `zero_error`: standard error of the load cell's zero along any axis [N].
    """
    parts = ((track, rows, law, surface, zero_error) for track in tracks for rows in level_runs(track, surface))
    return fit_each(_plate_run, parts, none=f"no level run of a plate; {_NEEDED}")


def fit_alpha_y(
    runs: Sequence[PlateRun], medium: Medium, *, shared_error: float = 0.0, model: AlphaYModel = "auto"
) -> AlphaYFit:
    """Fit α_y to the runs along e1; `shared_error`: relative standard error of ζ and the surface, which all runs share.

    Raises NotIdentifiable for too few runs or directions, and for an α_y that is not positive.
    """
    used = sorted(runs)
    beta = np.array([run.beta for run in used])
    alpha, errors = np.array([[run.alpha] for run in used]), np.array([[run.error] for run in used])
    steps = np.append(0, (np.diff(beta) > _SAME_BETA).cumsum())  # the runs' β, numbered
    count, span = int(steps[-1]) + 1, float(np.ptp(beta))
    if model in ("linear", "table") and (count < 2 or span < _BETA_SPAN):
        raise NotIdentifiable(
            f"the {len(used)} runs along e1 span {span:.0f}° of β in {count} steps; α_y {model} in β needs"
            f" {_BETA_SPAN:g}° and two steps"
        )
    if float(alpha.mean()) <= 0.0:
        raise NotIdentifiable(
            f"the mean α_y is {alpha.mean():.4f} N/cm³, but the grains oppose the motion; check sensor.sign,"
            " sensor.quaternion and medium.zeta (it scales the edges' force, which is subtracted)"
        )
    line = np.column_stack([np.ones_like(beta), beta])
    if model == "auto":
        trial = fit_measurements(line[:, None], alpha, errors)
        sure = count >= 3 and span >= _BETA_SPAN and abs(trial.coefficients[1]) > _SURE * trial.errors[1]
        model = "linear" if sure else "constant"
    design = {"constant": line[:, :1], "linear": line, "table": np.eye(count)[steps]}[model]
    fit = fit_measurements(design[:, None], alpha, errors)
    values = fit.coefficients
    covariance = fit.covariance + shared_error**2 * np.outer(values, values)
    if model == "table":
        at, found, published = (beta @ design / design.sum(axis=0)).round(1), values, False
    else:
        at, found = _LINE_ROWS, np.polyval(values[::-1], _LINE_ROWS)
        differences = design @ (values - np.array(alpha_y_model(model, medium)))
        published = bool((differences**2 <= 4.0 * np.einsum("ni,ij,nj->n", design, covariance, design)).all())
    scatter = f"scatter {100 * np.std(fit.residuals) / alpha.mean():.1f} % over {len(used)} runs"
    value = FittedValue(
        name=f"alpha_y ({model})",
        values=tuple(values.tolist()),
        errors=tuple(np.sqrt(np.diag(covariance)).tolist()),
        unit="N/cm³, N/cm³/deg" if model == "linear" else "N/cm³",
        goodness=scatter + ("; agrees with the published model" if published else ""),
        source=f"{len(used)} level runs along e1",
    )
    if published:
        return AlphaYFit(value, model, ())
    return AlphaYFit(value, "table", tuple(zip(at.tolist(), np.maximum(found, 0.0).tolist(), strict=True)))

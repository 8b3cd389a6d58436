"""The load cell's bias, the tool's mass and its centre of mass, from poses at rest in the air.

A reading is bias + sign · (weight, centre of mass × weight): linear in bias, mass, and mass times centre of mass.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import Fit, FittedValue, NotIdentifiable, fit_linear, fit_measurements
from rft_ros.calibration.track import Track, still_intervals
from rft_ros.estimator import LoadCell
from rft_ros.estimator.load_cell import GRAVITY
from rft_ros.rft import FORCE, TORQUE

__all__ = ["Sensor", "fit_tool_weight"]

_WIDEST = 30.0  # least turn of gravity in the sensor frame that separates mass from bias [deg]
_LEAST = 1e-6  # kg; a smaller mass is rounding
_SURE = 3.0  # a mass is accepted if it exceeds 0 by this many standard errors
_EXPLAINED = 0.5  # least share of the readings' variance that the mass explains
_NOTHING = 0.01  # kg; a mass near 0 with a smaller error is no mass: the driver subtracts the weight
_USUAL_MASS, _LEVER = 1.0, 0.1  # kg, m: standard deviations of a tool's mass and centre if the poses do not tell
_SPREAD = 0.15  # least RMS spread of gravity's unit vector in a second direction that identifies the centre of mass

_BIAS, _MASS, _MASS_TIMES_CENTER = slice(0, 3), 3, slice(3, 6)
"""Coefficients of the fits of forces and torques: the bias, then the mass, or the mass times its centre."""

Array = NDArray[np.float64]


class Sensor(NamedTuple):
    """The load cell. `zero_error`: standard error of its compensated force along any axis [N]; 0 if it was given."""

    cell: LoadCell
    zero_error: float = 0.0


class _Poses(NamedTuple):
    """The poses at rest in the air, m of them, in sensor axes.

    `gravity` [m/s²], shape [m, 3]. `readings`: mean of the raw reading at each pose; `errors`: the standard errors of
    these means [N], [N m], shape [m, 6].
    """

    gravity: Array
    readings: Array
    errors: Array

    @property
    def directions(self) -> Array:
        """Unit vectors of gravity, shape [m, 3]."""
        return np.asarray(self.gravity / np.linalg.norm(self.gravity, axis=1)[:, None])

    @property
    def widest(self) -> float:
        """Greatest angle between two directions of gravity [deg]."""
        return float(np.degrees(np.arccos(np.clip((self.directions @ self.directions.T).min(), -1.0, 1.0))))

    @property
    def spread(self) -> float:
        """RMS spread of gravity's unit vectors in the direction in which they spread second most."""
        around_mean = self.directions - self.directions.mean(axis=0)
        _, second, *_ = np.append(np.linalg.svd(around_mean, compute_uv=False), 0.0)
        return float(second / np.sqrt(len(self.gravity)))

    @property
    def source(self) -> str:
        """The poses in words."""
        return f"{len(self.gravity)} poses in the air, gravity turned by up to {self.widest:.1f}°"

    @property
    def of_bias(self) -> Array:
        """Columns of a design for the three numbers of a bias, shape [3 m, 3]."""
        return np.tile(np.eye(3), (len(self.gravity), 1))

    def explained(self, fit: Fit, part: slice) -> float:
        """R²: the share of the variance of one part of the readings, `FORCE` or `TORQUE`, that a fit explains."""
        observed = self.readings[:, part]
        spread = float(((observed - observed.mean(axis=0)) ** 2).sum())
        return 1.0 - float((fit.residuals**2).sum()) / spread if spread > 0.0 else 1.0


class _Mass(NamedTuple):
    """The mass as fitted, with its standard error [kg].

    `unknown`: why the poses do not determine it, empty if they do. `r2`: of the fit. `forces`: the fit of the forces,
    with the given mass if the fitted one is unknown.
    """

    value: float
    error: float
    unknown: str
    r2: float
    forces: Fit

    @property
    def in_words(self) -> str:
        """The mass in words."""
        return f"the fitted mass is {self.value:.4f} ± {self.error:.4f} kg"


def fit_tool_weight(
    tracks: Sequence[Track], cell: LoadCell, *, air: float
) -> tuple[Sensor, list[FittedValue], dict[str, str]]:
    """Fit bias, mass and centre of mass, as far as the poses above z = `air` [m] determine them.

    The reasons, by name, are those of values that stay as given. Raises NotIdentifiable if the tool never rests in the
    air, or if the fitted mass is negative.
    """
    poses = _poses_at_rest(tracks, cell, air)
    fitted: list[FittedValue] = []
    reasons: dict[str, str] = {}

    mass = _fit_mass(poses, cell)
    if mass.unknown:
        reasons["sensor.mass"] = f"{mass.unknown} (kept: {cell.mass:g} kg)"
        mass_error = 0.0
    else:
        cell = replace(cell, mass=max(mass.value, 0.0))
        mass_error = mass.error
        goodness = f"R² {mass.r2:.5f}"
        fitted.append(FittedValue("sensor.mass", (cell.mass,), (mass_error,), "kg", goodness, poses.source))

    unknown_center = _why_no_center(poses, mass)
    if unknown_center:
        reasons["sensor.center_of_mass"] = unknown_center
        weight_torques = np.cross(np.array(cell.center_of_mass), cell.sign * cell.mass * poses.gravity)
        torques = fit_measurements(poses.of_bias, poses.readings[:, TORQUE] - weight_torques, poses.errors[:, TORQUE])
    else:
        torques, center = _fit_center(poses, mass, cell.sign)
        x, y, z = center.values
        cell = replace(cell, center_of_mass=(x, y, z))
        fitted.append(center)

    bias = _bias(poses, cell, mass, torques, center_known=not unknown_center)
    fx, fy, fz, tx, ty, tz = bias.values
    zero_error = float(np.hypot(mass.forces.errors[_BIAS].max(), GRAVITY * mass_error))
    return Sensor(replace(cell, bias=(fx, fy, fz, tx, ty, tz)), zero_error), [bias, *fitted], reasons


def _poses_at_rest(tracks: Sequence[Track], cell: LoadCell, air: float) -> _Poses:
    """The poses at rest above z = `air` [m]. Raises NotIdentifiable if there are none."""
    gravity, readings, errors = [], [], []
    for track in tracks:
        steps = [_resolution(column) for column in track.readings.T]
        for rows in still_intervals(track):
            if track.heights()[rows].min() > air:
                series = track.readings[rows]
                gravity.append(track.gravity_in_sensor(cell)[rows].mean(axis=0))
                readings.append(series.mean(axis=0))
                errors.append([_error_of_rest(column, step) for column, step in zip(series.T, steps, strict=True)])
    if not gravity:
        raise NotIdentifiable("the tool never rests in the air for 0.5 s; the bias needs one such pose")
    return _Poses(np.array(gravity), np.array(readings), np.array(errors))


def _resolution(readings: Array) -> float:
    """The smallest difference of two readings, shape [n], in their unit; 0 if all are the same."""
    return float(np.diff(np.unique(readings)).min(initial=np.inf)) if np.ptp(readings) > 0.0 else 0.0


def _error_of_rest(readings: Array, resolution: float) -> float:
    """Standard error of the mean reading at rest. Noise below half of the resolution does not average its steps out."""
    error = float(fit_linear(np.ones((len(readings), 1, 1)), readings[:, None]).errors[0])
    return error if np.std(readings) > 0.5 * resolution else float(np.hypot(error, resolution / 12.0**0.5))


def _fit_mass(poses: _Poses, cell: LoadCell) -> _Mass:
    """Fit the mass and the forces of the bias. Raises NotIdentifiable if the mass is negative."""
    observed, errors = poses.readings[:, FORCE], poses.errors[:, FORCE]
    forces = fit_measurements(np.column_stack([poses.of_bias, cell.sign * poses.gravity.ravel()]), observed, errors)
    value, error, r2 = float(forces.coefficients[_MASS]), float(forces.errors[_MASS]), poses.explained(forces, FORCE)
    mass = _Mass(value, error, "", r2, forces)
    if poses.widest < _WIDEST:
        turned = f"gravity turns by {poses.widest:.1f}° in the sensor frame over {len(poses.gravity)} poses"
        mass = mass._replace(unknown=f"{turned}; it needs {_WIDEST:g}°")
    elif value < -max(_SURE * error, _LEAST):
        raise NotIdentifiable(f"{mass.in_words}: sensor.sign or sensor.quaternion is wrong")
    elif error > _NOTHING and (value <= _SURE * error or r2 < _EXPLAINED):
        needs = f"it needs {_SURE:g} times its error and R² {_EXPLAINED:g}"
        check = "check sensor.quaternion, and that nothing pulls at the tool"
        mass = mass._replace(unknown=f"{mass.in_words} (R² {r2:.3f}); {needs}: {check}")
    if mass.unknown:
        given = cell.sign * cell.mass * poses.gravity
        mass = mass._replace(forces=fit_measurements(poses.of_bias, observed - given, errors))
    return mass


def _why_no_center(poses: _Poses, mass: _Mass) -> str:
    """Why the poses do not determine the centre of mass; empty if they do."""
    if mass.unknown:
        return "mass unknown"
    if poses.spread >= _SPREAD and mass.value > max(_SURE * mass.error, _LEAST):
        return ""
    spread = f"{len(poses.gravity)} directions of gravity spread by {poses.spread:.3f} in a second direction"
    needs = f"it needs a mass over {_SURE:g} times its error and a spread of {_SPREAD:g}"
    return f"{mass.in_words}, and {spread}; {needs}"


def _fit_center(poses: _Poses, mass: _Mass, sign: float) -> tuple[Fit, FittedValue]:
    """The fit of the torques, and the centre of mass from it."""
    # columns: e_k × gravity, the torque for each component of mass times centre
    levers = sign * np.cross(np.eye(3), poses.gravity[:, None]).transpose(0, 2, 1).reshape(-1, 3)
    design = np.column_stack([poses.of_bias, levers])
    torques = fit_measurements(design, poses.readings[:, TORQUE], poses.errors[:, TORQUE])
    center = torques.coefficients[_MASS_TIMES_CENTER] / mass.value
    errors = np.hypot(torques.errors[_MASS_TIMES_CENTER], center * mass.error) / mass.value
    values, goodness = tuple(center.tolist()), f"R² {poses.explained(torques, TORQUE):.5f}"
    found = FittedValue("sensor.center_of_mass", values, tuple(errors.tolist()), "m", goodness, poses.source)
    return torques, found


def _bias(poses: _Poses, cell: LoadCell, mass: _Mass, torques: Fit, *, center_known: bool) -> FittedValue:
    """The bias, from the fits of the forces and of the `torques`; its errors include an unknown weight."""
    force_errors, torque_errors = mass.forces.errors[_BIAS], torques.errors[_BIAS]
    goodness = f"RMS {mass.forces.rms:.3f} N between poses"
    weight = _weight_in_bias(cell, mass_known=not mass.unknown)
    if weight > 0.0 and not center_known:
        torque_errors = np.hypot(torque_errors, weight * _LEVER)
        goodness += "; the bias torques include those of the weight at these attitudes"
        if mass.unknown and cell.mass == 0.0:
            force_errors = np.hypot(force_errors, weight * np.abs(poses.directions.mean(axis=0)))
            goodness += ", and the bias forces include the weight"
    values = np.concatenate([mass.forces.coefficients[_BIAS], torques.coefficients[_BIAS]])
    errors = np.concatenate([force_errors, torque_errors])
    return FittedValue("sensor.bias", tuple(values.tolist()), tuple(errors.tolist()), "N, N m", goodness, poses.source)


def _weight_in_bias(cell: LoadCell, *, mass_known: bool) -> float:
    """The weight [N] whose torques the poses do not separate from the bias: of the mass, or of a usual one."""
    if mass_known or cell.mass > 0.0:
        return cell.mass * GRAVITY
    return _USUAL_MASS * GRAVITY

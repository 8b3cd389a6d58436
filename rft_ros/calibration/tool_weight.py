"""The load cell's bias, the tool's mass and its centre of mass, from poses at rest in the air.

A reading is bias + sign · (weight, centre of mass × weight), linear in ten numbers: the bias, the mass, and the mass
times its centre. Numbers that the poses do not determine are taken as given, with an error that the bias then
includes.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import FitResults, FittedValue, NotIdentifiable, fit_linear
from rft_ros.calibration.track import Track, still_intervals
from rft_ros.diagnosis.fit import cross_matrices
from rft_ros.diagnosis.trial import resolutions
from rft_ros.errors import InputError
from rft_ros.estimator import GRAVITY
from rft_ros.parameters import LoadCell
from rft_ros.rft import FORCE, TORQUE

Array = NDArray[np.float64]

_BIAS = slice(0, 6)
_MASS = 6
_MOMENT = slice(7, 10)
"""The ten numbers: the bias [N], [N m], the mass [kg], and the mass times its centre [kg m]."""

_MAX_CENTER_ERROR_M = 0.01
"""Greatest accepted error of the centre of mass."""

_MIN_EIGENVALUE_RATIO = 1e-10
"""Least eigenvalue of the normal matrix, relative to its greatest one, whose direction the readings determine."""

_MIN_GRAVITY_TURN_DEG = 30.0
"""Least turn of gravity in the sensor frame that separates mass from bias."""

_MIN_MASS_KG = 1e-6
"""A smaller mass is rounding."""

_MIN_MASS_ERRORS_FACTOR = 3.0
"""A mass is accepted if it exceeds 0 by this many standard errors."""

_MIN_EXPLAINED_SHARE = 0.5
"""Least share of the readings' variance that the mass explains."""

_MAX_ZERO_MASS_ERROR_KG = 0.01
"""A mass near 0 with a smaller error is none: the driver subtracts the weight."""

_USUAL_MASS_KG = 1.0
_USUAL_LEVER_M = 0.1
"""Standard deviations of a tool's mass and of its centre, if the poses determine neither."""

_MAX_CENTER_DISTANCE_M = 1.0
"""A centre of mass farther from the load cell is a torque in another unit."""

_MAX_ATTITUDE_ANGLE_RAD = np.deg2rad(10.0)
"""Greatest angle between two directions of gravity in one attitude."""


def _columns_in_air(gravity: Array) -> Array:
    """What each of the ten numbers adds to a reading with the sign of a wrench on the tool, shape [n, 6, 10].

    `gravity`: in the axes of the load cell [m/s²], shape [n, 3].
    """
    columns = np.zeros((len(gravity), 6, 10))
    columns[:, :, _BIAS] = np.eye(6)
    columns[:, FORCE, _MASS] = gravity
    columns[:, TORQUE, _MOMENT] = cross_matrices(gravity)
    return columns


class _FitInAir(NamedTuple):
    """Least squares of n readings.

    `values` of the free numbers, shape [k], and their standard `errors`; `residuals`, shape [n, 6]; `inverse`, shape
    [k, n * 6], times a change of the readings is the change of the values.
    """

    values: Array
    errors: Array
    residuals: Array
    inverse: Array


def _fit_in_air(columns: Array, readings: Array, errors: Array | float = 0.0) -> _FitInAir:
    """Fit readings with these errors, shape [n, 6], or some of their axes, by columns of shape [n, 6, k].

    The variance of a reading is the greater of its axis' scatter about the fit and its own error squared.
    """
    matrix = columns.reshape(readings.size, -1)
    # by normal equations, which take a tenth of the time for thousands of readings
    inverse = (
        np.linalg.pinv(matrix.T @ matrix, rcond=_MIN_EIGENVALUE_RATIO, hermitian=True) @ matrix.T
    )
    values = inverse @ readings.ravel()
    residuals = readings - (matrix @ values).reshape(readings.shape)
    freedom = np.sum(1.0 - np.einsum("nk,kn->n", matrix, inverse).reshape(readings.shape), axis=0)
    scatter = np.sum(residuals**2, axis=0) / np.maximum(freedom, 1.0)
    variance = np.broadcast_to(np.maximum(scatter, errors**2), readings.shape).ravel()
    return _FitInAir(values, np.sqrt(inverse**2 @ variance), residuals, inverse)


class _Poses(NamedTuple):
    """The poses at rest in the air, m of them, in sensor axes.

    `gravity` [m/s²], shape [m, 3]. `readings`: mean of the reading at each pose, with the sign of a wrench on the tool;
    `errors`: the standard errors of these means [N], [N m], shape [m, 6].
    """

    gravity: Array
    readings: Array
    errors: Array

    @property
    def directions(self) -> Array:
        """Unit vectors along gravity, shape [m, 3]."""
        return self.gravity / GRAVITY

    @property
    def turned(self) -> float:
        """The greatest angle by which gravity turns in the sensor frame [deg]."""
        cosine = (self.directions @ self.directions.T).min()
        return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))

    def explained(self, residuals: Array, part: slice) -> float:
        """R²: the share of the variance of one part of the readings, `FORCE` or `TORQUE`, that a fit explains."""
        readings = self.readings[:, part]
        variance = float(((readings - readings.mean(axis=0)) ** 2).sum())
        return 1.0 - float((residuals[:, part] ** 2).sum()) / max(variance, 1e-300)


class _Mass(NamedTuple):
    """The mass that the poses show: `value` [kg] and standard `error`; `share`: its R².

    `center_error`: greatest standard error of a coordinate of its centre [m]; before it is known to `_USUAL_LEVER_M`.
    `is_negative`: by more than its errors, as of a driver that subtracts too much.
    """

    value: float
    error: float
    share: float
    center_error: float
    is_negative: bool

    def __str__(self) -> str:
        return f"the fitted mass is {self.value:.4f} ± {self.error:.4f} kg"


def _mass_of(poses: _Poses) -> _Mass:
    columns = _columns_in_air(poses.gravity)
    fit = _fit_in_air(columns, poses.readings, poses.errors)
    value = float(fit.values[_MASS])
    error = float(fit.errors[_MASS])
    is_negative = poses.turned >= _MIN_GRAVITY_TURN_DEG and value < -max(
        _MIN_MASS_ERRORS_FACTOR * error, _MIN_MASS_KG
    )
    # a fit tells no error of what it does not determine
    noise = np.sqrt(np.mean(fit.residuals**2, axis=0) + np.mean(poses.errors**2, axis=0))
    rows = (columns / np.maximum(noise, 1e-9)[:, None]).reshape(-1, 10)
    moment_error = _USUAL_LEVER_M * max(abs(value), _MIN_MASS_KG)
    prior_precision = np.zeros(10)
    prior_precision[_MOMENT] = moment_error**-2.0
    covariance = np.linalg.pinv(rows.T @ rows + np.diag(prior_precision), hermitian=True)
    center_errors = np.sqrt(np.diag(covariance)[_MOMENT]) / max(abs(value), _MIN_MASS_KG)
    # of a torque in another unit the error is in that unit, too
    distance = float(np.linalg.norm(fit.values[_MOMENT])) / max(abs(value), _MIN_MASS_KG)
    return _Mass(
        value=value,
        error=error,
        share=poses.explained(fit.residuals, FORCE),
        center_error=float(center_errors.max()) / max(1.0, distance / _MAX_CENTER_DISTANCE_M),
        is_negative=is_negative,
    )


def fit_tool_weight(result: FitResults, tracks: Sequence[Track], *, air: float) -> LoadCell:
    """Fit bias, mass and centre of mass, as far as the poses above z = `air` [m] determine them, into `result`.

    Returns the load cell. With a negative mass, the bias is that of the attitude in the grains: what is subtracted
    there is constant.

    Raises NotIdentifiable if the tool never rests in the air, or with a negative mass not in that attitude, or if a
    parameter does not take a fitted value; then nothing is fitted. Raises InputError for torques in N mm.
    """
    poses = _poses_at_rest(tracks, air)
    configured_cell = tracks[0].cell
    mass = _mass_of(poses)
    reasons = _reasons(poses, mass, configured_cell)
    is_mass_known = "sensor.mass" not in reasons
    is_center_known = "sensor.center_of_mass" not in reasons
    cell = (
        replace(configured_cell, mass=max(mass.value, 0.0)) if is_mass_known else configured_cell
    )
    if mass.is_negative:
        poses = _turned_as_in_grains(poses, tracks, air)
        if not len(poses.gravity):
            raise NotIdentifiable(reasons["sensor.mass"])

    columns = _columns_in_air(poses.gravity)
    fixed_numbers = np.zeros(10)
    fixed_errors = np.zeros(10)
    free = np.ones(10, dtype=np.bool_)
    notes = ""
    if not is_center_known:
        free[_MOMENT] = False
        fixed_numbers[_MOMENT] = cell.mass * np.array(cell.center_of_mass)
        is_none = is_mass_known and cell.mass == 0.0
        if not is_none:
            fixed_errors[_MOMENT] = _USUAL_LEVER_M * (cell.mass or _USUAL_MASS_KG)
            notes = "; the bias torques include those of the weight at these attitudes"
    if not is_mass_known:
        free[_MASS] = False
        fixed_numbers[_MASS] = cell.mass
        if cell.mass == 0.0:
            fixed_errors[_MASS] = _USUAL_MASS_KG
            notes += ", and the bias forces include the weight"
    fit = _fit_in_air(columns[:, :, free], poses.readings - columns @ fixed_numbers, poses.errors)
    propagated_errors = np.linalg.norm(
        fit.inverse @ (columns * fixed_errors).reshape(-1, 10), axis=1
    )

    source = f"{len(poses.gravity)} poses in the air, gravity turned by up to {poses.turned:.1f}°"
    scatter = float(np.sqrt(np.mean(fit.residuals[:, FORCE] ** 2)))
    fx, fy, fz, tx, ty, tz = (configured_cell.sign * fit.values[_BIAS]).tolist()
    cell = replace(cell, bias=(fx, fy, fz, tx, ty, tz))
    bias_errors = tuple(np.hypot(fit.errors, propagated_errors)[_BIAS].tolist())
    goodness = f"RMS {scatter:.3f} N between poses{notes}"
    fitted_values = [
        FittedValue("sensor.bias", cell.bias, bias_errors, "N, N m", goodness, source)
    ]
    if is_mass_known:
        share = f"R² {mass.share:.5f}"
        fitted_values.append(
            FittedValue("sensor.mass", (cell.mass,), (mass.error,), "kg", share, source)
        )
    if is_center_known:
        x, y, z = (fit.values[_MOMENT] / mass.value).tolist()
        if np.linalg.norm((x, y, z)) > _MAX_CENTER_DISTANCE_M:
            far = f"the torques in the air are those of a centre of mass at {x:.3g}, {y:.3g}, {z:.3g} m"
            advice = "the load cell's driver must give N m, and not N mm"
            raise InputError(f"{tracks[0].name}: {far}; {advice}")
        cell = replace(cell, center_of_mass=(x, y, z))
        errors = np.hypot(fit.errors[_MOMENT], np.array((x, y, z)) * mass.error) / mass.value
        share = f"R² {poses.explained(fit.residuals, TORQUE):.5f}"
        center_errors = tuple(errors.tolist())
        fitted_values.append(
            FittedValue("sensor.center_of_mass", (x, y, z), center_errors, "m", share, source)
        )
    result.fitted_values += fitted_values
    result.not_identifiable |= reasons
    return cell


def _reasons(poses: _Poses, mass: _Mass, cell: LoadCell) -> dict[str, str]:
    """Why the poses do not determine the mass or its centre, by the name of the parameter."""
    count = len(poses.gravity)
    unknown = ""
    if poses.turned < _MIN_GRAVITY_TURN_DEG:
        unknown = (
            f"gravity turns by {poses.turned:.1f}° in the sensor frame over {count} poses; it needs"
            f" {_MIN_GRAVITY_TURN_DEG:g}°"
        )
    elif mass.is_negative:
        too_much = f"the driver subtracts {-mass.value:.2g} kg more than the tool weighs (correct its payload)"
        unknown = f"{mass}: {too_much}, or sensor.sign or sensor.quaternion is wrong"
    elif mass.error > _MAX_ZERO_MASS_ERROR_KG and (
        mass.value <= _MIN_MASS_ERRORS_FACTOR * mass.error or mass.share < _MIN_EXPLAINED_SHARE
    ):
        needs = (
            f"it needs {_MIN_MASS_ERRORS_FACTOR:g} times its error and R² {_MIN_EXPLAINED_SHARE:g}"
        )
        advice = "check sensor.quaternion, and that nothing pulls at the tool"
        unknown = f"{mass} (R² {mass.share:.3f}); {needs}: {advice}"
    if unknown:
        return {
            "sensor.mass": f"{unknown} (kept: {cell.mass:g} kg)",
            "sensor.center_of_mass": "mass unknown",
        }
    is_mass_sure = mass.value > max(_MIN_MASS_ERRORS_FACTOR * mass.error, _MIN_MASS_KG)
    if is_mass_sure and mass.center_error <= _MAX_CENTER_ERROR_M:
        return {}
    center = (
        f"its centre is known to {1e3 * mass.center_error:.2g} mm by {count} directions of gravity"
    )
    needs = (
        f"it needs a mass over {_MIN_MASS_ERRORS_FACTOR:g} times its error, and {1e3 * _MAX_CENTER_ERROR_M:g} mm:"
        " turn the tool in a second direction"
    )
    return {"sensor.center_of_mass": f"{mass}, and {center}; {needs}"}


def _turned_as_in_grains(poses: _Poses, tracks: Sequence[Track], air: float) -> _Poses:
    """Those of the poses in which gravity lies in the sensor frame as it does below z = `air` [m] on the whole."""
    gravity = np.concatenate([track.cell_along.gravity[track.heights < air] for track in tracks])
    mean = gravity.mean(axis=0) if len(gravity) else np.zeros(3)
    same_attitude = poses.gravity @ mean > np.cos(_MAX_ATTITUDE_ANGLE_RAD) * GRAVITY**2
    return _Poses(*(part[same_attitude] for part in poses))


def _poses_at_rest(tracks: Sequence[Track], air: float) -> _Poses:
    """The poses at rest above z = `air` [m]. Raises NotIdentifiable if there are none."""
    poses = []
    for track in tracks:
        steps = resolutions(track.readings)
        for rows in still_intervals(track):
            if track.heights[rows].min() > air:
                gravity = track.cell_along.gravity[rows].mean(axis=0)
                poses.append((gravity, *_reading_at_rest(track, rows, steps)))
    if not poses:
        raise NotIdentifiable(
            "the tool never rests in the air for 0.5 s; the bias needs one such pose"
        )
    return _Poses(*map(np.array, zip(*poses, strict=True)))


def _reading_at_rest(
    track: Track, rows: NDArray[np.int64], steps: Array
) -> tuple[Array, list[float]]:
    """The mean reading at some rows, with the sign of a wrench on the tool, and its standard errors, shape [6] each.

    `steps`: the resolutions of the track's readings, shape [6].
    """
    series = track.readings[rows]
    errors = [
        _error_of_rest(column, resolution)
        for column, resolution in zip(series.T, steps, strict=True)
    ]
    return track.cell.sign * series.mean(axis=0), errors


def _error_of_rest(readings: Array, resolution: float) -> float:
    """Standard error of the mean reading at rest. Noise below half of the resolution does not average its steps out."""
    error = fit_linear(np.ones((len(readings), 1, 1)), readings[:, None]).error
    if np.std(readings) > 0.5 * resolution:
        return error
    return float(np.hypot(error, resolution / 12.0**0.5))

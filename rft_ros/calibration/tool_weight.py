"""The load cell's bias, the tool's mass and its centre of mass, from poses at rest in the air.

A reading is bias + sign · (weight, centre of mass × weight): linear in ten numbers, bias, mass, and mass times centre.
Those that the poses do not determine are taken as given, with an error that the bias then includes.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import FitResults, FittedValue, NotIdentifiable, fit_linear
from rft_ros.calibration.track import Track, still_intervals
from rft_ros.errors import InputError
from rft_ros.estimator import GRAVITY
from rft_ros.parameters import LoadCell
from rft_ros.rft import FORCE, TORQUE

Array = NDArray[np.float64]

_WIDEST = 30.0  # least turn of gravity in the sensor frame that separates mass from bias [deg]
_LEAST = 1e-6  # kg; a smaller mass is rounding
_SURE = 3.0  # a mass is accepted if it exceeds 0 by this many standard errors
_EXPLAINED = 0.5  # least share of the readings' variance that the mass explains
# kg; a mass near 0 with a smaller error is no mass: the driver subtracts the weight
_NOTHING = 0.01
_USUAL_MASS = 1.0  # kg: standard deviation of a tool's mass if the poses do not tell
_LEVER = 0.1  # m: the same of its centre
# m: a centre of mass that is farther from the load cell is a torque in another unit
_FARTHEST = 1.0
# greatest angle between two directions of gravity that count as one attitude
_ALIKE = np.deg2rad(10.0)
_SPREAD = 0.15  # least RMS spread of gravity's unit vector in a second direction that identifies the centre of mass

_BIAS = slice(0, 6)
_MASS = 6
_MOMENT = slice(7, 10)
"""Columns of the design: the bias, the mass, and the mass times its centre."""


class _Poses(NamedTuple):
    """The poses at rest in the air, m of them, in sensor axes.

    `gravity` [m/s²], shape [m, 3]. `readings`: mean of the raw reading at each pose; `errors`: the standard errors of
    these means [N], [N m], shape [m, 6].
    """

    gravity: Array
    readings: Array
    errors: Array

    def design(self, sign: float) -> Array:
        """What each of the ten numbers adds to the readings, shape [m, 6, 10]."""
        columns = np.zeros((len(self.gravity), 6, 10))
        columns[:, :, _BIAS] = np.eye(6)
        columns[:, FORCE, _MASS] = sign * self.gravity
        columns[:, TORQUE, _MOMENT] = sign * np.cross(np.eye(3), self.gravity[:, None]).transpose(
            0, 2, 1
        )
        return columns

    @property
    def turned(self) -> float:
        """The greatest angle by which gravity turns in the sensor frame [deg]."""
        directions = self.gravity / GRAVITY
        return float(np.degrees(np.arccos(np.clip((directions @ directions.T).min(), -1.0, 1.0))))

    @property
    def spread(self) -> float:
        """RMS spread of gravity's unit vector in the second of its directions."""
        directions = self.gravity / GRAVITY
        sizes = np.linalg.svd(directions - directions.mean(axis=0), compute_uv=False)
        return float(sizes[1] / np.sqrt(len(directions))) if len(sizes) > 1 else 0.0


class _Fit(NamedTuple):
    """Least squares of the readings at the poses.

    `values` of the free numbers, shape [k], and their standard `errors`; `residuals`, shape [m, 6]; `inverse`, shape
    [k, m * 6], times a change of the readings is the change of the values.
    """

    values: Array
    errors: Array
    residuals: Array
    inverse: Array

    def explained(self, poses: _Poses, part: slice) -> float:
        """R²: the share of the variance of one part of the readings, `FORCE` or `TORQUE`, that the fit explains."""
        observed = poses.readings[:, part]
        spread = float(((observed - observed.mean(axis=0)) ** 2).sum())
        return 1.0 - float((self.residuals[:, part] ** 2).sum()) / max(spread, 1e-300)


def _fitted(design: Array, readings: Array, errors: Array) -> _Fit:
    """Fit readings with these errors, shape [m, 6], by a design of shape [m, 6, k].

    The variance of a reading is the greater of its axis' scatter about the fit and its own error squared.
    """
    matrix = design.reshape(readings.size, -1)
    inverse = np.asarray(np.linalg.pinv(matrix), dtype=np.float64)
    values = inverse @ readings.ravel()
    residuals = readings - (matrix @ values).reshape(readings.shape)
    freedom = np.sum(1.0 - np.einsum("nk,kn->n", matrix, inverse).reshape(readings.shape), axis=0)
    scatter = np.sum(residuals**2, axis=0) / np.maximum(freedom, 1.0)
    variance = np.maximum(scatter, errors**2).ravel()
    return _Fit(values, np.sqrt(inverse**2 @ variance), residuals, inverse)


def fit_tool_weight(
    result: FitResults, tracks: Sequence[Track], *, air: float
) -> tuple[LoadCell, float]:
    """Fit bias, mass and centre of mass, as far as the poses above z = `air` [m] determine them, into `result`.

    Returns the load cell, and the standard error of its compensated force along any axis [N].

    With a negative mass, the bias is that of the attitude in the grains: what is subtracted there is constant.

    Raises NotIdentifiable if the tool never rests in the air, or with a negative mass not in that attitude, or if a
    parameter does not take a fitted value; then nothing is fitted. Raises InputError for torques in N mm.
    """
    every_pose = _poses_at_rest(tracks, air)
    given = tracks[0].cell
    whole = _fitted(every_pose.design(given.sign), every_pose.readings, every_pose.errors)
    mass = float(whole.values[_MASS])
    mass_error = float(whole.errors[_MASS])
    reasons = _reasons(every_pose, whole, given)
    is_mass_known = "sensor.mass" not in reasons
    is_center_known = "sensor.center_of_mass" not in reasons
    cell = replace(given, mass=max(mass, 0.0)) if is_mass_known else given
    poses = every_pose
    if _is_negative(every_pose, mass, mass_error):
        poses = _turned_as_in_grains(every_pose, tracks, air)
        if not len(poses.gravity):
            raise NotIdentifiable(reasons["sensor.mass"])

    design = poses.design(given.sign)
    taken = np.zeros(10)
    taken_errors = np.zeros(10)
    free = np.ones(10, dtype=np.bool_)
    notes = ""
    if not is_center_known:
        free[_MOMENT] = False
        taken[_MOMENT] = cell.mass * np.array(cell.center_of_mass)
        taken_errors[_MOMENT] = _LEVER * (
            cell.mass if cell.mass > 0.0 or is_mass_known else _USUAL_MASS
        )
        if taken_errors[_MOMENT].any():
            notes = "; the bias torques include those of the weight at these attitudes"
    if not is_mass_known:
        free[_MASS] = False
        taken[_MASS] = cell.mass
        if cell.mass == 0.0:
            taken_errors[_MASS] = _USUAL_MASS
            notes += ", and the bias forces include the weight"
    fit = _fitted(design[:, :, free], poses.readings - design @ taken, poses.errors)
    by_taken = np.linalg.norm(fit.inverse @ (design * taken_errors).reshape(-1, 10), axis=1)

    source = f"{len(poses.gravity)} poses in the air, gravity turned by up to {poses.turned:.1f}°"
    scatter = float(np.sqrt(np.mean(fit.residuals[:, FORCE] ** 2)))
    fx, fy, fz, tx, ty, tz = fit.values[_BIAS].tolist()
    bias = (fx, fy, fz, tx, ty, tz)
    bias_errors = np.hypot(fit.errors, by_taken)[_BIAS]
    goodness = f"RMS {scatter:.3f} N between poses{notes}"
    found = [
        FittedValue("sensor.bias", bias, tuple(bias_errors.tolist()), "N, N m", goodness, source)
    ]
    if is_mass_known:
        goodness = f"R² {whole.explained(poses, FORCE):.5f}"
        found.append(
            FittedValue("sensor.mass", (cell.mass,), (mass_error,), "kg", goodness, source)
        )
    if is_center_known:
        x, y, z = (fit.values[_MOMENT] / mass).tolist()
        if np.linalg.norm((x, y, z)) > _FARTHEST:
            far = f"the torques in the air are those of a centre of mass at {x:.3g}, {y:.3g}, {z:.3g} m"
            raise InputError(
                f"{tracks[0].name}: {far}; the load cell's driver must give N m, and not N mm"
            )
        cell = replace(cell, center_of_mass=(x, y, z))
        errors = np.hypot(fit.errors[_MOMENT], np.array((x, y, z)) * mass_error) / mass
        goodness = f"R² {fit.explained(poses, TORQUE):.5f}"
        found.append(
            FittedValue(
                "sensor.center_of_mass", (x, y, z), tuple(errors.tolist()), "m", goodness, source
            )
        )
    result.fitted += found
    result.not_identifiable |= reasons
    by_weight = GRAVITY * mass_error if is_mass_known else 0.0
    return replace(cell, bias=bias), float(np.hypot(fit.errors[FORCE].max(), by_weight))


def _reasons(poses: _Poses, fit: _Fit, cell: LoadCell) -> dict[str, str]:
    """Why the poses do not determine the mass or its centre, by the name of the parameter."""
    count = len(poses.gravity)
    mass = float(fit.values[_MASS])
    error = float(fit.errors[_MASS])
    share = fit.explained(poses, FORCE)
    fitted_mass = f"the fitted mass is {mass:.4f} ± {error:.4f} kg"
    unknown = ""
    if poses.turned < _WIDEST:
        unknown = f"gravity turns by {poses.turned:.1f}° in the sensor frame over {count} poses; it needs {_WIDEST:g}°"
    elif _is_negative(poses, mass, error):
        too_much = (
            f"the driver subtracts {-mass:.2g} kg more than the tool weighs (correct its payload)"
        )
        unknown = f"{fitted_mass}: {too_much}, or sensor.sign or sensor.quaternion is wrong"
    elif error > _NOTHING and (mass <= _SURE * error or share < _EXPLAINED):
        needs = f"it needs {_SURE:g} times its error and R² {_EXPLAINED:g}"
        advice = "check sensor.quaternion, and that nothing pulls at the tool"
        unknown = f"{fitted_mass} (R² {share:.3f}); {needs}: {advice}"
    if unknown:
        return {
            "sensor.mass": f"{unknown} (kept: {cell.mass:g} kg)",
            "sensor.center_of_mass": "mass unknown",
        }
    if poses.spread >= _SPREAD and mass > max(_SURE * error, _LEAST):
        return {}
    directions = (
        f"{count} directions of gravity spread by {poses.spread:.3f} in a second direction"
    )
    needs = f"it needs a mass over {_SURE:g} times its error and a spread of {_SPREAD:g}"
    return {"sensor.center_of_mass": f"{fitted_mass}, and {directions}; {needs}"}


def _is_negative(poses: _Poses, mass: float, error: float) -> bool:
    return poses.turned >= _WIDEST and mass < -max(_SURE * error, _LEAST)


def _turned_as_in_grains(poses: _Poses, tracks: Sequence[Track], air: float) -> _Poses:
    """Those of the poses in which gravity lies in the sensor frame as it does below z = `air` [m] on the whole."""
    gravity = np.concatenate([track.gravity[track.heights < air] for track in tracks])
    mean = gravity.mean(axis=0) if len(gravity) else np.zeros(3)
    alike = poses.gravity @ mean > np.cos(_ALIKE) * GRAVITY**2
    return _Poses(poses.gravity[alike], poses.readings[alike], poses.errors[alike])


def _poses_at_rest(tracks: Sequence[Track], air: float) -> _Poses:
    """The poses at rest above z = `air` [m]. Raises NotIdentifiable if there are none."""
    gravity = []
    readings = []
    errors = []
    for track in tracks:
        steps = [_resolution(column) for column in track.readings.T]
        for rows in still_intervals(track):
            if track.heights[rows].min() > air:
                series = track.readings[rows]
                gravity.append(track.gravity[rows].mean(axis=0))
                readings.append(series.mean(axis=0))
                errors.append(
                    [
                        _error_of_rest(column, step)
                        for column, step in zip(series.T, steps, strict=True)
                    ]
                )
    if not gravity:
        raise NotIdentifiable(
            "the tool never rests in the air for 0.5 s; the bias needs one such pose"
        )
    return _Poses(np.array(gravity), np.array(readings), np.array(errors))


def _resolution(readings: Array) -> float:
    """The smallest difference of two readings, shape [n], in their unit; 0 if all are the same."""
    return (
        float(np.diff(np.unique(readings)).min(initial=np.inf)) if np.ptp(readings) > 0.0 else 0.0
    )


def _error_of_rest(readings: Array, resolution: float) -> float:
    """Standard error of the mean reading at rest. Noise below half of the resolution does not average its steps out."""
    error = fit_linear(np.ones((len(readings), 1, 1)), readings[:, None]).error
    return (
        error
        if np.std(readings) > 0.5 * resolution
        else float(np.hypot(error, resolution / 12.0**0.5))
    )

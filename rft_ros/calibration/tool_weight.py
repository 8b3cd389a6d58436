"""The load cell's bias, the tool's mass and its centre of mass, from poses at rest in the air.

A reading is bias + sign · (weight, centre of mass × weight): linear in ten numbers, bias, mass, and mass times centre.
Those that the poses do not determine are taken as given, with an error that the bias then includes.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import (
    Estimates,
    FitResults,
    FittedValue,
    NotIdentifiable,
    fit_linear,
    fit_measurements,
)
from rft_ros.calibration.track import Track, still_intervals
from rft_ros.estimator import LoadCell
from rft_ros.estimator.load_cell import GRAVITY
from rft_ros.rft import FORCE, TORQUE

__all__ = ["fit_tool_weight"]

Array = NDArray[np.float64]

_WIDEST = 30.0  # least turn of gravity in the sensor frame that separates mass from bias [deg]
_LEAST = 1e-6  # kg; a smaller mass is rounding
_SURE = 3.0  # a mass is accepted if it exceeds 0 by this many standard errors
_EXPLAINED = 0.5  # least share of the readings' variance that the mass explains
_NOTHING = 0.01  # kg; a mass near 0 with a smaller error is no mass: the driver subtracts the weight
_USUAL_MASS, _LEVER = 1.0, 0.1  # kg, m: standard deviations of a tool's mass and centre if the poses do not tell
_SPREAD = 0.15  # least RMS spread of gravity's unit vector in a second direction that identifies the centre of mass

_BIAS, _MASS, _MOMENT = slice(0, 6), 6, slice(7, 10)
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
        columns[:, TORQUE, _MOMENT] = sign * np.cross(np.eye(3), self.gravity[:, None]).transpose(0, 2, 1)
        return columns

    def explained(self, fit: Estimates, part: slice) -> float:
        """R²: the share of the variance of one part of the readings, `FORCE` or `TORQUE`, that a fit explains."""
        observed = self.readings[:, part]
        spread = float(((observed - observed.mean(axis=0)) ** 2).sum())
        return 1.0 - float((fit.residuals[:, part] ** 2).sum()) / spread if spread > 0.0 else 1.0


def fit_tool_weight(result: FitResults, tracks: Sequence[Track], *, air: float) -> tuple[LoadCell, float]:
    """Fit bias, mass and centre of mass, as far as the poses above z = `air` [m] determine them, into `result`.

    Returns the load cell, and the standard error of its compensated force along any axis [N].

    Raises NotIdentifiable if the tool never rests in the air, if the fitted mass is negative, or if a parameter does
    not take a fitted value; then nothing is fitted.
    """
    poses, cell = _poses_at_rest(tracks, air), tracks[0].cell
    count, directions = len(poses.gravity), poses.gravity / GRAVITY
    widest = float(np.degrees(np.arccos(np.clip((directions @ directions.T).min(), -1.0, 1.0))))
    _, second, *_ = np.append(np.linalg.svd(directions - directions.mean(axis=0), compute_uv=False), 0.0)
    spread = float(second / np.sqrt(count))
    source = f"{count} poses in the air, gravity turned by up to {widest:.1f}°"
    design, reasons = poses.design(cell.sign), dict[str, str]()
    fit = fit_measurements(design, poses.readings, poses.errors)
    mass, mass_error = float(fit.coefficients[_MASS]), float(fit.errors[_MASS])
    in_words, r2 = f"the fitted mass is {mass:.4f} ± {mass_error:.4f} kg", poses.explained(fit, FORCE)

    unknown = ""
    if widest < _WIDEST:
        unknown = f"gravity turns by {widest:.1f}° in the sensor frame over {count} poses; it needs {_WIDEST:g}°"
    elif mass < -max(_SURE * mass_error, _LEAST):
        raise NotIdentifiable(f"{in_words}: sensor.sign or sensor.quaternion is wrong")
    elif mass_error > _NOTHING and (mass <= _SURE * mass_error or r2 < _EXPLAINED):
        needs = f"it needs {_SURE:g} times its error and R² {_EXPLAINED:g}"
        unknown = f"{in_words} (R² {r2:.3f}); {needs}: check sensor.quaternion, and that nothing pulls at the tool"
    if unknown:
        reasons["sensor.mass"] = f"{unknown} (kept: {cell.mass:g} kg)"
        reasons["sensor.center_of_mass"] = "mass unknown"
    else:
        cell = replace(cell, mass=max(mass, 0.0))
        if spread < _SPREAD or mass <= max(_SURE * mass_error, _LEAST):
            needs = f"it needs a mass over {_SURE:g} times its error and a spread of {_SPREAD:g}"
            directions_spread = f"{count} directions of gravity spread by {spread:.3f} in a second direction"
            reasons["sensor.center_of_mass"] = f"{in_words}, and {directions_spread}; {needs}"

    given, given_errors, free = np.zeros(10), np.zeros(10), np.ones(10, dtype=np.bool_)
    notes = ""
    if "sensor.center_of_mass" in reasons:
        free[_MOMENT], given[_MOMENT] = False, cell.mass * np.array(cell.center_of_mass)
        given_errors[_MOMENT] = _LEVER * (cell.mass if cell.mass > 0.0 or not unknown else _USUAL_MASS)
        if given_errors[_MOMENT].any():
            notes = "; the bias torques include those of the weight at these attitudes"
    if unknown:
        free[_MASS], given[_MASS] = False, cell.mass
        if cell.mass == 0.0:
            given_errors[_MASS] = _USUAL_MASS
            notes += ", and the bias forces include the weight"
    fit = fit_measurements(design[:, :, free], poses.readings - design @ given, poses.errors)
    of_given = np.linalg.norm(fit.inverse @ (design * given_errors).reshape(-1, 10), axis=1)
    errors, bias = np.hypot(fit.errors, of_given)[_BIAS], fit.coefficients[_BIAS]
    scatter = float(np.sqrt(np.mean(fit.residuals[:, FORCE] ** 2)))
    goodness = f"RMS {scatter:.3f} N between poses{notes}"
    fitted = [FittedValue("sensor.bias", tuple(bias.tolist()), tuple(errors.tolist()), "N, N m", goodness, source)]
    if not unknown:
        fitted.append(FittedValue("sensor.mass", (cell.mass,), (mass_error,), "kg", f"R² {r2:.5f}", source))
    if "sensor.center_of_mass" not in reasons:
        center = fit.coefficients[_MOMENT] / mass
        errors = np.hypot(fit.errors[_MOMENT], center * mass_error) / mass
        x, y, z = center.tolist()
        cell, goodness = replace(cell, center_of_mass=(x, y, z)), f"R² {poses.explained(fit, TORQUE):.5f}"
        fitted.append(FittedValue("sensor.center_of_mass", (x, y, z), tuple(errors.tolist()), "m", goodness, source))
    fx, fy, fz, tx, ty, tz = bias.tolist()
    zero_error = float(np.hypot(fit.errors[FORCE].max(), 0.0 if unknown else GRAVITY * mass_error))
    result.fitted += fitted
    result.not_identifiable |= reasons
    return replace(cell, bias=(fx, fy, fz, tx, ty, tz)), zero_error


def _poses_at_rest(tracks: Sequence[Track], air: float) -> _Poses:
    """The poses at rest above z = `air` [m]. Raises NotIdentifiable if there are none."""
    gravity, readings, errors = [], [], []
    for track in tracks:
        steps = [_resolution(column) for column in track.readings.T]
        for rows in still_intervals(track):
            if track.heights[rows].min() > air:
                series = track.readings[rows]
                gravity.append(track.gravity[rows].mean(axis=0))
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
    error = fit_linear(np.ones((len(readings), 1, 1)), readings[:, None]).error
    return error if np.std(readings) > 0.5 * resolution else float(np.hypot(error, resolution / 12.0**0.5))

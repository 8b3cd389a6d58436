"""The load cell's bias, the tool's mass and its centre of mass, from poses at rest in the air.

A reading is bias + sign · (weight, centre of mass × weight), linear in the ten numbers of `rft_ros.diagnosis.air`.
Those that the poses do not determine are taken as given, with an error that the bias then includes.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.air import BIAS, MASS, MOMENT, SPREAD, columns_in_air, fit_in_air, spread
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
_NOTHING = 0.01  # kg; a mass near 0 with a smaller error is none: the driver subtracts the weight
_USUAL_MASS = 1.0  # kg: standard deviation of a tool's mass if the poses do not tell
_LEVER = 0.1  # m: the same of its centre
_FARTHEST = 1.0  # m: a centre of mass farther from the load cell is a torque in another unit
_ALIKE = np.deg2rad(10.0)  # greatest angle between two directions of gravity in one attitude


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
        observed = self.readings[:, part]
        variance = float(((observed - observed.mean(axis=0)) ** 2).sum())
        return 1.0 - float((residuals[:, part] ** 2).sum()) / max(variance, 1e-300)


class _Mass(NamedTuple):
    """The mass that the poses show: `value` [kg] and standard `error`; `share`: its R².

    `is_negative`: by more than its errors, as of a driver that subtracts too much.
    """

    value: float
    error: float
    share: float
    is_negative: bool

    def __str__(self) -> str:
        return f"the fitted mass is {self.value:.4f} ± {self.error:.4f} kg"


def _mass_of(poses: _Poses) -> _Mass:
    fit = fit_in_air(columns_in_air(poses.gravity), poses.readings, poses.errors)
    value = float(fit.values[MASS])
    error = float(fit.errors[MASS])
    is_negative = poses.turned >= _WIDEST and value < -max(_SURE * error, _LEAST)
    return _Mass(value, error, poses.explained(fit.residuals, FORCE), is_negative)


def fit_tool_weight(
    result: FitResults, tracks: Sequence[Track], *, air: float
) -> tuple[LoadCell, float]:
    """Fit bias, mass and centre of mass, as far as the poses above z = `air` [m] determine them, into `result`.

    Returns the load cell, and the standard error of its compensated force along any axis [N].

    With a negative mass, the bias is that of the attitude in the grains: what is subtracted there is constant.

    Raises NotIdentifiable if the tool never rests in the air, or with a negative mass not in that attitude, or if a
    parameter does not take a fitted value; then nothing is fitted. Raises InputError for torques in N mm.
    """
    poses = _poses_at_rest(tracks, air)
    given = tracks[0].cell
    mass = _mass_of(poses)
    reasons = _reasons(poses, mass, given)
    is_mass_known = "sensor.mass" not in reasons
    is_center_known = "sensor.center_of_mass" not in reasons
    cell = replace(given, mass=max(mass.value, 0.0)) if is_mass_known else given
    if mass.is_negative:
        poses = _turned_as_in_grains(poses, tracks, air)
        if not len(poses.gravity):
            raise NotIdentifiable(reasons["sensor.mass"])

    columns = columns_in_air(poses.gravity)
    taken = np.zeros(10)
    taken_errors = np.zeros(10)
    free = np.ones(10, dtype=np.bool_)
    notes = ""
    if not is_center_known:
        free[MOMENT] = False
        taken[MOMENT] = cell.mass * np.array(cell.center_of_mass)
        is_none = is_mass_known and cell.mass == 0.0
        if not is_none:
            taken_errors[MOMENT] = _LEVER * (cell.mass or _USUAL_MASS)
            notes = "; the bias torques include those of the weight at these attitudes"
    if not is_mass_known:
        free[MASS] = False
        taken[MASS] = cell.mass
        if cell.mass == 0.0:
            taken_errors[MASS] = _USUAL_MASS
            notes += ", and the bias forces include the weight"
    fit = fit_in_air(columns[:, :, free], poses.readings - columns @ taken, poses.errors)
    by_taken = np.linalg.norm(fit.inverse @ (columns * taken_errors).reshape(-1, 10), axis=1)

    source = f"{len(poses.gravity)} poses in the air, gravity turned by up to {poses.turned:.1f}°"
    scatter = float(np.sqrt(np.mean(fit.residuals[:, FORCE] ** 2)))
    fx, fy, fz, tx, ty, tz = (given.sign * fit.values[BIAS]).tolist()
    cell = replace(cell, bias=(fx, fy, fz, tx, ty, tz))
    bias_errors = tuple(np.hypot(fit.errors, by_taken)[BIAS].tolist())
    goodness = f"RMS {scatter:.3f} N between poses{notes}"
    found = [FittedValue("sensor.bias", cell.bias, bias_errors, "N, N m", goodness, source)]
    if is_mass_known:
        share = f"R² {mass.share:.5f}"
        found.append(FittedValue("sensor.mass", (cell.mass,), (mass.error,), "kg", share, source))
    if is_center_known:
        x, y, z = (fit.values[MOMENT] / mass.value).tolist()
        if np.linalg.norm((x, y, z)) > _FARTHEST:
            far = f"the torques in the air are those of a centre of mass at {x:.3g}, {y:.3g}, {z:.3g} m"
            advice = "the load cell's driver must give N m, and not N mm"
            raise InputError(f"{tracks[0].name}: {far}; {advice}")
        cell = replace(cell, center_of_mass=(x, y, z))
        errors = np.hypot(fit.errors[MOMENT], np.array((x, y, z)) * mass.error) / mass.value
        share = f"R² {poses.explained(fit.residuals, TORQUE):.5f}"
        center_errors = tuple(errors.tolist())
        found.append(
            FittedValue("sensor.center_of_mass", (x, y, z), center_errors, "m", share, source)
        )
    result.fitted += found
    result.not_identifiable |= reasons
    by_weight = GRAVITY * mass.error if is_mass_known else 0.0
    return cell, float(np.hypot(fit.errors[FORCE].max(), by_weight))


def _reasons(poses: _Poses, mass: _Mass, cell: LoadCell) -> dict[str, str]:
    """Why the poses do not determine the mass or its centre, by the name of the parameter."""
    count = len(poses.gravity)
    unknown = ""
    if poses.turned < _WIDEST:
        unknown = f"gravity turns by {poses.turned:.1f}° in the sensor frame over {count} poses; it needs {_WIDEST:g}°"
    elif mass.is_negative:
        too_much = f"the driver subtracts {-mass.value:.2g} kg more than the tool weighs (correct its payload)"
        unknown = f"{mass}: {too_much}, or sensor.sign or sensor.quaternion is wrong"
    elif mass.error > _NOTHING and (mass.value <= _SURE * mass.error or mass.share < _EXPLAINED):
        needs = f"it needs {_SURE:g} times its error and R² {_EXPLAINED:g}"
        advice = "check sensor.quaternion, and that nothing pulls at the tool"
        unknown = f"{mass} (R² {mass.share:.3f}); {needs}: {advice}"
    if unknown:
        return {
            "sensor.mass": f"{unknown} (kept: {cell.mass:g} kg)",
            "sensor.center_of_mass": "mass unknown",
        }
    spread_of_all = spread(poses.directions)
    if spread_of_all >= SPREAD and mass.value > max(_SURE * mass.error, _LEAST):
        return {}
    directions = (
        f"{count} directions of gravity spread by {spread_of_all:.3f} in a second direction"
    )
    needs = f"it needs a mass over {_SURE:g} times its error and a spread of {SPREAD:g}"
    return {"sensor.center_of_mass": f"{mass}, and {directions}; {needs}"}


def _turned_as_in_grains(poses: _Poses, tracks: Sequence[Track], air: float) -> _Poses:
    """Those of the poses in which gravity lies in the sensor frame as it does below z = `air` [m] on the whole."""
    gravity = np.concatenate([track.cell_along.gravity[track.heights < air] for track in tracks])
    mean = gravity.mean(axis=0) if len(gravity) else np.zeros(3)
    alike = poses.gravity @ mean > np.cos(_ALIKE) * GRAVITY**2
    return _Poses(*(part[alike] for part in poses))


def _poses_at_rest(tracks: Sequence[Track], air: float) -> _Poses:
    """The poses at rest above z = `air` [m]. Raises NotIdentifiable if there are none."""
    found = []
    for track in tracks:
        resolutions = [_resolution(readings) for readings in track.readings.T]
        for rows in still_intervals(track):
            if track.heights[rows].min() > air:
                gravity = track.cell_along.gravity[rows].mean(axis=0)
                found.append((gravity, *_reading_at_rest(track, rows, resolutions)))
    if not found:
        raise NotIdentifiable(
            "the tool never rests in the air for 0.5 s; the bias needs one such pose"
        )
    return _Poses(*map(np.array, zip(*found, strict=True)))


def _reading_at_rest(
    track: Track, rows: NDArray[np.int64], resolutions: Sequence[float]
) -> tuple[Array, list[float]]:
    """The mean reading at some rows, with the sign of a wrench on the tool, and its standard errors, shape [6] each.

    `resolutions`: of the track's readings, six.
    """
    series = track.readings[rows]
    errors = [
        _error_of_rest(column, resolution)
        for column, resolution in zip(series.T, resolutions, strict=True)
    ]
    return track.cell.sign * series.mean(axis=0), errors


def _resolution(readings: Array) -> float:
    """The smallest difference of two readings, shape [n], in their unit; 0 if all are the same."""
    steps = np.diff(np.unique(readings))
    return float(steps.min(initial=np.inf)) if len(steps) else 0.0


def _error_of_rest(readings: Array, resolution: float) -> float:
    """Standard error of the mean reading at rest. Noise below half of the resolution does not average its steps out."""
    error = fit_linear(np.ones((len(readings), 1, 1)), readings[:, None]).error
    if np.std(readings) > 0.5 * resolution:
        return error
    return float(np.hypot(error, resolution / 12.0**0.5))

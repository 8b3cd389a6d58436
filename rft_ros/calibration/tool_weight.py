"""The load cell's bias, the tool's mass and its centre of mass, from poses at rest in the air.

A reading is bias + sign · (weight, centre of mass × weight): linear in bias, mass, and mass times centre of mass.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import Fit, FittedValue, NotIdentifiable, fit_measurements, fit_series
from rft_ros.calibration.track import Track, still_intervals
from rft_ros.estimator import LoadCell
from rft_ros.estimator.load_cell import GRAVITY

__all__ = ["Sensor", "fit_tool_weight"]

_WIDEST = 30.0  # least turn of gravity in the sensor frame that separates mass from bias [deg]
_LEAST = 1e-6  # kg; a smaller mass is rounding
_SURE = 3.0  # a mass is accepted if it exceeds 0 by this many standard errors
_EXPLAINED = 0.5  # least share of the readings' variance that the mass explains
_NOTHING = 0.01  # kg; a mass near 0 with a smaller error is no mass: the driver subtracts the weight
_USUAL_MASS, _LEVER = 1.0, 0.1  # kg, m: standard deviations of a tool's mass and centre if the poses do not tell
_SPREAD = 0.15  # least RMS spread of gravity's unit vector in a second direction that identifies the centre of mass


class Sensor(NamedTuple):
    """The load cell. `zero_error`: standard error of its compensated force along any axis [N]; 0 if it was given."""

    cell: LoadCell
    zero_error: float = 0.0


def fit_tool_weight(
    tracks: Sequence[Track], cell: LoadCell, *, air: float
) -> tuple[Sensor, list[FittedValue], dict[str, str]]:
    """Fit bias, mass and centre of mass, as far as the poses above z = `air` [m] determine them.

    The reasons, by name, are those of values that stay as given. Raises NotIdentifiable if the tool never rests in the
    air, or if the fitted mass is negative.
    """
    poses = [
        (track.readings[rows], track.gravity_in_sensor(cell)[rows].mean(axis=0))
        for track in tracks
        for rows in still_intervals(track)
        if track.heights()[rows].min() > air
    ]
    if not poses:
        raise NotIdentifiable("the tool never rests in the air for 0.5 s; the bias needs one such pose")
    gravity = np.array([g for _, g in poses])
    readings = np.array([r.mean(axis=0) for r, _ in poses])
    errors = np.array([[fit_series(np.ones((len(r), 1)), column).errors[0] for column in r.T] for r, _ in poses])
    units = gravity / np.linalg.norm(gravity, axis=1)[:, None]
    widest = float(np.degrees(np.arccos(np.clip((units @ units.T).min(), -1.0, 1.0))))
    spreads = np.append(np.linalg.svd(units - units.mean(axis=0), compute_uv=False), 0.0) / np.sqrt(len(units))
    source = f"{len(poses)} poses in the air, gravity turned by up to {widest:.1f}°"
    constant = np.tile(np.eye(3), (len(poses), 1))
    fitted: list[FittedValue] = []
    reasons: dict[str, str] = {}

    forces = fit_measurements(np.column_stack([constant, cell.sign * gravity.ravel()]), readings[:, :3], errors[:, :3])
    mass, error, r2 = float(forces.coefficients[3]), float(forces.errors[3]), _explained(forces, readings[:, :3])
    found = f"the fitted mass is {mass:.4f} ± {error:.4f} kg"
    unknown = ""  # why the mass is
    if widest < _WIDEST:
        unknown = f"gravity turns by {widest:.1f}° in the sensor frame over {len(poses)} poses; it needs {_WIDEST:g}°"
    elif mass < -max(_SURE * error, _LEAST):
        raise NotIdentifiable(f"{found}: sensor.sign or sensor.quaternion is wrong")
    elif error > _NOTHING and (mass <= _SURE * error or r2 < _EXPLAINED):
        unknown = (
            f"{found} (R² {r2:.3f}); it needs {_SURE:g} times its error and R² {_EXPLAINED:g}: check"
            " sensor.quaternion, and that nothing pulls at the tool"
        )
    if unknown:
        reasons["sensor.mass"] = f"{unknown} (kept: {cell.mass:g} kg)"
        forces = fit_measurements(constant, readings[:, :3] - cell.sign * cell.mass * gravity, errors[:, :3])
        error = 0.0
    else:
        cell = replace(cell, mass=max(mass, 0.0))
        fitted.append(FittedValue("sensor.mass", (cell.mass,), (error,), "kg", f"R² {r2:.5f}", source))

    if unknown or spreads[1] < _SPREAD or mass <= max(_SURE * error, _LEAST):
        spread = f"{len(poses)} directions of gravity spread by {spreads[1]:.3f} in a second direction"
        needs = f"it needs a mass over {_SURE:g} times its error and a spread of {_SPREAD:g}"
        reasons["sensor.center_of_mass"] = "mass unknown" if unknown else f"{found}, and {spread}; {needs}"
        weight_torques = np.cross(np.array(cell.center_of_mass), cell.sign * cell.mass * gravity)
        torques = fit_measurements(constant, readings[:, 3:] - weight_torques, errors[:, 3:])
    else:
        # columns: e_k × gravity, the torque for each component of mass times centre
        levers = cell.sign * np.cross(np.eye(3), gravity[:, None]).transpose(0, 2, 1).reshape(-1, 3)
        torques = fit_measurements(np.column_stack([constant, levers]), readings[:, 3:], errors[:, 3:])
        center = torques.coefficients[3:] / mass
        x, y, z = center.tolist()
        cell = replace(cell, center_of_mass=(x, y, z))
        center_errors = tuple((np.hypot(torques.errors[3:], center * error) / mass).tolist())
        goodness = f"R² {_explained(torques, readings[:, 3:]):.5f}"
        fitted.append(FittedValue("sensor.center_of_mass", cell.center_of_mass, center_errors, "m", goodness, source))

    fx, fy, fz, tx, ty, tz = np.concatenate([forces.coefficients[:3], torques.coefficients[:3]]).tolist()
    goodness = f"RMS {forces.rms:.3f} N between poses"
    bias_errors = np.concatenate([forces.errors[:3], torques.errors[:3]])
    zero_error = float(np.hypot(bias_errors[:3].max(), GRAVITY * error))
    weight = _weight_in_bias(cell, mass_known=not unknown)
    if weight > 0.0 and "sensor.center_of_mass" in reasons:
        bias_errors[3:] = np.hypot(bias_errors[3:], weight * _LEVER)
        goodness += "; its torques hold the weight's in these poses"
        if unknown and cell.mass == 0.0:
            bias_errors[:3] = np.hypot(bias_errors[:3], weight * np.abs(units.mean(axis=0)))
            goodness += ", its forces the weight"
    cell = replace(cell, bias=(fx, fy, fz, tx, ty, tz))
    fitted.insert(0, FittedValue("sensor.bias", cell.bias, tuple(bias_errors.tolist()), "N, N m", goodness, source))
    return Sensor(cell, zero_error), fitted, reasons


def _weight_in_bias(cell: LoadCell, *, mass_known: bool) -> float:
    """The weight [N] whose torques the poses do not separate from the bias: of the mass, or of a usual one."""
    if mass_known or cell.mass > 0.0:
        return cell.mass * GRAVITY
    return _USUAL_MASS * GRAVITY


def _explained(fit: Fit, observed: NDArray[np.float64]) -> float:
    """R²: the share of the variance of measurements, shape [m, axes], that a fit explains."""
    spread = float(((observed - observed.mean(axis=0)) ** 2).sum())
    return 1.0 - float((fit.residuals**2).sum()) / spread if spread > 0.0 else 1.0

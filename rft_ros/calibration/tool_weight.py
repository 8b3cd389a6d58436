"""The load cell's bias, the tool's mass and its centre of mass, from poses at rest in the air.

A reading is bias + sign · (weight, centre of mass × weight): linear in bias, mass, and mass times centre of mass.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import FittedValue, NotIdentifiable, error_of_mean, fit_measurements
from rft_ros.calibration.track import Track, still_intervals
from rft_ros.errors import InputError
from rft_ros.estimator import LoadCell
from rft_ros.estimator.load_cell import GRAVITY, drift

__all__ = ["Sensor", "fit_tool_weight", "tared"]

Array = NDArray[np.float64]

_WIDEST = 30.0  # least turn of gravity in the sensor frame that separates mass from bias [deg]
_LEAST = 1e-6  # a mass below this [kg] is rounding
_SURE = 3.0  # standard errors of the mass by which it must exceed 0 to be a mass
_EXPLAINED = 0.5  # least share of the readings' variance that the mass explains
_NOTHING = 0.01  # kg; a mass near 0 whose error is below is none: the driver takes off the weight
_SPREAD = 0.15  # least RMS spread of gravity's unit vector in a second direction that identifies the centre of mass


@dataclass(frozen=True, slots=True, eq=False)
class Sensor:
    """The load cell; covariance of its force zero fx, fy, fz [N] and mass [kg], shape [4, 4], 0 for what is given."""

    cell: LoadCell
    covariance: Array = field(default_factory=lambda: np.zeros((4, 4)))

    def force_error(self, track: Track, row: int, direction: Array) -> float:
        """Standard error of the compensated force's zero along a world direction, shape [3], in a row's pose [N]."""
        in_sensor = direction @ track.sensor_rotations(self.cell)[row]
        x = np.append(in_sensor, -self.cell.sign * GRAVITY * direction[2])
        return float(np.sqrt(x @ self.covariance @ x))


def fit_tool_weight(
    tracks: Sequence[Track], cell: LoadCell, *, air: float
) -> tuple[Sensor, list[FittedValue], dict[str, str]]:
    """Fit bias, mass and centre of mass, as far as the poses above z = `air` [m] determine them.

    Returns the load cell with the fitted values, these values, and by name the reason for each that is not
    identifiable, which stays as given. Raises NotIdentifiable if the tool never rests in the air, or if the fitted mass
    is negative.
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
    errors = np.array([[error_of_mean(column) for column in r.T] for r, _ in poses])
    units = gravity / np.linalg.norm(gravity, axis=1)[:, None]
    widest = float(np.degrees(np.arccos(np.clip((units @ units.T).min(), -1.0, 1.0))))
    spreads = np.append(np.linalg.svd(units - units.mean(axis=0), compute_uv=False), 0.0) / np.sqrt(len(units))
    source = f"{len(poses)} poses in the air, gravity turned by up to {widest:.1f}°"
    constant = np.tile(np.eye(3), (len(poses), 1))
    fitted: list[FittedValue] = []
    reasons: dict[str, str] = {}

    unknown = ""  # why the mass is
    if widest < _WIDEST:
        unknown = f"gravity turns by {widest:.1f}° in the sensor frame over {len(poses)} poses; it needs {_WIDEST:g}°"
        mass = error = 0.0
    else:
        design = np.column_stack([constant, cell.sign * gravity.ravel()])
        forces, r2 = fit_measurements(design, readings[:, :3], errors[:, :3])
        mass, error = float(forces.coefficients[3]), float(forces.errors[3])
        found = f"the fitted mass is {mass:.4f} ± {error:.4f} kg"
        if mass < -max(_SURE * error, _LEAST):
            raise NotIdentifiable(f"{found}: sensor.sign or sensor.quaternion is wrong")
        if error > _NOTHING and (mass <= _SURE * error or r2 < _EXPLAINED):
            unknown = (
                f"{found} (R² {r2:.3f}); it needs {_SURE:g} times its error and R² {_EXPLAINED:g}: check"
                " sensor.quaternion, and that nothing pulls at the tool"
            )
    covariance = np.zeros((4, 4))
    if unknown:
        reasons["sensor.mass"] = f"{unknown} (kept: {cell.mass:g} kg)"
        forces, _ = fit_measurements(constant, readings[:, :3] - cell.sign * cell.mass * gravity, errors[:, :3])
        covariance[:3, :3] = forces.covariance
    else:
        covariance = forces.covariance
        cell = replace(cell, mass=max(mass, 0.0))
        fitted.append(FittedValue("sensor.mass", (cell.mass,), (error,), "kg", f"R² {r2:.5f}", source))

    if unknown:
        reasons["sensor.center_of_mass"] = "mass unknown"
    elif spreads[1] < _SPREAD:
        reasons["sensor.center_of_mass"] = (
            f"{len(poses)} directions of gravity spread by {spreads[1]:.3f} in a second direction; it needs {_SPREAD:g}"
        )
    elif mass <= max(_SURE * error, _LEAST):
        reasons["sensor.center_of_mass"] = (
            f"the mass of {mass:.4f} ± {error:.4f} kg is not over {_SURE:g} times its error"
        )
    else:
        # columns: e_k × gravity, the torque for each component of mass times centre
        levers = cell.sign * np.cross(np.eye(3), gravity[:, None]).transpose(0, 2, 1).reshape(-1, 3)
        torques, r2 = fit_measurements(np.column_stack([constant, levers]), readings[:, 3:], errors[:, 3:])
        x, y, z = center = torques.coefficients[3:] / mass
        own = np.hypot(torques.errors[3:], center * error) / mass
        cell = replace(cell, center_of_mass=(float(x), float(y), float(z)))
        values = cell.center_of_mass, tuple(own.tolist())
        fitted.append(FittedValue("sensor.center_of_mass", *values, "m", f"R² {r2:.5f}", source))
    if "sensor.center_of_mass" in reasons:
        weight_torques = np.cross(np.array(cell.center_of_mass), cell.sign * cell.mass * gravity)
        torques, _ = fit_measurements(constant, readings[:, 3:] - weight_torques, errors[:, 3:])

    bias = np.concatenate([forces.coefficients[:3], torques.coefficients[:3]])
    rms = np.sqrt(np.mean((readings[:, :3] - bias[:3] - cell.sign * cell.mass * gravity) ** 2))
    goodness = f"RMS {rms:.3f} N between poses" + (f", with the mass of {cell.mass:g} kg as given" if unknown else "")
    own = np.concatenate([forces.errors[:3], torques.errors[:3]])
    fx, fy, fz, tx, ty, tz = bias.tolist()
    cell = replace(cell, bias=(fx, fy, fz, tx, ty, tz))
    fitted.insert(0, FittedValue("sensor.bias", cell.bias, tuple(own.tolist()), "N, N m", goodness, source))
    return Sensor(cell, covariance), fitted, reasons


def tared(tracks: Sequence[Track], sensor: Sensor, *, seconds: float, air: float) -> tuple[list[Track], Sensor]:
    """Tare each track: shift its forces so that over the first `seconds` they equal bias and weight.

    Also return the sensor with the tare's error. Raises InputError unless the tool rests above z = `air` [m] meanwhile.
    """
    shifted, error, cell = [], 0.0, sensor.cell
    for track in tracks:
        rows = np.flatnonzero(track.time <= seconds)
        refused = f"tare refused: within the first {seconds:g} s of {track.name} the tool"
        if (lowest := float(track.heights()[rows].min())) <= air:
            raise InputError(f"{refused} is as low as z = {lowest:.4f} m; it must be above {air:.4f} m")
        if len(rows) < 2:
            raise InputError(f"{refused} has {len(rows)} poses; a tare needs 2 or more")
        speed = drift(track.time[rows], track.states[rows, :7], track.tool.plates.reach)
        if speed >= track.rest_speed:
            raise InputError(f"{refused} moves at {speed:.4f} m/s; it must rest")
        weight = np.array(cell.bias[:3]) + cell.sign * cell.mass * track.gravity_in_sensor(cell)[rows]
        excess = track.readings[rows, :3] - weight
        error = max(error, *(error_of_mean(column) for column in excess.T))
        shifted.append(replace(track, readings=track.readings - np.append(excess.mean(axis=0), np.zeros(3))))
    return shifted, Sensor(cell, sensor.covariance + np.diag([error**2] * 3 + [0.0]))

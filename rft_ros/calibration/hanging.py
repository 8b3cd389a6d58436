"""Bias, mass and centre of mass from poses in which the tool hangs still in the air.

A reading is bias + sign · (weight, centre of mass x weight), linear in bias, mass, and mass times centre of mass.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.findings import CannotTell, Finding, Refusal
from rft_ros.calibration.load_cell_weight import gravity_in_sensor
from rft_ros.calibration.regression import error_of_mean
from rft_ros.calibration.track import Track
from rft_ros.estimator import LoadCell
from rft_ros.estimator.load_cell import GRAVITY

__all__ = ["Hanging", "HangingFit", "fit_hanging", "hanging_pose"]

_WIDEST = 30.0
"""Gravity must turn by this many degrees in the sensor frame before mass and bias can be told apart."""

_SPREAD = 0.15
"""Directions of gravity must spread by this much (RMS, of a unit vector) in a second direction to tell the centre."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hanging:
    """One pose in the air: mean `reading` and its standard `error`, shape [6]; `gravity` in sensor axes, shape [3]."""

    bag: str
    reading: NDArray[np.float64]
    error: NDArray[np.float64]
    gravity: NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HangingFit:
    """The load cell with what could be told put in; `force_covariance` of bias fx, fy, fz [N] and mass [kg], [4, 4]."""

    cell: LoadCell
    force_covariance: NDArray[np.float64]
    findings: tuple[Finding, ...]
    refusals: tuple[Refusal, ...]

    @property
    def level_error(self) -> float:
        """Standard error of the compensated force's zero in its worst direction across gravity [N]."""
        return float(np.sqrt(np.linalg.eigvalsh(self.force_covariance[:3, :3])[-1]))

    def vertical_error(self, up: NDArray[np.float64]) -> float:
        """Standard error of the compensated vertical force's zero [N]; `up`: world z in sensor axes, shape [3]."""
        row = np.append(up, -self.cell.sign * GRAVITY)
        return float(np.sqrt(row @ self.force_covariance @ row))


def hanging_pose(track: Track, rows: NDArray[np.int64], cell: LoadCell) -> Hanging:
    """The mean of an interval at rest."""
    readings = track.readings[rows]
    return Hanging(
        bag=track.name,
        reading=readings.mean(axis=0),
        error=np.array([error_of_mean(column) for column in readings.T]),
        gravity=gravity_in_sensor(track, cell)[rows].mean(axis=0),
    )


def _cross(v: NDArray[np.float64]) -> NDArray[np.float64]:
    """The matrix of v x, shape [3, 3]."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _solve(
    blocks: Sequence[NDArray[np.float64]], observed: NDArray[np.float64], errors: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Coefficients, covariance and R² of poses' blocks of three rows; `observed`, `errors`: shape [poses, 3].

    An axis' variance is the greater of the scatter between poses and what the poses' own errors say.
    """
    design, y = np.vstack(blocks), observed.ravel()
    inverse = np.linalg.pinv(design)
    found = inverse @ y
    residuals = (y - design @ found).reshape(-1, 3)
    freedom = max(1.0 - design.shape[1] / len(y), 1.0 / len(y))
    scatter = (residuals**2).mean(axis=0) / freedom
    variance = np.maximum(scatter, errors**2).ravel()
    spread = float(((observed - observed.mean(axis=0)) ** 2).sum())
    r2 = 1.0 - float((residuals**2).sum()) / spread if spread > 0.0 else 1.0
    return found, (inverse * variance) @ inverse.T, r2


def fit_hanging(poses: Sequence[Hanging], cell: LoadCell) -> HangingFit:
    """What the poses can tell of bias, mass and centre of mass; the rest stays as in `cell` and is refused by name.

    Raises CannotTell where the tool never hangs still in the air, and where the fitted mass is negative.
    """
    if not poses:
        raise CannotTell("the tool never hangs still in the air for 0.5 s; the bias needs one such pose")
    gravity = np.array([p.gravity for p in poses])
    units = gravity / np.linalg.norm(gravity, axis=1)[:, None]
    widest = float(np.degrees(np.arccos(np.clip((units @ units.T).min(), -1.0, 1.0))))
    spreads = np.linalg.svd(units - units.mean(axis=0), compute_uv=False) / np.sqrt(len(units))
    second = float(spreads[1]) if len(spreads) > 1 else 0.0
    source = f"{len(poses)} poses in the air, gravity turned by up to {widest:.1f}°"
    refusals = []

    sign, eye = cell.sign, np.eye(3)
    forces, torques = (np.array([p.reading[part] for p in poses]) for part in (slice(3), slice(3, 6)))
    force_errors, torque_errors = (np.array([p.error[part] for p in poses]) for part in (slice(3), slice(3, 6)))
    cov = np.zeros((4, 4))
    told = []
    if widest >= _WIDEST:
        blocks = [np.column_stack([eye, sign * g]) for g in gravity]
        b, cov, r2 = _solve(blocks, forces, force_errors)
        mass, error = float(b[3]), float(np.sqrt(cov[3, 3]))
        if mass < -3.0 * error:
            raise CannotTell(
                f"the mass comes out as {mass:.4f} ± {error:.4f} kg: sensor.sign or sensor.quaternion is wrong"
            )
        cell = replace(cell, mass=max(mass, 0.0))
        told.append(_finding("sensor.mass", (mass,), (error,), "kg", f"R² {r2:.5f}", source))
    else:
        why = f"gravity turns by {widest:.1f}° in the sensor frame over {len(poses)} poses; it needs {_WIDEST:g}°"
        refusals.append(Refusal(name="sensor.mass", why=f"{why} (kept: {cell.mass:g} kg)"))
        b, cov[:3, :3], _ = _solve([eye] * len(poses), forces - sign * cell.mass * gravity, force_errors)

    if widest >= _WIDEST and second >= _SPREAD:
        # torque of the weight: mass centre x g = -[g]x (mass centre)
        blocks = [np.column_stack([eye, -sign * _cross(g)]) for g in gravity]
        t, torque_cov, r2 = _solve(blocks, torques, torque_errors)
        center = t[3:6] / mass
        errors = np.sqrt(np.diag(torque_cov)[3:6] + (center * error) ** 2) / abs(mass)
        cell = replace(cell, center_of_mass=(float(center[0]), float(center[1]), float(center[2])))
        told.append(_finding("sensor.center_of_mass", center, errors, "m", f"R² {r2:.5f}", source))
    else:
        why = f"{len(poses)} directions of gravity spread by {second:.3f} in a second direction; it needs {_SPREAD:g}"
        if widest < _WIDEST:
            why = "the mass is not told"
        refusals.append(Refusal(name="sensor.center_of_mass", why=why))
        weight_torques = np.cross(np.array(cell.center_of_mass), sign * cell.mass * gravity)
        t, torque_cov, _ = _solve([eye] * len(poses), torques - weight_torques, torque_errors)

    bias = np.concatenate([b[:3], t[:3]])
    errors = np.sqrt(np.concatenate([np.diag(cov)[:3], np.diag(torque_cov)[:3]]))
    fx, fy, fz, tx, ty, tz = bias.tolist()
    cell = replace(cell, bias=(fx, fy, fz, tx, ty, tz))
    kept = "" if widest >= _WIDEST else f", with the mass of {cell.mass:g} kg as given"
    rms = np.sqrt(np.mean((forces - b[:3] - sign * cell.mass * gravity) ** 2))
    goodness = f"RMS {rms:.3f} N between poses{kept}"
    told.insert(0, _finding("sensor.bias", bias, errors, "N, N m", goodness, source))
    return HangingFit(cell=cell, force_covariance=cov, findings=tuple(told), refusals=tuple(refusals))


def _finding(
    name: str,
    values: Sequence[float] | NDArray[np.float64],
    errors: Sequence[float] | NDArray[np.float64],
    unit: str,
    goodness: str,
    source: str,
) -> Finding:
    return Finding(
        name=name,
        values=tuple(float(v) for v in values),
        errors=tuple(float(e) for e in errors),
        unit=unit,
        goodness=goodness,
        source=source,
        parameter=name,
    )

"""The paper's families of motion: poses in closed form, with their exact derivative as twist.

Lengths in m, speeds in m/s, times in s; angles in degrees (fields with ``_deg``). World axes, z up, surface at z = 0
unless the caller says otherwise. Positions are those of the tool frame's origin.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rft_ros.errors import InputError
from rft_ros.rft import STATE

__all__ = ["FAMILIES", "Circumnutation", "Motion", "OscillatingInsertion", "PlateDrag", "Straight", "sample"]

Array = NDArray[np.float64]

_LEAST, _MOST = 1e-9, 1e6  # within these, times and poses are finite


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion(ABC):
    """A path at constant speed. `travel`: its length, or the depth gained.

    Raises InputError for a parameter that is no number from -1e6 to 1e6, or from 1e-9 where it must be positive.
    """

    travel: float = 0.05

    def __post_init__(self) -> None:
        for field in fields(self):
            value, least = getattr(self, field.name), _LEAST if field.name in ("speed", "travel", "pitch") else -_MOST
            if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= _MOST:
                between = f"a number from {least:g} to {_MOST:g}"
                raise InputError(f"{type(self).__name__}.{field.name} is {value!r}; it must be {between}")

    @property
    @abstractmethod
    def speed(self) -> float:
        """Speed along the path [m/s]."""

    @property
    def duration(self) -> float:
        """Time from the first pose to the last [s]."""
        return self.travel / self.speed

    def at(self, times: ArrayLike) -> Array:
        """States at times [s], shape [n, 13], columns `rft_ros.rft.STATE`."""
        return self._at(np.atleast_1d(np.asarray(times, dtype=np.float64)))

    @abstractmethod
    def _at(self, t: Array) -> Array: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Straight(Motion):
    """Insertion, penetration or withdrawal along a line, without turning.

    `start_height`: z at t = 0. `descent_deg`: angle of the path below the horizontal, 90 straight down, -90 straight
    up; `heading_deg`: its horizontal direction, from +x towards +y. The tool's attitude is Rz(yaw) Ry(tilt).
    """

    speed: float = 0.01
    start_height: float = 0.0
    descent_deg: float = 90.0
    heading_deg: float = 0.0
    tilt_deg: float = 0.0
    yaw_deg: float = 0.0

    def _at(self, t: Array) -> Array:
        descent, heading = math.radians(self.descent_deg), math.radians(self.heading_deg)
        forward = self.speed * math.cos(descent)
        velocity = forward * math.cos(heading), forward * math.sin(heading), -self.speed * math.sin(descent)
        return _line(t, self.start_height, velocity, math.radians(self.yaw_deg), math.radians(self.tilt_deg))


@dataclass(frozen=True, slots=True, kw_only=True)
class PlateDrag(Motion):
    """A plate dragged along +x without turning (paper Figs. 2 and 3; with `phi_deg`, Figs. 5 and 6).

    The plate's face is the tool's -z: it faces down at `beta_deg` = 0 and forwards at 90. `psi_deg`: angle from the
    horizontal direction of motion to the face's e2; 90 moves a vertical plate along itself. `phi_deg`: how far below
    the horizontal the plate moves; 0 in Fig. 3. `depth`: below z = 0 at the start.
    """

    speed: float = 0.01
    psi_deg: float = 0.0
    beta_deg: float = 90.0
    phi_deg: float = 0.0
    depth: float = 0.0255

    def _at(self, t: Array) -> Array:
        attitude = {"tilt_deg": -self.beta_deg, "yaw_deg": self.psi_deg}
        return Straight(speed=self.speed, start_height=-self.depth, descent_deg=self.phi_deg, **attitude).at(t)


@dataclass(frozen=True, slots=True, kw_only=True)
class OscillatingInsertion(Motion):
    """Straight down while pitching about y as amplitude * sin(2π frequency t) (paper Fig. 7; its ellipsoid).

    `frequency` [Hz]: 0.625 in the released code (ω = 1.25π rad/s), 1.25 in the paper's text. `start_height`: z at
    t = 0; 18 mm puts the ellipsoid's tip on the surface.
    """

    frequency: float = 0.625
    amplitude_deg: float = 9.0
    speed: float = 0.005
    travel: float = 0.06
    start_height: float = 0.018

    def _at(self, t: Array) -> Array:
        omega, amplitude = 2.0 * math.pi * self.frequency, math.radians(self.amplitude_deg)
        tilt = amplitude * np.sin(omega * t)
        states = _line(t, self.start_height, (0.0, 0.0, -self.speed), 0.0, tilt)
        states[:, 11] = amplitude * omega * np.cos(omega * t)
        return states


@dataclass(frozen=True, slots=True, kw_only=True)
class Circumnutation(Motion):
    """A tilted root tip that descends a helix, turning about the vertical (paper Fig. 8).

    `tilt_deg`: η, angle of the root's axis from the vertical. `pitch`: P, depth gained per turn. `rate_deg_s`: angular
    velocity about the vertical [deg/s], negative for clockwise from above. `start_height`: z at t = 0 of the origin,
    which lies on the axis of turning; 0 puts the root's base at the surface, as in the released code.
    """

    tilt_deg: float = 10.0
    pitch: float = 0.04
    rate_deg_s: float = 15.0
    travel: float = 0.035
    start_height: float = 0.0

    def __post_init__(self) -> None:
        Motion.__post_init__(self)
        if abs(self.rate_deg_s) < _LEAST:
            raise InputError(f"Circumnutation.rate_deg_s is {self.rate_deg_s:g}; for no turning use Straight")

    @property
    def speed(self) -> float:
        """Speed of the descent [m/s]."""
        return self.pitch * abs(self.rate_deg_s) / 360.0

    def _at(self, t: Array) -> Array:
        rate, tilt = math.radians(self.rate_deg_s), math.radians(self.tilt_deg)
        states = _line(t, self.start_height, (0.0, 0.0, -self.speed), rate * t, tilt)
        states[:, 12] = rate
        return states


FAMILIES: dict[str, type[Motion]] = {
    "straight": Straight,
    "plate_drag": PlateDrag,
    "oscillating_insertion": OscillatingInsertion,
    "circumnutation": Circumnutation,
}


def sample(motion: Motion, count: int) -> tuple[Array, Array]:
    """Times [s], shape [count], evenly spaced from the start to the end, and states, shape [count, 13]."""
    times = np.linspace(0.0, motion.duration, count)
    return times, motion.at(times)


def _line(
    t: Array, start_height: float, velocity: tuple[float, float, float], yaw: float | Array, tilt: float | Array
) -> Array:
    """States on a straight path at constant speed with attitude Rz(yaw) Ry(tilt) [rad] and no angular velocity."""
    states = np.zeros((len(t), len(STATE)))
    states[:, 0:3] = np.array([0.0, 0.0, start_height]) + np.outer(t, velocity)
    sin_y, cos_y, sin_t, cos_t = np.sin(yaw / 2.0), np.cos(yaw / 2.0), np.sin(tilt / 2.0), np.cos(tilt / 2.0)
    for column, part in zip(range(3, 7), (-sin_y * sin_t, cos_y * sin_t, sin_y * cos_t, cos_y * cos_t), strict=True):
        states[:, column] = part
    states[:, 7:10] = velocity
    return states

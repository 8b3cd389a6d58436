"""The paper's families of motion: poses in closed form, with their exact derivative as twist.

Lengths in m, speeds in m/s, times in s; angles in degrees (names with ``_deg``). World axes, z up, surface at z = 0
unless the caller says otherwise. Positions are those of the tool frame's origin; `start_height` is its z at t = 0.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rft_ros.errors import InputError
from rft_ros.rft import (
    ANGULAR_VELOCITY,
    POSITION,
    QUATERNION,
    STATE,
    VELOCITY,
    quaternion_products,
)

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Trajectory:
    """A straight path at constant `velocity` [m/s], on which the tool may turn about the vertical and pitch.

    Its attitude is Rz(yaw + turning t) Ry(tilt + amplitude sin(omega t)), with `yaw`, `tilt` and `amplitude` in rad,
    `turning` and `omega` in rad/s. `duration`: from the first pose to the last [s].
    """

    duration: float
    velocity: tuple[float, float, float]
    start_height: float
    yaw: float = 0.0
    tilt: float = 0.0
    turning: float = 0.0
    amplitude: float = 0.0
    omega: float = 0.0

    def at(self, times: ArrayLike) -> Array:
        """States at times [s], shape [n, 13], columns `rft_ros.rft.STATE`."""
        t = np.atleast_1d(np.asarray(times, dtype=np.float64))
        yaw = self.yaw + self.turning * t
        tilt = self.tilt + self.amplitude * np.sin(self.omega * t)
        pitching = self.amplitude * self.omega * np.cos(self.omega * t)
        states = np.zeros((len(t), len(STATE)))
        states[:, POSITION] = np.outer(t, self.velocity)
        states[:, 2] += self.start_height
        about_z = np.zeros((len(t), 4))
        about_z[:, 2] = np.sin(yaw / 2.0)
        about_z[:, 3] = np.cos(yaw / 2.0)
        about_y = np.zeros((len(t), 4))
        about_y[:, 1] = np.sin(tilt / 2.0)
        about_y[:, 3] = np.cos(tilt / 2.0)
        states[:, QUATERNION] = quaternion_products(about_z, about_y)
        states[:, VELOCITY] = self.velocity
        spin = states[:, ANGULAR_VELOCITY]  # a view
        spin[:, 0] -= pitching * np.sin(yaw)
        spin[:, 1] += pitching * np.cos(yaw)
        spin[:, 2] = self.turning
        return states


def straight(
    *,
    travel: float = 0.05,
    speed: float = 0.01,
    start_height: float = 0.0,
    descent_deg: float = 90.0,
    heading_deg: float = 0.0,
    tilt_deg: float = 0.0,
    yaw_deg: float = 0.0,
) -> Trajectory:
    """Insertion, penetration or withdrawal along a line of length `travel`, without turning.

    `descent_deg`: angle of the path below the horizontal, 90 straight down, -90 straight up; `heading_deg`: its
    horizontal direction, from +x towards +y. The tool's attitude is Rz(yaw) Ry(tilt).
    """
    descent = math.radians(descent_deg)
    heading = math.radians(heading_deg)
    forward = speed * math.cos(descent)
    return Trajectory(
        duration=travel / speed,
        velocity=(
            forward * math.cos(heading),
            forward * math.sin(heading),
            -speed * math.sin(descent),
        ),
        start_height=start_height,
        yaw=math.radians(yaw_deg),
        tilt=math.radians(tilt_deg),
    )


def plate_drag(
    *,
    travel: float = 0.05,
    speed: float = 0.01,
    psi_deg: float = 0.0,
    beta_deg: float = 90.0,
    phi_deg: float = 0.0,
    depth: float = 0.0255,
) -> Trajectory:
    """A plate dragged along +x without turning (paper Figs. 2 and 3; with `phi_deg`, Figs. 5 and 6).

    The plate's face is the tool's -z: it faces down at `beta_deg` = 0 and forwards at 90. `psi_deg`: angle from the
    horizontal direction of motion to the face's e2; 90 moves a vertical plate along itself. `phi_deg`: how far below
    the horizontal the plate moves; 0 in Fig. 3. `depth`: below z = 0 at the start.
    """
    return straight(
        travel=travel,
        speed=speed,
        start_height=-depth,
        descent_deg=phi_deg,
        tilt_deg=-beta_deg,
        yaw_deg=psi_deg,
    )


def oscillating_insertion(
    *,
    frequency: float = 0.625,
    amplitude_deg: float = 9.0,
    speed: float = 0.005,
    travel: float = 0.06,
    start_height: float = 0.018,
) -> Trajectory:
    """Straight down while pitching about y as amplitude * sin(2π frequency t) (paper Fig. 7; its ellipsoid).

    `frequency` [Hz]: 0.625 in the released code (ω = 1.25π rad/s), 1.25 in the paper's text. A `start_height` of 18 mm
    puts the ellipsoid's tip on the surface.
    """
    return Trajectory(
        duration=travel / speed,
        velocity=(0.0, 0.0, -speed),
        start_height=start_height,
        amplitude=math.radians(amplitude_deg),
        omega=2.0 * math.pi * frequency,
    )


def circumnutation(
    *,
    tilt_deg: float = 10.0,
    pitch: float = 0.04,
    rate_deg_s: float = 15.0,
    travel: float = 0.035,
    start_height: float = 0.0,
) -> Trajectory:
    """A tilted root tip that descends a helix, turning about the vertical (paper Fig. 8).

    `tilt_deg`: η, angle of the root's axis from the vertical. `pitch`: P, depth gained per turn; `travel`: in all.
    `rate_deg_s`: angular velocity about the vertical [deg/s], negative for clockwise from above. The origin lies on the
    axis of turning; a `start_height` of 0 puts the root's base at the surface, as in the released code.
    """
    if abs(rate_deg_s) < 1e-9:
        raise InputError(f"rate_deg_s is {rate_deg_s:g}; for no turning use the family straight")
    speed = pitch * abs(rate_deg_s) / 360.0
    return Trajectory(
        duration=travel / speed,
        velocity=(0.0, 0.0, -speed),
        start_height=start_height,
        tilt=math.radians(tilt_deg),
        turning=math.radians(rate_deg_s),
    )


FAMILIES: dict[str, Callable[..., Trajectory]] = {
    family.__name__: family
    for family in (straight, plate_drag, oscillating_insertion, circumnutation)
}


def sample(motion: Trajectory, count: int) -> tuple[Array, Array]:
    """Times [s], shape [count], evenly spaced from the start to the end, and states, shape [count, 13]."""
    times = np.linspace(0.0, motion.duration, count)
    return times, motion.at(times)

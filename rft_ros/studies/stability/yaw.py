"""Yaw of upright and leaning tools while they move in one direction: facets pass through motion along themselves."""

import numpy as np
from scipy.spatial.transform import Rotation

from rft_ros.studies.stability.sweep import ANGLE_STEP, Array, Sweep, evenly, scene_states, shipped

__all__ = ["yaw_sweeps"]

_ATTITUDES = {
    "upright": Rotation.from_euler("y", 90.0, degrees=True),
    "leaning": Rotation.from_euler("yx", [50.0, 20.0], degrees=True),
}


def yaw_sweeps(*tools: str) -> tuple[Sweep, ...]:
    """Yaw over 120° of shipped tools (default: plate, ellipsoid and root tip), moving on, or on and down."""
    sweeps = []
    for tool in tools or ("plate", "ellipsoid", "root_tip"):
        plates = shipped(tool)
        for name, attitude in _ATTITUDES.items():
            velocity = (0.01, 0.0, 0.0) if name == "upright" else (0.01, 0.002, -0.004)

            def states(
                yaw: Array, attitude: Rotation = attitude, velocity: tuple[float, float, float] = velocity
            ) -> Array:
                return scene_states(Rotation.from_euler("z", yaw[:, None]) * attitude, velocity=velocity)

            values = evenly(np.radians(-15.0), np.radians(105.0), ANGLE_STEP)
            sweeps.append(Sweep(name=f"yaw, {tool}, {name}", tool=plates, values=values, states=states))
    return tuple(sweeps)

"""Gravity in the load cell's axes, and the force of the grains that is left once bias and weight are taken off."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rft_ros.calibration.track import Track
from rft_ros.estimator import LoadCell
from rft_ros.estimator.load_cell import GRAVITY

__all__ = ["grain_forces", "gravity_in_sensor", "sensor_rotations"]


def sensor_rotations(track: Track, cell: LoadCell) -> NDArray[np.float64]:
    """Rotation of the sensor frame into the world at each moment, shape [n, 3, 3]."""
    return np.asarray(track.rotations() @ Rotation.from_quat(cell.quaternion).as_matrix())


def gravity_in_sensor(track: Track, cell: LoadCell) -> NDArray[np.float64]:
    """Acceleration of gravity in sensor axes [m/s²], shape [n, 3]."""
    return -GRAVITY * sensor_rotations(track, cell)[:, 2, :]


def grain_forces(track: Track, cell: LoadCell) -> NDArray[np.float64]:
    """Force on the tool by the grains, world axes [N], shape [n, 3]."""
    measured = cell.sign * (track.readings[:, :3] - np.array(cell.bias[:3]))
    in_sensor = measured - cell.mass * gravity_in_sensor(track, cell)
    return np.asarray(np.einsum("nij,nj->ni", sensor_rotations(track, cell), in_sensor))

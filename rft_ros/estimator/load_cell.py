"""From what the load cell reports to what the grains do, and from the tool's wrench to the load cell's frame."""

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.settings import LoadCell
from rft_ros.rft.compilation import compiled
from rft_ros.rft.frames import rotation

__all__ = ["GRAVITY", "LoadCellFrame"]

GRAVITY = 9.80665  # m/s², standard (ISO 80000-3)


@compiled
def _into_sensor(mount, quaternion, world_wrench, out):  # type: ignore[no-untyped-def]
    """Wrench in world axes about the tool frame's origin into sensor axes about the sensor's origin; and the weight.

    `mount`: position (3), quaternion (4) of the sensor in the tool frame, weight [N], centre of mass (3).
    `out`: 12 numbers, the wrench and then the weight's wrench, both in the sensor frame.
    """
    a = rotation(quaternion[0], quaternion[1], quaternion[2], quaternion[3])
    b = rotation(mount[3], mount[4], mount[5], mount[6])
    fx, fy, fz, tx, ty, tz = world_wrench[:6]
    # into tool axes, then about the sensor's origin: torque - position x force
    gx, gy, gz = a[0] * fx + a[3] * fy + a[6] * fz, a[1] * fx + a[4] * fy + a[7] * fz, a[2] * fx + a[5] * fy + a[8] * fz
    ux, uy, uz = a[0] * tx + a[3] * ty + a[6] * tz, a[1] * tx + a[4] * ty + a[7] * tz, a[2] * tx + a[5] * ty + a[8] * tz
    px, py, pz = mount[0], mount[1], mount[2]
    ux, uy, uz = ux - (py * gz - pz * gy), uy - (pz * gx - px * gz), uz - (px * gy - py * gx)
    out[0], out[1], out[2] = (
        b[0] * gx + b[3] * gy + b[6] * gz,
        b[1] * gx + b[4] * gy + b[7] * gz,
        b[2] * gx + b[5] * gy + b[8] * gz,
    )
    out[3], out[4], out[5] = (
        b[0] * ux + b[3] * uy + b[6] * uz,
        b[1] * ux + b[4] * uy + b[7] * uz,
        b[2] * ux + b[5] * uy + b[8] * uz,
    )
    # weight: -E3 in tool axes is minus the third row of the tool's rotation
    w = mount[7]
    gx, gy, gz = -w * a[6], -w * a[7], -w * a[8]
    wx, wy, wz = b[0] * gx + b[3] * gy + b[6] * gz, b[1] * gx + b[4] * gy + b[7] * gz, b[2] * gx + b[5] * gy + b[8] * gz
    cx, cy, cz = mount[8], mount[9], mount[10]
    out[6], out[7], out[8] = wx, wy, wz
    out[9], out[10], out[11] = cy * wz - cz * wy, cz * wx - cx * wz, cx * wy - cy * wx


class LoadCellFrame:
    """A load cell's mounting and tool weight, prepared once."""

    def __init__(self, cell: LoadCell) -> None:
        self.sign = cell.sign
        self.bias = cell.bias
        self._mount = np.array([*cell.position, *cell.quaternion, cell.mass * GRAVITY, *cell.center_of_mass])
        self._out = np.zeros(12)

    def into_sensor(self, quaternion: NDArray[np.float64], world_wrench: NDArray[np.float64]) -> list[float]:
        """Twelve numbers in the sensor frame: the wrench (given in world axes, about the tool) and the weight's."""
        _into_sensor(self._mount, quaternion, world_wrench, self._out)
        return self._out.tolist()

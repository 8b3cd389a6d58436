"""The load cell: its mounting, tool weight and bias, and the wrenches in its frame."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.samples import PoseSample, WrenchSample
from rft_ros.estimator.sigma import parts_of_prediction
from rft_ros.parameters import LoadCell
from rft_ros.rft.frames import Vector, Wrench, attitude, into_frame
from rft_ros.rft.kernel.compilation import compiled, machine_code

Array = NDArray[np.float64]

GRAVITY = 9.80665
"""Standard gravity [m/s²] (ISO 80000-3)."""

HISTORY = 8192
"""Load-cell samples kept: 8 s of a 1 kHz stream. A pose that is older than all of them has no measurement."""

_MOUNT = np.dtype(
    [
        ("position", float, 3),  # of the sensor in the tool frame [m]
        ("quaternion", float, 4),
        ("weight", float),  # of the mass below the cell [N]
        ("center_of_mass", float, 3),  # of this mass, in the sensor frame [m]
        ("bias", float, 6),  # in the sign of a force on the tool [N], [N m]
    ]
)
_IN_SENSOR = np.dtype([("wrench", float, 6), ("offset", float, 6), ("sigma", float, 6)])


@compiled
def _into_sensor(mounts, quaternion, wrench_and_sigma, outs):
    """Write wrench, offset and deviations, in sensor axes about the sensor's origin, to `outs`, one record.

    `mounts`: one record of `_MOUNT`. `quaternion` of the tool. `wrench_and_sigma`, shape [12]: wrench and its standard
    deviations in world axes about the tool frame's origin. The errors of world components, and those of force and
    torque, are taken as independent.
    """
    mount = mounts[0]
    out = outs[0]
    position = mount.position
    center = mount.center_of_mass
    bias = mount.bias
    wrench = out.wrench
    offset = out.offset
    sigma = out.sigma
    force, torque, force_sigma, torque_sigma = parts_of_prediction(wrench_and_sigma)
    tool = attitude(quaternion)
    sensor = attitude(mount.quaternion)
    px, py, pz = position[0], position[1], position[2]
    world_axis = 0.0, 0.0, 0.0
    for i in range(6):
        wrench[i] = sigma[i] = 0.0
    # `world_axis`: a world axis, in sensor axes; `lever`: the torque of a unit force along it
    for k in range(3):
        x, y, z = into_frame(
            tool, 1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0
        )
        world_axis = into_frame(sensor, x, y, z)
        lever = into_frame(sensor, pz * y - py * z, px * z - pz * x, py * x - px * y)
        for i in range(3):
            wrench[i] += force[k] * world_axis[i]
            wrench[3 + i] += force[k] * lever[i] + torque[k] * world_axis[i]
            sigma[i] += (force_sigma[k] * world_axis[i]) ** 2
            sigma[3 + i] += (force_sigma[k] * lever[i]) ** 2 + (
                torque_sigma[k] * world_axis[i]
            ) ** 2
    # `world_axis` is the world's z axis, along which the weight hangs
    wx, wy, wz = (
        -mount.weight * world_axis[0],
        -mount.weight * world_axis[1],
        -mount.weight * world_axis[2],
    )
    cx, cy, cz = center[0], center[1], center[2]
    weight = wx, wy, wz, cy * wz - cz * wy, cz * wx - cx * wz, cx * wy - cy * wx
    for i in range(6):
        offset[i] = bias[i] + weight[i]
        sigma[i] = math.sqrt(sigma[i])


class LoadCellFrame:
    """A load cell's mounting, tool weight and bias, prepared once."""

    def __init__(self, cell: LoadCell) -> None:
        self.sign = cell.sign
        self._place = cell.place
        bias = tuple(cell.sign * b for b in cell.bias)
        mount = cell.position, cell.quaternion, cell.mass * GRAVITY, cell.center_of_mass, bias
        self._mount = np.array([mount], _MOUNT)
        self._out = np.zeros(1, _IN_SENSOR)
        self._rows = self._out.view(np.float64).reshape(3, 6)  # wrench, offset, sigma
        self._into_sensor = machine_code(
            _into_sensor, (self._mount, np.zeros(4), np.zeros(12), self._out)
        )

    def into_sensor(
        self, quaternion: Array, wrench_and_sigma: Array
    ) -> tuple[Wrench, Wrench, Wrench]:
        """The wrench, the offset and one standard deviation of each component of the wrench, in the sensor frame.

        The offset is bias plus tool weight, in the sign of a force on the tool: the raw reading is `sign` times the sum
        of wrench and offset. `wrench_and_sigma`, shape [12]: wrench and standard deviations in world axes, about the
        tool frame's origin [N], [N m]. Both arrays are contiguous.
        """
        self._into_sensor(self._mount, quaternion, wrench_and_sigma, self._out)
        rows: list[Any] = self._rows.tolist()
        wrench, offset, sigma = map(tuple, rows)
        return wrench, offset, sigma

    def in_own_axes(self, reading: WrenchSample, tool: PoseSample) -> Wrench:
        """The wrench of a reading in the sensor frame. `tool`: the pose of the tool frame at its stamp.

        A reading in the frame of this pose is in world axes; its torque is about the sensor's origin.
        """
        if reading.frame != tool.frame:
            return reading.wrench
        to_sensor = tool.place.of(self._place).inverse()
        return *to_sensor.rotate(reading.wrench[:3]), *to_sensor.rotate(reading.wrench[3:])

    def force_in_world(self, wrench: Wrench, tool: PoseSample) -> Vector:
        """The force of a wrench in sensor axes [N], in world axes. `tool`: the pose of the tool frame."""
        return tool.place.rotate(self._place.rotate(wrench[:3]))


class Prediction(NamedTuple):
    """A prediction that waits for its load-cell reading: `LoadCellFrame.into_sensor` at its pose.

    `in_air`: the tool touched nothing. `max_age`: the greatest time between it and a reading that is used with it [ns].
    """

    pose: PoseSample
    wrench: Wrench
    offset: Wrench
    cell: LoadCellFrame
    in_air: bool
    max_age: int

    def force_in_world(self, wrench: Wrench) -> Vector:
        """The force of its compensated reading [N], in world axes."""
        return self.cell.force_in_world(wrench, self.pose)

"""The load cell: its frame on the tool, and how its readings are compared with the predictions."""

import math
from collections import Counter, deque
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.samples import Measurement, PoseSample, Reason, WrenchSample
from rft_ros.estimator.sigma import parts_of_prediction
from rft_ros.estimator.timeline import PATIENCE, Timeline, between
from rft_ros.parameters import LoadCell
from rft_ros.rft.frames import Placement, Vector, Wrench, attitude, into_frame
from rft_ros.rft.kernel.compilation import compiled, machine_code

Array = NDArray[np.float64]

GRAVITY = 9.80665
"""Standard gravity [m/s²] (ISO 80000-3)."""

HISTORY = 8192
"""Load-cell samples kept: 8 s of a 1 kHz stream. A pose that is older than all of them has no measurement."""

# estimates that wait for samples; if there are more, the oldest is compared early
_MOST_PENDING = 4096

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
def _into_sensor(mounts, quaternion, with_sigma, outs):
    """Write wrench, offset and deviations, in sensor axes about the sensor's origin, to `outs`, one record.

    `mounts`: one record of `_MOUNT`. `quaternion` of the tool. `with_sigma`, shape [12]: wrench and its standard
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
    force, torque, force_sigma, torque_sigma = parts_of_prediction(with_sigma)
    tool = attitude(quaternion)
    sensor = attitude(mount.quaternion)
    px, py, pz = position[0], position[1], position[2]
    turned = 0.0, 0.0, 0.0
    for i in range(6):
        wrench[i] = sigma[i] = 0.0
    for k in range(
        3
    ):  # `turned`: a world axis, in sensor axes; `lever`: the torque of a unit force along it
        x, y, z = into_frame(
            tool, 1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0
        )
        turned = into_frame(sensor, x, y, z)
        lever = into_frame(sensor, pz * y - py * z, px * z - pz * x, py * x - px * y)
        for i in range(3):
            wrench[i] += force[k] * turned[i]
            wrench[3 + i] += force[k] * lever[i] + torque[k] * turned[i]
            sigma[i] += (force_sigma[k] * turned[i]) ** 2
            sigma[3 + i] += (force_sigma[k] * lever[i]) ** 2 + (torque_sigma[k] * turned[i]) ** 2
    # `turned` is the world's z axis, along which the weight hangs
    wx, wy, wz = -mount.weight * turned[0], -mount.weight * turned[1], -mount.weight * turned[2]
    cx, cy, cz = center[0], center[1], center[2]
    weight = wx, wy, wz, cy * wz - cz * wy, cz * wx - cx * wz, cx * wy - cy * wx
    for i in range(6):
        offset[i] = bias[i] + weight[i]
        sigma[i] = math.sqrt(sigma[i])


class LoadCellFrame:
    """A load cell's mounting, tool weight and bias, prepared once."""

    def __init__(self, cell: LoadCell) -> None:
        self.sign = cell.sign
        self._place = Placement(cell.position, cell.quaternion)
        bias = tuple(cell.sign * b for b in cell.bias)
        mount = cell.position, cell.quaternion, cell.mass * GRAVITY, cell.center_of_mass, bias
        self._mount = np.array([mount], _MOUNT)
        self._out = np.zeros(1, _IN_SENSOR)
        self._rows = self._out.view(np.float64).reshape(3, 6)  # wrench, offset, sigma
        self._into_sensor = machine_code(
            _into_sensor, (self._mount, np.zeros(4), np.zeros(12), self._out)
        )

    def into_sensor(self, quaternion: Array, with_sigma: Array) -> tuple[Wrench, Wrench, Wrench]:
        """The wrench, the offset and one standard deviation of each component of the wrench, in the sensor frame.

        The offset is bias plus tool weight, in the sign of a force on the tool: the raw reading is `sign` times the sum
        of wrench and offset. `with_sigma`, shape [12]: wrench and standard deviations in world axes, about the tool
        frame's origin [N], [N m]. Both arrays are contiguous.
        """
        self._into_sensor(self._mount, quaternion, with_sigma, self._out)
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

    @property
    def patience(self) -> int:
        """How much later [ns] than its pose the stamp of another input is when the prediction waits no longer."""
        return max(self.max_age, PATIENCE)

    def force_in_world(self, compensated: Wrench) -> Vector:
        """The force of its reading [N], in world axes."""
        return self.cell.force_in_world(compensated, self.pose)


class Comparison:
    """Compares each prediction with the load cell at its stamp, once the readings around the stamp have come.

    The reading is interpolated linearly between those on both sides of the stamp, each within `max_age`. If no reading
    follows within that, the last one before the stamp is used. A prediction waits for a later reading until another
    input has a stamp that is later by `patience`: 1 s, or `max_age` if that is longer. Reasons for predictions without
    a measurement are counted in `counts`. `on_compared` is called with each prediction that has one, in the order of
    the estimates, with the compensated wrench, and whether the raw reading equals the one before, bit by bit.
    """

    def __init__(
        self, counts: Counter[Reason], on_compared: Callable[[Prediction, Wrench, bool], None]
    ) -> None:
        self._counts = counts
        self._on_compared = on_compared
        self._pending: deque[Prediction] = deque()
        self._final: list[Measurement] = []
        self._last_raw: Wrench | None = None

    def add(self, prediction: Prediction, readings: Timeline[WrenchSample]) -> None:
        """Add a prediction."""
        if len(self._pending) >= _MOST_PENDING:
            self._compare_oldest(readings)
        self._pending.append(prediction)
        self.settle(prediction.pose.stamp, readings)

    def settle(self, now: float, readings: Timeline[WrenchSample]) -> None:
        """Compare the predictions that need not wait. `now` [ns]: the stamp of the sample that has just come."""
        while self._pending:
            oldest = self._pending[0]
            newest = readings.last.stamp if readings.last else 0
            if newest < oldest.pose.stamp and now <= oldest.pose.stamp + oldest.patience:
                break
            self._compare_oldest(readings)

    def measurements(self) -> list[Measurement]:
        """The measurements that became final since the last call, in the order of the estimates."""
        final = self._final
        self._final = []
        return final

    def _compare_oldest(self, readings: Timeline[WrenchSample]) -> None:
        self._final.append(self._measured(self._pending.popleft(), readings))

    def _measured(self, prediction: Prediction, readings: Timeline[WrenchSample]) -> Measurement:
        pose = prediction.pose
        cell = prediction.cell
        before, after, share = readings.around(pose.stamp)
        if before is None or pose.stamp - before.stamp > prediction.max_age:
            reason = Reason.WRENCH_MISSING if before is None else Reason.WRENCH_STALE
            self._counts[reason] += 1
            return Measurement(pose.stamp, None, None, reason)
        raw = before
        if (
            after
            and after.stamp - pose.stamp <= prediction.max_age
            and after.frame == before.frame
        ):
            fx, fy, fz, tx, ty, tz = between(before.wrench, after.wrench, share)
            raw = before._replace(wrench=(fx, fy, fz, tx, ty, tz))
        is_repeated = raw.wrench == self._last_raw
        self._last_raw = raw.wrench
        compensated = _difference(cell.sign, cell.in_own_axes(raw, pose), prediction.offset)
        self._on_compared(prediction, compensated, is_repeated)
        return Measurement(
            pose.stamp, compensated, _difference(1.0, compensated, prediction.wrench), None
        )


def _difference(factor: float, a: Wrench, b: Wrench) -> Wrench:
    """`factor` times one wrench, minus the other; written out, since a loop takes twice as long."""
    fx, fy, fz, tx, ty, tz = a
    gx, gy, gz, ux, uy, uz = b
    force = factor * fx - gx, factor * fy - gy, factor * fz - gz
    return *force, factor * tx - ux, factor * ty - uy, factor * tz - uz

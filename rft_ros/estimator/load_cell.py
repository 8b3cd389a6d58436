"""The load cell: its frame, its tare, and how its samples are compared with the predictions."""

import math
from collections import Counter, deque
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.estimator.samples import PATIENCE, Measurement, PoseSample, Reason, Vector, Wrench, WrenchSample, around
from rft_ros.estimator.sigma import parts_of_prediction
from rft_ros.parameters import LoadCell
from rft_ros.rft import POSITION, QUATERNION
from rft_ros.rft.frames import attitude, into_frame
from rft_ros.rft.kernel.compilation import compiled, machine_code
from rft_ros.rft.placement import Placement

__all__ = ["GRAVITY", "HISTORY", "Comparison", "LoadCellFrame", "PastPose", "Prediction", "Reading"]
__all__ += ["drift", "mean_in_air"]

Array = NDArray[np.float64]

GRAVITY = 9.80665
"""Standard gravity [m/s²] (ISO 80000-3)."""

HISTORY = 8192
"""Load-cell samples kept: 8 s of a 1 kHz stream. A pose that is older than all of them has no measurement."""

_MOST_PENDING = 4096  # estimates that wait for samples; if there are more, the oldest is compared early
_FEWEST_FOR_TARE = 10
_STRETCH = 0.25
"""Time over which poses are averaged to see a drift [s]. It reduces 10 µm of pose noise at 125 Hz to 0.01 mm/s."""


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
    mount, out = mounts[0], outs[0]
    position, center, bias = mount.position, mount.center_of_mass, mount.bias
    wrench, offset, sigma = out.wrench, out.offset, out.sigma
    force, torque, force_sigma, torque_sigma = parts_of_prediction(with_sigma)
    tool, sensor = attitude(quaternion), attitude(mount.quaternion)
    px, py, pz = position[0], position[1], position[2]
    turned = 0.0, 0.0, 0.0
    for i in range(6):
        wrench[i] = sigma[i] = 0.0
    for k in range(3):  # `turned`: a world axis, in sensor axes; `lever`: the torque of a unit force along it
        x, y, z = into_frame(tool, 1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0)
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
        self._mount, self._out = np.array([mount], _MOUNT), np.zeros(1, _IN_SENSOR)
        self._rows = self._out.view(np.float64).reshape(3, 6)  # wrench, offset, sigma
        self._into_sensor = machine_code(_into_sensor, (self._mount, np.zeros(4), np.zeros(12), self._out))

    def into_sensor(self, quaternion: Array, with_sigma: Array) -> tuple[Wrench, Wrench, Wrench]:
        """The wrench, the offset and one standard deviation of each component of the wrench, in the sensor frame.

        The offset is bias plus tool weight, in the sign of a force on the tool: the raw reading is `sign` times the sum
        of wrench and offset. `with_sigma`, shape [12]: wrench and standard deviations in world axes, about the tool
        frame's origin [N], [N m].
        """
        self._into_sensor(self._mount, np.ascontiguousarray(quaternion), np.ascontiguousarray(with_sigma), self._out)
        rows: list[Any] = self._rows.tolist()
        wrench, offset, sigma = map(tuple, rows)
        return wrench, offset, sigma

    def into_world(self, tool: PoseSample, force: Vector) -> Vector:
        """Rotate a force [N] from sensor axes to world axes. `tool`: the pose of the tool frame."""
        return Placement(tool.position, tool.quaternion).rotate(self._place.rotate(force))


class Prediction(NamedTuple):
    """A prediction that waits for its load-cell reading: `LoadCellFrame.into_sensor` at its pose."""

    pose: PoseSample
    wrench: Wrench
    offset: Wrench
    cell: LoadCellFrame
    in_air: bool


class Reading(NamedTuple):
    """The load cell's reading at the stamp [ns] of a prediction.

    `force`: compensated [N], world axes. `predicted`: magnitude of the predicted force [N]. `repeated`: the raw reading
    equals the one before, bit by bit. `in_air`: the tool touched nothing.
    """

    stamp: int
    force: Vector
    predicted: float
    repeated: bool
    in_air: bool


class Comparison:
    """Compares each prediction with the load cell at its stamp, once the samples around the stamp have come.

    The reading is interpolated linearly between the samples on both sides of the stamp, each within `max_age` [ns]. If
    no sample follows within that, the last one before the stamp is used. A prediction waits for a later sample until
    another input has a stamp that is later by 1 s, or by `max_age` if that is longer. `samples`: of the load cell, in
    the order of stamps; the intake adds them. Reasons for predictions without a measurement are counted in `counts`.
    """

    def __init__(self, counts: Counter[Reason]) -> None:
        self.samples: deque[WrenchSample] = deque(maxlen=HISTORY)
        self._counts = counts
        self._pending: deque[Prediction] = deque()
        self._final: list[Measurement] = []
        self._readings: list[Reading] = []
        self._last_raw: Wrench | None = None
        self.max_age = 0

    def add(self, prediction: Prediction) -> None:
        """Add a prediction."""
        if len(self._pending) >= _MOST_PENDING:
            self._final.append(self._measured(self._pending.popleft()))
        self._pending.append(prediction)
        self.settle(prediction.pose.stamp)

    def settle(self, now: float) -> None:
        """Compare the predictions that need not wait. `now` [ns]: the stamp of the sample that has just come."""
        pending = self._pending
        if not pending:
            return
        newest = self.samples[-1].stamp if self.samples else 0
        late = now - max(self.max_age, PATIENCE)
        while pending and ((stamp := pending[0].pose.stamp) <= newest or stamp < late):
            self._final.append(self._measured(pending.popleft()))

    def measurements(self) -> list[Measurement]:
        """The measurements that became final since the last call, in the order of the estimates."""
        final, self._final = self._final, []
        return final

    def readings(self) -> list[Reading]:
        """The readings of the measurements that became final since the last call of this, in their order."""
        new, self._readings = self._readings, []
        return new

    def _measured(self, prediction: Prediction) -> Measurement:
        stamp, cell = prediction.pose.stamp, prediction.cell
        before, after = around(self.samples, stamp)
        if before is None or stamp - before.stamp > self.max_age:
            reason = Reason.WRENCH_MISSING if before is None else Reason.WRENCH_STALE
            self._counts[reason] += 1
            return Measurement(stamp, None, None, reason)
        raw = before.wrench
        if before.stamp < stamp and after is not None and after.stamp - stamp <= self.max_age:
            share = (stamp - before.stamp) / (after.stamp - before.stamp)
            raw = _interpolated(before.wrench, after.wrench, share)
        repeated, self._last_raw = raw == self._last_raw, raw
        signed = raw if cell.sign > 0.0 else _negative(raw)
        compensated = _difference(signed, prediction.offset)
        force = cell.into_world(prediction.pose, compensated[:3])
        fx, fy, fz, *_ = prediction.wrench
        self._readings.append(Reading(stamp, force, math.hypot(fx, fy, fz), repeated, prediction.in_air))
        return Measurement(stamp, compensated, _difference(compensated, prediction.wrench), None)


# Written out by component, since loops take twice as long.


def _interpolated(a: Wrench, b: Wrench, share: float) -> Wrench:
    """The wrench at a share of the way from one to the other."""
    (ax, ay, az, dx, dy, dz), (bx, by, bz, ex, ey, ez) = a, b
    return (
        ax + share * (bx - ax),
        ay + share * (by - ay),
        az + share * (bz - az),
        dx + share * (ex - dx),
        dy + share * (ey - dy),
        dz + share * (ez - dz),
    )


def _difference(a: Wrench, b: Wrench) -> Wrench:
    (ax, ay, az, dx, dy, dz), (bx, by, bz, ex, ey, ez) = a, b
    return ax - bx, ay - by, az - bz, dx - ex, dy - ey, dz - ez


def _negative(wrench: Wrench) -> Wrench:
    fx, fy, fz, tx, ty, tz = wrench
    return -fx, -fy, -fz, -tx, -ty, -tz


class PastPose(NamedTuple):
    """A past pose. `refusal`: why a tare must not use it; None if it may."""

    pose: PoseSample
    refusal: str | None


def drift(time: Array, places: Array, reach: float) -> float:
    """Greatest speed [m/s] between the means of successive quarters of a second, which average out noise of the poses.

    `time` [s], shape [n], n at least 2; `places`: position and quaternion, shape [n, 7]; `reach` of the plates [m].
    """
    quaternions = places[:, QUATERNION]
    alike = np.where(quaternions @ quaternions[-1] < 0.0, -1.0, 1.0)  # q and -q are one attitude
    count = min(max(2, round((time[-1] - time[0]) / _STRETCH)), len(time))

    def steps(values: Array) -> Array:
        return np.diff([part.mean(axis=0) for part in np.array_split(values, count)], axis=0)

    moved = np.linalg.norm(steps(places[:, POSITION]), axis=1)
    turned = 2.0 * np.linalg.norm(steps(alike[:, None] * quaternions), axis=1)
    return float(((moved + reach * turned) / steps(time)).max())


def mean_in_air(
    samples: deque[WrenchSample],
    poses: deque[PastPose],
    window: float,
    *,
    rest_speed: float,
    reach: float,
) -> Array:
    """Mean of the raw samples over the last `window` [s], shape [6]. Raises InputError if a tare would be wrong now.

    `poses`: the last ones, at most `HISTORY`. The tool must not drift faster than `rest_speed` [m/s]. `reach` of its
    plates [m].
    """
    if not poses:
        raise InputError("tare refused: no pose with a known velocity has come yet")
    end = samples[-1].stamp if samples else poses[-1].pose.stamp
    start = end - round(window * 1e9)
    refused = f"tare refused: within the last {window:g} s"
    recent = [past for past in poses if past.pose.stamp > start]
    for past in reversed(recent):
        if past.refusal is not None:
            raise InputError(f"{refused} {past.refusal}")
    if len(recent) < 2:
        raise InputError(f"{refused} no pose has shown the tool at rest")
    time = np.array([past.pose.stamp - start for past in recent]) * 1e-9
    speed = drift(time, np.array([(*past.pose.position, *past.pose.quaternion) for past in recent]), reach)
    if speed >= rest_speed:
        raise InputError(f"{refused} the tool moved at {speed:.4f} m/s")
    if len(poses) == HISTORY:
        start = max(start, recent[0].pose.stamp)
    used = [s.wrench for s in samples if s.stamp > start]
    if len(used) < _FEWEST_FOR_TARE:
        raise InputError(f"{refused} {len(used)} load-cell samples came; it needs {_FEWEST_FOR_TARE}")
    mean: Array = np.mean(used, axis=0)
    return mean

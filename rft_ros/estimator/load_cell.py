"""The load cell: its frame, its tare, and how its samples are compared with the predictions."""

import math
from collections import Counter, deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.estimator.samples import PATIENCE, Measurement, PoseSample, Reason, Vector, Wrench, WrenchSample, around
from rft_ros.estimator.transforms import Placement
from rft_ros.parameters import LoadCell
from rft_ros.rft.compilation import compiled, machine_code
from rft_ros.rft.frames import into_frame, rotation

__all__ = ["GRAVITY", "HISTORY", "Comparison", "LoadCellFrame", "Prediction", "Reading", "drift", "mean_in_air"]

Array = NDArray[np.float64]

GRAVITY = 9.80665
"""Standard gravity [m/s²] (ISO 80000-3)."""

HISTORY = 8192
"""Load-cell samples kept: 8 s of a 1 kHz stream. A pose older than all of them counts as without any."""

_MOST_PENDING = 4096  # estimates that wait for samples; more settle the oldest early
_FEWEST_FOR_TARE = 10
_STRETCH = 0.25  # time over which poses are averaged to see a drift [s]: 10 µm of noise at 125 Hz count as 0.01 mm/s


@compiled
def _into_sensor(mount, quaternion, answer, out):
    """Write wrench, offset and deviations, in sensor axes about the sensor's origin, to `out`, shape [18].

    `mount`: position (3) and quaternion (4) of the sensor in the tool frame, weight [N], centre of mass (3), bias (6)
    of a cell that reads the force on the tool. `answer`: wrench and its standard deviations in world axes about the
    tool frame's origin. The errors of world components, and those of force and torque, are taken as independent.
    """
    tool = rotation(quaternion[0], quaternion[1], quaternion[2], quaternion[3])
    sensor = rotation(mount[3], mount[4], mount[5], mount[6])
    px, py, pz = mount[0], mount[1], mount[2]
    turned = 0.0, 0.0, 0.0
    for i in range(18):
        out[i] = mount[5 + i] if 6 <= i < 12 else 0.0
    for k in range(3):  # one world axis after another: in the sensor's axes, and its torque about the sensor's origin
        x, y, z = into_frame(tool, 1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0)
        turned = into_frame(sensor, x, y, z)
        lever = into_frame(sensor, pz * y - py * z, px * z - pz * x, py * x - px * y)
        for i in range(3):
            out[i] += answer[k] * turned[i]
            out[3 + i] += answer[k] * lever[i] + answer[3 + k] * turned[i]
            out[12 + i] += (answer[6 + k] * turned[i]) ** 2
            out[15 + i] += (answer[6 + k] * lever[i]) ** 2 + (answer[9 + k] * turned[i]) ** 2
    wx, wy, wz = -mount[7] * turned[0], -mount[7] * turned[1], -mount[7] * turned[2]
    cx, cy, cz = mount[8], mount[9], mount[10]
    weight = wx, wy, wz, cy * wz - cz * wy, cz * wx - cx * wz, cx * wy - cy * wx
    for i in range(6):
        out[6 + i] += weight[i]
    for i in range(12, 18):
        out[i] = math.sqrt(out[i])


class LoadCellFrame:
    """A load cell's mounting, tool weight and bias, prepared once."""

    def __init__(self, cell: LoadCell) -> None:
        self.sign = cell.sign
        self._place = Placement(cell.position, cell.quaternion)
        bias = [cell.sign * b for b in cell.bias]
        self._mount = np.array([*cell.position, *cell.quaternion, cell.mass * GRAVITY, *cell.center_of_mass, *bias])
        self._out = np.zeros(18)
        self._into_sensor = machine_code(_into_sensor, (self._mount, np.zeros(4), np.zeros(12), self._out))

    def into_sensor(self, quaternion: Array, answer: Array) -> tuple[Wrench, Wrench, Wrench]:
        """In the sensor frame: the wrench, the offset that the cell reads beside it, one standard deviation.

        The offset, bias and weight, has the sign of a force on the tool: the raw reading is `sign` times the sum.
        `answer`, shape [12]: wrench and standard deviations in world axes, about the tool frame's origin [N], [N m].
        """
        self._into_sensor(self._mount, np.ascontiguousarray(quaternion), np.ascontiguousarray(answer), self._out)
        a, b, c, d, e, f, g, h, i, j, k, m, n, o, p, q, r, s = self._out.tolist()
        return (a, b, c, d, e, f), (g, h, i, j, k, m), (n, o, p, q, r, s)

    def into_world(self, tool: PoseSample, force: Vector) -> Vector:
        """A force [N] given in sensor axes, in world axes."""
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

    `force`: compensated [N], world axes. `repeated`: the raw reading equals the one before, bit by bit. `in_air`: the
    tool touched nothing.
    """

    stamp: int
    force: Vector
    repeated: bool
    in_air: bool


class Comparison:
    """Compare each prediction with the load cell at its stamp, once the samples around it have come.

    The reading is interpolated linearly between the samples on both sides of the stamp, each within `max_age` [ns].
    Without a sample after the stamp, the last one before it counts; that is decided once another input carries a stamp
    later by 1 s, or by `max_age` if that is longer. `samples`: the load cell's, by stamp, which the intake adds.
    `counts` gets the reasons.
    """

    def __init__(self, counts: Counter[str]) -> None:
        self.samples: deque[WrenchSample] = deque(maxlen=HISTORY)
        self._counts = counts
        self._pending: deque[Prediction] = deque()
        self._final: list[Measurement] = []
        self._readings: list[Reading] = []
        self._last: Wrench | None = None
        self.max_age = 0

    def add(self, prediction: Prediction) -> None:
        """Add a prediction."""
        if len(self._pending) >= _MOST_PENDING:
            self._final.append(self._measured(self._pending.popleft()))
        self._pending.append(prediction)
        self.settle(prediction.pose.stamp)

    def settle(self, now: float) -> None:
        """Compare what can be compared; `now` [ns]: the stamp of the sample of any kind that has just come."""
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
        if not self._readings:
            return self._readings
        new, self._readings = self._readings, []
        return new

    def _measured(self, prediction: Prediction) -> Measurement:
        stamp, cell = prediction.pose.stamp, prediction.cell
        before, after = around(self.samples, stamp)
        if before is None or stamp - before.stamp > self.max_age:
            reason = Reason.WRENCH_MISSING if before is None else Reason.WRENCH_STALE
            self._counts[reason.value] += 1
            return Measurement(stamp, None, None, reason)
        # written out by component: loops take twice as long
        ax, ay, az, dx, dy, dz = before.wrench
        if before.stamp < stamp and after is not None and after.stamp - stamp <= self.max_age:
            share = (stamp - before.stamp) / (after.stamp - before.stamp)
            bx, by, bz, ex, ey, ez = after.wrench
            ax, ay, az = ax + share * (bx - ax), ay + share * (by - ay), az + share * (bz - az)
            dx, dy, dz = dx + share * (ex - dx), dy + share * (ey - dy), dz + share * (ez - dz)
        last, self._last = self._last, (ax, ay, az, dx, dy, dz)
        sign, (bx, by, bz, ex, ey, ez), (fx, fy, fz, tx, ty, tz) = cell.sign, prediction.offset, prediction.wrench
        ax, ay, az = sign * ax - bx, sign * ay - by, sign * az - bz
        dx, dy, dz = sign * dx - ex, sign * dy - ey, sign * dz - ez
        world = cell.into_world(prediction.pose, (ax, ay, az))
        self._readings.append(Reading(stamp, world, last == self._last, prediction.in_air))
        residual = ax - fx, ay - fy, az - fz, dx - tx, dy - ty, dz - tz
        return Measurement(stamp, (ax, ay, az, dx, dy, dz), residual, None)


def drift(time: Array, places: Array, reach: float) -> float:
    """Greatest speed [m/s] between the means of neighbouring quarters of a second: the noise of poses is no motion.

    `time` [s], shape [n], n at least 2; `places`: position and quaternion, shape [n, 7]; `reach` of the plates [m].
    """
    alike = np.where(places[:, 3:] @ places[-1, 3:] < 0.0, -1.0, 1.0)  # q and -q are one attitude
    rows = np.column_stack([time, places[:, :3], alike[:, None] * places[:, 3:]])
    parts = np.array_split(rows, min(max(2, round((time[-1] - time[0]) / _STRETCH)), len(rows)))
    steps = np.diff([part.mean(axis=0) for part in parts], axis=0)
    ways = np.linalg.norm(steps[:, 1:4], axis=1) + 2.0 * reach * np.linalg.norm(steps[:, 4:], axis=1)
    return float((ways / steps[:, 0]).max())


def mean_in_air(
    samples: deque[WrenchSample],
    poses: deque[tuple[PoseSample, str]],
    window: float,
    *,
    rest_speed: float,
    reach: float,
) -> Array:
    """Mean of the raw samples over the last `window` [s], shape [6]; InputError says why a tare would be wrong now.

    `poses`: the last, at most `HISTORY`, each with why a tare there would be wrong, empty if the tool was in the air.
    The tool must not drift faster than `rest_speed` [m/s]; `reach` of its plates [m].
    """
    if not poses:
        raise InputError("tare refused: no pose with a known velocity has come yet")
    start = (samples or [poses[-1][0]])[-1].stamp - round(window * 1e9)
    refused = f"tare refused: within the last {window:g} s"
    recent = [(pose, wrong) for pose, wrong in poses if pose.stamp > start]
    for _, wrong in reversed(recent):
        if wrong:
            raise InputError(f"{refused} {wrong}")
    if len(recent) < 2:
        raise InputError(f"{refused} no pose has shown the tool at rest")
    time = np.array([pose.stamp - start for pose, _ in recent]) * 1e-9
    speed = drift(time, np.array([(*pose.position, *pose.quaternion) for pose, _ in recent]), reach)
    if speed >= rest_speed:
        raise InputError(f"{refused} the tool moved at {speed:.4f} m/s")
    if len(poses) == HISTORY:
        start = max(start, recent[0][0].stamp)
    used = [s.wrench for s in samples if s.stamp > start]
    if len(used) < _FEWEST_FOR_TARE:
        raise InputError(f"{refused} {len(used)} load-cell samples came; it needs {_FEWEST_FOR_TARE}")
    mean: Array = np.mean(used, axis=0)
    return mean

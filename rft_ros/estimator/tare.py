"""What the load cell reads in the air: an offset, or the bias that a tare of a tool at rest takes from it."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.estimator.load_cell import HISTORY, LoadCellFrame, Prediction
from rft_ros.estimator.samples import PoseSample, WrenchSample
from rft_ros.estimator.timeline import Timeline
from rft_ros.rft import POSITION, QUATERNION
from rft_ros.rft.frames import Vector, Wrench

Array = NDArray[np.float64]

_MIN_READING_COUNT = 10
_AVERAGING_TIME_S = 0.25
"""Time over which poses are averaged to see a drift. It reduces 10 µm of pose noise at 125 Hz to 0.01 mm/s."""

_MEAN_READING_COUNT = 64  # averaged at most; half as many are enough to judge the mean
_MIN_OFFSET_N = 0.2  # a smaller mean is noise, or a small error of the tool's weight
_MIN_OFFSET_SHARE = 0.1  # of the force in the grains: a smaller mean matters little beside it

OFFSET_SENTENCE = "the load cell reads a force in the air: call ~/tare there, or check sensor.bias and sensor.mass"
"""What an offset says to a user."""


def is_offset(load: float, greatest: float, *, share: float = _MIN_OFFSET_SHARE) -> bool:
    """Whether a mean force `load` in the air [N] is an offset of the load cell.

    `greatest`: the greatest force in the grains [N]. A load below `share` of it is no offset.
    """
    return load > max(_MIN_OFFSET_N, share * greatest)


class AirReading:
    """The mean of the last compensated forces in the air, and whether it is an offset."""

    def __init__(self) -> None:
        # until no late reading can come before it
        self._waiting: deque[tuple[Prediction, Wrench]] = deque()
        self._mean = (0.0, 0.0, 0.0)
        self._count = 0
        self._greatest = 0.0  # predicted force in the grains so far [N]
        self.load = 0.0
        """Magnitude of the mean [N]; 0 before there are enough readings."""

    @property
    def is_offset(self) -> bool:
        """Whether the load cell reads a force in the air."""
        return is_offset(self.load, self._greatest)

    def add(self, prediction: Prediction, wrench: Wrench) -> None:
        """Add the compensated wrench at a prediction; it counts from `settle` on."""
        self._waiting.append((prediction, wrench))

    def settle(self, stamp: float) -> None:
        """Count the forces before a stamp [ns]: so the mean depends on stamps, and not on the order of arrival."""
        while self._waiting and self._waiting[0][0].pose.stamp < stamp:
            prediction, wrench = self._waiting.popleft()
            if prediction.in_air:
                self._average(prediction.force_in_world(wrench))
            else:
                self._greatest = max(self._greatest, math.hypot(*prediction.wrench[:3]))

    def _average(self, force: Vector) -> None:
        """Bring the mean to the next force [N]."""
        self._count = min(self._count + 1, _MEAN_READING_COUNT)
        a, b, c = force
        x, y, z = self._mean
        n = self._count
        x, y, z = x + (a - x) / n, y + (b - y) / n, z + (c - z) / n
        self._mean = x, y, z
        if 2 * n >= _MEAN_READING_COUNT:
            self.load = math.sqrt(x * x + y * y + z * z)

    def issues(self) -> list[str]:
        """`OFFSET_SENTENCE` if the load cell reads a force in the air; otherwise nothing."""
        return [OFFSET_SENTENCE] if self.is_offset else []


class TarePose(NamedTuple):
    """A pose for a tare. `refusal`: why a tare must not use it; None if it may."""

    pose: PoseSample
    refusal: str | None


def drift(time: Array, places: Array, reach: float) -> float:
    """Greatest speed [m/s] between the means of successive quarters of a second, which average out noise of the poses.

    `time` [s], shape [n], n at least 2; `places`: position and quaternion, shape [n, 7]; `reach` of the plates [m].
    """
    quaternions = places[:, QUATERNION]
    signs = np.where(quaternions @ quaternions[-1] < 0.0, -1.0, 1.0)  # q and -q are one attitude
    count = min(max(2, round((time[-1] - time[0]) / _AVERAGING_TIME_S)), len(time))

    def steps(values: Array) -> Array:
        return np.diff([part.mean(axis=0) for part in np.array_split(values, count)], axis=0)

    distances = np.linalg.norm(steps(places[:, POSITION]), axis=1)
    angles = 2.0 * np.linalg.norm(steps(signs[:, None] * quaternions), axis=1)
    return float(((distances + reach * angles) / steps(time)).max())


def silent(what: str, age: float) -> str:
    """The refusal of a tare while an input is silent. `age`: of its last message [s], infinite if none has come."""
    last = f"the last one is {age:.1f} s old" if math.isfinite(age) else "none has come yet"
    return f"tare refused: no {what} come, {last}; start their driver, and tare again"


def mean_in_air(
    readings: Timeline[WrenchSample],
    poses: deque[TarePose],
    cell: LoadCellFrame,
    *,
    newest_pose: int,
    longest_gap: int,
    window: float,
    rest_speed: float,
    reach: float,
) -> Array:
    """Mean of the readings of `cell` over the last `window` [s], shape [6]. Raises InputError if a tare would be wrong.

    `poses`: the last ones, at most `HISTORY`. `newest_pose`: stamp of the last one that was accepted; it and that of
    the last reading must not differ by more than `longest_gap`, both [ns]. The tool must not drift faster than
    `rest_speed` [m/s]. `reach` of its plates [m].
    """
    if not poses:
        raise InputError(
            "tare refused: no pose with a known velocity has come yet; start the driver of the poses or twists"
        )
    if readings.last is not None:
        newest_reading = readings.last.stamp
        if newest_pose - newest_reading > longest_gap:
            raise InputError(silent("load-cell samples", 1e-9 * (newest_pose - newest_reading)))
        if newest_reading - newest_pose > longest_gap:
            raise InputError(silent("poses", 1e-9 * (newest_reading - newest_pose)))
    end = readings.last.stamp if readings.last else poses[-1].pose.stamp
    start = end - round(window * 1e9)
    refusal = f"tare refused: within the last {window:g} s"
    recent = [each for each in poses if each.pose.stamp > start]
    for each in reversed(recent):
        if each.refusal is not None:
            raise InputError(f"{refusal} {each.refusal}")
    if len(recent) < 2:
        raise InputError(f"{refusal} no pose has shown the tool at rest")
    time = np.array([each.pose.stamp - start for each in recent]) * 1e-9
    speed = drift(
        time, np.array([(*each.pose.position, *each.pose.quaternion) for each in recent]), reach
    )
    if speed >= rest_speed:
        raise InputError(
            f"{refusal} the tool moved at {speed:.4f} m/s, and rest_speed is {rest_speed:g}; hold it still"
        )
    if len(poses) == HISTORY:
        start = max(start, recent[0].pose.stamp)
    wrenches = [
        cell.in_own_axes(reading, poses[-1].pose) for reading in readings if reading.stamp > start
    ]
    if len(wrenches) < _MIN_READING_COUNT:
        raise InputError(
            f"{refusal} {len(wrenches)} load-cell samples came; it needs {_MIN_READING_COUNT}:"
            " start its driver"
        )
    mean: Array = np.mean(wrenches, axis=0)
    return mean

"""The tare: the mean reading of the load cell while the tool rests in the air."""

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.estimator.load_cell import HISTORY, LoadCellFrame, Reading
from rft_ros.estimator.samples import PoseSample
from rft_ros.estimator.timeline import Timeline
from rft_ros.rft import POSITION, QUATERNION

__all__ = ["PastPose", "drift", "mean_in_air"]

Array = NDArray[np.float64]

_FEWEST_FOR_TARE = 10
_STRETCH = 0.25
"""Time over which poses are averaged to see a drift [s]. It reduces 10 µm of pose noise at 125 Hz to 0.01 mm/s."""


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
    readings: Timeline[Reading],
    poses: deque[PastPose],
    cell: LoadCellFrame,
    *,
    window: float,
    rest_speed: float,
    reach: float,
) -> Array:
    """Mean of the readings of `cell` over the last `window` [s], shape [6]. Raises InputError if a tare would be wrong.

    `poses`: the last ones, at most `HISTORY`. The tool must not drift faster than `rest_speed` [m/s]. `reach` of its
    plates [m].
    """
    if not poses:
        raise InputError("tare refused: no pose with a known velocity has come yet")
    end = readings.last.stamp if readings.last else poses[-1].pose.stamp
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
    used = [cell.in_own_axes(reading, poses[-1].pose) for reading in readings if reading.stamp > start]
    if len(used) < _FEWEST_FOR_TARE:
        raise InputError(f"{refused} {len(used)} load-cell samples came; it needs {_FEWEST_FOR_TARE}")
    mean: Array = np.mean(used, axis=0)
    return mean

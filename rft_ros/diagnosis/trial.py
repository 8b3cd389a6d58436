"""A trial: n moments of a robot cell, each with the state of the tool, and the readings of its load cell.

A trial knows nothing of what is above it: it comes from a bag, from live messages, or from the rows of estimates.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rft_ros.estimator import dead_band_of
from rft_ros.rft import POSE, POSITION, QUATERNION, displacements_followed

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

STRETCH_M = 0.006
"""Path over which errors of the model are alike: a stretch counts as one measurement."""
STRETCH_S = 1.0
"""The same at rest: the time over which errors of a load cell are alike."""
CHANGE_S = 0.03
"""Time before and after a moment in which a change of the motion is seen."""
NOISE_STEPS = (1, 2, 4, 8, 16)
MAX_NOISE_STEP_S = 0.021
"""Samples, and the longest time, between the values of which differences are taken: load cells have 50 Hz or more."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Readings:
    """m readings of a load cell, in the order of time.

    `time` [s], shape [m], on the clock of the poses and with the given delay removed; `wrenches` [N], [N m], shape
    [m, 6]: as the driver gave them, in its own axes and sign.
    """

    time: Array
    wrenches: Array

    def at(self, time: Array) -> Array:
        """The readings about other times, shape [k, 6].

        Each is the mean of two that are interpolated a third of the interval before and after. So the variance of its
        noise is half of a sample's at any time. That of one interpolated reading is half between two samples and whole
        at one: delays that put the moments between samples would fit better.
        """
        off = self.interval / 3.0
        early, late = (
            np.column_stack([np.interp(time + shift, self.time, axis) for axis in self.wrenches.T])
            for shift in (-off, off)
        )
        return np.asarray(0.5 * (early + late))

    @cached_property
    def interval(self) -> float:
        """Usual time between two readings [s]."""
        return float(np.median(np.diff(self.time))) if len(self.time) > 1 else 1.0

    @cached_property
    def noise(self) -> Array:
        """Standard deviation of the noise of each axis [N], [N m], shape [6], at least that of its resolution.

        By fourth differences over several intervals: readings may be interpolated, and are smooth between samples then.
        """
        steps = [
            step for step in NOISE_STEPS if step == 1 or step * self.interval <= MAX_NOISE_STEP_S
        ]
        noises = [_noise_by_fourth_differences(self.wrenches, step) for step in steps]
        return np.asarray(np.max([*noises, resolutions(self.wrenches) / 12.0**0.5], axis=0))


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """n moments of a cell in the order of time, and the readings of its load cell.

    `time` [s], shape [n], and `poses` of the tool frame in the world, position [m] and quaternion xyzw, shape [n, 7].
    Of a trial that is followed: `path` of the tool so far [m], shape [n], and `interval` between two poses as they were
    sent [s].
    """

    time: Array
    poses: Array
    readings: Readings
    path: Array = field(default_factory=lambda: np.zeros(0))
    interval: float = 0.0

    def __len__(self) -> int:
        return len(self.time)

    @property
    def position(self) -> Array:
        """Of the tool frame [m], shape [n, 3]."""
        return self.poses[:, POSITION]

    @cached_property
    def rotation(self) -> Rotation:
        """From the axes of the tool to those of the world. Of a trial with at least one moment."""
        return Rotation.from_quat(self.poses[:, QUATERNION])

    @cached_property
    def matrices(self) -> Array:
        """The same as matrices, shape [n, 3, 3]."""
        return np.asarray(self.rotation.as_matrix())

    @property
    def down(self) -> Array:
        """The direction of gravity in the axes of the tool, shape [n, 3]."""
        return -self.matrices[:, 2]

    def path_of(self, reach: float) -> Array:
        """How far the tool has gone, turns included, shape [n]; `reach` of its plates, all [m]."""
        distance = np.linalg.norm(np.diff(self.position, axis=0), axis=1)
        trace = np.einsum("nij,nij->n", self.matrices[1:], self.matrices[:-1])
        angle = np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))
        return np.append(0.0, np.cumsum(distance + 0.5 * reach * angle))

    def thinned(self, count: int) -> "Trial":
        """At most `count` of its moments."""
        return self.at(np.arange(len(self))[thin_rows(len(self), count)])

    def at(self, rows: Indices) -> "Trial":
        """Some of its moments, with all readings."""
        path = self.path[rows] if len(self.path) else self.path
        return replace(self, time=self.time[rows], poses=self.poses[rows], path=path)

    def posed(self, position: Array, rotation: Rotation) -> "Trial":
        """The same readings at other poses."""
        return replace(self, poses=np.hstack([position, rotation.as_quat()]))

    def followed(self, reach: float, count: int) -> "Trial":
        """At most `count` moments of it, evenly over time and path, without the noise of the poses.

        `reach` of the tool's plates [m].
        """
        band = dead_band_of(float(noise_of(self.position).max()))
        poses = self.poses.copy()
        poses[:, POSITION] = places_followed(self.time, poses, reach=reach, dead_band=band)
        quiet = replace(self, poses=poses)
        path = quiet.path_of(reach)
        interval = float(np.median(np.diff(self.time)))
        quiet = replace(quiet, path=path, interval=interval)
        rows = _rows_along((self.time, path, _changes(self.time, quiet.position)), count)
        return quiet.at(rows)


def places_followed(time: Array, poses: Array, *, reach: float, dead_band: float) -> Array:
    """Places that follow poses, shape [n, 7], at the distance of a dead band [m], shape [n, 3].

    The mean of those that follow forwards and backwards in `time` [s], which starts and stops with the tool. `reach` of
    its plates [m].
    """
    forwards = _places_behind(time, poses, reach, dead_band)
    backwards = _places_behind(-time[::-1], poses[::-1], reach, dead_band)[::-1]
    return 0.5 * (forwards + backwards)


def _places_behind(time: Array, poses: Array, reach: float, dead_band: float) -> Array:
    steps = np.maximum(np.diff(time), 1e-4)[:, None]
    turns = Rotation.from_quat(poses[:, QUATERNION])
    states = np.zeros((len(time), 13))
    states[:, POSE] = poses
    states[1:, 7:10] = np.diff(poses[:, POSITION], axis=0) / steps
    states[1:, 10:] = (turns[1:] * turns[:-1].inv()).as_rotvec() / steps
    displacements = displacements_followed(states, reach=reach, dead_band=dead_band)
    return np.asarray(poses[0, POSITION] + np.cumsum(displacements[:, :3], axis=0))


def thin_rows(length: int, count: int) -> slice:
    """Every k-th of some rows, so that at most `count` remain."""
    return slice(None, None, max(1, -(-length // count)))


def noise_of(series: Array) -> Array:
    """Standard deviation of the noise of series, shape [n, k], by the median of their second differences."""
    if len(series) < 3:
        return np.zeros(series.shape[1])
    steps = np.diff(series, 2, axis=0)
    return np.asarray(1.48 * np.median(np.abs(steps), axis=0) / 6.0**0.5)


def _noise_by_fourth_differences(series: Array, step: int) -> Array:
    """As `noise_of`, of every `step`-th value: hardly changed by any motion."""
    if len(series) <= 4 * step:
        return np.zeros(series.shape[1])
    shifted = [series[k * step : len(series) - (4 - k) * step] for k in range(5)]
    differences = shifted[0] - 4.0 * shifted[1] + 6.0 * shifted[2] - 4.0 * shifted[3] + shifted[4]
    return np.asarray(1.48 * np.median(np.abs(differences), axis=0) / 70.0**0.5)


def resolutions(series: Array) -> Array:
    """The least difference of two values of series, shape [n, k]."""
    steps = [np.diff(np.unique(values)) for values in series.T]
    return np.array([step.min(initial=np.inf) if len(step) else 0.0 for step in steps])


def _rows_along(measures: Sequence[Array], count: int) -> Indices:
    """At most `count` rows, spread evenly over several measures alike, each shape [n] and never falling."""
    length = len(measures[0])
    if length <= count:
        return np.arange(length)
    place = np.sum([(m - m[0]) / max(m[-1] - m[0], 1e-9) for m in measures], axis=0)
    rows = np.arange(0)
    # where the measures rise most, several places fall on one row
    for places in (count * np.array([1.0, 1.3, 1.7, 2.2, 3.0, 4.0])).astype(int):
        more = np.unique(np.searchsorted(place, np.linspace(0.0, place[-1], places)))
        if len(more) > count:
            break
        rows = more
    return rows


def _changes(time: Array, position: Array) -> Array:
    """How much the velocity has changed so far [m/s], shape [n]: starts, stops and turns show a delay."""

    def differences(values: Array) -> Array:
        later_values, earlier_values = (
            np.column_stack([np.interp(time + shift, time, axis) for axis in values.T])
            for shift in (CHANGE_S, -CHANGE_S)
        )
        return np.asarray(later_values - earlier_values)

    change = np.linalg.norm(differences(differences(position)), axis=1) / (2.0 * CHANGE_S)
    noise = np.median(change)
    steps = np.maximum(change - 2.0 * noise, 0.0) * np.gradient(time)
    return np.asarray(np.cumsum(steps))


def stretches(time: Array, path: Array) -> Array:
    """How many independent stretches each moment stands for, shape [n]."""
    distance = np.gradient(path) / STRETCH_M
    rest = np.gradient(time) / STRETCH_S
    return np.asarray(np.minimum(distance + rest, 1.0))

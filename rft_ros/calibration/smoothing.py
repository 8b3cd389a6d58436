"""Smooths the poses of a recording, and computes velocities from them: removes the noise, and keeps sharp corners.

Each pose is replaced by the value of a straight line through its neighbours, before, after or on both sides. The line
is the longest one whose value agrees with that of every shorter one within the noise (intersection of confidence
intervals: Goldenshluger and Nemirovski, Mathematical Methods of Statistics 6, 1997). So the line is long on a straight
way and short at a corner, where an average over a fixed time would round the corner off by tenths of a millimetre.
"""

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d

from rft_ros.rft.frames import POSE, POSITION, QUATERNION, TWIST, VELOCITY

Array = NDArray[np.float64]

MAX_SAMPLE_GAP_S = 0.5
"""A longer time between samples ends a segment."""

_MAX_LINE_TIME_S = 0.25
"""Duration of the longest line."""

_LINE_GROWTH_FACTOR = 1.6
"""Factor of the number of poses from one line to the next longer one."""

_AGREEMENT_ERRORS_FACTOR = 3.0
"""Standard deviations within which two estimates of a pose agree."""

_MIN_POSE_NOISE_M = 1e-8
"""Smaller noise is rounding and is not smoothed. Noise of the quaternion has the same limit [rad/2]."""

_CORNER_FREE_SHARE = 0.8
"""Share of the third differences that contain no corner."""

_CORNER_FREE_CHI2_RATIO = 4.642
"""That quantile of chi-squared with 3 degrees of freedom."""

_THIRD_DIFFERENCE_VARIANCE_RATIO = 20.0
"""Variance of a third difference over that of a number."""

_MIN_BEND_RATIO = 0.2
"""Least change of the velocity at a corner, relative to the speeds before and after it."""

_MIN_CORNER_TIME_SHARE = 0.02
"""A corner that is nearer to a pose than this share of the time between two poses is that pose."""

_VELOCITY_DIGITS = 9
"""Decimals of velocities: rounding must not decide whether a wall along the motion leads."""


class CorneredMotion(NamedTuple):
    """A motion as `states`, shape [m, 13], at `time` [s], shape [m].

    `rows`: those of the recording's moments, shape [n]. The other rows are the corners of the path between two moments.
    """

    time: Array
    states: Array
    rows: NDArray[np.int64]


class _Line(NamedTuple):
    """Estimates at n poses from lines of one kind: values and slopes in time, shape [n, 7].

    `deviation`: standard deviation of the values over that of one pose, shape [n].
    """

    value: Array
    slope: Array
    deviation: Array


def interpolated(targets: Array, places: Array, columns: Array) -> Array:
    """Columns, shape [n, k], that are known at `places`, shape [n], by straight lines between these; shape [m, k].

    `targets`: where they are wanted, shape [m].
    """
    return np.column_stack([np.interp(targets, places, column) for column in columns.T])


def segments(mask: NDArray[np.bool_], time: Array) -> list[NDArray[np.int64]]:
    """The rows of each part of the mask, shape [n], that has no gap. `time` [s], shape [n]."""
    rows = np.flatnonzero(mask)
    apart = np.diff(time[rows]) > MAX_SAMPLE_GAP_S
    ends = np.flatnonzero(apart | (np.diff(rows) > 1))
    return [part for part in np.split(rows, ends + 1) if len(part)]


def without_jumps(states: Array) -> Array:
    """The states, shape [n, 13], with such signs of the quaternions that these do not jump."""
    quaternions = states[:, QUATERNION]
    same_signs = np.sum(quaternions[1:] * quaternions[:-1], axis=1) >= 0.0
    signs = np.append(1.0, np.cumprod(np.where(same_signs, 1.0, -1.0)))
    continuous_states = states.copy()
    continuous_states[:, QUATERNION] *= signs[:, None]
    return continuous_states


def _parts(time: Array, states: Array) -> Iterator[tuple[NDArray[np.int64], Array]]:
    """The rows of each part between gaps, and the noise of a pose's numbers there, shape [7].

    Parts of less than four rows are left out. `states`: without jumps of the quaternions.
    """
    for rows in segments(np.ones(len(time), dtype=np.bool_), time):
        if len(rows) < 4:
            continue
        third = np.diff(states[rows, POSE], n=3, axis=0)
        noise = np.empty(QUATERNION.stop)
        for part in (POSITION, QUATERNION):
            squares = np.sum(third[:, part] ** 2, axis=1)
            calm = np.quantile(squares, _CORNER_FREE_SHARE, method="lower")
            noise[part] = np.sqrt(
                calm / _CORNER_FREE_CHI2_RATIO / _THIRD_DIFFERENCE_VARIANCE_RATIO
            )
        yield rows, noise


def _line(time: Array, places: Array, poses_before: int, poses_after: int) -> _Line:
    """Fit a line at each pose, to `poses_before` poses before it and `poses_after` poses after it.

    The deviation is inf where the recording does not have as many.
    """
    size = poses_before + poses_after + 1
    number = np.arange(size) - 0.5 * (size - 1)
    mean = np.full(size, 1.0 / size)
    correlate = partial(correlate1d, axis=0, mode="nearest", origin=poses_before - size // 2)
    # beyond the ends all moments are one
    spans = np.maximum(correlate(time, number), 1e-12)
    rate = correlate(places, number) / spans[:, None]
    late = correlate(time, mean) - time
    lever = 0.5 * (poses_after - poses_before)
    variance = 1.0 / size + lever**2 / (number @ number)
    deviation = np.full(len(time), np.sqrt(variance))
    deviation[:poses_before] = np.inf
    deviation[len(time) - poses_after :] = np.inf
    value = correlate(places, mean) - rate * late[:, None]
    return _Line(value=value, slope=rate, deviation=deviation)


def _longest_lines(time: Array, places: Array, noise: Array) -> _Line:
    """Of each kind of line the longest that agrees with the shorter ones; of the kinds the one of least deviation."""
    step = max(float(np.median(np.diff(time))), 1e-6)
    max_count = min(round(_MAX_LINE_TIME_S / step), len(time) - 1)
    # fallback: the pose itself, with the slope to the pose before
    best = _line(time, places, 1, 0)
    best.slope[0] = best.slope[1]
    best.deviation[0] = 1.0
    for poses_before, poses_after in ((1, 0), (0, 1), (1, 1)):
        low = places - _AGREEMENT_ERRORS_FACTOR * noise
        high = places + _AGREEMENT_ERRORS_FACTOR * noise
        agrees = np.ones(len(time), dtype=np.bool_)
        count = 1
        while count * (poses_before + poses_after) <= max_count:
            line = _line(time, places, poses_before * count, poses_after * count)
            spread = _AGREEMENT_ERRORS_FACTOR * line.deviation[:, None] * noise
            low = np.maximum(low, line.value - spread)
            high = np.minimum(high, line.value + spread)
            agrees &= (low <= high).all(axis=1)
            better = agrees & (line.deviation < best.deviation - 1e-9)
            for best_values, line_values in zip(best, line, strict=True):
                best_values[better] = line_values[better]
            count = max(count + 1, round(_LINE_GROWTH_FACTOR * count))
    return best


def smoothed_states(time: Array, states: Array) -> Array:
    """The states with smoothed poses, and the velocities of these, shape [n, 13], columns `rft_ros.rft.STATE`.

    `time` [s], shape [n]. Parts between gaps are smoothed on their own. Poses whose noise is rounding stay as they are.
    """
    smooth_states = without_jumps(states)
    for rows, noise in _parts(time, smooth_states):
        poses = smooth_states[rows, POSE]
        middle = poses.mean(axis=0)
        line = _longest_lines(time[rows], poses - middle, np.maximum(noise, _MIN_POSE_NOISE_M))
        spin = _spin(poses[:, QUATERNION], line.slope[:, QUATERNION])
        smooth_states[rows, POSE] = np.where(noise > _MIN_POSE_NOISE_M, line.value + middle, poses)
        twist = np.hstack([line.slope[:, POSITION], spin])
        smooth_states[rows, TWIST] = np.round(twist, _VELOCITY_DIGITS)
    return _of_unit_length(smooth_states)


def _of_unit_length(states: Array) -> Array:
    lengths = np.linalg.norm(states[:, QUATERNION], axis=1)
    states[:, QUATERNION] /= lengths[:, None]
    return states


def _spin(quaternions: Array, rates: Array) -> Array:
    """Angular velocity in world axes [rad/s], shape [n, 3], from quaternions and their rates [1/s], shape [n, 4]."""
    vector = quaternions[:, :3]
    vector_rate = rates[:, :3]
    scalar_terms = quaternions[:, 3:] * vector_rate - rates[:, 3:] * vector
    return np.asarray(2.0 * (scalar_terms - np.cross(vector_rate, vector)))


def cornered_motion(time: Array, states: Array) -> CorneredMotion:
    """The motion through smoothed states, shape [n, 13], with the corners between them.

    An arm turns back or stops between two poses. Without the corner the path is too short by what the arm did after the
    one pose and undid before the other: up to 0.1 mm at 125 Hz, where grains lose their force within 0.3 mm. A corner
    lies where the lines through the poses before and after it meet.
    """
    index = np.arange(float(len(time)))
    corner_rows, share = _corners(time, states)
    span = share * np.diff(time)[corner_rows]
    corners = interpolated(corner_rows + share, index, states)
    corners[:, POSITION] = (
        states[corner_rows, POSITION] + states[corner_rows, VELOCITY] * span[:, None]
    )
    corners[:, TWIST] = states[corner_rows, TWIST]
    path = np.insert(states, corner_rows + 1, corners, axis=0)
    rows = np.arange(len(time)) + np.searchsorted(corner_rows, index)
    corner_times = time[corner_rows] + span
    return CorneredMotion(
        np.insert(time, corner_rows + 1, corner_times), _of_unit_length(path), rows
    )


def _corners(time: Array, states: Array) -> tuple[NDArray[np.int64], Array]:
    """The rows after which the path has a corner, and the share of the time to the next row that has passed there."""
    span = np.diff(time)
    velocities_before = states[:-1, VELOCITY]
    velocities_after = states[1:, VELOCITY]
    bend = velocities_before - velocities_after
    size = np.linalg.norm(bend, axis=1)
    speeds = np.linalg.norm(velocities_before, axis=1) + np.linalg.norm(velocities_after, axis=1)
    position_gaps = np.diff(states[:, POSITION], axis=0) - velocities_after * span[:, None]
    share = np.sum(position_gaps * bend, axis=1) / np.maximum(size**2 * span, 1e-300)
    inside = (share > _MIN_CORNER_TIME_SHARE) & (share < 1.0 - _MIN_CORNER_TIME_SHARE)
    corner_rows = np.flatnonzero(
        inside & (size > _MIN_BEND_RATIO * speeds) & (span <= MAX_SAMPLE_GAP_S)
    )
    return corner_rows, share[corner_rows]

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

GAP = 0.5
"""A longer time between samples [s] ends a segment."""

_LONGEST = 0.25  # s, the longest line
_GROWTH = 1.6  # factor of the number of poses from one line to the next longer one
_AGREE = 3.0  # standard deviations within which two estimates of a pose agree
_QUIET = 1e-8  # noise [m], [rad/2]; smaller noise is rounding and is not smoothed
_CALM = 0.8  # share of the third differences that contain no corner
_CHI2_OF_CALM = 4.642  # that quantile of chi-squared with 3 degrees of freedom
_THIRD = 20.0  # variance of a third difference over that of a number
# least change of the velocity at a corner, relative to the speeds before and after it
_BENDS = 0.2
_BETWEEN = 0.02  # a corner that is nearer to a pose than this share of the time between two poses is that pose
_STEP = 2e-5  # m: longest step of a fine motion,
_MOST_STEPS = 8  # unless that takes more steps than this from pose to pose
# decimals of velocities: rounding must not decide whether a wall along the motion leads
_ROUNDED = 9


class FineMotion(NamedTuple):
    """A motion as `states`, shape [m, 13]. `rows`: those of the recording's moments, shape [n].

    The other rows lie between two moments: corners of the path, and steps.
    """

    states: Array
    rows: NDArray[np.int64]


class _Line(NamedTuple):
    """Estimates at n poses from lines of one kind: values and slopes in time, shape [n, 7].

    `deviation`: standard deviation of the values over that of one pose, shape [n].
    """

    value: Array
    slope: Array
    deviation: Array


def interpolated(at: Array, places: Array, columns: Array) -> Array:
    """Columns, shape [n, k], that are known at `places`, shape [n], by straight lines between these; shape [m, k].

    `at`: where they are wanted, shape [m].
    """
    return np.column_stack([np.interp(at, places, column) for column in columns.T])


def segments(mask: NDArray[np.bool_], time: Array) -> list[NDArray[np.int64]]:
    """The rows of each part of the mask, shape [n], that has no gap. `time` [s], shape [n]."""
    rows = np.flatnonzero(mask)
    apart = np.diff(time[rows]) > GAP
    ends = np.flatnonzero(apart | (np.diff(rows) > 1))
    return [part for part in np.split(rows, ends + 1) if len(part)]


def _without_jumps(states: Array) -> Array:
    """The states, shape [n, 13], with such signs of the quaternions that these do not jump."""
    quaternions = states[:, QUATERNION]
    alike = np.sum(quaternions[1:] * quaternions[:-1], axis=1) >= 0.0
    signs = np.append(1.0, np.cumprod(np.where(alike, 1.0, -1.0)))
    signed = states.copy()
    signed[:, QUATERNION] *= signs[:, None]
    return signed


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
            calm = np.quantile(squares, _CALM, method="lower")
            noise[part] = np.sqrt(calm / _CHI2_OF_CALM / _THIRD)
        yield rows, noise


def _line(time: Array, places: Array, before: int, after: int) -> _Line:
    """Fit a line at each pose, to the `before` poses before it and the `after` poses after it.

    The deviation is inf where the recording does not have as many.
    """
    size = before + after + 1
    number = np.arange(size) - 0.5 * (size - 1)
    mean = np.full(size, 1.0 / size)
    over = partial(correlate1d, axis=0, mode="nearest", origin=before - size // 2)
    # beyond the ends all moments are one
    spans = np.maximum(over(time, number), 1e-12)
    rate = over(places, number) / spans[:, None]
    late = over(time, mean) - time
    lever = 0.5 * (after - before)
    variance = 1.0 / size + lever**2 / (number @ number)
    deviation = np.full(len(time), np.sqrt(variance))
    deviation[:before] = np.inf
    deviation[len(time) - after :] = np.inf
    value = over(places, mean) - rate * late[:, None]
    return _Line(value=value, slope=rate, deviation=deviation)


def _longest_lines(time: Array, places: Array, noise: Array) -> _Line:
    """Of each kind of line the longest that agrees with the shorter ones; of the kinds the one of least deviation."""
    step = max(float(np.median(np.diff(time))), 1e-6)
    most = min(round(_LONGEST / step), len(time) - 1)
    # fallback: the pose itself, with the slope to the pose before
    best = _line(time, places, 1, 0)
    best.slope[0] = best.slope[1]
    best.deviation[0] = 1.0
    for before, after in ((1, 0), (0, 1), (1, 1)):
        low = places - _AGREE * noise
        high = places + _AGREE * noise
        agrees = np.ones(len(time), dtype=np.bool_)
        count = 1
        while count * (before + after) <= most:
            line = _line(time, places, before * count, after * count)
            spread = _AGREE * line.deviation[:, None] * noise
            low = np.maximum(low, line.value - spread)
            high = np.minimum(high, line.value + spread)
            agrees &= (low <= high).all(axis=1)
            better = agrees & (line.deviation < best.deviation - 1e-9)
            for kept, new in zip(best, line, strict=True):
                kept[better] = new[better]
            count = max(count + 1, round(_GROWTH * count))
    return best


def shaken_states(time: Array, states: Array, seed: int) -> Array:
    """The states, shape [n, 13], with noise added to the poses, so that the deviation of their noise doubles."""
    rng = np.random.default_rng(seed)
    shaken = _without_jumps(states)
    for rows, noise in _parts(time, shaken):
        added = 3.0**0.5 * np.where(noise > _QUIET, noise, 0.0)
        shaken[rows, POSE] += added * rng.normal(size=(len(rows), len(added)))
    return _of_unit_length(shaken)


def smoothed_states(time: Array, states: Array) -> Array:
    """The states with smoothed poses, and the velocities of these, shape [n, 13], columns `rft_ros.rft.STATE`.

    `time` [s], shape [n]. Parts between gaps are smoothed on their own. Poses whose noise is rounding stay as they are.
    """
    smoothed = _without_jumps(states)
    for rows, noise in _parts(time, smoothed):
        poses = smoothed[rows, POSE]
        middle = poses.mean(axis=0)
        line = _longest_lines(time[rows], poses - middle, np.maximum(noise, _QUIET))
        spin = _spin(poses[:, QUATERNION], line.slope[:, QUATERNION])
        smoothed[rows, POSE] = np.where(noise > _QUIET, line.value + middle, poses)
        twist = np.hstack([line.slope[:, POSITION], spin])
        smoothed[rows, TWIST] = np.round(twist, _ROUNDED)
    return _of_unit_length(smoothed)


def _of_unit_length(states: Array) -> Array:
    lengths = np.linalg.norm(states[:, QUATERNION], axis=1)
    states[:, QUATERNION] /= lengths[:, None]
    return states


def _spin(quaternions: Array, rates: Array) -> Array:
    """Angular velocity in world axes [rad/s], shape [n, 3], from quaternions and their rates [1/s], shape [n, 4]."""
    vector = quaternions[:, :3]
    vector_rate = rates[:, :3]
    along = quaternions[:, 3:] * vector_rate - rates[:, 3:] * vector
    return np.asarray(2.0 * (along - np.cross(vector_rate, vector)))


def fine_motion(time: Array, states: Array) -> FineMotion:
    """The motion through smoothed states, shape [n, 13], with the corners between them, in steps of up to 20 µm.

    An arm turns back or stops between two poses. Without the corner the path is too short by what the arm did after the
    one pose and undid before the other: up to 0.1 mm at 125 Hz, where grains lose their force within 0.3 mm. A corner
    lies where the lines through the poses before and after it meet. Steps that are long beside those 0.3 mm bias λ.
    """
    index = np.arange(float(len(time)))
    at, share = _corners(time, states)
    span = share * np.diff(time)[at]
    corners = interpolated(at + share, index, states)
    corners[:, POSITION] = states[at, POSITION] + states[at, VELOCITY] * span[:, None]
    corners[:, TWIST] = states[at, TWIST]
    path = np.insert(states, at + 1, corners, axis=0)
    moments = np.insert(time, at + 1, time[at] + span)

    way = np.linalg.norm(np.diff(path[:, POSITION], axis=0), axis=1)
    wanted = np.clip(np.ceil(way / _STEP), 1, _MOST_STEPS).astype(np.int64)
    steps = np.where(np.diff(moments) <= GAP, wanted, 1)
    ends = np.append(0, np.cumsum(steps))  # the row of each state of the path among the steps
    path_index = np.arange(float(len(path)))
    places = np.interp(np.arange(ends[-1] + 1), ends, path_index)
    fine = interpolated(places, path_index, path)
    fine[:, TWIST] = path[np.ceil(places).astype(np.int64), TWIST]
    corners_before = np.searchsorted(at, index)
    rows = ends[np.arange(len(time)) + corners_before]
    return FineMotion(_of_unit_length(fine), rows)


def _corners(time: Array, states: Array) -> tuple[NDArray[np.int64], Array]:
    """The rows after which the path has a corner, and the share of the time to the next row that has passed there."""
    span = np.diff(time)
    before = states[:-1, VELOCITY]
    after = states[1:, VELOCITY]
    bend = before - after
    size = np.linalg.norm(bend, axis=1)
    speeds = np.linalg.norm(before, axis=1) + np.linalg.norm(after, axis=1)
    missed = np.diff(states[:, POSITION], axis=0) - after * span[:, None]
    share = np.sum(missed * bend, axis=1) / np.maximum(size**2 * span, 1e-300)
    inside = (share > _BETWEEN) & (share < 1.0 - _BETWEEN)
    at = np.flatnonzero(inside & (size > _BENDS * speeds) & (span <= GAP))
    return at, share[at]

"""Smooths the poses of a recording, and computes velocities from them: removes the noise, and keeps sharp corners.

Each pose is replaced by the value of a straight line through its neighbours, before, after or on both sides. The line
is the longest one whose value agrees with that of every shorter one within the noise (intersection of confidence
intervals: Goldenshluger and Nemirovski, Mathematical Methods of Statistics 6, 1997). So the line is long on a straight
way and short at a corner, where an average over a fixed time would round the corner off by tenths of a millimetre.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d

from rft_ros.rft.frames import POSE, POSITION, QUATERNION, TWIST, VELOCITY

__all__ = ["GAP", "FineMotion", "fine_motion", "shaken_states", "smoothed_states"]

Array = NDArray[np.float64]

GAP = 0.5
"""A longer time between samples [s] ends a segment."""

_LONGEST = 0.25  # s, the longest line
_GROWTH = 1.6  # factor of the number of poses from one line to the next longer one
_AGREE = 3.0  # standard deviations within which two estimates of a pose agree
_QUIET = 1e-8  # noise [m], [rad/2]; smaller noise is rounding and is not smoothed
_CALM, _CHI2_OF_CALM = 0.8, 4.642
"""Share of the third differences that contain no corner, and that quantile of chi-squared with 3 degrees of freedom."""
_BENDS = 0.2  # least change of the velocity at a corner, relative to the speeds before and after it
_BETWEEN = 0.02  # a corner that is nearer to a pose than this share of the time between two poses is that pose
_STEP, _MOST_STEPS = 2e-5, 8  # m: longest step, unless that takes more steps than this from pose to pose
_ROUNDED = 9  # decimals of velocities: rounding must not decide whether a wall along the motion leads


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


def _parts(time: Array, states: Array) -> Iterator[tuple[NDArray[np.int64], Array, Array]]:
    """The parts between gaps: their rows, their poses, shape [n, 7], and the noise of a pose's numbers, shape [7].

    Parts of less than four rows are left out. The signs of quaternions are such that they do not jump.
    """
    for rows in np.split(np.arange(len(time)), np.flatnonzero(np.diff(time) > GAP) + 1):
        if len(rows) < 4:
            continue
        places, noise = states[rows, POSE].copy(), np.empty(QUATERNION.stop)
        turned = np.sum(places[1:, QUATERNION] * places[:-1, QUATERNION], axis=1) < 0.0
        places[1:, QUATERNION] *= np.cumprod(np.where(turned, -1.0, 1.0))[:, None]
        third = np.diff(places, n=3, axis=0)
        for part in (POSITION, QUATERNION):
            squares = np.sort(np.sum(third[:, part] ** 2, axis=1))
            noise[part] = np.sqrt(squares[int(_CALM * (len(squares) - 1))] / _CHI2_OF_CALM / 20.0)
        yield rows, places, noise


def _line(time: Array, places: Array, before: int, after: int) -> _Line:
    """Fit a line at each pose, to the `before` poses before it and the `after` poses after it.

    The deviation is inf where the recording does not have as many.
    """
    size, n = before + after + 1, len(time)
    number = np.arange(size) - 0.5 * (size - 1)
    mean, slope = np.full(size, 1.0 / size), number / (number @ number)
    begin = size // 2  # index of the filter's result for the first `size` poses
    inner = slice(before, n - after)

    def over(weights: Array, columns: Array) -> Array:
        return np.asarray(correlate1d(columns, weights, axis=0)[begin : begin + n - size + 1])

    rate = over(slope, places) / over(slope, time)[:, None]
    late = over(mean, time) - time[inner]
    found = _Line(places.copy(), np.zeros_like(places), np.full(n, np.inf))
    found.value[inner] = over(mean, places) - rate * late[:, None]
    found.slope[inner] = rate
    lever = 0.5 * (after - before)
    found.deviation[inner] = np.sqrt(1.0 / size + lever * lever / (number @ number))
    return found


def _longest_lines(time: Array, places: Array, noise: Array) -> _Line:
    """Of each kind of line the longest that agrees with the shorter ones; of the kinds the one of least deviation."""
    n = len(time)
    step = max(float(np.median(np.diff(time))), 1e-6)
    most = min(round(_LONGEST / step), n - 1)
    # fallback: the pose itself, with the slope to the pose before
    best = _line(time, places, 1, 0)
    best.slope[0], best.deviation[0] = best.slope[1], 1.0
    best.value[0] = places[0]
    for before, after in ((1, 0), (0, 1), (1, 1)):
        low, high = places - _AGREE * noise, places + _AGREE * noise
        agrees, count = np.ones(n, dtype=np.bool_), 1
        while count * (before + after) <= most:
            line = _line(time, places, before * count, after * count)
            agrees &= np.isfinite(line.deviation)
            spread = _AGREE * np.where(agrees, line.deviation, 0.0)[:, None] * noise
            low, high = np.maximum(low, line.value - spread), np.minimum(high, line.value + spread)
            agrees &= (low <= high).all(axis=1)
            better = agrees & (line.deviation < best.deviation - 1e-9)
            for kept, new in zip(best, line, strict=True):
                kept[better] = new[better]
            count = max(count + 1, round(_GROWTH * count))
    return best


def shaken_states(time: Array, states: Array, *, times: float, rng: np.random.Generator) -> Array | None:
    """The states, shape [n, 13], with noise added to the poses: of `times` the deviation of their own noise.

    None if the poses' own noise is rounding.
    """
    result, shaken = states.copy(), False
    for rows, _, noise in _parts(time, states):
        noise[noise <= _QUIET] = 0.0
        shaken |= bool(noise.any())
        result[rows, POSE] += times * noise * rng.normal(size=(len(rows), 7))
    result[:, QUATERNION] /= np.linalg.norm(result[:, QUATERNION], axis=1)[:, None]
    return result if shaken else None


def smoothed_states(time: Array, states: Array) -> Array:
    """The states with smoothed poses, and the velocities of these, shape [n, 13], columns `rft_ros.rft.STATE`.

    `time` [s], shape [n]. Parts between gaps are smoothed on their own. Poses whose noise is rounding stay as they are.
    """
    result = states.copy()
    for rows, places, noise in _parts(time, states):
        middle = places.mean(axis=0)
        line = _longest_lines(time[rows], places - middle, np.maximum(noise, _QUIET))
        value = np.where(noise > _QUIET, line.value + middle, states[rows, POSE])
        value[:, QUATERNION] /= np.linalg.norm(value[:, QUATERNION], axis=1)[:, None]
        spin = _spin(places[:, QUATERNION], line.slope[:, QUATERNION])
        result[rows, POSE] = value
        result[rows, TWIST] = np.round(np.hstack([line.slope[:, POSITION], spin]), _ROUNDED)
    return result


def _spin(quaternions: Array, rates: Array) -> Array:
    """Angular velocity in world axes [rad/s], shape [n, 3], from quaternions and their rates [1/s], shape [n, 4]."""
    (vector, scalar), (vector_rate, scalar_rate) = (np.split(q, [3], axis=1) for q in (quaternions, rates))
    return np.asarray(2.0 * (scalar * vector_rate - scalar_rate * vector - np.cross(vector_rate, vector)))


def fine_motion(time: Array, states: Array) -> FineMotion:
    """The motion through smoothed states, shape [n, 13], with the corners between them, in steps of up to 20 µm.

    An arm turns back or stops between two poses. Without the corner the path is too short by what the arm did after the
    one pose and undid before the other: up to 0.1 mm at 125 Hz, where grains lose their force within 0.3 mm. A corner
    lies where the lines through the poses before and after it meet. Steps that are long beside those 0.3 mm bias λ.
    """
    span = np.diff(time)
    before, after = states[:-1, VELOCITY], states[1:, VELOCITY]
    bend = before - after
    size = np.linalg.norm(bend, axis=1)
    speeds = np.linalg.norm(before, axis=1) + np.linalg.norm(after, axis=1)
    missed = np.diff(states[:, POSITION], axis=0) - after * span[:, None]
    share = np.sum(missed * bend, axis=1) / np.maximum(size**2 * span, 1e-300)
    between = (size > _BENDS * speeds) & (span <= GAP) & (share > _BETWEEN) & (share < 1.0 - _BETWEEN)
    at = np.flatnonzero(between)
    corners = _between(states, at, share[at])
    corners[:, POSITION] = states[at, POSITION] + before[at] * (share[at] * span[at])[:, None]
    corners[:, TWIST] = states[at, TWIST]
    rows = np.arange(len(time)) + np.append(0, np.cumsum(between))
    time = np.insert(time, at + 1, time[at] + share[at] * span[at])
    states = np.insert(states, at + 1, corners, axis=0)

    way = np.linalg.norm(np.diff(states[:, POSITION], axis=0), axis=1)
    steps = np.where(np.diff(time) <= GAP, np.clip(np.ceil(way / _STEP), 1, _MOST_STEPS), 1).astype(np.int64)
    ends = np.append(0, np.cumsum(steps))  # the row of each of these states among the steps
    row = np.arange(ends[-1])
    begin = np.repeat(np.arange(len(steps)), steps)
    part = (row - ends[begin]) / steps[begin]
    fine = np.vstack([_between(states, begin, part), states[-1:]])
    fine[row[part > 0.0], TWIST] = states[begin[part > 0.0] + 1, TWIST]
    return FineMotion(fine, ends[rows])


def _between(states: Array, rows: NDArray[np.int64], share: Array) -> Array:
    """States at that share of the way from each of the rows to the next one; attitudes in proportion."""
    part, after = share[:, None], states[rows + 1]
    opposite = np.sum(states[rows, QUATERNION] * after[:, QUATERNION], axis=1) < 0.0
    after[opposite, QUATERNION] *= -1.0
    found = np.asarray((1.0 - part) * states[rows] + part * after)
    found[:, QUATERNION] /= np.linalg.norm(found[:, QUATERNION], axis=1)[:, None]
    return found

"""Segments of a recording that a fit can use: at rest, straight down, level, turns. Found from pose and velocity."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from rft_ros.calibration.track import Track

__all__ = ["Stroke", "Turn", "down_strokes", "level_runs", "still_intervals", "turns_in_grains"]

_GAP = 0.5  # a longer time between samples [s] ends a segment
_SETTLING = 0.1  # time [s] that is left out after a stop and before a start: the arm vibrates and velocities lag
_SHORTEST_STILL = 0.25  # shortest time at rest, after settling [s]
_TURN = 0.002  # shortest movement up that ends a stroke down [m]
_TILT = np.deg2rad(3.0)  # greatest difference of orientations that count as one [rad]
_STEEP = np.tan(np.deg2rad(15.0))
_LEVEL = np.sin(np.deg2rad(5.0))
_TURNING = 0.2  # greatest speed from rotation in a straight motion, relative to that from translation
_CHORD = 0.001  # path over which the directions before and after a turn are taken [m]
_TURNED = 0.5  # cosine of the least angle of a turn, 60°
_BEFORE = 0.003
_AFTER = 0.010
"""Path used before and after a turn [m]: long enough for the force to settle, short enough to miss the next turn."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stroke:
    """A movement down in one orientation: `rows` of the track in time order, pauses included, to its deepest point.

    `moving`: whether the tool moves straight down in each of the rows, shape [len(rows)], no unit.
    """

    rows: NDArray[np.int64]
    moving: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Turn:
    """A change of direction by 60° or more in the grains, or a start from rest in a recording that begins there.

    `first`: row from which the memory of the grains is known. `at`: row of the turn; if the tool rests there, the row
    before the rest. `rows`: rows in motion, shape [n], from 3 mm of path before the turn to 10 mm after it or to the
    next turn. `after`: path from the turn to the last row [m].
    """

    first: int
    at: int
    rows: NDArray[np.int64]
    after: float


def _segments(mask: NDArray[np.bool_], time: NDArray[np.float64]) -> list[NDArray[np.int64]]:
    rows = np.flatnonzero(mask)
    broken = (np.diff(rows) > 1) | (np.diff(time[rows]) > _GAP)
    return [part for part in np.split(rows, np.flatnonzero(broken) + 1) if len(part)]


def still_intervals(track: Track) -> list[NDArray[np.int64]]:
    """Rows of each interval at rest, without the time to settle, as indices of `Track`'s rows, shape [n], no unit."""
    found = []
    for rows in _segments(track.speeds() < track.rest_speed, track.time):
        begin, end = track.time[rows[[0, -1]]]
        settled = rows[(track.time[rows] >= begin + _SETTLING) & (track.time[rows] <= end - _SETTLING)]
        if len(settled) >= 8 and track.time[settled[-1]] - track.time[settled[0]] >= _SHORTEST_STILL:
            found.append(settled)
    return found


def _ways_down(heights: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Highest and lowest row of each movement down, separated by movements up of more than `_TURN`."""
    # padding lets the ends be peaks
    bottoms, _ = find_peaks(np.pad(-heights, 1, constant_values=-np.inf), prominence=_TURN)
    found, begin = [], 0
    for end in bottoms.tolist():  # a row after the bottom; the tool may rest there
        top = begin + int(np.argmax(heights[begin:end]))
        begin = top + int(np.argmin(heights[top:end]))
        found.append((top, begin))
    return found


def down_strokes(track: Track) -> list[Stroke]:
    """Each movement down with at least 20 rows of straight motion in the orientation of its deepest point."""
    heights, twists, rotations = track.heights(), track.smooth_twists(), track.rotations()
    turning = np.linalg.norm(twists[:, 3:], axis=1) * track.tool.plates.reach
    sinking = -twists[:, 2]
    straight = (np.linalg.norm(twists[:, :2], axis=1) < _STEEP * sinking) & (turning < _TURNING * sinking)
    straight &= sinking >= track.rest_speed
    found = []
    for top, bottom in _ways_down(heights):
        rows = np.arange(top, bottom + 1)
        alike = np.einsum("nij,ij->n", rotations[rows], rotations[bottom]) > 1.0 + 2.0 * np.cos(_TILT)
        rows = rows[alike]
        if straight[rows].sum() >= 20:
            found.append(Stroke(rows=rows, moving=straight[rows]))
    return found


def level_runs(track: Track, surface: float) -> list[NDArray[np.int64]]:
    """Rows, shape [n], no unit, of each unbroken straight level motion with the lowest point below the surface."""
    twists = track.smooth_twists()
    speed = np.linalg.norm(twists[:, :3], axis=1)
    turning = np.linalg.norm(twists[:, 3:], axis=1) * track.tool.plates.reach
    level = (speed >= track.rest_speed) & (np.abs(twists[:, 2]) < _LEVEL * speed) & (turning < _TURNING * speed)
    return [rows for rows in _segments(level & (track.heights() < surface), track.time) if len(rows) >= 20]


def turns_in_grains(track: Track, surface: float) -> list[Turn]:
    """Each turn or start followed by at least 2 mm of path in the grains, with at least 20 rows."""
    center = 0.5 * (track.tool.corners.min(axis=0) + track.tool.corners.max(axis=0))
    places = track.states[:, :3] + track.rotations() @ center
    moving, dry = track.speeds() >= track.rest_speed, track.heights() >= surface
    found = []
    for segment in _segments(~dry, track.time):
        rows = segment[moving[segment]]
        if len(rows) < 20:
            continue
        path = np.append(0.0, np.linalg.norm(np.diff(places[rows], axis=0), axis=1).cumsum())
        turns = _turning(path, places[rows])
        if segment[0] == 0 and not moving[0]:
            turns.insert(0, 0)
        for k, turn in enumerate(turns):
            begin = path[turns[k - 1]] if k else 0.0
            end = min(path[turns[k + 1]] if k + 1 < len(turns) else path[-1], path[turn] + _AFTER)
            near = (path >= max(begin, path[turn] - _BEFORE)) & (path <= end)
            first, after = max(int(segment[0]) - 1, 0), float(end - path[turn])
            if after >= 2.0 * _CHORD and near.sum() >= 20:
                found.append(Turn(first=first, at=int(rows[turn]), rows=rows[near], after=after))
    return found


def _turning(path: NDArray[np.float64], places: NDArray[np.float64]) -> list[int]:
    """Index of the sharpest turn in each group of neighbouring places where the path turns by 60° or more.

    `path`: arc length [m], shape [n]. `places` [m], shape [n, 3].
    """

    def at(s: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack([np.interp(s, path, column) for column in places.T])

    inner = np.flatnonzero((path >= _CHORD) & (path <= path[-1] - _CHORD))
    behind, ahead = places[inner] - at(path[inner] - _CHORD), at(path[inner] + _CHORD) - places[inner]
    lengths = np.linalg.norm(behind, axis=1) * np.linalg.norm(ahead, axis=1)
    cosine = np.einsum("ni,ni->n", behind, ahead) / np.maximum(lengths, 1e-12)
    turned = np.flatnonzero(cosine < _TURNED)
    groups = np.split(turned, np.flatnonzero(np.diff(turned) > 1) + 1)
    return [int(inner[group[np.argmin(cosine[group])]]) for group in groups if len(group)]

"""Which moments of a recording are of use: still, going down, dragged level. Found from pose and speed alone."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.track import Track

__all__ = ["Stroke", "down_strokes", "level_runs", "still_intervals"]

_GAP = 0.5
"""Samples further apart than this [s] do not belong together."""

_SETTLING = 0.1
"""What follows a stop and precedes a start by less than this [s] is left out: the arm rings, velocities lag."""

_SHORTEST_STILL = 0.25
"""Shortest time at rest that counts, after settling [s]."""

_TURN = 0.002
"""A movement up must be this long [m] to end a stroke down."""

_TILT = np.deg2rad(3.0)
"""Orientations that differ by less than this are taken as one."""

_STEEP = np.tan(np.deg2rad(15.0))
_LEVEL = np.sin(np.deg2rad(5.0))
_TURNING = 0.2
"""Speed from rotation, as a share of that from translation, above which a motion is no longer a straight one."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stroke:
    """A way down in one orientation: `rows` of the track in time order, pauses included, to its deepest point.

    `moving`: those of the rows in which the tool went straight down, shape [len(rows)].
    """

    rows: NDArray[np.int64]
    moving: NDArray[np.bool_]


def _together(mask: NDArray[np.bool_], time: NDArray[np.float64]) -> list[NDArray[np.int64]]:
    """Indices of each unbroken stretch of the mask."""
    rows = np.flatnonzero(mask)
    broken = (np.diff(rows) > 1) | (np.diff(time[rows]) > _GAP)
    return [part for part in np.split(rows, np.flatnonzero(broken) + 1) if len(part)]


def still_intervals(track: Track, rest_speed: float) -> list[NDArray[np.int64]]:
    """Rows of each interval in which the tool stayed at rest, without the time that it takes to settle."""
    found = []
    for rows in _together(track.speeds() < rest_speed, track.time):
        begin, end = track.time[rows[[0, -1]]]
        settled = rows[(track.time[rows] >= begin + _SETTLING) & (track.time[rows] <= end - _SETTLING)]
        if len(settled) >= 8 and track.time[settled[-1]] - track.time[settled[0]] >= _SHORTEST_STILL:
            found.append(settled)
    return found


def _bottoms(heights: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Pairs of highest and lowest row of each way down that is longer than `_TURN`."""
    found: list[tuple[int, int]] = []
    top = bottom = 0
    for row, height in enumerate(heights.tolist()):
        if height < heights[bottom]:
            bottom = row
        if height > heights[bottom] + _TURN or row == len(heights) - 1:
            if heights[top] - heights[bottom] > _TURN:
                found.append((top, bottom))
            top = bottom = row
        elif bottom == top and height > heights[top]:
            top = bottom = row
    return found


def down_strokes(track: Track, rest_speed: float) -> list[Stroke]:
    """Each way down that has at least 20 rows of straight motion in the orientation of its deepest point."""
    heights, twists, rotations = track.heights(), track.smooth_twists(), track.rotations()
    turning = np.linalg.norm(twists[:, 3:], axis=1) * track.tool.plates.reach
    sinking = -twists[:, 2]
    straight = (np.linalg.norm(twists[:, :2], axis=1) < _STEEP * sinking) & (turning < _TURNING * sinking)
    straight &= sinking >= rest_speed
    found = []
    for top, bottom in _bottoms(heights):
        rows = np.arange(top, bottom + 1)
        alike = np.einsum("nij,ij->n", rotations[rows], rotations[bottom]) > 1.0 + 2.0 * np.cos(_TILT)
        rows = rows[alike]
        if straight[rows].sum() >= 20:
            found.append(Stroke(rows=rows, moving=straight[rows]))
    return found


def level_runs(track: Track, surface: float, rest_speed: float) -> list[NDArray[np.int64]]:
    """Rows of each unbroken straight level motion with the tool's lowest point under the surface."""
    twists = track.smooth_twists()
    speed = np.linalg.norm(twists[:, :3], axis=1)
    turning = np.linalg.norm(twists[:, 3:], axis=1) * track.tool.plates.reach
    level = (speed >= rest_speed) & (np.abs(twists[:, 2]) < _LEVEL * speed) & (turning < _TURNING * speed)
    return [rows for rows in _together(level & (track.heights() < surface), track.time) if len(rows) >= 20]

"""Refuses recordings that no arm and no load cell can give; fits would turn them into numbers that look right."""

from itertools import pairwise

import numpy as np

from rft_ros.calibration.track import Track
from rft_ros.errors import InputError
from rft_ros.rft import POSITION

__all__ = ["refuse_implausible"]

_LARGEST = 1e6  # reading [N], [N m] that the fits can square, and limit of sensor.bias
_FROZEN = 0.5  # share of the path; a load cell that repeats one reading over more is stuck
_FAR, _FAST = 10.0, 1.0  # m, m/s: no arm exceeds both this extent and this mean speed in grains


def refuse_implausible(track: Track) -> None:
    """Raise InputError for readings beyond any load cell, a load cell that repeats itself, or poses in millimetres."""
    largest = float(np.abs(track.readings).max())
    if not largest <= _LARGEST:
        limit = f"the limit is {_LARGEST:g}; check the driver and its unit"
        raise InputError(f"{track.name} has a load-cell reading of {largest:g} N or N m; {limit}")
    positions = track.states[:, POSITION]
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    extent, path = float(np.ptp(positions, axis=0).max()), float(steps.sum())
    moving = np.diff(track.time)[steps > 0.0]
    if extent > _FAR and path > _FAST * float(moving.sum()):
        raise InputError(
            f"{track.name}: the tool moves over {extent:.3g} m at {path / float(moving.sum()):.3g} m/s on average;"
            " poses are in metres, so divide them by 1000 if the driver gives millimetres"
        )
    changes = np.flatnonzero((np.diff(track.readings, axis=0) != 0.0).any(axis=1)) + 1
    edges = [0, *changes.tolist(), len(track.time)]
    frozen_path, start = max((float(steps[a : b - 1].sum()), a) for a, b in pairwise(edges))
    if path > 0.0 and frozen_path > _FROZEN * path:
        reading = track.readings[start]
        wrong = "reads 0 N and 0 N m" if not reading.any() else f"repeats one reading ({reading[2]:g} N along its z)"
        share = 100.0 * frozen_path / path
        raise InputError(
            f"{track.name}: the load cell {wrong} from {track.time[start]:.1f} s on, over {share:.0f} % of the"
            " tool's path; check that its driver runs and that ~/wrench_measured is its topic, then record again"
        )

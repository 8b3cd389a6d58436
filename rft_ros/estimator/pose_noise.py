"""The noise of the poses, estimated from the poses themselves, and the repeats that bring nothing new."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.samples import PoseSample
from rft_ros.rft.kernel.compilation import compiled, machine_code

__all__ = ["NOISY", "NOISY_SENTENCE", "PoseNoise"]

NOISY = 5e-5
"""Noise of the poses at the tool's farthest point [m] beyond which forces follow the motion late."""

NOISY_SENTENCE = (
    f"the poses have a noise of over {1e3 * NOISY:g} mm at the tool's farthest point, so forces follow the motion late:"
    " smooth the poses in their driver, or take them from the arm's encoders"
)
"""What such noise says to a user."""

_MISFITS = 256  # misfits that are kept
_REFRESH = 16  # new misfits between two estimates of the noise, and before the first one
_QUANTILE, _CHI2_OF_QUANTILE = 0.95, 7.815
"""The noise is estimated from this quantile of the misfits, which have a chi-squared distribution of 3 degrees.

A high quantile, since poses with jittering stamps are noise, too; the few misfits at reversals change it little.
"""
_ROUNDING = 1e-18  # the least variance: 1 nm, 1 nrad
_REPEATS = 1.5  # a pose that stays the same for longer than this many times the last interval has come to rest


_TRACK = np.dtype(
    [
        ("stamps", np.int64, 4),  # of the last four poses that differ, the newest first [ns]; 0 where there is none
        ("poses", float, (4, 7)),  # their positions and quaternions
        ("interval", np.int64),  # between the last two of them [ns]
        ("misfits", float, (2, _MISFITS)),  # the last ones, of positions and rotations
        ("count", int),  # of misfits
    ]
)


class PoseNoise:
    """Follows the poses of one tool.

    The misfit of a pose is its distance from the parabola through the three poses before it, scaled to the variance of
    one pose. A driver that publishes faster than it measures repeats poses; repeats have no part in this.

    `position`, `rotation`: variance of a coordinate of a position [m²], and of a rotation [rad²]; infinite until there
    are enough misfits, and while the poses do not vary, such as the attitude of an arm that only translates.
    """

    def __init__(self) -> None:
        self.position = self.rotation = math.inf
        self._tracks, self._pose = np.zeros(1, _TRACK), np.zeros(7)
        self._add: Any = machine_code(_add, (self._tracks, self._pose, 0, 0))

    def at_tip(self, reach: float) -> float:
        """Standard deviation of a coordinate of a point at `reach` from the origin [m]; 0 while nothing is known."""
        position = self.position if self.position < math.inf else 0.0
        rotation = self.rotation if self.rotation < math.inf else 0.0
        return math.sqrt(position + reach * reach * rotation)

    def add(self, pose: PoseSample, *, gap: int) -> bool:
        """Add a pose in world axes. Returns False for a repeat, which brings nothing new; True also for one at rest.

        After an interval longer than `gap` [ns] the poses before it are dropped.
        """
        self._pose[:] = (*pose.position, *pose.quaternion)
        found = self._add(self._tracks, self._pose, pose.stamp, gap)
        if found == _DUE:
            misfits = self._tracks[0]["misfits"]
            self.position, self.rotation = map(_variance, misfits, (self.position, self.rotation))
        return bool(found != _REPEAT)


_REPEAT, _NEW, _DUE = range(3)  # what `_add` returns; `_DUE`: the noise is to be estimated again


@compiled
def _add(tracks, pose, stamp, gap):
    """Add a pose to the record of `_TRACK` in `tracks`, with its misfit if there are three before it."""
    track = tracks[0]
    stamps, poses = track.stamps, track.poses
    if stamps[0] > 0:
        cosine, same = 0.0, True
        for c in range(3, 7):
            cosine += pose[c] * poses[0, c]
        for c in range(3, 7):
            pose[c] = math.copysign(1.0, cosine) * pose[c]  # q and -q are one attitude
        for c in range(7):
            same = same and pose[c] == poses[0, c]
        interval = stamp - stamps[0]
        if same:
            return _NEW if interval > _REPEATS * track.interval else _REPEAT
        if interval > gap:
            stamps[:] = 0
        else:
            track.interval = interval
    for k in range(3, 0, -1):
        stamps[k] = stamps[k - 1]
        for c in range(7):
            poses[k, c] = poses[k - 1, c]
    stamps[0] = stamp
    for c in range(7):
        poses[0, c] = pose[c]
    if stamps[3] == 0:
        return _NEW
    p, q, r = float(stamps[1] - stamp), float(stamps[2] - stamp), float(stamps[3] - stamp)
    of_1, of_2, of_3 = q * r / ((p - q) * (p - r)), p * r / ((q - p) * (q - r)), p * q / ((r - p) * (r - q))
    of_position = of_rotation = 0.0
    for i in range(7):
        square = (poses[0, i] - of_1 * poses[1, i] - of_2 * poses[2, i] - of_3 * poses[3, i]) ** 2
        if i < 3:
            of_position += square
        else:
            of_rotation += 4.0 * square  # a rotation moves a quaternion by half of its angle
    scale, place = 1.0 + of_1 * of_1 + of_2 * of_2 + of_3 * of_3, track.count % _MISFITS
    track.misfits[0, place], track.misfits[1, place] = of_position / scale, of_rotation / scale
    track.count += 1
    return _DUE if track.count % _REFRESH == 0 else _NEW


def _variance(misfits: NDArray[np.float64], before: float) -> float:
    """The variance of one coordinate. Misfits of zero are left out: encoders with coarse steps give them."""
    found = np.sort(misfits[misfits > 0.0])
    if len(found) < _REFRESH:
        return before
    return max(float(found[int(_QUANTILE * (len(found) - 1))]) / _CHI2_OF_QUANTILE, _ROUNDING)

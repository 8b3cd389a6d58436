"""The noise of the poses, estimated from the poses themselves, and the repeats that bring nothing new."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.samples import PoseSample
from rft_ros.rft.kernel.compilation import compiled, machine_code

NOISY = 5e-5
"""Noise of the poses at the tool's farthest point [m] beyond which forces follow the motion late."""

NOISY_SENTENCE = (
    f"the poses have a noise of over {1e3 * NOISY:g} mm at the tool's farthest point, so forces follow the motion late:"
    " smooth the poses in their driver, or take them from the arm's encoders"
)
"""What such noise says to a user."""

_MISFIT_COUNT = 256  # misfits that are kept
_NEW_MISFIT_COUNT = 16  # new misfits between two estimates of the noise, and before the first one
_FIT_QUANTILE = 0.95, 7.815
"""A quantile of the misfits, and that of their chi-squared distribution of 3 degrees: the variance is their ratio.

A high quantile, since poses with jittering stamps are noise to a fit; the few misfits at reversals change it little.
"""
# the same across the motion; the median, since a tenth of the misfits may be those of corners
_TIP_QUANTILE = 0.5, 2.366
_MIN_SIGMA_M = 1e-9  # of a position; of a rotation the same in rad
# a pose that stays the same for longer than this many times the last interval has come to rest
_REST_INTERVAL_FACTOR = 1.5
# poses: the four of a misfit, with one on each side, which show the direction of the motion
_POSE_COUNT = 6


_TRACK_FIELDS = np.dtype(
    [
        # of the last poses that differ, the newest first [ns]; 0 where there is none
        ("stamps", np.int64, _POSE_COUNT),
        ("poses", float, (_POSE_COUNT, 7)),  # their positions and quaternions
        ("interval", np.int64),  # between the last two of them [ns]
        # the last ones, of positions and rotations, then the same across the motion
        ("misfits", float, (4, _MISFIT_COUNT)),
        ("count", int),  # of misfits
    ]
)
_TRACK = np.dtype((np.record, _TRACK_FIELDS))


class PoseNoise:
    """Follows the poses of one tool.

    The misfit of a pose is its distance from the parabola through the three poses before it, scaled to the variance of
    one pose. A driver that publishes faster than it measures repeats poses; repeats have no part in this.

    `variances`: of a coordinate of a position [m²], and of a rotation [rad²], shape [2]; infinite until there are
    enough misfits, and while the poses do not vary, such as the attitude of an arm that only translates.
    """

    def __init__(self) -> None:
        self.variances = np.full(2, np.inf)
        # The same, but only across the motion while the poses go on one way, where jitter of the stamps moves no pose.
        # At rest all directions count: a stage with one axis has noise along it alone.
        self._position_across = 0.0
        self._rotation_across = 0.0
        self._tracks = np.zeros(1, _TRACK)
        self._pose = np.zeros(7)
        self._add: Any = machine_code(_add, (self._tracks, self._pose, 0, 0))

    def at_tip(self, reach: float) -> float:
        """Standard deviation of a coordinate of a point at `reach` from the origin [m]; 0 while nothing is known.

        It is that across a motion: stamps that jitter, as on a busy machine, do not move the path of the poses.
        """
        return math.sqrt(self._position_across + reach * reach * self._rotation_across)

    def add(self, pose: PoseSample, *, gap: int) -> bool:
        """Add a pose in world axes. Returns False for a repeat, which brings nothing new; True also for one at rest.

        After an interval longer than `gap` [ns] the poses before it are dropped.
        """
        self._pose[:] = (*pose.position, *pose.quaternion)
        outcome = self._add(self._tracks, self._pose, pose.stamp, gap)
        if outcome == _DUE:
            position, rotation, position_across, rotation_across = self._tracks[0].misfits
            self.variances[0] = _variance(position, self.variances[0], *_FIT_QUANTILE)
            self.variances[1] = _variance(rotation, self.variances[1], *_FIT_QUANTILE)
            self._position_across = _variance(
                position_across, self._position_across, *_TIP_QUANTILE
            )
            self._rotation_across = _variance(
                rotation_across, self._rotation_across, *_TIP_QUANTILE
            )
        return bool(outcome != _REPEAT)


_REPEAT, _NEW, _DUE = range(3)  # what `_add` returns; `_DUE`: the noise is to be estimated again


@compiled
def _add(tracks, pose, stamp, gap):
    """Add a pose to the record of `_TRACK` in `tracks`, with the misfit of the pose before it."""
    track = tracks[0]
    stamps = track.stamps
    poses = track.poses
    if stamps[0] > 0:
        cosine = 0.0
        is_repeat = True
        for c in range(3, 7):
            cosine += pose[c] * poses[0, c]
        for c in range(3, 7):
            pose[c] = math.copysign(1.0, cosine) * pose[c]  # q and -q are one attitude
        for c in range(7):
            is_repeat = is_repeat and pose[c] == poses[0, c]
        interval = stamp - stamps[0]
        if is_repeat:
            return _NEW if interval > _REST_INTERVAL_FACTOR * track.interval else _REPEAT
        if interval > gap:
            stamps[:] = 0
        else:
            track.interval = interval
    for k in range(_POSE_COUNT - 1, 0, -1):
        stamps[k] = stamps[k - 1]
        for c in range(7):
            poses[k, c] = poses[k - 1, c]
    stamps[0] = stamp
    for c in range(7):
        poses[0, c] = pose[c]
    if stamps[_POSE_COUNT - 1] == 0:
        return _NEW
    place = track.count % _MISFIT_COUNT
    p = float(stamps[2] - stamps[1])
    q = float(stamps[3] - stamps[1])
    r = float(stamps[4] - stamps[1])
    weight_1 = q * r / ((p - q) * (p - r))
    weight_2 = p * r / ((q - p) * (q - r))
    weight_3 = p * q / ((r - p) * (r - q))
    scale = 1.0 + weight_1 * weight_1 + weight_2 * weight_2 + weight_3 * weight_3
    for kind in range(2):
        square = product = path_square = 0.0
        first = 3 * kind  # positions, then quaternions
        last = 3 + 4 * kind
        for i in range(first, last):
            misfit = (
                poses[1, i]
                - weight_1 * poses[2, i]
                - weight_2 * poses[3, i]
                - weight_3 * poses[4, i]
            )
            path = poses[0, i] - poses[_POSE_COUNT - 1, i]
            square += misfit * misfit
            product += misfit * path
            path_square += path * path
        goes_on = True
        for k in range(_POSE_COUNT - 1):
            step = 0.0
            for i in range(first, last):
                step += (poses[k, i] - poses[k + 1, i]) * (poses[0, i] - poses[_POSE_COUNT - 1, i])
            goes_on = goes_on and step > 0.0
        # two coordinates stand for three
        square_across = square
        if goes_on:
            square_across = 1.5 * max(square - product * product / path_square, 0.0)
        if kind == 1:  # a rotation moves a quaternion by half of its angle
            square *= 4.0
            square_across *= 4.0
        track.misfits[kind, place] = square / scale
        track.misfits[2 + kind, place] = square_across / scale
    track.count += 1
    return _DUE if track.count % _NEW_MISFIT_COUNT == 0 else _NEW


def _variance(misfits: NDArray[np.float64], last: float, quantile: float, chi2: float) -> float:
    """The variance of one coordinate. Misfits of zero are left out: encoders with coarse steps give them."""
    positive = np.sort(misfits[misfits > 0.0])
    if len(positive) < _NEW_MISFIT_COUNT:
        return last
    return max(float(positive[int(quantile * (len(positive) - 1))]) / chi2, _MIN_SIGMA_M**2)

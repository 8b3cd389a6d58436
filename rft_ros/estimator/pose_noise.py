"""The noise of the poses, estimated from the poses themselves, and the repeats that bring nothing new."""

import math

import numpy as np

from rft_ros.estimator.samples import PoseSample

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


class PoseNoise:
    """Follows the poses of one tool.

    The misfit of a pose is its distance from the parabola through the three poses before it, scaled to the variance of
    one pose. A driver that publishes faster than it measures repeats poses; repeats have no part in this.

    `position`, `rotation`: variance of a coordinate of a position [m²], and of a rotation [rad²]; infinite until there
    are enough misfits, and while the poses do not vary, such as the attitude of an arm that only translates.
    """

    def __init__(self) -> None:
        self.position = self.rotation = math.inf
        self._poses: list[tuple[int, tuple[float, ...]]] = []  # stamp [ns], position and quaternion; the newest last
        self._misfits, self._count = np.zeros((2, _MISFITS)), 0
        self._changed = self._interval = 0  # stamp of the last pose that differs from the one before, and since when

    def at_tip(self, reach: float) -> float:
        """Standard deviation of a coordinate of a point at `reach` from the origin [m]; 0 while nothing is known."""
        position = self.position if self.position < math.inf else 0.0
        rotation = self.rotation if self.rotation < math.inf else 0.0
        return math.sqrt(position + reach * reach * rotation)

    def add(self, pose: PoseSample, *, gap: int) -> bool:
        """Add a pose in world axes. Returns False for a repeat, which brings nothing new; True also for one at rest.

        After an interval longer than `gap` [ns] the poses before it are dropped.
        """
        numbers: tuple[float, ...] = (*pose.position, *pose.quaternion)
        if self._poses:
            _, last = self._poses[-1]
            if sum([p * q for p, q in zip(numbers[3:], last[3:], strict=True)]) < 0.0:  # q and -q are one attitude
                numbers = *pose.position, *[-q for q in pose.quaternion]
            interval = pose.stamp - self._changed
            if numbers == last:
                return interval > _REPEATS * self._interval
            if interval > gap:
                self._poses.clear()
            else:
                self._interval = interval
        self._changed = pose.stamp
        self._poses.append((pose.stamp, numbers))
        if len(self._poses) > 3:
            self._add_misfit()
            del self._poses[0]
        return True

    def _add_misfit(self) -> None:
        (t3, c), (t2, b), (t1, a), (t0, newest) = self._poses
        p, q, r = t1 - t0, t2 - t0, t3 - t0
        of_a, of_b, of_c = q * r / ((p - q) * (p - r)), p * r / ((q - p) * (q - r)), p * q / ((r - p) * (r - q))
        squares = [(n - of_a * i - of_b * j - of_c * k) ** 2 for n, i, j, k in zip(newest, a, b, c, strict=True)]
        scale = 1.0 + of_a * of_a + of_b * of_b + of_c * of_c
        place = self._count % _MISFITS
        self._misfits[0, place] = sum(squares[:3]) / scale
        self._misfits[1, place] = 4.0 * sum(squares[3:]) / scale  # a rotation moves a quaternion by half of its angle
        self._count += 1
        if self._count % _REFRESH == 0:
            self.position, self.rotation = map(_variance, self._misfits, (self.position, self.rotation))


def _variance(misfits: np.ndarray, before: float) -> float:
    """The variance of one coordinate. Misfits of zero are left out: encoders with coarse steps give them."""
    found = np.sort(misfits[misfits > 0.0])
    if len(found) < _REFRESH:
        return before
    return max(float(found[int(_QUANTILE * (len(found) - 1))]) / _CHI2_OF_QUANTILE, _ROUNDING)

"""The velocity of the tool from its poses alone.

It is the slope, at the newest pose, of a parabola fitted to the last poses on SE(3). This end derivative of Savitzky
and Golay (Analytical Chemistry 36, 1964) has no lag under constant acceleration. Where the parabola's bend is within
the noise of the poses, it is the slope of a line, whose noise is a quarter. The window is the longest one whose misfit
stays within the noise. Across a reversal a longer one would overshoot.
"""

import math

import numpy as np

from rft_ros.estimator.pose_noise import PoseNoise
from rft_ros.estimator.samples import PoseSample
from rft_ros.rft import POSITION, QUATERNION
from rft_ros.rft.kernel.compilation import compiled, inlined

_MAX_POSE_COUNT = 2048  # poses: the longest window, 1 s, at 2 kHz
_MIN_POSE_COUNT = 3
_MIN_PARABOLA_POSE_COUNT = 5
# standard deviations of chi-squared; beyond, the window is shortened, and the slope is noisier
_MAX_MISFIT_FACTOR = 8.0
_BEND_CHI2_LIMIT = (
    16.3  # chi-squared with probability 1e-3: a smaller bend of the parabola is left out
)
# chi-squared with probability 1e-8: false motion at rest would release the held force
_MOTION_CHI2_LIMIT = 40.0
# of the window: in its older part, poses closer than this to the one before are skipped
_MIN_INTERVAL_SHARE = 1.0 / 64.0
# the two kinds of coordinates of a pose, which have noise of their own
_POSITIONS, _ROTATIONS = range(2)


class PoseDifference:
    """Keeps the last poses, and computes the `twist` at the newest: vx, vy, vz, wx, wy, wz [m/s], [rad/s], world axes.

    A twist within the noise of the poses is set to zero. `noise`: of the poses, estimated from the same poses.
    """

    def __init__(self) -> None:
        self.twist = np.zeros(6)
        self.noise = PoseNoise()
        self._stamps = np.zeros(_MAX_POSE_COUNT, dtype=np.int64)
        self._ring = np.zeros((_MAX_POSE_COUNT, 7))
        times = np.zeros(_MAX_POSE_COUNT)
        coordinates = np.zeros((2, 3, _MAX_POSE_COUNT))
        self._arrays = (
            self._stamps,
            self._ring,
            self.noise.variances,
            times,
            coordinates,
            self.twist.reshape(2, 3),
        )
        self._count = 0
        self._fitted = 0

    def push(self, pose: PoseSample, *, window: float, gap: int) -> bool:
        """Add a pose. Returns whether there are enough poses for `twist`.

        `window`: of the fit [s]; it has at least three poses, and ends at an interval longer than `gap` [ns].
        """
        if self.noise.add(pose, gap=gap):
            newest = self._count % _MAX_POSE_COUNT
            self._stamps[newest] = pose.stamp
            self._ring[newest] = (*pose.position, *pose.quaternion)
            self._fitted = int(_fit(*self._arrays, newest, round(1e9 * window), gap))
            self._count += 1
        return self._fitted >= _MIN_POSE_COUNT


@inlined
def _rotation_vector(attitude, ax, ay, az, aw):
    """Rotation vector to an attitude from another one; ax, ay, az, aw: the conjugate of that one's quaternion."""
    bx, by, bz, bw = attitude[0], attitude[1], attitude[2], attitude[3]
    rx = bw * ax + bx * aw + by * az - bz * ay
    ry = bw * ay - bx * az + by * aw + bz * ax
    rz = bw * az + bx * ay - by * ax + bz * aw
    rw = bw * aw - bx * ax - by * ay - bz * az
    sine = math.sqrt(rx * rx + ry * ry + rz * rz)
    scale = math.copysign(2.0 * math.atan2(sine, abs(rw)) / sine if sine > 0.0 else 2.0, rw)
    return rx * scale, ry * scale, rz * scale


@inlined
def _recent(stamps, ring, newest, window, gap, t, x):
    """Write the poses of the window to `t` and `x`, newest first and relative to the newest; return their number.

    At least 3 poses are written if there are as many. `t`: times [s]. `x`: positions and rotation vectors in world
    axes, shape [2, 3, n]. `ring`: rows position, quaternion xyzw. `stamps`, `window`, `gap` [ns]; a stamp is 0 where
    the ring has no pose yet.
    """
    positions = ring[:, POSITION]
    attitudes = ring[:, QUATERNION]
    attitude = attitudes[newest]
    ax, ay, az, aw = -attitude[0], -attitude[1], -attitude[2], attitude[3]
    younger = stamps[newest]
    n = 0
    for back in range(len(stamps)):
        index = (newest - back) % len(stamps)
        age = stamps[newest] - stamps[index]  # a difference of integers has no rounding error
        if (
            stamps[index] == 0
            or younger - stamps[index] > gap
            or (age > window and n >= _MIN_POSE_COUNT)
        ):
            break
        younger = stamps[index]
        if (
            n > _MIN_PARABOLA_POSE_COUNT
            and t[n - 1] + 1e-9 * age < _MIN_INTERVAL_SHARE * 1e-9 * window
        ):
            continue
        t[n] = -1e-9 * age
        turns = _rotation_vector(attitudes[index], ax, ay, az, aw)
        for axis in range(3):
            x[_POSITIONS, axis, n] = positions[index, axis] - positions[newest, axis]
            x[_ROTATIONS, axis, n] = turns[axis]
        n += 1
    return n


@inlined
def _end_slopes(t, x, n, noise, slopes, squares, factors):
    """Fit a parabola to the newest n poses by least squares; write its slopes at the newest to `slopes`, shape [2, 3].

    The bend is left out if it is within the `noise`. Writes the sums of squared misfits of positions and rotations to
    `squares`, and the variance of their slopes over the variance of one pose to `factors`. The fit uses polynomials in
    time that are orthogonal over the poses: 1, u, and q = u² - skew u - mean.
    """
    middle = uu = uuu = qq = 0.0
    for i in range(n):
        middle += t[i] / n
    for i in range(n):
        u = t[i] - middle
        uu += u * u
        uuu += u * u * u
    skew = uuu / uu
    mean = uu / n
    for i in range(n):
        u = t[i] - middle
        qq += (u * u - skew * u - mean) ** 2
    bend = 2.0 * (t[0] - middle) - skew  # dq/dt at the newest pose
    squares[:] = 0.0
    bend_slopes = np.empty(3)
    for kind in range(2):
        square_of_bend = 0.0
        for axis in range(3):
            a = b = c = square = 0.0
            y = x[kind, axis]
            for i in range(n):
                u = t[i] - middle
                a += y[i] / n
                b += y[i] * u / uu
                c += y[i] * (u * u - skew * u - mean) / qq
            for i in range(n):
                u = t[i] - middle
                square += (y[i] - a - b * u - c * (u * u - skew * u - mean)) ** 2
            slopes[kind, axis] = b
            bend_slopes[axis] = c * bend
            squares[kind] += square
            square_of_bend += c * c * qq
        factors[kind] = 1.0 / uu
        # the noise is infinite until it is estimated
        if not square_of_bend <= _BEND_CHI2_LIMIT * noise[kind] < np.inf:
            factors[kind] += bend * bend / qq
            for axis in range(3):
                slopes[kind, axis] += bend_slopes[axis]


@compiled
def _fit(stamps, ring, noise, t, x, twist, newest, window, gap):
    """Fit the longest parabola whose misfit is within the `noise`, and write its slopes to `twist`, shape [2, 3].

    Returns the number of poses in the window. With fewer than five the slopes are those of the line through the newest
    two. A twist within the `noise` is set to zero.
    """
    count = n = _recent(stamps, ring, newest, window, gap, t, x)
    if n < 2:
        return n
    squares = np.empty(2)
    factors = np.empty(2)
    misfits_are_large = True
    while misfits_are_large and n >= _MIN_PARABOLA_POSE_COUNT:
        _end_slopes(t, x, n, noise, twist, squares, factors)
        free = 3.0 * (n - 3)
        excess = max(
            squares[_POSITIONS] / noise[_POSITIONS], squares[_ROTATIONS] / noise[_ROTATIONS]
        )
        misfits_are_large = excess > free + _MAX_MISFIT_FACTOR * math.sqrt(2.0 * free)
        n = 4 * n // 5
    if misfits_are_large:
        factors[:] = 2.0 / (t[1] * t[1])
        for kind in range(2):
            for axis in range(3):
                twist[kind, axis] = x[kind, axis, 1] / t[1]
    still = True
    for kind in range(2):
        square = twist[kind, 0] ** 2 + twist[kind, 1] ** 2 + twist[kind, 2] ** 2
        bound = _MOTION_CHI2_LIMIT * noise[kind] * factors[kind]
        still = still and (square == 0.0 or square <= bound < np.inf)
    if still:
        twist[:] = 0.0
    return count

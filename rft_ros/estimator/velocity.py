"""Velocity from poses: the slope, at the newest pose, of a parabola fitted to the last ones on SE(3).

This end derivative of Savitzky and Golay (Analytical Chemistry 36, 1964) has no lag under constant acceleration. The
parabola spans as many poses as the noise of the poses lets look like one: over a turn of the motion it would overshoot.
"""

import math

import numpy as np

from rft_ros.estimator.samples import PoseSample
from rft_ros.rft.compilation import compiled, inlined

__all__ = ["PoseDifference"]

_CAPACITY = 2048  # the longest window, 1 s, at 2 kHz
_FEWEST, _FEWEST_OF_PARABOLA = 3, 5
_MISFITS = 256
# of chi-squared with 3 degrees of freedom: high, since jitter of stamps gives outliers, but turns count little
_QUANTILE, _CHI2_OF_QUANTILE = 0.95, 7.815
_UNLIKELY = 8.0  # standard deviations of chi-squared; a false alarm costs a noisy slope
_MOVES = 40.0  # chi-squared of 1e-8: noise taken for motion at rest lets the grains go
_ROUNDING = 1e-18  # the least variance: 1 nm, 1 nrad
_THIN = 1.0 / 64.0  # of the window: poses of its older part that are closer do not count
_REFRESH = 16  # misfits between two estimates of the noise, and before the first


@inlined
def _rotation_vector(row, ax, ay, az, aw):  # type: ignore[no-untyped-def]
    """Rotation from an attitude, whose conjugate is a, to that of a pose."""
    bx, by, bz, bw = row[3], row[4], row[5], row[6]
    rx = bw * ax + bx * aw + by * az - bz * ay
    ry = bw * ay - bx * az + by * aw + bz * ax
    rz = bw * az + bx * ay - by * ax + bz * aw
    rw = bw * aw - bx * ax - by * ay - bz * az
    if rw < 0.0:
        rx, ry, rz, rw = -rx, -ry, -rz, -rw
    square = rx * rx + ry * ry + rz * rz
    if square < 2.5e-5:
        scale = 2.0 + square / 3.0 + 0.15 * square * square  # of the arcsine; exact to 1e-15
    else:
        sine = math.sqrt(square)
        scale = 2.0 * math.atan2(sine, rw) / sine
    return rx * scale, ry * scale, rz * scale


@inlined
def _variance(misfits):  # type: ignore[no-untyped-def]
    """Variance of one coordinate of a pose, from a quantile that turns do not shift."""
    return max(np.sort(misfits)[int(_QUANTILE * (len(misfits) - 1))] / _CHI2_OF_QUANTILE, _ROUNDING)


@inlined
def _misfit(t, x, g):  # type: ignore[no-untyped-def]
    """Squared distance of pose 0, at the origin, from the parabola through poses 1 to 3, in variances of one pose."""
    p, q, r = t[1], t[2], t[3]
    a, b, c = q * r / ((p - q) * (p - r)), p * r / ((q - p) * (q - r)), p * q / ((r - p) * (r - q))
    square = 0.0
    for k in range(3 * g, 3 * g + 3):
        square += (a * x[1, k] + b * x[2, k] + c * x[3, k]) ** 2
    return square / (1.0 + a * a + b * b + c * c)


@compiled
def _recent(stamps, ring, newest, window, gap, t, x):  # type: ignore[no-untyped-def]
    """Write times [s] and places relative to the newest pose, newest first; return how many, 3 or more if there are.

    `stamps`, `window`, `gap` [ns]; a stamp is 0 where there is no pose. `ring`: rows position, quaternion xyzw. `x`:
    positions and rotation vectors in world axes, shape [n, 6].
    """
    ax, ay, az, aw = -ring[newest, 3], -ring[newest, 4], -ring[newest, 5], ring[newest, 6]
    younger, n = stamps[newest], 0
    for back in range(len(stamps)):
        at = (newest - back) % len(stamps)
        age = stamps[newest] - stamps[at]  # of integers: independent of the epoch
        if stamps[at] == 0 or younger - stamps[at] > gap or (age > window and n >= _FEWEST):
            break
        younger = stamps[at]
        if n > _FEWEST_OF_PARABOLA and t[n - 1] + 1e-9 * age < _THIN * 1e-9 * window:
            continue
        t[n] = -1e-9 * age
        for k in range(3):
            x[n, k] = ring[at, k] - ring[newest, k]
        x[n, 3], x[n, 4], x[n, 5] = _rotation_vector(ring[at], ax, ay, az, aw)
        n += 1
    return n


@compiled
def _end_slopes(t, x, n, slopes, squares):  # type: ignore[no-untyped-def]
    """Least squares of a parabola to the newest n poses: write its slopes at the newest, shape [6], to `slopes`.

    Writes the sums of squared misfits of position and rotation to `squares`; returns the variance of a slope in
    variances of one pose. Of fewer than five poses it takes the line through the newest two. With polynomials in time
    that are orthogonal over the poses: 1, u, q = u² - skew u - mean.
    """
    squares[:] = 0.0
    if n < _FEWEST_OF_PARABOLA:
        for k in range(6):
            slopes[k] = x[1, k] / t[1]
        return 2.0 / (t[1] * t[1])
    middle = t[:n].mean()
    uu = uuu = qq = 0.0
    for i in range(n):
        u = t[i] - middle
        uu += u * u
        uuu += u * u * u
    mean, skew = uu / n, uuu / uu
    a, b, c = np.zeros(6), np.zeros(6), np.zeros(6)
    for i in range(n):
        u = t[i] - middle
        q = u * u - skew * u - mean
        qq += q * q
        for k in range(6):
            a[k] += x[i, k]
            b[k] += x[i, k] * u
            c[k] += x[i, k] * q
    bend = -2.0 * middle - skew  # dq/dt at the newest pose
    for k in range(6):
        a[k], b[k], c[k] = a[k] / n, b[k] / uu, c[k] / qq
        slopes[k] = b[k] + c[k] * bend
    for i in range(n):
        u = t[i] - middle
        q = u * u - skew * u - mean
        for k in range(6):
            squares[k // 3] += (x[i, k] - a[k] - b[k] * u - c[k] * q) ** 2
    return 1.0 / uu + bend * bend / qq


@compiled
def _fit(t, x, n, noise, twist):  # type: ignore[no-untyped-def]
    """Write the slopes of the longest parabola whose misfit the `noise` explains to `twist`.

    A twist that the noise explains is zero.
    """
    squares, m = np.empty(2), n
    while True:
        factor = _end_slopes(t, x, m, twist, squares)
        free = 3.0 * (m - 3)
        unlike = max(squares[0] / noise[0], squares[1] / noise[1]) > free + _UNLIKELY * math.sqrt(2.0 * free)
        if m < _FEWEST_OF_PARABOLA or not unlike:
            break
        m = 4 * m // 5
    still = True
    for g in range(2):
        square = twist[3 * g] ** 2 + twist[3 * g + 1] ** 2 + twist[3 * g + 2] ** 2
        bound = _MOVES * noise[g] * factor
        still = still and (square == 0.0 or square <= bound < np.inf)  # an attitude without noise does not move
    if still:
        twist[:] = 0.0


@compiled
def _learn_noise(t, x, misfits, stored, noise):  # type: ignore[no-untyped-def]
    """Add the newest pose's misfits, of position [m²] and rotation [rad²], to the last ones, shape [2, n].

    Zeros, which encoders with coarse steps give, do not count. `stored`: how many there were. Updates `noise`, the
    `_variance`.
    """
    for g in range(2):
        misfit = _misfit(t, x, g)
        if misfit > 0.0:
            misfits[g, stored[g] % _MISFITS] = misfit
            stored[g] += 1
            if stored[g] % _REFRESH == 0:
                noise[g] = _variance(misfits[g, : min(stored[g], _MISFITS)])


class PoseDifference:
    """A ring of the last poses, and the twist at the newest one."""

    def __init__(self) -> None:
        self._window = 0
        self._gap = 0
        self._stamps = np.zeros(_CAPACITY, dtype=np.int64)
        self._ring = np.zeros((_CAPACITY, 7))
        self._misfits = np.zeros((2, _MISFITS))
        self._stored = np.zeros(2, dtype=np.int64)
        self._noise = np.full(2, np.inf)
        self._times, self._places = np.zeros(_CAPACITY), np.zeros((_CAPACITY, 6))
        self._newest = -1
        self.twist = np.zeros(6)

    def span(self, *, window: float, max_age: float) -> None:
        """Fit to the poses of the last `window` [s], at least three, none over `max_age` [s] from the one before."""
        self._window = round(1e9 * window)
        self._gap = round(1e9 * max_age)

    def push(self, pose: PoseSample) -> bool:
        """Add a pose; whether there are enough for `twist` (vx, vy, vz, wx, wy, wz [m/s], [rad/s]; world axes).

        A twist that the noise of the poses explains is zero.
        """
        self._newest = (self._newest + 1) % _CAPACITY
        self._stamps[self._newest] = pose.stamp
        row = self._ring[self._newest]
        row[0:3] = pose.position
        row[3:7] = pose.quaternion
        t, x = self._times, self._places
        n: int = _recent(self._stamps, self._ring, self._newest, self._window, self._gap, t, x)
        if n > 1:
            _fit(t, x, n, self._noise, self.twist)
        if n > 3:
            _learn_noise(t, x, self._misfits, self._stored, self._noise)
        return n >= _FEWEST

    def reset(self) -> None:
        """Forget all poses."""
        self._stamps.fill(0)
        self._stored.fill(0)
        self._noise.fill(np.inf)
        self._newest = -1

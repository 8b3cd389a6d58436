"""Velocity from poses: the slope, at the newest pose, of curves fitted to the last ones on SE(3).

The slope at the end of a parabola has no lag under constant acceleration, where that of a line lags by half its span.
But a parabola over a turn of the motion overshoots. The longest parabola counts that agrees, within the noise of the
poses, with lines through the newest of them: else the longest line that agrees with all shorter ones.
"""

import math

import numpy as np

from rft_ros.estimator.samples import PoseSample
from rft_ros.rft.compilation import compiled, inlined

__all__ = ["PoseDifference"]

_CAPACITY = 2048  # the longest window, 1 s, at 2 kHz
_FEWEST, _FEWEST_OF_PARABOLA = 3, 5
_LINES = 16
_MISFITS = 256
# Bounds on chi-squared with 3 degrees of freedom, at the probability of a false alarm.
_QUANTILE, _CHI2_OF_QUANTILE = 0.7, 3.665  # a turn disturbs only three misfits
_LINES_DIFFER = 40.0  # 1e-8: a false alarm costs a noisy slope
_PARABOLA_DIFFERS = 16.3  # 1e-3: a false alarm costs the lag of a line
_MOVES = 40.0  # 1e-8: noise taken for motion at rest lets the grains go
_ROUNDING = 1e-18  # the least variance: 1 nm, 1 nrad
_REFRESH = 8  # misfits between two estimates of the noise, and before the first
_THIN = 1.0 / 64.0  # of the window: poses of its older part that are closer do not count


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
def _end_slopes(stamps, ring, misfits, stored, noise, newest, window, gap, twist):  # type: ignore[no-untyped-def]
    """Slopes at the newest pose; rotations as vectors from the newest pose, world axes.

    `stamps`, `window`, `gap` [ns]; a stamp is 0 where there is no pose. `ring`: rows position, quaternion xyzw.
    `misfits`: the last `_misfit`s, of position [m²] and rotation [rad²], shape [2, n]; zeros, which encoders with
    coarse steps give, do not count. `stored`: how many there were. Updates both, and `noise`, the `_variance` or
    infinity where too few are known; writes vx..wz to `twist`; returns the number of poses used.
    """
    capacity, span = ring.shape[0], 1e-9 * window
    ax, ay, az, aw = -ring[newest, 3], -ring[newest, 4], -ring[newest, 5], ring[newest, 6]
    lines, line_factors, middles = np.zeros((_LINES, 6)), np.zeros(_LINES), np.zeros(_LINES)
    factors = np.zeros(2)  # variance of the slope in `twist`, in variances of one pose
    straight, curved = np.ones(2, dtype=np.bool_), np.ones(2, dtype=np.bool_)
    first_t, first_x = np.zeros(4), np.zeros((4, 6))  # the newest poses
    x, end, bend = np.zeros(6), np.zeros(6), np.zeros(6)
    sums = np.zeros((3, 6))
    n = fitted = parabolas = 0
    s1 = s2 = s3 = s4 = t = until = 0.0
    younger = stamps[newest]
    for back in range(capacity + 1):
        at = (newest - back) % capacity
        age = stamps[newest] - stamps[at]
        ends = back == capacity or stamps[at] == 0 or younger - stamps[at] > gap or (age > window and n >= _FEWEST)
        if n > 1 and (ends or 1e-9 * age > until):
            spread = n * s2 - s1 * s1
            if not spread > 0.0:
                break
            if fitted < _LINES and (until <= 0.25 * span or n < _FEWEST_OF_PARABOLA):
                line_factors[fitted], middles[fitted] = n / spread, s1 / n
                for g in range(2):
                    for k in range(3 * g, 3 * g + 3):
                        lines[fitted, k] = (n * sums[1, k] - s1 * sums[0, k]) / spread
                    for line in range(fitted):
                        apart = 0.0
                        for k in range(3 * g, 3 * g + 3):
                            apart += (lines[fitted, k] - lines[line, k]) ** 2
                        if apart > _LINES_DIFFER * noise[g] * line_factors[line]:
                            straight[g] = False
                    if straight[g]:
                        factors[g] = line_factors[fitted]
                        for k in range(3 * g, 3 * g + 3):
                            twist[k] = lines[fitted, k]
                fitted += 1
            if n >= _FEWEST_OF_PARABOLA and (until >= 0.5 * span or (ends and -t > 0.25 * span)):
                c0, c1, c2, c3 = s2 * s3 - s1 * s4, n * s4 - s2 * s2, s1 * s2 - n * s3, s1 * s3 - s2 * s2
                determinant = s1 * c0 + s2 * c1 + s3 * c2
                for g in range(2):
                    for k in range(3 * g, 3 * g + 3):
                        end[k] = (c0 * sums[0, k] + c1 * sums[1, k] + c2 * sums[2, k]) / determinant
                        bend[k] = (c3 * sums[0, k] + c2 * sums[1, k] + spread * sums[2, k]) / determinant
                    for line in range(fitted):  # a line's slope is the parabola's at the middle of the line
                        twice = 2.0 * middles[line]
                        apart = 0.0
                        for k in range(3 * g, 3 * g + 3):
                            apart += (end[k] + twice * bend[k] - lines[line, k]) ** 2
                        own = (c1 + twice * (2.0 * c2 + twice * spread)) / determinant
                        if apart > _PARABOLA_DIFFERS * noise[g] * (own + line_factors[line]):
                            curved[g] = False
                    apart = 0.0
                    for k in range(3 * g, 3 * g + 3):
                        apart += (end[k] - twist[k]) ** 2
                    if parabolas > 0 and apart > _PARABOLA_DIFFERS * noise[g] * factors[g]:
                        curved[g] = False
                    if curved[g]:
                        factors[g] = c1 / determinant
                        for k in range(3 * g, 3 * g + 3):
                            twist[k] = end[k]
                parabolas += 1
                if not (curved[0] or curved[1]):
                    break
            if -2.0 * t < 0.25 * span:
                until = -2.0 * t
            else:
                until = span * (0.25 if until < 0.25 * span else 0.5 if until < 0.5 * span else 1.0)
        if ends:
            break
        younger = stamps[at]
        if until > 0.25 * span and n > _FEWEST_OF_PARABOLA and t + 1e-9 * age < _THIN * span:
            continue
        t = -1e-9 * age  # from integer differences: independent of the epoch
        for k in range(3):
            x[k] = ring[at, k] - ring[newest, k]
        x[3], x[4], x[5] = _rotation_vector(ring[at], ax, ay, az, aw)
        if n < 4:
            first_t[n] = t
            for k in range(6):  # assigning arrays compiles numba's error for shapes that differ: 4 s
                first_x[n, k] = x[k]
        n += 1
        s1 += t
        s2 += t * t
        s3 += t * t * t
        s4 += t * t * t * t
        for k in range(6):
            sums[0, k] += x[k]
            sums[1, k] += t * x[k]
            sums[2, k] += t * t * x[k]

    still = True
    for g in range(2):
        misfit = _misfit(first_t, first_x, g) if n > 3 else 0.0
        if misfit > 0.0:
            misfits[g, stored[g] % _MISFITS] = misfit
            stored[g] += 1
            if stored[g] % _REFRESH == 0:
                noise[g] = _variance(misfits[g, : min(stored[g], _MISFITS)])
        square = 0.0
        for k in range(3 * g, 3 * g + 3):
            square += twist[k] * twist[k]
        bound = _MOVES * noise[g] * factors[g]
        still = still and (square == 0.0 or square <= bound < np.inf)  # an attitude without noise does not move
    if still:
        twist[:] = 0.0
    return n


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
        used: int = _end_slopes(
            self._stamps, self._ring, self._misfits, self._stored, self._noise,
            self._newest, self._window, self._gap, self.twist,
        )  # fmt: skip
        return used >= _FEWEST

    def reset(self) -> None:
        """Forget all poses."""
        self._stamps.fill(0)
        self._stored.fill(0)
        self._noise.fill(np.inf)
        self._newest = -1

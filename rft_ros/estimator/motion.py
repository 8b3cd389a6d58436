"""How the tool moves at a pose: its velocity, from twists or from the poses themselves, and the path behind it.

The velocity from poses is the slope, at the newest, of a parabola fitted to the last ones on SE(3). This end derivative
of Savitzky and Golay (Analytical Chemistry 36, 1964) has no lag under constant acceleration. The parabola spans as many
poses as the noise of the poses lets look like one: over a turn of the motion it would overshoot.
"""

import math
from collections import deque
from collections.abc import Sequence
from struct import Struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.samples import PoseSample, Reason, RefusedError, TwistSample, Vector, around
from rft_ros.parameters import Settings
from rft_ros.rft import STATE
from rft_ros.rft.compilation import compiled, inlined
from rft_ros.rft.placement import Placement

__all__ = ["UNKNOWN_VELOCITY", "Kinematics", "Motion", "PoseDifference"]

UNKNOWN_VELOCITY = {Reason.TWIST_MISSING, Reason.TWIST_STALE, Reason.POSE_HISTORY_SHORT}
"""Reasons of poses whose velocity is unknown."""

_STATE = Struct(f"{len(STATE)}d")  # writes a row in half the time that numpy takes
_CAPACITY = 2048  # the longest window, 1 s, at 2 kHz
_FEWEST, _FEWEST_OF_PARABOLA = 3, 5
_MISFITS, _REFRESH = 256, 16  # misfits kept; misfits between two estimates of the noise, and before the first
# of chi-squared with 3 degrees of freedom: high, since jitter of stamps gives outliers, but turns count little
_QUANTILE, _CHI2_OF_QUANTILE = 0.95, 7.815
_UNLIKELY = 8.0  # standard deviations of chi-squared; a false alarm costs a noisy slope
_MOVES = 40.0  # chi-squared of 1e-8: noise taken for motion at rest lets the grains go
_ROUNDING = 1e-18  # the least variance: 1 nm, 1 nrad
_THIN = 1.0 / 64.0  # of the window: poses of its older part that are closer do not count


class Motion(NamedTuple):
    """`state`: shape [1, 13], columns `rft_ros.rft.STATE`; `velocity` of the tool frame's origin, world axes [m/s].

    `speed`: an upper bound on the plates' speeds [m/s]; `rests`: it is below `rest_speed`. `path` of the fastest point
    since the motion before [m], and its `duration` [s].
    """

    pose: PoseSample
    state: NDArray[np.float64]
    velocity: Vector
    speed: float
    rests: bool
    path: float
    duration: float


class Kinematics:
    """Follows the motion of one tool; `reach`: largest distance of its plates from the tool frame's origin [m]."""

    def __init__(self, settings: Settings, twists: deque[TwistSample], reach: float) -> None:
        self.reach, self._twists, self._settings = reach, twists, settings
        self.begin_again()

    def use(self, settings: Settings) -> None:
        """Take new settings."""
        self._settings = settings
        self._max_age = round(settings.max_input_age * 1e9)
        self._period = round(min(1e9 / settings.max_rate, 1e18)) if settings.max_rate > 0.0 else 0
        self._due = 0
        self._difference.span(window=settings.twist_window, max_age=settings.max_input_age)

    def begin_again(self) -> None:
        """Forget the motion so far: a new run, or new axes."""
        self._difference = PoseDifference()
        self._before: Motion | None = None
        self.use(self._settings)

    def at(self, pose: PoseSample) -> Motion:
        """The motion at a pose; `RefusedError` if it has no velocity, or comes sooner than `max_rate` allows."""
        velocity = self._velocity(pose)  # of each pose: the slope is that of all, also of those that are not answered
        # a tenth of a period lets a 125 Hz stream with jittering stamps pass a limit of 125 Hz
        if pose.stamp + self._period // 10 < self._due:
            raise RefusedError(Reason.POSE_RATE_LIMITED)
        if isinstance(velocity, Reason):
            raise RefusedError(velocity)
        self._due = max(self._due, pose.stamp) + self._period
        vx, vy, vz, wx, wy, wz = velocity
        speed = math.hypot(vx, vy, vz) + math.hypot(wx, wy, wz) * self.reach
        rests = speed < self._settings.rest_speed or speed == 0.0
        path, duration = self._path_since(pose, 0.0 if rests else speed)
        state = np.empty((1, len(STATE)))
        _STATE.pack_into(state.data, 0, *pose.position, *pose.quaternion, *velocity)
        self._before = motion = Motion(pose, state, (vx, vy, vz), speed, rests, path, duration)
        return motion

    def _velocity(self, pose: PoseSample) -> Sequence[float] | Reason:
        """Linear and angular velocity at a pose, world axes; or why it has none."""
        if self._settings.twist_source == "pose_difference":
            return self._difference.twist.tolist() if self._difference.push(pose) else Reason.POSE_HISTORY_SHORT
        twist, _ = around(self._twists, pose.stamp)
        if twist is None:
            return Reason.TWIST_MISSING
        if pose.stamp - twist.stamp > self._max_age:
            return Reason.TWIST_STALE
        if twist.frame != self._settings.tool_frame:
            return *twist.linear, *twist.angular
        to_world = Placement(pose.position, pose.quaternion)
        return *to_world.rotate(twist.linear), *to_world.rotate(twist.angular)

    def _path_since(self, pose: PoseSample, speed: float) -> tuple[float, float]:
        """Path and duration since the motion before; `speed`: 0 at rest.

        After a gap over `max_input_age` the path is the poses' displacement, and the duration what it takes.
        """
        if self._before is None:
            return 0.0, 0.0
        last = self._before.pose
        mean = 0.5 * (speed + (0.0 if self._before.rests else self._before.speed))
        duration = (pose.stamp - last.stamp) * 1e-9
        if pose.stamp - last.stamp <= self._max_age or mean == 0.0:
            return mean * duration, duration
        cosine = abs(sum(a * b for a, b in zip(pose.quaternion, last.quaternion, strict=True)))
        path = math.dist(pose.position, last.position) + self.reach * 2.0 * math.acos(min(cosine, 1.0))
        return path, path / mean


class PoseDifference:
    """A ring of the last poses, and `twist` at the newest: vx, vy, vz, wx, wy, wz [m/s], [rad/s], world axes.

    A twist that the noise of the poses explains is zero.
    """

    def __init__(self) -> None:
        self.twist = np.zeros(6)
        self._stamps, self._ring = np.zeros(_CAPACITY, dtype=np.int64), np.zeros((_CAPACITY, 7))
        self._misfits, self._noise = np.zeros((_MISFITS, 2)), np.full(2, np.inf)
        work = np.zeros(_CAPACITY), np.zeros((6, _CAPACITY))
        self._arrays = self._stamps, self._ring, self._noise, *work, self.twist
        self._count = 0
        self.span(window=0.0, max_age=0.0)

    def span(self, *, window: float, max_age: float) -> None:
        """Fit to the poses of the last `window` [s], at least three, none over `max_age` [s] from the one before."""
        self._window, self._gap = round(1e9 * window), round(1e9 * max_age)

    def push(self, pose: PoseSample) -> bool:
        """Add a pose; whether there are enough for `twist`."""
        newest = self._count % _CAPACITY
        self._stamps[newest] = pose.stamp
        self._ring[newest] = (*pose.position, *pose.quaternion)
        misfit = self._misfits[self._count % _MISFITS]
        n: int = _fit(*self._arrays, misfit, newest, self._window, self._gap)
        self._count += 1
        if self._count % _REFRESH == 0:
            self._learn_noise()
        return n >= _FEWEST

    def _learn_noise(self) -> None:
        """The variance of one coordinate of a pose, of positions [m²] and rotations [rad²], from the last misfits.

        A quantile that turns do not shift. Zeros, which encoders with coarse steps give, do not count.
        """
        for group, misfits in enumerate(np.sort(self._misfits, axis=0).T):
            found = misfits[misfits > 0.0]
            if len(found) >= _REFRESH:
                quantile = found[int(_QUANTILE * (len(found) - 1))]
                self._noise[group] = max(quantile / _CHI2_OF_QUANTILE, _ROUNDING)


@inlined
def _rotation_vector(row, ax, ay, az, aw):
    """Rotation from an attitude, whose conjugate is a, to that of a pose."""
    bx, by, bz, bw = row[3], row[4], row[5], row[6]
    rx = bw * ax + bx * aw + by * az - bz * ay
    ry = bw * ay - bx * az + by * aw + bz * ax
    rz = bw * az + bx * ay - by * ax + bz * aw
    rw = bw * aw - bx * ax - by * ay - bz * az
    sine = math.sqrt(rx * rx + ry * ry + rz * rz)
    scale = math.copysign(2.0 * math.atan2(sine, abs(rw)) / sine if sine > 0.0 else 2.0, rw)
    return rx * scale, ry * scale, rz * scale


@inlined
def _recent(stamps, ring, newest, window, gap, t, x):
    """Write times [s] and places relative to the newest pose, newest first; return how many, 3 or more if there are.

    `stamps`, `window`, `gap` [ns]; a stamp is 0 where there is no pose. `ring`: rows position, quaternion xyzw. `x`:
    positions and rotation vectors in world axes, shape [6, n].
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
            x[k, n] = ring[at, k] - ring[newest, k]
        x[3, n], x[4, n], x[5, n] = _rotation_vector(ring[at], ax, ay, az, aw)
        n += 1
    return n


@inlined
def _end_slopes(t, x, n, slopes, squares):
    """Least squares of a parabola to the newest n poses: write its slopes at the newest, shape [6], to `slopes`.

    Writes the sums of squared misfits of position and rotation to `squares`; returns the variance of a slope in
    variances of one pose. With polynomials in time that are orthogonal over the poses: 1, u, q = u² - skew u - mean.
    """
    middle = uu = uuu = qq = 0.0
    for i in range(n):
        middle += t[i] / n
    for i in range(n):
        u = t[i] - middle
        uu, uuu = uu + u * u, uuu + u * u * u
    skew, mean = uuu / uu, uu / n
    for i in range(n):
        u = t[i] - middle
        qq += (u * u - skew * u - mean) ** 2
    bend = 2.0 * (t[0] - middle) - skew  # dq/dt at the newest pose
    squares[:] = 0.0
    for k in range(6):
        a = b = c = square = 0.0
        for i in range(n):
            u = t[i] - middle
            a, b, c = a + x[k, i] / n, b + x[k, i] * u / uu, c + x[k, i] * (u * u - skew * u - mean) / qq
        for i in range(n):
            u = t[i] - middle
            square += (x[k, i] - a - b * u - c * (u * u - skew * u - mean)) ** 2
        slopes[k] = b + c * bend
        squares[k // 3] += square
    return 1.0 / uu + bend * bend / qq


@compiled
def _fit(stamps, ring, noise, t, x, twist, misfit, newest, window, gap):
    """Write the slopes of the longest parabola whose misfit the `noise` explains to `twist`; return the poses' number.

    Of fewer than five poses it takes the line through the newest two. A twist that the noise explains is zero. Writes
    the newest pose's misfits to `misfit`, of position [m²] and rotation [rad²].
    """
    count = n = _recent(stamps, ring, newest, window, gap, t, x)
    for g in range(2):
        misfit[g] = _misfit(t, x, g) if n > 3 else 0.0
    if n < 2:
        return n
    squares, unlike = np.empty(2), True
    while unlike and n >= _FEWEST_OF_PARABOLA:
        factor = _end_slopes(t, x, n, twist, squares)
        free = 3.0 * (n - 3)
        unlike = max(squares[0] / noise[0], squares[1] / noise[1]) > free + _UNLIKELY * math.sqrt(2.0 * free)
        n = 4 * n // 5
    if unlike:
        factor = 2.0 / (t[1] * t[1])
        for k in range(6):
            twist[k] = x[k, 1] / t[1]
    still = True
    for g in range(2):
        square = twist[3 * g] ** 2 + twist[3 * g + 1] ** 2 + twist[3 * g + 2] ** 2
        bound = _MOVES * noise[g] * factor
        still = still and (square == 0.0 or square <= bound < np.inf)  # an attitude without noise does not move
    if still:
        twist[:] = 0.0
    return count


@inlined
def _misfit(t, x, g):
    """Squared distance of pose 0, at the origin, from the parabola through poses 1 to 3, in variances of one pose."""
    p, q, r = t[1], t[2], t[3]
    a, b, c = q * r / ((p - q) * (p - r)), p * r / ((q - p) * (q - r)), p * q / ((r - p) * (r - q))
    square = 0.0
    for k in range(3 * g, 3 * g + 3):
        square += (a * x[k, 1] + b * x[k, 2] + c * x[k, 3]) ** 2
    return square / (1.0 + a * a + b * b + c * c)

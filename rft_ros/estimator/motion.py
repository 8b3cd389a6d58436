"""The motion of the tool at a pose: its velocity, from twists or from the poses themselves, and its path.

The velocity from poses is the slope, at the newest pose, of a parabola fitted to the last poses on SE(3). This end
derivative of Savitzky and Golay (Analytical Chemistry 36, 1964) has no lag under constant acceleration. The window is
the longest one whose misfit stays within the noise of the poses. Across a reversal a longer one would overshoot.
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
from rft_ros.rft.kernel.compilation import compiled, inlined
from rft_ros.rft.placement import Placement

__all__ = ["UNKNOWN_VELOCITY", "Kinematics", "Motion", "PoseDifference"]

UNKNOWN_VELOCITY = {Reason.TWIST_MISSING, Reason.TWIST_STALE, Reason.POSE_HISTORY_SHORT}
"""Reasons for which a pose has no velocity."""

_PACK_STATE = Struct(f"{len(STATE)}d")  # writes a state in half the time that numpy takes
_CAPACITY = 2048  # poses: the longest window, 1 s, at 2 kHz
_FEWEST, _FEWEST_OF_PARABOLA = 3, 5
_MISFITS, _REFRESH = 256, 16  # misfits kept; new misfits between two estimates of the noise, and before the first
_QUANTILE, _CHI2_OF_QUANTILE = 0.95, 7.815
"""The noise is estimated from this quantile of the misfits, which have a chi-squared distribution of 3 degrees.

A high quantile, since poses with jittering stamps are noise, too; the few misfits at reversals change it little.
"""
_UNLIKELY = 8.0  # standard deviations of chi-squared; beyond, the window is shortened, and the slope is noisier
_MOVES = 40.0  # chi-squared with probability 1e-8: false motion at rest would release the held force
_ROUNDING = 1e-18  # the least variance: 1 nm, 1 nrad
_THIN = 1.0 / 64.0  # of the window: in its older part, poses closer than this to the one before are skipped


class Motion(NamedTuple):
    """The motion of the tool at a pose.

    `state`: shape [1, 13], columns `rft_ros.rft.STATE`. `velocity`: of the tool frame's origin, world axes [m/s].
    `speed_bound`: an upper bound on the plates' speeds [m/s]. `rests`: it is below `rest_speed`. `path`: an upper bound
    on the path of any plate since the motion before [m]. `duration`: time since then [s]. `tip_noise`: standard
    deviation of a coordinate of the tool's farthest point, by the noise of the poses [m]. A part of the noise that is
    not known counts as 0: both with a topic of twists and at the beginning, and that of rotations or of positions that
    have not changed yet, as of an arm that keeps its attitude exactly.
    """

    pose: PoseSample
    state: NDArray[np.float64]
    velocity: Vector
    speed_bound: float
    rests: bool
    path: float
    duration: float
    tip_noise: float


class Kinematics:
    """Follows the motion of one tool; `reach`: largest distance of its plates from the tool frame's origin [m]."""

    def __init__(self, settings: Settings, twists: deque[TwistSample], reach: float) -> None:
        self.reach, self._twists, self._settings = reach, twists, settings
        self.start_run()

    def use_settings(self, settings: Settings) -> None:
        """Apply new settings."""
        self._settings = settings
        self._max_age = round(settings.max_input_age * 1e9)
        self._period = round(min(1e9 / settings.max_rate, 1e18)) if settings.max_rate > 0.0 else 0
        self._due = 0
        self._difference.span(window=settings.twist_window, max_age=settings.max_input_age)

    def start_run(self) -> None:
        """Start a new run, or a run in new axes: drop the poses and the motion so far."""
        self._difference = PoseDifference()
        self._before: Motion | None = None
        self.use_settings(self._settings)

    def at(self, pose: PoseSample) -> Motion:
        """The motion at a pose. Raises `RefusedError` without a velocity, or if `max_rate` allows no answer yet."""
        velocity = self._velocity(pose)  # first, since poses that `max_rate` skips belong to the window, too
        # a tenth of a period lets a 125 Hz stream with jittering stamps pass a limit of 125 Hz
        if pose.stamp + self._period // 10 < self._due:
            raise RefusedError(Reason.POSE_RATE_LIMITED)
        if isinstance(velocity, Reason):
            raise RefusedError(velocity)
        self._due = max(self._due, pose.stamp) + self._period
        vx, vy, vz, wx, wy, wz = velocity
        bound = math.hypot(vx, vy, vz) + math.hypot(wx, wy, wz) * self.reach
        rests = bound < self._settings.rest_speed or bound == 0.0
        path, duration = self._path_since(pose, 0.0 if rests else bound)
        noise = self._difference.noise
        state = np.empty((1, len(STATE)))
        _PACK_STATE.pack_into(state.data, 0, *pose.position, *pose.quaternion, *velocity)
        self._before = motion = Motion(
            pose=pose,
            state=state,
            velocity=(vx, vy, vz),
            speed_bound=bound,
            rests=rests,
            path=path,
            duration=duration,
            tip_noise=math.sqrt(noise.position + self.reach * self.reach * noise.rotation),
        )
        return motion

    def _velocity(self, pose: PoseSample) -> Sequence[float] | Reason:
        """Linear and angular velocity at a pose, world axes; or the reason why it has none."""
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
        """Path [m] and duration [s] since the motion before. `speed` [m/s]: 0 at rest.

        After a gap longer than `max_input_age` the speeds in between are unknown. The path is then the displacement
        between the two poses, and the duration is the path over the mean speed.
        """
        if self._before is None:
            return 0.0, 0.0
        last = self._before.pose
        mean = 0.5 * (speed + (0.0 if self._before.rests else self._before.speed_bound))
        duration = (pose.stamp - last.stamp) * 1e-9
        if pose.stamp - last.stamp <= self._max_age or mean == 0.0:
            return mean * duration, duration
        cosine = abs(sum(a * b for a, b in zip(pose.quaternion, last.quaternion, strict=True)))
        path = math.dist(pose.position, last.position) + self.reach * 2.0 * math.acos(min(cosine, 1.0))
        return path, path / mean


class PoseNoise(NamedTuple):
    """Variance of one coordinate of a pose: of positions [m²] and of rotations [rad²]; 0 while unknown."""

    position: float
    rotation: float


class PoseDifference:
    """Keeps the last poses, and computes the `twist` at the newest: vx, vy, vz, wx, wy, wz [m/s], [rad/s], world axes.

    A twist within the noise of the poses is set to zero.
    """

    def __init__(self) -> None:
        self.twist = np.zeros(6)
        self._stamps, self._ring = np.zeros(_CAPACITY, dtype=np.int64), np.zeros((_CAPACITY, 7))
        self._misfits, self._noise = np.zeros((_MISFITS, 2)), np.full(2, np.inf)
        work = np.zeros(_CAPACITY), np.zeros((6, _CAPACITY))
        self._arrays = self._stamps, self._ring, self._noise, *work, self.twist
        self._count = 0
        self.noise = PoseNoise(0.0, 0.0)
        """The noise of the poses so far."""
        self.span(window=0.0, max_age=0.0)

    def span(self, *, window: float, max_age: float) -> None:
        """Set the window of the fit [s]; it has at least three poses, and ends at a gap longer than `max_age` [s]."""
        self._window, self._gap = round(1e9 * window), round(1e9 * max_age)

    def push(self, pose: PoseSample) -> bool:
        """Add a pose. Returns whether there are enough poses for `twist`."""
        newest = self._count % _CAPACITY
        self._stamps[newest] = pose.stamp
        self._ring[newest] = (*pose.position, *pose.quaternion)
        misfit = self._misfits[self._count % _MISFITS]
        n: int = _fit(*self._arrays, misfit, newest, self._window, self._gap)
        self._count += 1
        if self._count % _REFRESH == 0:
            self._estimate_noise()
        return n >= _FEWEST

    def _estimate_noise(self) -> None:
        """Estimate the noise of the poses.

        The variances are quantiles of the last misfits. Misfits of zero, as from encoders with coarse steps, are left
        out.
        """
        for group, misfits in enumerate(np.sort(self._misfits, axis=0).T):
            found = misfits[misfits > 0.0]
            if len(found) >= _REFRESH:
                quantile = found[int(_QUANTILE * (len(found) - 1))]
                self._noise[group] = max(quantile / _CHI2_OF_QUANTILE, _ROUNDING)
        self.noise = PoseNoise(*np.where(self._noise < np.inf, self._noise, 0.0).tolist())


@inlined
def _rotation_vector(pose, ax, ay, az, aw):
    """Rotation vector from the attitude whose conjugate is a to that of a pose: position, quaternion xyzw."""
    quaternion = pose[3:]
    bx, by, bz, bw = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
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
    axes, shape [6, n]. `ring`: rows position, quaternion xyzw. `stamps`, `window`, `gap` [ns]; a stamp is 0 where the
    ring has no pose yet.
    """
    quaternion = ring[newest, 3:]
    ax, ay, az, aw = -quaternion[0], -quaternion[1], -quaternion[2], quaternion[3]
    younger, n = stamps[newest], 0
    for back in range(len(stamps)):
        at = (newest - back) % len(stamps)
        age = stamps[newest] - stamps[at]  # a difference of integers has no rounding error
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
    """Fit a parabola to the newest n poses by least squares; write its slopes at the newest, shape [6], to `slopes`.

    Writes the sums of squared misfits of position and rotation to `squares`. Returns the variance of a slope over the
    variance of one pose. The fit uses polynomials in time that are orthogonal over the poses: 1, u, and
    q = u² - skew u - mean.
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
    """Fit the longest parabola whose misfit is within the `noise`, and write its slopes to `twist`.

    Returns the number of poses in the window. With fewer than five the slopes are those of the line through the newest
    two. A twist within the noise is set to zero. Writes the misfits of the newest pose to `misfit`, of position [m²]
    and rotation [rad²].
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
        still = still and (square == 0.0 or square <= bound < np.inf)  # the noise is infinite until it is estimated
    if still:
        twist[:] = 0.0
    return count


@inlined
def _misfit(t, x, g):
    """Squared distance of pose 0, the origin, from the parabola through poses 1 to 3; scaled to one pose's variance."""
    p, q, r = t[1], t[2], t[3]
    a, b, c = q * r / ((p - q) * (p - r)), p * r / ((q - p) * (q - r)), p * q / ((r - p) * (r - q))
    square = 0.0
    for k in range(3 * g, 3 * g + 3):
        square += (a * x[k, 1] + b * x[k, 2] + c * x[k, 3]) ** 2
    return square / (1.0 + a * a + b * b + c * c)

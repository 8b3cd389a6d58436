"""How the tool moves at a pose: its velocity, from twists or from the poses themselves, and the path behind it."""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.samples import PoseSample, Reason, RefusedError, TwistSample, Vector
from rft_ros.estimator.transforms import Placement
from rft_ros.estimator.velocity import PoseDifference
from rft_ros.parameters import Settings
from rft_ros.rft import STATE

__all__ = ["UNKNOWN_VELOCITY", "Kinematics", "Motion"]

UNKNOWN_VELOCITY = {Reason.TWIST_MISSING, Reason.TWIST_STALE, Reason.POSE_HISTORY_SHORT}
"""Reasons of poses whose velocity is unknown."""


class Motion(NamedTuple):
    """The tool's motion at a pose.

    `state`: shape [1, 13], columns `rft_ros.rft.STATE`. `velocity` of the tool frame's origin, world axes [m/s].
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
        self.reach = reach
        self._twists = twists
        self._difference = PoseDifference()
        self._before: Motion | None = None
        self.use(settings)

    def use(self, settings: Settings) -> None:
        """Take new settings."""
        self._settings = settings
        self._max_age = round(settings.max_input_age * 1e9)
        self._period = round(min(1e9 / settings.max_rate, 1e18)) if settings.max_rate > 0.0 else 0
        self._due = 0
        self._difference.span(window=settings.twist_window, max_age=settings.max_input_age)

    def begin_again(self) -> None:
        """Forget the motion so far: a new run, or new axes."""
        self._difference.reset()
        self._before = None
        self._due = 0

    def at(self, pose: PoseSample) -> Motion:
        """The motion at a pose; `RefusedError` if it has no velocity, or comes sooner than `max_rate` allows."""
        velocity = self._velocity(pose)
        # a tenth of a period lets a 125 Hz stream with jittering stamps pass a limit of 125 Hz
        if pose.stamp + self._period // 10 < self._due:
            raise RefusedError(Reason.POSE_RATE_LIMITED)
        if isinstance(velocity, Reason):
            raise RefusedError(velocity)
        self._due = max(self._due, pose.stamp) + self._period
        vx, vy, vz, wx, wy, wz = velocity
        speed = math.hypot(vx, vy, vz) + math.hypot(wx, wy, wz) * self.reach
        rests = speed < self._settings.rest_speed
        path, duration = self._way(pose, 0.0 if rests else speed)
        state = np.empty((1, len(STATE)))  # an array of a nested list takes half as long again
        state[0] = (*pose.position, *pose.quaternion, *velocity)
        self._before = motion = Motion(pose, state, (vx, vy, vz), speed, rests, path, duration)
        return motion

    def _velocity(self, pose: PoseSample) -> Sequence[float] | Reason:
        """Linear and angular velocity at a pose, world axes; or why it has none."""
        if self._settings.twist_source == "pose_difference":
            ready, twist = self._difference.push(pose), self._difference.twist.tolist()
            return twist if ready else Reason.POSE_HISTORY_SHORT
        for sample in reversed(self._twists):
            if sample.stamp <= pose.stamp:
                break
        else:
            return Reason.TWIST_MISSING
        if pose.stamp - sample.stamp > self._max_age:
            return Reason.TWIST_STALE
        if sample.frame == self._settings.tool_frame:
            to_world = Placement(pose.position, pose.quaternion)
            return *to_world.rotate(sample.linear), *to_world.rotate(sample.angular)
        return sample.linear + sample.angular

    def _way(self, pose: PoseSample, speed: float) -> tuple[float, float]:
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

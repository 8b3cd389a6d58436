"""The motion of the tool at a pose: its velocity, from twists or from the poses themselves, and its path."""

import math
from collections import deque
from collections.abc import Sequence
from struct import Struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.pose_difference import PoseDifference
from rft_ros.estimator.samples import PoseSample, Reason, RefusedError, TwistSample, Vector, around
from rft_ros.parameters import Settings
from rft_ros.rft import STATE
from rft_ros.rft.placement import Placement

__all__ = ["UNKNOWN_VELOCITY", "Kinematics", "Motion"]

UNKNOWN_VELOCITY = {Reason.TWIST_MISSING, Reason.TWIST_STALE, Reason.POSE_HISTORY_SHORT}
"""Reasons for which a pose has no velocity."""

_MOVED = 1e-4  # m; a driver that sends few poses must not make path of their noise at rest
_PACK_STATE = Struct(f"{len(STATE)}d")  # writes a state in half the time that numpy takes


class Motion(NamedTuple):
    """The motion of the tool at a pose.

    `state`: shape [1, 13], columns `rft_ros.rft.STATE`. `velocity`: of the tool frame's origin, world axes [m/s].
    `speed_bound`: an upper bound on the plates' speeds [m/s]. `rests`: it is below `rest_speed`. `path`: an upper bound
    on the path of any plate since the motion before [m]. `duration`: time since then [s]. `tip_noise`: standard
    deviation of a coordinate of the tool's farthest point, by the noise of the poses [m]. The noise of positions and
    that of rotations are estimated separately, and count as 0 until they are known. They stay unknown if the twists
    come from a topic, and while the poses do not vary, such as the attitude of an arm that only translates.
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
        velocity = self._velocity(pose)  # before the check of `max_rate`: the poses that it skips belong to the window
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
        between the two poses, and the duration is the path over the mean speed. Where the tool rests at both poses, the
        duration is that of the gap, and a displacement below `_MOVED` is noise.
        """
        if self._before is None:
            return 0.0, 0.0
        last = self._before.pose
        mean = 0.5 * (speed + (0.0 if self._before.rests else self._before.speed_bound))
        duration = (pose.stamp - last.stamp) * 1e-9
        if pose.stamp - last.stamp <= self._max_age:
            return mean * duration, duration
        cosine = abs(sum(a * b for a, b in zip(pose.quaternion, last.quaternion, strict=True)))
        path = math.dist(pose.position, last.position) + self.reach * 2.0 * math.acos(min(cosine, 1.0))
        if mean == 0.0:
            return (path if path > _MOVED else 0.0), duration
        return path, path / mean

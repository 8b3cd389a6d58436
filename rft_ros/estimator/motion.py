"""The motion of the tool at a pose: its velocity, from twists or from the poses themselves, and its path."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.pose_difference import PoseDifference
from rft_ros.estimator.pose_noise import NOISY, PoseNoise
from rft_ros.estimator.samples import PoseSample, Reason, RefusedError, TwistSample, Vector
from rft_ros.estimator.timeline import Timeline
from rft_ros.parameters import Settings
from rft_ros.rft import QUATERNION, SLACK, STATE
from rft_ros.rft.frames import Placement, attitude
from rft_ros.rft.kernel.compilation import compiled, machine_code
from rft_ros.rft.memory import DEAD_BAND, HEAD, displacement

__all__ = ["UNKNOWN_VELOCITY", "Kinematics", "Motion"]

UNKNOWN_VELOCITY = {Reason.TWIST_MISSING, Reason.TWIST_STALE, Reason.POSE_HISTORY_SHORT}
"""Reasons for which a pose has no velocity."""

_BAND_OVER_NOISE = 5.0  # dead band, in standard deviations of the pose noise at the tool's tip
_WIDEST_BAND = 2e-3  # m


class Motion(NamedTuple):
    """The motion of the tool at a pose.

    `state`: shape [1, 13], columns `rft_ros.rft.STATE`. `velocity`: of the tool frame's origin, world axes [m/s].
    `speed_bound`: an upper bound on the plates' speeds [m/s]. `rests`: it is below `rest_speed`. `path`: an upper bound
    on the displacement of any plate since the motion before, beyond the dead band [m]. `rise`: displacement of the
    origin upwards in it [m]. `dead_band` [m]: displacements within it are noise of the poses. `is_along`: there
    is a displacement, and it goes along the velocity. Just after a stop a fitted velocity can oppose the displacement;
    at rest it can point anywhere. `is_noisy`: the dead band is wide.
    """

    pose: PoseSample
    state: NDArray[np.float64]
    velocity: Vector
    speed_bound: float
    rests: bool
    path: float
    rise: float
    dead_band: float
    is_along: bool
    is_noisy: bool


class Kinematics:
    """Follows the motion of one tool; `reach`: largest distance of its plates from the tool frame's origin [m].

    Velocities are those of the twists, or are found from the poses. The path is always that of the poses: of a pose
    that follows the tool's at the distance of the dead band, so that noise at rest is no path.
    """

    def __init__(self, settings: Settings, twists: Timeline[TwistSample], *, reach: float) -> None:
        self._twists, self._settings, self.reach = twists, settings, reach
        self._follow: Any = machine_code(_follow, (np.zeros(HEAD), np.zeros(len(STATE)), 0.0))
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
        self._head = np.zeros(HEAD)
        self.use_settings(self._settings)

    @property
    def noise(self) -> PoseNoise:
        """The noise of the poses."""
        return self._difference.noise

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
        noise = self.noise.at_tip(self.reach)
        dead_band = min(max(_BAND_OVER_NOISE * noise, SLACK), _WIDEST_BAND)
        state = np.array([(*pose.position, *pose.quaternion, *velocity)], dtype=np.float64)
        self._head[DEAD_BAND] = dead_band
        path, rise, along = self._follow(self._head, state[0], self.reach)
        return Motion(
            pose=pose,
            state=state,
            velocity=(vx, vy, vz),
            speed_bound=bound,
            rests=bound < self._settings.rest_speed or bound == 0.0,
            path=path,
            rise=rise,
            dead_band=dead_band,
            is_along=along > 0.0,
            is_noisy=noise > NOISY,
        )

    def _velocity(self, pose: PoseSample) -> Sequence[float] | Reason:
        """Linear and angular velocity at a pose, world axes; or the reason why it has none."""
        if self._settings.twist_source == "pose_difference":
            return self._difference.twist.tolist() if self._difference.push(pose) else Reason.POSE_HISTORY_SHORT
        self.noise.add(pose, gap=self._max_age)
        twist, _, _ = self._twists.around(pose.stamp)
        if twist is None:
            return Reason.TWIST_MISSING
        if pose.stamp - twist.stamp > self._max_age:
            return Reason.TWIST_STALE
        if twist.frame != self._settings.tool_frame:
            return *twist.linear, *twist.angular
        to_world = Placement(pose.position, pose.quaternion)
        return *to_world.rotate(twist.linear), *to_world.rotate(twist.angular)


@compiled
def _follow(head, state, reach):
    """Path and rise of a tool that comes to a state, shape [13], and its displacement along the twist [m²/s].

    The displacement is that which the memory of plates has. `head`: of a row of `Memory.numbers`, with the dead band.
    `reach` of the plates [m].
    """
    ((x, y, z), turn), _ = displacement(head, state, attitude(state[QUATERNION]), reach)
    _, xy, xz, yx, _, yz, zx, zy, _ = turn
    spin = 0.0
    for t in turn:
        spin += t * t
    along = x * state[7] + y * state[8] + z * state[9]
    turned = 0.5 * ((zy - yz) * state[10] + (xz - zx) * state[11] + (yx - xy) * state[12])
    path = math.sqrt(x * x + y * y + z * z) + reach * math.sqrt(0.5 * spin)
    return path, z, along + reach * reach * turned

"""The motion of the tool at a pose: its velocity, from twists or from the poses themselves, and its path."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.pose_difference import PoseDifference
from rft_ros.estimator.pose_noise import NOISY, PoseNoise
from rft_ros.estimator.samples import PoseSample, Reason, TwistSample, Vector
from rft_ros.estimator.timeline import Timeline
from rft_ros.parameters import Settings
from rft_ros.rft import QUATERNION, SLACK, STATE
from rft_ros.rft.frames import Placement, attitude
from rft_ros.rft.kernel.compilation import compiled, machine_code
from rft_ros.rft.memory import DEAD_BAND, HEAD, displacement

__all__ = ["UNKNOWN_VELOCITY", "Kinematics", "Motion", "Pace"]

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


class Pace:
    """Limits the rate of estimates to `max_rate` [Hz]; 0: no limit."""

    def __init__(self, max_rate: float) -> None:
        self._period = round(min(1e9 / max_rate, 1e18)) if max_rate > 0.0 else 0
        self._due = 0

    def allows(self, stamp: int) -> bool:
        """Whether a pose with this stamp [ns] may have an estimate."""
        # a tenth of a period lets a 125 Hz stream with jittering stamps pass a limit of 125 Hz
        return stamp + self._period // 10 >= self._due

    def count(self, stamp: int) -> None:
        """Count an estimate at a stamp [ns]."""
        self._due = max(self._due, stamp) + self._period


class Kinematics:
    """Follows the motion of one tool.

    Velocities are those of the twists, or are found from the poses. The path is always that of the poses: of a pose
    that follows the tool's at the distance of the dead band, so that noise at rest is no path.
    """

    def __init__(self) -> None:
        self._difference = PoseDifference()
        self._head = np.zeros(HEAD)
        self._follow: Any = machine_code(_follow, (self._head, np.zeros(len(STATE)), 0.0))

    @property
    def noise(self) -> PoseNoise:
        """The noise of the poses."""
        return self._difference.noise

    def velocity(
        self, pose: PoseSample, twists: Timeline[TwistSample], settings: Settings
    ) -> tuple[float, ...] | Reason:
        """Linear and angular velocity at the next pose, world axes; or the reason why it has none.

        Call it at every pose: those without an estimate belong to the window of `PoseDifference`, too.
        """
        max_age = settings.max_age
        if settings.twist_source == "pose_difference":
            is_known = self._difference.push(pose, window=settings.twist_window, gap=max_age)
            return tuple(self._difference.twist.tolist()) if is_known else Reason.POSE_HISTORY_SHORT
        self.noise.add(pose, gap=max_age)
        twist, _, _ = twists.around(pose.stamp)
        if twist is None:
            return Reason.TWIST_MISSING
        if pose.stamp - twist.stamp > max_age:
            return Reason.TWIST_STALE
        if twist.frame != settings.tool_frame:
            return *twist.linear, *twist.angular
        to_world = Placement(pose.position, pose.quaternion)
        return *to_world.rotate(twist.linear), *to_world.rotate(twist.angular)

    def motion(self, pose: PoseSample, velocity: tuple[float, ...], *, reach: float, rest_speed: float) -> Motion:
        """The motion of the tool to a pose, at which it has this `velocity`. `reach`: of its plates [m]."""
        vx, vy, vz, wx, wy, wz = velocity
        bound = math.hypot(vx, vy, vz) + math.hypot(wx, wy, wz) * reach
        noise = self.noise.at_tip(reach)
        dead_band = min(max(_BAND_OVER_NOISE * noise, SLACK), _WIDEST_BAND)
        state = np.array([(*pose.position, *pose.quaternion, *velocity)], dtype=np.float64)
        self._head[DEAD_BAND] = dead_band
        path, rise, along = self._follow(self._head, state[0], reach)
        return Motion(
            pose=pose,
            state=state,
            velocity=(vx, vy, vz),
            speed_bound=bound,
            rests=bound < rest_speed or bound == 0.0,
            path=path,
            rise=rise,
            dead_band=dead_band,
            is_along=along > 0.0,
            is_noisy=noise > NOISY,
        )


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

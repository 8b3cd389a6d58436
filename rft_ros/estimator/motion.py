"""The motion of the tool at a pose: its velocity, from twists or from the poses themselves, and its path."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.pose_difference import PoseDifference
from rft_ros.estimator.pose_noise import NOISY, PoseNoise
from rft_ros.estimator.samples import PoseSample, Reason, TwistSample
from rft_ros.estimator.timeline import Timeline
from rft_ros.parameters import Settings
from rft_ros.rft import SLACK, STATE, TWIST
from rft_ros.rft.displacement import DISPLACEMENT, FOLLOWED, as_motion, follow, product
from rft_ros.rft.frames import Vector
from rft_ros.rft.kernel.compilation import compiled, machine_code

UNKNOWN_VELOCITY = {Reason.TWIST_MISSING, Reason.TWIST_STALE, Reason.POSE_HISTORY_SHORT}
"""Reasons for which a pose has no velocity."""

_BAND_OVER_NOISE = 5.0  # dead band, in standard deviations of the pose noise at the tool's tip
_WIDEST_BAND = 2e-3  # m
_CREEP = 1e-6  # m/s; so slow that inertia of the grains is nothing


class Motion(NamedTuple):
    """The motion of the tool at a pose.

    `state`: shape [1, 13], columns `rft_ros.rft.STATE`. `displacement`: of the tool since the motion before, beyond the
    dead band, shape [1, 12] (`rft_ros.rft.displacement`). `with_direction`: the state for a model with memory. Just
    after a stop a fitted velocity can oppose the displacement, and at rest it can point anywhere: in place of such a
    velocity it has the last one that did not, as a creep. `velocity`: of the tool frame's origin, world axes [m/s].
    `speed_bound`: an upper bound on the plates' speeds [m/s]. `rests`: it is below `rest_speed`. `path`: an upper bound
    on the displacement of any plate [m]. `rise`: displacement of the origin upwards [m]. `is_noisy`: the dead band is
    wide.
    """

    pose: PoseSample
    state: NDArray[np.float64]
    displacement: NDArray[np.float64]
    with_direction: NDArray[np.float64]
    velocity: Vector
    speed_bound: float
    rests: bool
    path: float
    rise: float
    is_noisy: bool


class Pace:
    """Limits the rate of estimates."""

    def __init__(self) -> None:
        self._last_due = -math.inf  # [ns]

    def allows(self, stamp: int, max_rate: float) -> bool:
        """Whether a pose with this stamp [ns] may have an estimate. `max_rate` [Hz]; 0: no limit."""
        if max_rate == 0.0:
            return True
        period = _period(max_rate)
        # a tenth of a period lets a 125 Hz stream with jittering stamps pass a limit of 125 Hz
        return stamp + period // 10 >= self._last_due + period

    def count(self, stamp: int, max_rate: float) -> None:
        """Count an estimate at a stamp [ns]."""
        period = _period(max_rate) if max_rate > 0.0 else 0
        self._last_due = max(self._last_due + period, stamp)


def _period(rate: float) -> int:
    """The period of a rate [Hz], in ns."""
    return round(min(1e9 / rate, 1e18))


class Kinematics:
    """Follows the motion of one tool.

    Velocities are those of the twists, or are found from the poses. The path is always that of the poses: of a pose
    that follows the tool's at the distance of the dead band, so that noise at rest is no path.
    """

    def __init__(self) -> None:
        self._difference = PoseDifference()
        self._followed = np.zeros(1, FOLLOWED)
        states = np.zeros((1, len(STATE)))
        self._follow: Any = machine_code(
            _follow, (self._followed, states, 0.0, 0.0, np.zeros((1, DISPLACEMENT)))
        )
        self._last_along = states  # the last state whose twist was along the displacement
        self._speed_along = 1.0  # its bound on the plates' speeds [m/s]

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
            return (
                tuple(self._difference.twist.tolist()) if is_known else Reason.POSE_HISTORY_SHORT
            )
        self.noise.add(pose, gap=max_age)
        twist, _, _ = twists.around(pose.stamp)
        if twist is None:
            return Reason.TWIST_MISSING
        if pose.stamp - twist.stamp > max_age:
            return Reason.TWIST_STALE
        if twist.frame != settings.tool_frame:
            return *twist.linear, *twist.angular
        return *pose.place.rotate(twist.linear), *pose.place.rotate(twist.angular)

    def motion(
        self, pose: PoseSample, velocity: tuple[float, ...], *, reach: float, rest_speed: float
    ) -> Motion:
        """The motion of the tool to a pose, at which it has this `velocity`. `reach`: of its plates [m]."""
        vx, vy, vz, wx, wy, wz = velocity
        bound = math.hypot(vx, vy, vz) + math.hypot(wx, wy, wz) * reach
        noise = self.noise.at_tip(reach)
        dead_band = min(max(_BAND_OVER_NOISE * noise, SLACK), _WIDEST_BAND)
        state = np.array([(*pose.position, *pose.quaternion, *velocity)], dtype=np.float64)
        displacement = np.empty((1, DISPLACEMENT))
        path, rise, along = self._follow(self._followed, state, reach, dead_band, displacement)
        with_direction = state
        if along > 0.0:
            self._last_along = state
            self._speed_along = bound
        else:
            with_direction = state.copy()
            with_direction[0, TWIST] = _CREEP * (self._last_along[0, TWIST] / self._speed_along)
        return Motion(
            pose=pose,
            state=state,
            displacement=displacement,
            with_direction=with_direction,
            velocity=(vx, vy, vz),
            speed_bound=bound,
            rests=bound < rest_speed or bound == 0.0,
            path=path,
            rise=rise,
            is_noisy=noise > NOISY,
        )


@compiled
def _follow(followed, states, reach, dead_band, displacements):
    """Follow a tool to its next state, shape [1, 13], and write its displacement, shape [1, 12].

    Returns path, rise and the displacement along the twist [m²/s]. `followed`: one record of `FOLLOWED`. `reach` of the
    plates [m].
    """
    state = states[0]
    moved = displacements[0]
    follow(followed[0], state, reach, dead_band, moved)
    (x, y, z), matrix = as_motion(moved)
    spin = 0.0
    for turn in matrix:
        spin += turn * turn
    path = math.sqrt(x * x + y * y + z * z) + reach * math.sqrt(0.5 * spin)
    return path, z, product(moved, state[TWIST], reach)

"""The motion of the tool at a pose: its velocity, from twists or from the poses themselves, and its path."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.pose_difference import PoseDifference
from rft_ros.estimator.pose_noise import NOISY, PoseNoise
from rft_ros.estimator.samples import PoseSample, Reason, TwistSample
from rft_ros.estimator.timeline import Timeline
from rft_ros.parameters import InputsConfig
from rft_ros.rft import SLACK, STATE, TWIST
from rft_ros.rft.displacement import DISPLACEMENT_COUNT, FOLLOWER, displacement_in, follow, product
from rft_ros.rft.frames import Vector
from rft_ros.rft.kernel.compilation import compiled, machine_code

UNKNOWN_VELOCITY = {Reason.TWIST_MISSING, Reason.TWIST_STALE, Reason.POSE_HISTORY_SHORT}
"""Reasons for which a pose has no velocity."""

_DEAD_BAND_FACTOR = 5.0
_MAX_DEAD_BAND_M = 2e-3

CREEP_SPEED_M_S = 1e-6
"""Speed of a state without a velocity of its own: so slow that inertia of the grains is nothing."""


def dead_band_of(noise: float) -> float:
    """The path [m] within which a tool whose poses have a `noise` [m] rests: its standard deviation at the tip."""
    return min(max(_DEAD_BAND_FACTOR * noise, SLACK), _MAX_DEAD_BAND_M)


class Motion(NamedTuple):
    """The motion of the tool at a pose.

    `state`: shape [1, 13], columns `rft_ros.rft.STATE`. `displacement`: of the tool since the motion before, beyond the
    dead band, shape [1, 12] (`rft_ros.rft.displacement`). `memory_state`: the state for a model with memory. Where the
    fitted velocity opposes the displacement, as just after a stop, or points anywhere, as at rest, it is replaced by
    1 µm/s along the last consistent one. `velocity`: of the tool frame's origin, world axes [m/s].
    `speed_bound`: an upper bound on the plates' speeds [m/s]. `rests`: it is below `rest_speed`. `path`: an upper bound
    on the displacement of any plate [m]. `rise`: displacement of the origin upwards [m]. `is_noisy`: the dead band is
    wide.
    """

    pose: PoseSample
    state: NDArray[np.float64]
    displacement: NDArray[np.float64]
    memory_state: NDArray[np.float64]
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
        self._follower = np.zeros(1, FOLLOWER)
        states = np.zeros((1, len(STATE)))
        self._follow: Any = machine_code(
            _follow, (self._follower, states, 0.0, 0.0, np.zeros((1, DISPLACEMENT_COUNT)))
        )
        self._consistent_state = states  # the last one whose twist was along the displacement
        self._consistent_speed = 1.0  # its bound on the plates' speeds [m/s]

    @property
    def noise(self) -> PoseNoise:
        """The noise of the poses."""
        return self._difference.noise

    def velocity(
        self,
        pose: PoseSample,
        twists: Timeline[TwistSample],
        inputs: InputsConfig,
        *,
        tool_frame: str,
    ) -> tuple[float, ...] | Reason:
        """Linear and angular velocity at the next pose, world axes; or the reason why it has none.

        Call it at every pose: those without an estimate belong to the window of `PoseDifference`, too.
        """
        max_age = inputs.max_age
        if inputs.twist_source == "pose_difference":
            is_known = self._difference.push(pose, window=inputs.twist_window, gap=max_age)
            return (
                tuple(self._difference.twist.tolist()) if is_known else Reason.POSE_HISTORY_SHORT
            )
        self.noise.add(pose, gap=max_age)
        twist, _, _ = twists.around(pose.stamp)
        if twist is None:
            return Reason.TWIST_MISSING
        if pose.stamp - twist.stamp > max_age:
            return Reason.TWIST_STALE
        if twist.frame != tool_frame:
            return *twist.linear, *twist.angular
        return *pose.place.rotate(twist.linear), *pose.place.rotate(twist.angular)

    def motion(
        self, pose: PoseSample, velocity: tuple[float, ...], *, reach: float, rest_speed: float
    ) -> Motion:
        """The motion of the tool to a pose, at which it has this `velocity`. `reach`: of its plates [m]."""
        vx, vy, vz, wx, wy, wz = velocity
        bound = math.hypot(vx, vy, vz) + math.hypot(wx, wy, wz) * reach
        noise = self.noise.at_tip(reach)
        dead_band = dead_band_of(noise)
        state = np.array([(*pose.position, *pose.quaternion, *velocity)], dtype=np.float64)
        displacement = np.empty((1, DISPLACEMENT_COUNT))
        path, rise, agreement = self._follow(self._follower, state, reach, dead_band, displacement)
        memory_state = state
        if agreement > 0.0:
            self._consistent_state = state
            self._consistent_speed = bound
        else:
            memory_state = state.copy()
            direction = self._consistent_state[0, TWIST] / self._consistent_speed
            memory_state[0, TWIST] = CREEP_SPEED_M_S * direction
        return Motion(
            pose=pose,
            state=state,
            displacement=displacement,
            memory_state=memory_state,
            velocity=(vx, vy, vz),
            speed_bound=bound,
            rests=bound < rest_speed or bound == 0.0,
            path=path,
            rise=rise,
            is_noisy=noise > NOISY,
        )


@compiled
def _follow(followers, states, reach, dead_band, displacements):
    """Follow a tool to its next state, shape [1, 13], and write its displacement, shape [1, 12].

    Returns path, rise and the displacement along the twist [m²/s]. `followers`: one record of `FOLLOWER`. `reach` of
    the plates [m].
    """
    state = states[0]
    row = displacements[0]
    follow(followers[0], state, reach, dead_band, row)
    displacement = displacement_in(row)
    x, y, z = displacement.origin
    square_of_turn = 0.0
    for number in displacement.matrix:
        square_of_turn += number * number
    path = math.sqrt(x * x + y * y + z * z) + reach * math.sqrt(0.5 * square_of_turn)
    return path, z, product(row, state[TWIST], reach)

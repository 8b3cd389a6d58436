"""A recording as the fits of the grains use it: its motion without noise, the measured force, and the model's force."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.smoothing import (
    GAP,
    FineMotion,
    fine_motion,
    shaken_states,
    smoothed_states,
)
from rft_ros.calibration.track import Track, moved_back
from rft_ros.rft import FORCE, Law, Memory, displacements_followed, wrenches, wrenches_in_time
from rft_ros.rft.frames import TWIST, VELOCITY

Array = NDArray[np.float64]

SHAKEN = 2
"""Number of motions with more noise, to which each fit is compared."""

_LOST_MOTION = 5e-6  # m: path that an arm loses when it turns back, by backlash or in the dead band of noisy poses
# m: at this height above the surface the memory is empty, despite noise of the poses
_CLEAR = 0.001


class BedValues(NamedTuple):
    """Values of the model that all fits use; those that a phase of a recording determines are fitted to it.

    Surface height [m]; natural logarithm of λ [m], -inf without memory; delay of the load cell [s], on top of the one
    that the recording was read with.
    """

    surface: float
    log_length: float
    delay: float = 0.0

    @property
    def length(self) -> float:
        """λ [m]; 0 without memory."""
        return float(np.exp(self.log_length))


@dataclass(frozen=True, kw_only=True, eq=False)
class Recorded:
    """One recording of n moments, for `law` at ζ = 1.

    `motion`: without the noise of the poses, at rest with velocity 0. `friction`: the part of the measured force that
    reverses with the motion, world axes [N], shape [n, 3].
    """

    track: Track
    law: Law
    motion: FineMotion
    friction: Array

    def before_contact(self, row: int, surface: float) -> int:
        """The last row before `row` at which the tool is in the air or poses are missing; 0 if it never is."""
        apart = np.flatnonzero(np.diff(self.track.time[: row + 1]) > GAP) + 1
        in_air = np.flatnonzero(self.track.heights[: row + 1] > surface + _CLEAR)
        return int(max(apart.max(initial=0), in_air.max(initial=0)))

    def predicted(self, values: BedValues, first: int, last: int) -> Array:
        """Force on the tool at the rows from `first`, where the memory is empty, to `last`, world axes [N], [m, 3]."""
        plates = self.track.tool.plates
        if values.length == 0.0:
            # smooth velocities: without memory there is no force at rest, and an arm guided by hand stops in between
            states = self.track.smooth[first : last + 1]
            return wrenches(plates, self.law, states, surface_height=values.surface, threads=1)[
                :, FORCE
            ]
        law = replace(self.law, mobilization_length=values.length)
        rows = self.motion.rows[first : last + 1]
        states = self.motion.states[rows[0] : rows[-1] + 1]
        moved = displacements_followed(states, reach=plates.reach, dead_band=_LOST_MOTION)
        found = wrenches_in_time(
            plates, law, states, Memory(plates), displacements=moved, surface_height=values.surface
        )
        return np.asarray(found[rows - rows[0], FORCE])

    def by_delay(self, delay: float) -> Array:
        """What a delay of the load cell [s] changes in the forces: half the difference of either way [N], [n, 3]."""
        early = moved_back(self.track.time, self.track.forces, delay)
        late = moved_back(self.track.time, self.track.forces, -delay)
        return 0.5 * (early - late)

    @cached_property
    def shaken(self) -> list["Recorded"]:
        """The recording with noise added in `SHAKEN` ways, so that its deviation doubles; none if it has no noise."""
        found = []
        for seed in range(SHAKEN):
            rng = np.random.default_rng(seed)
            states = shaken_states(self.track.time, self.track.states, times=3.0**0.5, rng=rng)
            if states is not None:
                found.append(replace(self, motion=_motion(self.track, states)))
        return found


def _motion(track: Track, states: Array) -> FineMotion:
    """The motion without the noise of the poses, at rest with velocity 0."""
    smooth = smoothed_states(track.time, states)
    smooth[np.add(*track.speeds(smooth)) < track.rest_speed, TWIST] = 0.0
    return fine_motion(track.time, smooth)


def _friction(track: Track, in_air: NDArray[np.bool_]) -> Array:
    """What reverses with the motion in the air, beside the bias and the weight, at every moment [N], shape [n, 3]."""
    velocity = track.smooth[:, VELOCITY]
    speed = np.linalg.norm(velocity, axis=1)
    moving = speed >= track.rest_speed
    way = np.zeros_like(velocity)
    way[moving] = velocity[moving] / speed[moving, None]
    if not way[in_air].any():
        return np.zeros_like(way)
    weight = np.broadcast_to([[0.0], [0.0], [1.0]], (len(way), 3, 1))
    columns = np.concatenate([track.sensor_rotations, weight, way[:, :, None]], axis=2)
    found = np.linalg.lstsq(
        columns[in_air].reshape(-1, 5), track.forces[in_air].ravel(), rcond=None
    )[0]
    return np.asarray(found[-1] * way)


def recorded(track: Track, law: Law, *, surface: float) -> Recorded:
    """Prepare a recording; `law`: without memory and inertia, at ζ = 1. What is above the `surface` [m] is air."""
    friction = _friction(track, track.heights > surface + _CLEAR)
    return Recorded(track=track, law=law, motion=_motion(track, track.states), friction=friction)

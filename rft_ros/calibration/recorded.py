"""A recording as the fits of the grains use it: its motion without noise, the measured force, and the model's force."""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.smoothing import (
    CorneredMotion,
    cornered_motion,
    interpolated,
    smoothed_states,
)
from rft_ros.calibration.track import Indices, Track
from rft_ros.diagnosis.trial import places_followed
from rft_ros.rft import FORCE, Law, Memory, displacements_followed, wrenches, wrenches_in_time
from rft_ros.rft.frames import POSE, POSITION, TWIST, VELOCITY

Array = NDArray[np.float64]

MAX_DELAY_S = 0.25
"""Greatest delay that is searched, to both sides."""

_COARSE_TOLERANCE_SHARE = 0.025
"""Error of the reduced tools over the force.

In nine recordings the fitted delay moved by less than a fifth of its error.
"""

_DEAD_BAND_M = 5e-6
"""Path that an arm loses when it turns back, by backlash or in the dead band of noisy poses."""

_MIN_AIR_CLEARANCE_M = 0.001
"""At this height above the surface the memory is empty, despite noise of the poses."""


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
    """One recording of n moments, for `law` without memory and inertia, at ζ = 1; above `air` [m] is the air."""

    track: Track
    law: Law
    air: float

    @property
    def name(self) -> str:
        """Of the track."""
        return self.track.name

    @property
    def moments(self) -> range:
        """The rows of all moments."""
        return range(len(self.track.time))

    def moments_about(self, rows: Indices, *, first: int) -> range:
        """The moments from `first` to the greatest delay after the last of some rows."""
        time = self.track.time
        return range(first, int(np.searchsorted(time, time[rows[-1]] + MAX_DELAY_S)))

    @cached_property
    def coarse(self) -> "Recorded":
        """With a reduced tool, whose error matters where only changes of the force count; itself if it has one."""
        tool = self.track.tool.reduced(_COARSE_TOLERANCE_SHARE)
        return (
            self
            if tool is self.track.tool
            else replace(self, track=replace(self.track, tool=tool))
        )

    @cached_property
    def motion(self) -> CorneredMotion:
        """The motion without the noise of the poses, at rest with velocity 0."""
        smooth = smoothed_states(self.track.time, self.track.states)
        smooth[np.add(*self.track.speeds(smooth)) < self.track.rest_speed, TWIST] = 0.0
        motion = cornered_motion(self.track.time, smooth)
        reach = self.track.tool.plates.reach
        motion.states[:, POSITION] = places_followed(
            motion.time, motion.states[:, POSE], reach=reach, dead_band=_DEAD_BAND_M
        )
        return motion

    def lowest(self, rows: Indices) -> float:
        """World z of the tool's lowest point at some rows or at a corner of the path after them [m]."""
        last = min(rows[-1] + 1, len(self.motion.rows) - 1)
        states = self.motion.states[self.motion.rows[rows[0]] : self.motion.rows[last] + 1]
        return float(self.track.tool.lowest_points(states)[0].min())

    @cached_property
    def friction(self) -> Array:
        """What reverses with the motion in the air, beside bias and weight, world axes [N], [n, 3]."""
        track = self.track
        velocity = track.smooth[:, VELOCITY]
        speed = np.linalg.norm(velocity, axis=1)
        moving = speed >= track.rest_speed
        in_air = track.heights > self.air + _MIN_AIR_CLEARANCE_M
        way = np.zeros_like(velocity)
        way[moving] = velocity[moving] / speed[moving, None]
        if not way[in_air].any():
            return np.zeros_like(way)
        axes = track.cell_along.to_world
        weight = np.broadcast_to([[0.0], [0.0], [1.0]], (len(way), 3, 1))
        columns = np.concatenate([axes, weight, way[:, :, None]], axis=2)
        in_rows = columns[in_air].reshape(-1, 5)
        coefficients = np.linalg.lstsq(in_rows, track.forces[in_air].ravel(), rcond=None)[0]
        return np.asarray(coefficients[-1] * way)

    def by_delay(self, delay: float) -> Array:
        """What a delay of the load cell [s] changes in the forces: half the difference of either way [N], [n, 3]."""
        time = self.track.time
        early = interpolated(time + delay, time, self.track.forces)
        late = interpolated(time - delay, time, self.track.forces)
        return 0.5 * (early - late)


class Course(NamedTuple):
    """The model's `force` on the tool along a motion, world axes [N], shape [m, 3], at `time` [s], shape [m]."""

    time: Array
    force: Array


@lru_cache(maxsize=32)
def course_of_force(recording: Recorded, values: BedValues, moments: range) -> Course:
    """The model's force at successive moments and, with memory, at the corners of the path between them.

    The memory is empty at the first one. The delay of the `values` shifts nothing here.
    """
    plates = recording.track.tool.plates
    surface = values.surface
    if values.length == 0.0:
        # smooth velocities: without memory there is no force at rest, and an arm guided by hand stops in between
        states = recording.track.smooth[moments.start : moments.stop]
        model_wrenches = wrenches(plates, recording.law, states, surface_height=surface, threads=1)
        return Course(recording.track.time[moments.start : moments.stop], model_wrenches[:, FORCE])
    law = replace(recording.law, mobilization_length=values.length)
    first, last = recording.motion.rows[[moments.start, moments.stop - 1]]
    part = slice(first, last + 1)
    states = recording.motion.states[part]
    displacements = displacements_followed(states, reach=plates.reach, dead_band=0.0)
    model_wrenches = wrenches_in_time(
        plates, law, states, Memory(plates), displacements=displacements, surface_height=surface
    )
    return Course(recording.motion.time[part], model_wrenches[:, FORCE])

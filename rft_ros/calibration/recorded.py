"""A recording as the fits of the grains use it: its motion without noise, the measured force, and the model's force."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.smoothing import FineMotion, fine_motion, noise_of_poses, shaken_states, smoothed_states
from rft_ros.calibration.track import GAP, Indices, Track, moved_back
from rft_ros.estimator import LoadCell
from rft_ros.rft import FORCE, Law, Memory, wrenches, wrenches_in_time
from rft_ros.rft.frames import ANGULAR_VELOCITY, TWIST, VELOCITY

__all__ = ["BedValues", "Recorded", "recorded"]

Array = NDArray[np.float64]

_CLEAR = 0.001  # m: at this height above the surface the memory is empty, despite noise of the poses


class BedValues(NamedTuple):
    """Values that all fits use: surface height [m]; λ [m], 0 without memory; lost motion of the arm at a turn [m]."""

    surface: float
    length: float
    lost_motion: float

    @property
    def has_memory(self) -> bool:
        """Whether the model's force has memory."""
        return self.length > 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recorded:
    """One recording of n moments, for `law` at ζ = 1.

    `motion`: without the noise of the poses, at rest with velocity 0. `heights` of the tool's lowest point [m], shape
    [n]. `forces`: measured force of the grains, world axes [N], shape [n, 3].
    """

    track: Track
    law: Law
    motion: FineMotion
    heights: Array
    forces: Array

    def before_contact(self, row: int, surface: float) -> int:
        """The last row before `row` at which the tool is in the air or poses are missing; 0 if it never is."""
        apart = np.flatnonzero(np.diff(self.track.time[: row + 1]) > GAP) + 1
        in_air = np.flatnonzero(self.heights[: row + 1] > surface + _CLEAR)
        return int(max(apart.max(initial=0), in_air.max(initial=0)))

    def predicted(self, grains: BedValues, first: int, rows: Indices) -> Array:
        """Force on the tool at `rows`, with a memory that is empty at the row `first`, world axes [N], shape [m, 3]."""
        plates, last = self.track.tool.plates, int(rows[-1])
        if not grains.has_memory:
            # smooth velocities: without memory there is no force at rest, and an arm guided by hand stops in between
            states = self.track.smooth_states()[rows]
            return wrenches(plates, self.law, states, surface_height=grains.surface, threads=1)[:, FORCE]
        law = replace(self.law, mobilization_length=grains.length)
        _, states, at = self.motion
        span = slice(at[first], at[last] + 1)
        memory = Memory(plates, slack=grains.lost_motion)
        found = wrenches_in_time(plates, law, states[span], memory, surface_height=grains.surface)
        return np.asarray(found[at[rows] - span.start, FORCE])

    def noise(self) -> float:
        """Standard deviation of one coordinate of the tool's fastest point [m]; 0 where the poses have no noise."""
        track = self.track
        return noise_of_poses(track.time, track.states, gap=GAP, reach=track.tool.plates.reach)

    def earlier(self, delay: float) -> "Recorded":
        """The recording with its forces moved back in time by `delay` [s]."""
        return replace(self, forces=moved_back(self.track.time, self.forces, delay))

    def shaken(self, rng: np.random.Generator) -> "Recorded":
        """The recording with noise added, so that its deviation doubles; itself if the poses have no noise."""
        track = self.track
        states = shaken_states(track.time, track.states, gap=GAP, times=3.0**0.5, rng=rng)
        return self if states is None else replace(self, motion=_motion(track, states))


def _motion(track: Track, states: Array) -> FineMotion:
    """The motion without the noise of the poses, at rest with velocity 0."""
    smooth = smoothed_states(track.time, states, gap=GAP)
    speed, spin = (np.linalg.norm(smooth[:, part], axis=1) for part in (VELOCITY, ANGULAR_VELOCITY))
    smooth[speed + spin * track.tool.plates.reach < track.rest_speed, TWIST] = 0.0
    return fine_motion(track.time, smooth, gap=GAP)


def recorded(track: Track, cell: LoadCell, law: Law) -> Recorded:
    """Prepare a recording; `law`: without memory and inertia, at ζ = 1."""
    motion, forces = _motion(track, track.states), track.grain_forces(cell)
    return Recorded(track=track, law=law, motion=motion, heights=track.heights(), forces=forces)

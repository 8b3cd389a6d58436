"""A recording as arrays, and the parts of it that fits use: rest, penetrations and turns."""

import itertools
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d
from scipy.signal import find_peaks

from rft_ros.bags.estimates import ESTIMATE
from rft_ros.bags.options import ReplayOptions
from rft_ros.bags.playback import played, reasons
from rft_ros.bags.reading import bag_name, opened_recording
from rft_ros.calibration.cell_along import CellAlong
from rft_ros.calibration.smoothing import interpolated, segments
from rft_ros.diagnosis.fit import START_M
from rft_ros.errors import InputError
from rft_ros.estimator import Estimator
from rft_ros.parameters import Config, LoadCell, Values
from rft_ros.rft import AXES, FORCE, STATE, rotate_vectors, rotation_matrices
from rft_ros.rft.frames import (
    ANGULAR_VELOCITY,
    POSE,
    POSITION,
    QUATERNION,
    TWIST,
    VELOCITY,
    Placement,
)
from rft_ros.tool import Tool

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
"""Indices of moments of a `Track`, shape [n]."""

_DEEP_SURFACE_M = -1e9
"""With such a low surface the tool is in the air, and every pose has an estimate, also at rest."""

_THIN_STEP_M = 2e-4
"""That of the greatest speed recommended, 25 mm/s, at 125 Hz."""

_SMOOTHING_TIME_S = 0.1
"""Time over which velocities are averaged before they classify the motion."""

MIN_SAMPLES_COUNT = 20
"""Samples that a usable segment in motion has at least."""

_SETTLING_TIME_S = 0.1
"""Time that is left out after a stop and before a start: the arm vibrates and velocities lag."""

_MIN_REST_S = 0.25
"""Shortest time at rest, after settling."""

_MIN_RISE_M = 0.002
"""Shortest movement up that ends a stroke down."""

_MAX_TILT_RAD = np.deg2rad(3.0)
"""Greatest difference of orientations that count as one."""

_MAX_ASIDE_RATIO = np.tan(np.deg2rad(15.0))
_MAX_ROTATION_RATIO = 0.2
"""Greatest speeds in a straight motion down, relative to its speed down: to the side, and of a plate by rotation."""

_CHORD_M = 0.001
"""Path over which the directions before and after a turn are taken."""

_MAX_TURN_COSINE_RATIO = 0.5
"""Cosine of the least angle of a turn, 60°."""

_PATH_BEFORE_TURN_M = 0.003
_PATH_AFTER_TURN_M = 0.010
"""Path used before and after a turn: long enough for the force to settle, short enough to miss the next turn."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """One recording: n moments in time order.

    `begin`: header stamp of the first moment [ns]; `time`: since then [s], shape [n]. `states`: shape [n, 13].
    `readings` of the load `cell`, raw sign, sensor axes [N], [N m], shape [n, 6]. `rest_speed` [m/s]: the tool's.
    `mount`: the sensor frame in the tool frame, if fixed transforms link the two.
    """

    name: str
    begin: int
    time: Array
    states: Array
    readings: Array
    cell: LoadCell
    tool: Tool
    rest_speed: float
    damage: str | None = None
    mount: Placement | None = None

    def without_delay(self, late: float) -> "Track":
        """The recording with each reading moved to when the load cell felt it, `late` [s] earlier."""
        return replace(self, readings=interpolated(self.time + late, self.time, self.readings))

    @cached_property
    def rotations(self) -> Array:
        """Rotation of the tool frame into the world at each moment, shape [n, 3, 3], no unit."""
        return rotation_matrices(self.states[:, QUATERNION])

    @cached_property
    def heights(self) -> Array:
        """World z of the tool's lowest point [m], shape [n]."""
        return self.tool.lowest_points(self.states)[0]

    @cached_property
    def smooth(self) -> Array:
        """The states with velocities averaged over 0.1 s, shape [n, 13], units of `STATE`: noise averages out."""
        step = float(np.median(np.diff(self.time)))
        # stamps may lie closer than any driver's
        count = max(1, round(_SMOOTHING_TIME_S / max(step, 1e-4)))
        # uniform_filter1d would leave 1e-18 in place of 0, and walls along the motion would count as leading
        mean = correlate1d(
            self.states[:, TWIST], np.full(count, 1.0 / count), axis=0, mode="nearest"
        )
        return np.hstack([self.states[:, POSE], mean])

    def speeds(self, states: Array) -> tuple[Array, Array]:
        """Speed of the tool frame's origin, and the greatest speed of a plate by rotation [m/s], each shape [n]."""
        speed = np.linalg.norm(states[:, VELOCITY], axis=1)
        spin = np.linalg.norm(states[:, ANGULAR_VELOCITY], axis=1)
        return speed, spin * self.tool.plates.reach

    @cached_property
    def moving(self) -> NDArray[np.bool_]:
        """Whether the speed of a plate may reach `rest_speed`, shape [n], no unit."""
        return np.asarray(np.add(*self.speeds(self.smooth)) >= self.rest_speed)

    @cached_property
    def cell_along(self) -> CellAlong:
        """The load cell at each moment."""
        return CellAlong(self.cell, self.states)

    @property
    def compensated(self) -> Array:
        """Measured wrench on the tool, minus bias and weight, sensor axes [N], [N m], shape [n, 6]."""
        unbiased_wrenches = self.cell.sign * (self.readings - np.array(self.cell.bias))
        return np.asarray(unbiased_wrenches - self.cell_along.weight)

    @cached_property
    def forces(self) -> Array:
        """Measured force of the grains on the tool, world axes [N], shape [n, 3]."""
        return rotate_vectors(self.cell_along.to_world, self.compensated[:, FORCE])


def read_track(
    bag: Path, parameters: Config | Values, options: ReplayOptions | None = None
) -> Track:
    """Read a bag's poses, each with the twist and load-cell reading that the estimator uses for it; no tare.

    Raises InputError for a bag with fewer than two poses that have both.
    """
    # the error of a reduced tool would bias the fits of the grains; they know level ground only
    exact = {"tolerance": 0.0, "ground.cell": 0.0, "ground.file": ""}
    config = Config.of(parameters).changed(exact)
    model = config.model()
    with opened_recording(bag, config, options, needs_wrench=True) as recording:
        config_read = recording.config
        estimator = Estimator(_config_of_readings(config_read), model)
        rows = played(recording, estimator)
    usable = rows[(rows["reason"] == ESTIMATE) & ~np.isnan(rows["compensated"][:, 0])]
    # by stamp: a bag recorded in a loop steps back in time and repeats stamps
    stamps, stamp_rows = np.unique(usable["stamp"], return_index=True)
    if len(stamps) < 2:
        topics = ", ".join(recording.topics.values())
        usable_poses = f"{len(stamps)} poses with a velocity and a load-cell sample on {topics}"
        raise InputError(f"bag '{bag}' has {usable_poses}; {reasons(recording, estimator)}")
    unknown = np.isnan(usable["compensated"]).any(axis=0)
    if unknown.any():
        axes = ", ".join(itertools.compress(AXES, unknown.tolist()))
        raise InputError(
            f"bag '{bag}': the load cell gives no number on {axes}; a calibration needs all six axes"
        )
    return Track(
        name=bag_name(bag),
        begin=int(stamps[0]),
        time=(stamps - stamps[0]) * 1e-9,
        states=usable["state"][stamp_rows],
        readings=usable["compensated"][stamp_rows],
        cell=config_read.sensor,
        tool=model.tool,
        rest_speed=config_read.inputs.rest_speed,
        damage=recording.damage,
        mount=estimator.transforms.fixed(config_read.frames.tool, config_read.frames.sensor),
    )


def _config_of_readings(config: Config) -> Config:
    """A config with which every pose has an estimate, whose compensated wrench is the raw one in the cell's axes."""
    cell = config.sensor
    is_in_world = config.frames.sensor_source == "world"
    return replace(
        config,
        sensor=LoadCell(position=cell.position, quaternion=cell.quaternion, delay=cell.delay),
        frames=replace(config.frames, sensor_source="world" if is_in_world else "parameters"),
        inputs=replace(config.inputs, max_rate=0.0),
        surface_height=_DEEP_SURFACE_M,
    )


def thinned(track: Track, rate: float) -> Track:
    """The recording at moments that follow each other at most at a rate [Hz]; each keeps its own reading.

    Of a tool that moves fast all moments stay: they lie no more than `_THIN_STEP_M` apart.
    """
    step = float(np.median(np.diff(track.time)))
    ways = np.linalg.norm(np.diff(track.states[:, POSITION], axis=0), axis=1)
    fast = float(np.quantile(ways, 0.95))
    every = int(min(1.0 / (rate * max(step, 1e-6)), _THIN_STEP_M / max(fast, 1e-9)) + 1e-6)
    if every < 2:
        return track
    return replace(
        track,
        time=track.time[::every],
        states=track.states[::every],
        readings=track.readings[::every],
    )


class Turn(NamedTuple):
    """A change of direction by 60° or more in the grains, or a start from rest in a recording that begins there.

    `where`: the recording and the moment, in words. `first`: row from which the memory of the grains is known. `rows`:
    those in motion, from 3 mm of path before to 10 mm after it, or to the next turn. `path_after`: path to the last
    row [m].
    """

    where: str
    first: int
    rows: Indices
    path_after: float


def still_intervals(track: Track) -> list[Indices]:
    """Rows of each interval at rest, without the time to settle, as indices of `Track`'s rows, shape [n], no unit."""
    intervals = []
    for rows in segments(~track.moving, track.time):
        time = track.time[rows]
        settled_moments = (time >= time[0] + _SETTLING_TIME_S) & (
            time <= time[-1] - _SETTLING_TIME_S
        )
        if settled_moments.sum() >= 8 and np.ptp(time[settled_moments]) >= _MIN_REST_S:
            intervals.append(rows[settled_moments])
    return intervals


def down_strokes(track: Track, max_height: float = np.inf) -> list[Indices]:
    """Rows of straight motion down in each movement to a point below a height [m], in the orientation of their end.

    The end is that of the longest straight way down: the tool may go deeper afterwards, as it rolls or is dragged.
    """
    heights = track.heights
    rotations = track.rotations
    sinking = -track.smooth[:, STATE.index("vz")]
    aside = np.linalg.norm(track.smooth[:, VELOCITY][:, :2], axis=1)
    _, turning = track.speeds(track.smooth)
    straight = (
        (aside < _MAX_ASIDE_RATIO * sinking)
        & (turning < _MAX_ROTATION_RATIO * sinking)
        & (sinking >= track.rest_speed)
    )
    # padded, so that the ends may be bottoms, too; movements up of over 2 mm separate the bottoms
    bottoms, _ = find_peaks(np.pad(-heights, 1, constant_values=-np.inf), prominence=_MIN_RISE_M)
    strokes = []
    begin = 0
    for end in bottoms.tolist():  # a row after the bottom; the tool may rest there
        top = begin + int(np.argmax(heights[begin:end]))
        begin = top + int(np.argmin(heights[top:end]))
        rows = np.arange(top, begin + 1)
        ways = segments(straight & np.isin(np.arange(len(straight)), rows), track.time)
        if not ways:
            continue
        last = max(ways, key=lambda way: float(heights[way[0]] - heights[way[-1]]))[-1]
        traces = np.einsum("nij,ij->n", rotations[rows], rotations[last])
        same_attitude = traces > 1.0 + 2.0 * np.cos(_MAX_TILT_RAD)
        stroke = rows[same_attitude & straight[rows]]
        if len(stroke) >= MIN_SAMPLES_COUNT and heights[stroke].min() < max_height:
            strokes.append(stroke)
    return strokes


def turns_in_grains(track: Track, surface: float) -> list[Turn]:
    """Each turn or start followed by at least 2 mm of path in the grains, with at least 20 rows."""
    places = track.states[:, POSITION] + track.rotations @ track.tool.middle
    grain_turns = []
    for segment in segments(track.heights < surface, track.time):
        rows = segment[track.moving[segment]]
        if len(rows) < MIN_SAMPLES_COUNT:
            continue
        steps = np.linalg.norm(np.diff(places[rows], axis=0), axis=1)
        path = np.append(0.0, steps.cumsum())
        turns = _sharp_turns(path, places[rows])
        if segment[0] == 0 and track.moving[0]:
            # what the tool did before is not known
            turns = [turn for turn in turns if path[turn] > START_M]
        elif segment[0] == 0:
            turns.insert(0, 0)
        for turn, turn_before, turn_after in zip(
            turns, [0, *turns], [*turns[1:], -1], strict=False
        ):
            begin = max(path[turn_before], path[turn] - _PATH_BEFORE_TURN_M)
            end = min(path[turn_after], path[turn] + _PATH_AFTER_TURN_M)
            nearby_rows = rows[(path >= begin) & (path <= end)]
            path_after = float(end - path[turn])
            if path_after >= 2.0 * _CHORD_M and len(nearby_rows) >= MIN_SAMPLES_COUNT:
                where = f"{track.name}, {track.time[rows[turn]]:.1f} s after its beginning"
                first = max(int(segment[0]) - 1, 0)
                grain_turns.append(
                    Turn(where=where, first=first, rows=nearby_rows, path_after=path_after)
                )
    return grain_turns


def _sharp_turns(path: Array, places: Array) -> list[int]:
    """Index of the sharpest turn in each group of neighbouring places, shape [n, 3], with a turn by 60° or more."""
    inner = np.flatnonzero((path >= _CHORD_M) & (path <= path[-1] - _CHORD_M))
    way_before = places[inner] - interpolated(path[inner] - _CHORD_M, path, places)
    way_after = interpolated(path[inner] + _CHORD_M, path, places) - places[inner]
    lengths = np.linalg.norm(way_before, axis=1) * np.linalg.norm(way_after, axis=1)
    cosine = np.einsum("ni,ni->n", way_before, way_after) / np.maximum(lengths, 1e-12)
    sharp_indices = np.flatnonzero(cosine < _MAX_TURN_COSINE_RATIO)
    groups = np.split(sharp_indices, np.flatnonzero(np.diff(sharp_indices) > 1) + 1)
    return [int(inner[group[np.argmin(cosine[group])]]) for group in groups if len(group)]

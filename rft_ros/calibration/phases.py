"""The phases of a recording that determine values of the grains, and the least squares that fit them to each.

| phase | determines | free besides |
|---|---|---|
| first contact of a way straight down | surface height | scale and zero of the vertical force |
| turn: a reversal, another change of direction, a start from rest | λ | scale of the force |
| the same with the moments at rest around it (`delay.py`) | delay of the load cell | λ, scale, zero of each axis |
| whole way straight down | ζ (Treers et al. 2021, IV) | nothing |

A value is fitted to its own phase alone: real grains do not follow the model's growth with depth, nor its force on the
way up, and would else shift the other values. One fit of the whole force, with friction, that growth, and the ζ of each
kind of motion free, was tried. On 40 random recordings ζ was 2 % off (RMS, here 6 %), the surface 0.7 mm (0.4 mm) and
the delay 3 ms (2 ms); but in real sand the surface was up to 11 mm off, and delays were up to 80 ms. A stop does not
determine λ, as the force persists for any λ above 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from rft_ros.calibration.fitting import (
    Fit,
    Measurement,
    NotIdentifiable,
    SearchRange,
    fit_curve,
    fit_each,
    fit_linear,
)
from rft_ros.calibration.recorded import (
    MAX_DELAY_S,
    BedValues,
    Course,
    Recorded,
    course_of_force,
)
from rft_ros.calibration.smoothing import interpolated
from rft_ros.calibration.track import MIN_SAMPLES_COUNT, Indices, Track, Turn, down_strokes
from rft_ros.rft import FORCE, STATE, Law, wrenches
from rft_ros.rft.frames import TWIST
from rft_ros.tool import Tool

Array = NDArray[np.float64]

MIN_LENGTH_M = 1e-4
"""Least λ that is searched."""

_MAX_LENGTH_M = 0.1
"""Greatest λ that is searched."""

LOG_LENGTHS = np.linspace(np.log(MIN_LENGTH_M), np.log(_MAX_LENGTH_M), 16)
"""Logarithms of λ that are tried before the best one is refined. With fewer a delay was 6 ms off."""

MAX_MISFIT_RATIO = 0.15
"""Greatest accepted RMS residual, relative to the greatest force or its range."""

_VERTICAL = slice(2, 3)
_MAX_AIR_HEIGHT_M = 0.02
"""Height above the surface up to which the force in the air is used: further up the load cell may have drifted."""

_CONTACT_DEPTH_SHARE = 0.25
_MIN_CONTACT_DEPTH_M = 0.004
"""A first contact is fitted down to this share of the stroke's depth, and at least to this depth.

Over the whole depth, a pressure that grows faster than linearly would shift the surface down.
"""

_MAX_WINDOWS_COUNT = 6
"""Ranges of height that are fitted in turn, each about the surface that the one before gave."""

_TRIED_HEIGHTS_COUNT = 24
"""Surface heights that are tried before the best one is refined."""

_PRESS_DEPTHS_COUNT = 256
"""Depths at which the force of a first contact is computed."""

_MIN_RISE_RATIO = 6.0
"""Least rise of the force at a first contact, relative to the RMS residual."""

_MIN_AIR_SAMPLES_COUNT = 10
"""Least number of samples in the air before a first contact."""

_MAX_LENGTH_ERROR_RATIO = 0.75
"""Greatest accepted standard error of λ, relative to λ."""

_MIN_PENETRATION_M = 0.005
"""Least depth of a penetration: below it the force depends more on the surface height than on ζ."""

_MAX_ZETA_MISFIT_RATIO = 0.25
"""Greatest accepted misfit of ζ. Between a force that grows with depth and one that does not, it is greater."""


@lru_cache(maxsize=1)
def courses_over_length(
    recording: Recorded, surface: float, moments: range
) -> tuple[Array, CubicSpline]:
    """The times of a course [s], shape [m], and the model's force on the tool over log λ, shape [m, 3] [N]."""
    values = [BedValues(surface, log_length) for log_length in LOG_LENGTHS.tolist()]
    courses = [course_of_force(recording, value, moments) for value in values]
    return courses[0].time, CubicSpline(LOG_LENGTHS, [course.force for course in courses])


@lru_cache(maxsize=32)
def course_between_lengths(recording: Recorded, values: BedValues, moments: range) -> Course:
    """As `course_of_force`, from the courses over λ: a fit of the delay tries many of one turn."""
    times, force_over_length = courses_over_length(recording, values.surface, moments)
    return Course(times, np.asarray(force_over_length(values.log_length)))


class TooShortToResolve(NotIdentifiable):
    """The force follows the turn at once: λ is shorter than the recording can resolve."""


class Contact(NamedTuple):
    """A first contact: the number of its track, and the rows around it.

    `surface`: its height by a fit without memory [m]. `misfit`: RMS residual of that fit over the rise of the force.
    """

    number: int
    rows: Indices
    surface: float
    misfit: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """Some rows of a recording, at which the model's force is compared with the measured one.

    `moments`: those that the model follows, with an empty memory at the first one. `axes` of the force that are
    compared. `zeros`: each has a free zero. `between_lengths`: the model's force is interpolated between `LOG_LENGTHS`,
    where no more than the time of its changes counts.
    """

    recording: Recorded
    moments: range
    rows: Indices
    axes: slice
    zeros: bool = False
    between_lengths: bool = False

    @property
    def observed(self) -> Array:
        """The measured force, shape [n, axes] [N]."""
        return self.recording.track.forces[self.rows, self.axes]

    def modelled(self, values: BedValues, delays: Array) -> Array:
        """The model's force as read at k `delays` beside that of the track [s], shape [k, n, axes] [N]."""
        course_of = course_between_lengths if self.between_lengths else course_of_force
        course = course_of(self.recording, values._replace(delay=0.0), self.moments)
        force_times = (self.recording.track.time[self.rows] - delays[:, None]).ravel()
        force = interpolated(force_times, course.time, course.force[:, self.axes])
        return np.asarray(force.reshape(len(delays), len(self.rows), -1))

    def columns(self, values: BedValues) -> Array:
        """Columns of the linear coefficients, shape [n, axes, 1 or more]: the model's force, and the zeros."""
        force: Array = self.modelled(values, np.array([values.delay]))[0]
        if not self.zeros:
            return force[:, :, None]
        axes = force.shape[1]
        zeros = np.broadcast_to(np.eye(axes), (*force.shape, axes))
        return np.concatenate([force[:, :, None], zeros], axis=2)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Phase:
    """A phase as fitted. Coefficients of the `fit`: those values that are `free`, then scale and zeros.

    `values`: the fitted ones, and the others for which they were fitted.
    """

    part: Part
    free: tuple[str, ...]
    values: BedValues
    fit: Fit

    @property
    def recording(self) -> Recorded:
        """The recording that has the phase."""
        return self.part.recording

    @property
    def time(self) -> float:
        """When the phase begins, since the beginning of its recording [s]."""
        return float(self.recording.track.time[self.part.rows[0]])

    @property
    def where(self) -> str:
        """The recording and the time, in words."""
        return f"{self.recording.name}, {self.time:.1f} s after its beginning"

    @property
    def value(self) -> float:
        """The value that the phase determines: the first coefficient."""
        return float(self.fit.coefficients[0])

    @property
    def scale(self) -> float:
        """The measured force over the model's."""
        return float(self.fit.coefficients[len(self.free)])

    @property
    def misfit(self) -> float:
        """RMS residual over the greatest measured force."""
        peak = float(np.linalg.norm(self.part.observed, axis=1).max())
        return self.fit.rms / peak if peak > 0.0 else 0.0

    def measurement(self, shared_error: float = 0.0) -> Measurement:
        """The value, with its own error and one that it shares with others."""
        error = float(np.hypot(self.fit.error, shared_error))
        return Measurement(self.recording.name, self.value, error, self.time)

    def by_force(self, force: Array) -> float:
        """Change of the value by a force that is added to the measured one: shape [3], or [n, 3] of the recording."""
        added_force = np.broadcast_to(force, self.recording.track.forces.shape)
        part_force = added_force[self.part.rows, self.part.axes]
        return float(np.sum(self.fit.influence * part_force))

    def change(self, **changed_values: float) -> float:
        """Change of the value with other values; to first order, and by the force on the reduced tool."""
        part = replace(self.part, recording=self.recording.coarse)
        changed_columns = part.columns(self.values._replace(**changed_values))
        force = (changed_columns - part.columns(self.values)) @ self.fit.coefficients[
            len(self.free) :
        ]
        return -float(np.sum(self.fit.influence * force))

    def slope(self, name: str, step: float) -> float:
        """Derivative of the value by another one, over a step to either side; 0 by one that is free."""
        if name in self.free:
            return 0.0
        value = getattr(self.values, name)
        more = self.change(**{name: value + step})
        less = self.change(**{name: value - step})
        return (more - less) / (2.0 * step)

    def again(self, values: BedValues) -> "Phase":
        """Refits with other fixed values, starting from the present solution."""
        free_values = {name: getattr(self.values, name) for name in self.free}
        return fitted(self.part, values._replace(**free_values), self.free)


def fitted(
    part: Part, values: BedValues, free: tuple[str, ...], starts: Sequence[tuple[float, ...]] = ()
) -> Phase:
    """Fit the `free` values to a part, from the best of the `starts` on, or from `values`."""
    if not free:
        fit = fit_linear(part.columns(values), part.observed)
        return Phase(part=part, free=free, values=values, fit=fit)

    def columns_of(parameters: Array) -> Array:
        free_values = zip(free, parameters.tolist(), strict=True)
        return part.columns(values._replace(**dict(free_values)))

    heights = part.recording.track.heights[part.rows]
    parameters = {
        "surface": SearchRange(2e-5, float(heights.min()), float(heights.max())),
        "log_length": SearchRange(0.03, float(LOG_LENGTHS[0]), float(LOG_LENGTHS[-1])),
        "delay": SearchRange(5e-4, -MAX_DELAY_S, MAX_DELAY_S),
    }
    ranges = [parameters[name] for name in free]
    begins = starts or [tuple(getattr(values, name) for name in free)]
    fit = fit_curve(columns_of, ranges, part.observed, map(np.array, begins))
    free_values = zip(free, fit.coefficients.tolist(), strict=False)
    return Phase(part=part, free=free, values=values._replace(**dict(free_values)), fit=fit)


def _press_states(tool: Tool, state: Array, depths: Array) -> Array:
    """States of a press straight down in the attitude of a state, shape [13], into grains whose surface lies at z = 0.

    `depths` of the tool's lowest point [m], shape [m]; the states: shape [m, 13].
    """
    states = np.repeat(state[None], len(depths), axis=0)
    states[:, TWIST] = (0.0, 0.0, -1.0, 0.0, 0.0, 0.0)
    states[:, STATE.index("pz")] -= tool.lowest_points(state[None])[0] + depths
    return states


def _found_contact(number: int, track: Track, stroke: Indices, law: Law) -> Contact:
    """Find the contact of one stroke: fit the vertical force with a free scale and bias, without memory."""
    force = track.forces[stroke, _VERTICAL]
    height = track.heights[stroke]
    low = float(height.min())
    high = float(height.max())
    depths = np.linspace(0.0, high - low, _PRESS_DEPTHS_COUNT)
    press_states = _press_states(track.tool, track.states[stroke[-1]], depths)
    force_of_law = wrenches(track.tool.plates, law, press_states, threads=1)[:, 2]

    window = np.ones(len(stroke), dtype=np.bool_)
    lowest_surface = low
    highest_surface = high
    for _ in range(_MAX_WINDOWS_COUNT):
        z = height[window]

        def columns(parameters: Array, z: Array = z) -> Array:
            course = np.interp(parameters[0] - z, depths, force_of_law)
            return np.stack([course, np.ones_like(z)], axis=-1)[:, None]

        limits = SearchRange(
            1e-4 * (highest_surface - lowest_surface), lowest_surface, highest_surface
        )
        starts = np.linspace(lowest_surface, highest_surface, _TRIED_HEIGHTS_COUNT)[:, None]
        fit = fit_curve(columns, [limits], force[window], starts)
        surface = float(fit.coefficients[0])
        lowest_surface = max(
            low, surface - max(_CONTACT_DEPTH_SHARE * (surface - low), _MIN_CONTACT_DEPTH_M)
        )
        highest_surface = min(high, surface + 0.5 * _MAX_AIR_HEIGHT_M)
        next_window = (height > lowest_surface) & (height < surface + _MAX_AIR_HEIGHT_M)
        if next_window.sum() < MIN_SAMPLES_COUNT or (next_window == window).all():
            break
        window = next_window
    rise = float(fit.coefficients[1] * np.interp(surface - z.min(), depths, force_of_law))
    in_air = int((z > surface).sum())
    if in_air < _MIN_AIR_SAMPLES_COUNT or not rise > _MIN_RISE_RATIO * fit.rms:
        raise NotIdentifiable(
            f"{track.name}: no first contact between z = {high:.4f} and {low:.4f} m: {in_air} samples in the air, and a"
            f" vertical force that rises by {rise:.2f} N with {fit.rms:.2f} N of scatter; it needs"
            f" {_MIN_AIR_SAMPLES_COUNT} samples, and a rise of {_MIN_RISE_RATIO:g} times the scatter"
        )
    return Contact(number, stroke[window], surface, fit.rms / rise)


def find_contacts(tracks: Sequence[Track], law: Law) -> list[Contact]:
    """The first contacts, by fits without memory. Raises NotIdentifiable if there are none.

    A way down that begins below another contact of its recording, as after a short way up, is none.
    """
    strokes = (
        (k, track, stroke, law) for k, track in enumerate(tracks) for stroke in down_strokes(track)
    )
    contacts = fit_each(_found_contact, strokes, none="the tool never goes straight down")

    def begins_in_air(contact: Contact) -> bool:
        surfaces = [
            other_contact.surface
            for other_contact in contacts
            if other_contact.number == contact.number
        ]
        heights = tracks[contact.number].heights[contact.rows]
        return bool(heights.max() > max(surfaces))

    return list(filter(begins_in_air, contacts))


def first_contact(recording: Recorded, rows: Indices, values: BedValues) -> Phase:
    """The surface height [m] at the rows around a contact, from that of `values` on.

    The model with memory begins to resist at the first pose below the surface. The fitted height therefore depends on
    where the surface lies between two poses, and the error includes the standard deviation of that place.
    """
    moments = recording.moments_about(rows, first=int(rows[0]))
    part = Part(recording=recording, moments=moments, rows=rows, axes=_VERTICAL, zeros=True)
    return fitted(part, values, ("surface",))


def turn_for_length(recording: Recorded, turn: Turn, values: BedValues) -> Phase:
    """Log λ [log m] of a turn. Raises NotIdentifiable if the turn does not determine it.

    By the reduced tool: when a force changes hardly depends on the plates, and its size is free here.
    """
    moments = recording.moments_about(turn.rows, first=turn.first)
    part = Part(recording=recording.coarse, moments=moments, rows=turn.rows, axes=FORCE)
    if not part.observed.any():
        raise NotIdentifiable(f"{turn.where}: the load cell measures no force of the grains")
    starts = [(log_length,) for log_length in LOG_LENGTHS.tolist()]
    phase = fitted(part, values, ("log_length",), starts)
    length = phase.values.length
    if phase.value < LOG_LENGTHS[0] + 0.02 * np.ptp(LOG_LENGTHS):
        raise TooShortToResolve(
            f"{turn.where}: the force follows the turn at once; λ is below the resolution of {1e3 * length:.2g} mm"
        )
    error = phase.fit.error
    sure = error <= _MAX_LENGTH_ERROR_RATIO and length <= turn.path_after
    if not (sure and phase.misfit <= MAX_MISFIT_RATIO and phase.scale > 0.0):
        raise NotIdentifiable(
            f"{turn.where}: the fitted λ is {1e3 * length:.3g} mm ± {100 * error:.3g} %, the force {phase.scale:.2g}"
            f" times the model's, its RMS residual {100 * phase.misfit:.0f} % of the greatest; λ must be below the"
            f" {1e3 * turn.path_after:.3g} mm of path after the turn, its error at most"
            f" {100 * _MAX_LENGTH_ERROR_RATIO:.0f} %, the factor over 0, and the residual at most"
            f" {100 * MAX_MISFIT_RATIO:.0f} %"
        )
    return phase


def way_down(recording: Recorded, stroke: Indices, values: BedValues) -> Phase:
    """ζ of the part of a stroke below the surface. Raises NotIdentifiable if it is too shallow."""
    depths = values.surface - recording.track.heights[stroke]
    rows = stroke[depths > 0.0]
    depth = float(depths.max())
    begin = recording.track.time[stroke[0]]
    if len(rows) < MIN_SAMPLES_COUNT or depth < _MIN_PENETRATION_M:
        raise NotIdentifiable(
            f"{recording.name}, {begin:.1f} s after its beginning: a penetration of {1e3 * depth:.1f} mm in"
            f" {len(rows)} samples is too shallow; ζ"
            f" needs {1e3 * _MIN_PENETRATION_M:g} mm and {MIN_SAMPLES_COUNT} samples"
        )
    part = Part(recording=recording, moments=recording.moments, rows=rows, axes=_VERTICAL)
    return fitted(part, values, ())


def check_strength(way: Phase, shared_error: float) -> Phase:
    """The way down. Raises NotIdentifiable if ζ does not exceed its error, or if the model does not fit the force."""
    error = way.measurement(shared_error).error
    if not (way.value > error and way.misfit < _MAX_ZETA_MISFIT_RATIO):
        raise NotIdentifiable(
            f"{way.where}: the fitted ζ is {way.value:.3f} ± {error:.3f}, with a residual of"
            f" {100 * way.misfit:.0f} % of the peak; ζ must exceed its error, and the residual be below"
            f" {100 * _MAX_ZETA_MISFIT_RATIO:.0f} %: check sensor.quaternion, sensor.sign, surface_height, sensor.bias"
            " and mesh.file, as rft doctor does"
        )
    return way

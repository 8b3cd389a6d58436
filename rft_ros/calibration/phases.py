"""The phases of a recording that determine values of the grains, and the least squares that fit them to each.

| phase | determines | free besides |
|---|---|---|
| first contact of a way straight down | surface height | scale and zero of the vertical force |
| turn: a reversal, another change of direction, a start from rest | λ | scale of the force |
| the same with the moments at rest around it | delay of the load cell | λ, scale, zero of each axis |
| whole way straight down | ζ (Treers et al. 2021, IV) | nothing |

A value is fitted to its own phase alone: real grains do not follow the model's growth with depth, and would else shift
the other values. A stop does not determine λ, as the force persists for any λ above 0. A first contact does not
determine the delay, as another height of the surface gives the same force.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import (
    Fit,
    FittedValue,
    Measurement,
    NotIdentifiable,
    Parameter,
    fit_curve,
    fit_each,
    fit_linear,
    listed,
)
from rft_ros.calibration.recorded import BedValues, Recorded
from rft_ros.calibration.smoothing import GAP
from rft_ros.calibration.track import FEWEST, Indices, Track, Turn, down_strokes, turns_in_grains
from rft_ros.rft import FORCE, Law

__all__ = ["SHORTEST", "Contact", "Phase", "TooShortToResolve", "check_strength", "find_contacts"]
__all__ += ["first_contact", "fit_delay", "turn_for_length", "way_down"]

Array = NDArray[np.float64]

SHORTEST, _LONGEST = 1e-4, 0.1
"""Range of λ that is searched [m]."""

_LATEST = 0.25  # greatest delay that is searched, to both sides [s]
_LOG_LENGTHS = np.linspace(np.log(SHORTEST), np.log(_LONGEST), 16)
_DELAYS = np.linspace(-_LATEST, _LATEST, 26)
"""Values that are tried before the best ones are refined. From fewer λ a delay was 6 ms off, in a local minimum."""
_VERTICAL = slice(2, 3)

_AIR = 0.02  # height [m] up to which the force in the air is used: further up the load cell may have drifted
_SHALLOW, _AT_LEAST = 0.25, 0.004
"""First contact is fitted to this share of the stroke's depth, but at least this depth [m]. Over the whole depth, a
pressure that grows faster than linearly would shift the surface down."""

_HEIGHTS = 24  # heights that are tried before the best one is refined
_MOST_UNLIKE = 0.15  # greatest accepted RMS residual, relative to the greatest force or its range
_MOST_UNSURE = 0.75  # greatest accepted standard error of λ, relative to λ
_DELAY_UNSURE = 0.05  # greatest accepted standard error of the delay of one turn [s]
_DELAY_SEEN = 2.0  # standard errors: a smaller delay is not told from the given one
_DELAY_RESOLUTION = 1e-3  # s: delays of synthetic recordings are found up to 1.6 ms too early
_SHALLOWEST = 0.005  # a penetration's least depth [m]: below it the force depends more on the surface height than on ζ
_ALIKE = 0.9
"""Least correlation of the measured and the modelled force, over all components and times. With less, the RMS residual
of a force that grows with depth is over a quarter of its peak."""


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
class _Part:
    """Some rows of a recording, which the model follows from `first`, with an empty memory.

    `axes` of the force that are compared. `zeros`: each has a free zero. `approach`: rows before it, from the air on.
    `ahead`: rows that the model follows beyond the last.
    """

    recording: Recorded
    first: int
    rows: Indices
    axes: slice
    zeros: bool = False
    approach: Indices = field(default_factory=lambda: np.arange(0))
    ahead: int = 0

    def course(self, recording: Recorded, values: BedValues) -> Array:
        """The model's force from `first` on, world axes [N], shape [m, 3]."""
        return recording.predicted(values, self.first, int(self.rows[-1]) + self.ahead)

    def observed(self, recording: Recorded) -> Array:
        """The measured force, shape [n, axes] [N]."""
        return recording.track.forces[self.rows, self.axes]

    def columns(self, course: Array, values: BedValues) -> Array:
        """Columns of the linear coefficients, shape [n, axes, 1 or more], from the model's force."""
        if values.delay:
            time = self.recording.track.time
            at, span = time[self.rows] - values.delay, time[self.first : self.first + len(course)]
            force = np.column_stack([np.interp(at, span, axis) for axis in course.T])[:, self.axes]
        else:
            force = course[self.rows - self.first, self.axes]
        if not self.zeros:
            return force[:, :, None]
        zero = np.eye(force.shape[1])
        return np.concatenate([force[:, :, None], np.broadcast_to(zero, (len(force), *zero.shape))], axis=2)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Phase:
    """A phase as fitted. Coefficients of the `fit`: those values that are `free`, then scale and zeros.

    `values`: the fitted ones, and the others for which they were fitted.
    """

    part: _Part
    free: tuple[str, ...]
    values: BedValues
    fit: Fit

    @property
    def value(self) -> float:
        """The value that the phase determines: the first coefficient."""
        return float(self.fit.coefficients[0])

    @property
    def error(self) -> float:
        """Standard error of the value from the noise of the force."""
        return self.fit.error

    @property
    def scale(self) -> float:
        """The measured force over the model's."""
        return float(self.fit.coefficients[len(self.free)])

    def by_force(self, force: Array) -> float:
        """Change of the value by a force that is added to the measured one: shape [3], or [n, 3] of the recording."""
        added = np.broadcast_to(force, self.part.recording.track.forces.shape)[self.part.rows, self.part.axes]
        return float(np.sum(self.fit.influence * added))

    def measurement(self, shared_error: float = 0.0) -> Measurement:
        """The value, with its own error and one that it shares with others."""
        return Measurement(self.part.recording.track.name, self.value, float(np.hypot(self.error, shared_error)))

    @property
    def misfit(self) -> float:
        """RMS residual over the greatest measured force."""
        peak = float(np.linalg.norm(self.part.observed(self.part.recording), axis=1).max())
        return self.fit.rms / peak if peak > 0.0 else 0.0

    def change(self, recording: Recorded | None = None, **others: float) -> float:
        """Change of the value with another motion or force of the recording, and other values; to first order."""
        part, values = self.part, self.values._replace(**others)
        recording = recording or part.recording
        modelled = part.columns(part.course(recording, values), values) @ self.fit.coefficients[len(self.free) :]
        return float(np.sum(self.fit.influence * (part.observed(recording) - modelled - self.fit.residuals)))

    def again(self, values: BedValues) -> "Phase":
        """The phase fitted again with other values; those that are free from the fitted ones on."""
        own = {name: getattr(self.values, name) for name in self.free}
        return _fitted(self.part, values._replace(**own), self.free)


def _fitted(part: _Part, values: BedValues, free: tuple[str, ...], starts: Sequence[tuple[float, ...]] = ()) -> Phase:
    """Fit the `free` values to a part, from the best of the `starts` on, or from `values`."""
    recording, observed = part.recording, part.observed(part.recording)
    if not free:
        columns = part.columns(part.course(recording, values), values)
        return Phase(part=part, free=free, values=values, fit=fit_linear(columns, observed))

    @cache
    def course(values: BedValues) -> Array:
        return part.course(recording, values)

    def columns_of(parameters: Array) -> Array:
        at = values._replace(**dict(zip(free, parameters.tolist(), strict=True)))
        return part.columns(course(at._replace(delay=0.0)), at)

    heights = recording.track.heights[part.rows]
    parameters = {
        "surface": Parameter(2e-5, float(heights.min()), float(heights.max())),
        "log_length": Parameter(0.03, float(np.log(SHORTEST)), float(np.log(_LONGEST))),
        "delay": Parameter(5e-4, -_LATEST, _LATEST),
    }
    given = starts or [tuple(getattr(values, name) for name in free)]
    fit = fit_curve(columns_of, [parameters[name] for name in free], observed, map(np.array, given))
    found = values._replace(**dict(zip(free, fit.coefficients.tolist(), strict=False)))
    return Phase(part=part, free=free, values=found, fit=fit)


def _found_contact(number: int, track: Track, stroke: Indices, law: Law) -> Contact:
    """Find the contact of one stroke: fit the vertical force with a free scale and bias, without memory."""
    up, height = track.sensor_rotations[stroke][:, 2], track.heights[stroke]
    force = track.cell.sign * np.einsum("nj,nj->n", up, track.readings[stroke, FORCE])
    low, high = float(height.min()), float(height.max())
    depths = np.linspace(0.0, high - low, 256)
    predicted = track.forces_over_depth(law, int(stroke[-1]), depths)[:, 2]

    used, least, most = np.ones(len(stroke), dtype=np.bool_), low, high
    for _ in range(6):
        z = height[used]

        def columns(parameters: Array, z: Array = z) -> Array:
            force_of_law = np.interp(parameters[0] - z, depths, predicted)
            return np.stack([force_of_law, np.ones_like(z)], axis=-1)[:, None]

        starts, parameter = np.linspace(least, most, _HEIGHTS)[:, None], Parameter(1e-4 * (most - least), least, most)
        found = fit_curve(columns, [parameter], force[used][:, None], starts)
        surface = float(found.coefficients[0])
        least = surface - max(_SHALLOW * (surface - low), min(_AT_LEAST, surface - low))
        most = min(high, surface + 0.5 * _AIR)
        near = (height > least) & (height < surface + _AIR)
        if near.sum() < FEWEST or (near == used).all():
            break
        used = near
    rise = float(found.coefficients[1] * np.interp(surface - z.min(), depths, predicted))
    in_air = int((z > surface).sum())
    if in_air < 10 or surface >= high - 1e-6 or not rise > 6.0 * found.rms:
        raise NotIdentifiable(
            f"{track.name}: no first contact between z = {high:.4f} and {low:.4f} m: {in_air} samples in the air, and a"
            f" vertical force that rises by {rise:.2f} N with {found.rms:.2f} N of scatter; it needs 10 samples, and a"
            " rise of 6 times the scatter"
        )
    return Contact(number, stroke[used], surface, found.rms / rise)


def find_contacts(tracks: Sequence[Track], law: Law) -> list[Contact]:
    """The first contacts, by fits without memory. Raises NotIdentifiable if there are none."""
    strokes = ((k, track, stroke, law) for k, track in enumerate(tracks) for stroke in down_strokes(track))
    return fit_each(_found_contact, strokes, none="the tool never goes straight down")


def first_contact(recording: Recorded, rows: Indices, values: BedValues) -> Phase:
    """The surface height [m] at the rows around a contact, from that of `values` on.

    The model with memory begins to resist at the first pose below the surface. The fitted height therefore depends on
    where the surface lies between two poses, and the error includes the standard deviation of that place.
    """
    return _fitted(
        _Part(recording=recording, first=int(rows[0]), rows=rows, axes=_VERTICAL, zeros=True), values, ("surface",)
    )


def turn_for_length(recording: Recorded, turn: Turn, values: BedValues) -> Phase:
    """Log λ [log m] of a turn. Raises NotIdentifiable if the turn does not determine it."""
    where = f"{recording.track.name}, {recording.track.time[turn.at]:.1f} s after its beginning"
    part = _Part(recording=recording, first=turn.first, rows=turn.rows, axes=FORCE)
    if not part.observed(recording).any():
        raise NotIdentifiable(f"{where}: the load cell measures no force of the grains")
    found = _fitted(part, values, ("log_length",), [(float(x),) for x in _LOG_LENGTHS])
    length, misfit = float(np.exp(found.value)), found.misfit
    if found.value < np.log(SHORTEST) + 0.02 * np.log(_LONGEST / SHORTEST):
        raise TooShortToResolve(
            f"{where}: the force follows the turn at once; λ is below the resolution of {1e3 * length:.2g} mm"
        )
    if found.error > _MOST_UNSURE or length > turn.after or misfit > _MOST_UNLIKE or found.scale <= 0.0:
        raise NotIdentifiable(
            f"{where}: the fitted λ is {1e3 * length:.3g} mm ± {100 * found.error:.0f} %, the force {found.scale:.2g}"
            f" times the model's, its RMS residual {100 * misfit:.0f} % of the greatest; λ must be below the"
            f" {1e3 * turn.after:.3g} mm of path after the turn, its error at most {100 * _MOST_UNSURE:.0f} %, the"
            f" factor over 0, and the residual at most {100 * _MOST_UNLIKE:.0f} %"
        )
    return found


def _turn_for_delay(recording: Recorded, turn: Turn, surface: float) -> tuple[Measurement, float]:
    """The delay [s] at one turn, and its misfit. Raises NotIdentifiable if the turn does not determine it.

    When the force changes is the delay, how fast is λ: the turn is fitted over both.
    """
    time, ends = recording.track.time, recording.track.time[turn.rows[[0, -1]]]
    wide = np.flatnonzero((time >= ends[0] - _LATEST) & (time <= ends[1] + _LATEST))
    wide = wide[wide >= turn.first]
    rows = wide[(wide >= turn.rows[0]) & (wide <= turn.rows[-1])]
    # at rest the force may relax: only its first and last moments count
    after = np.clip(np.searchsorted(turn.rows, rows), 1, len(turn.rows) - 1)
    away = np.minimum(np.abs(time[rows] - time[turn.rows[after - 1]]), np.abs(time[turn.rows[after]] - time[rows]))
    rows = rows[away <= _LATEST]
    where = f"{recording.track.name}, {time[turn.at]:.1f} s after its beginning"
    if len(rows) < FEWEST or np.diff(time[wide]).max() > GAP:
        raise NotIdentifiable(f"{where}: {len(rows)} samples around a turn; the delay needs {FEWEST} without a gap")
    ahead = int(wide[-1] - rows[-1])
    part = _Part(recording=recording, first=turn.first, rows=rows, axes=FORCE, zeros=True, ahead=ahead)
    starts = [(float(delay), float(log_length)) for log_length in _LOG_LENGTHS for delay in _DELAYS]
    values = BedValues(surface, log_length=starts[0][1])
    found = _fitted(part, values, ("delay", "log_length"), starts)
    between_poses = float(np.median(np.diff(time[rows]))) / 12.0**0.5  # where the turn lies
    error = float(np.linalg.norm([found.error, _DELAY_RESOLUTION, between_poses, found.by_force(recording.friction)]))
    misfit = found.fit.rms / max(float(np.ptp(part.observed(recording), axis=0).max()), 1e-300)
    sure = error < _DELAY_UNSURE and abs(found.value) < _LATEST - error
    if not (sure and misfit < _MOST_UNLIKE and found.scale > 0.0):
        raise NotIdentifiable(
            f"{where}: the fitted delay is {found.value:.3f} ± {error:.2g} s with a residual of {100.0 * misfit:.0f} %"
            f" of the force's range; its error must be below {_DELAY_UNSURE:g} s, and the residual below"
            f" {100.0 * _MOST_UNLIKE:.0f} %"
        )
    return Measurement(recording.track.name, found.value, error), misfit


def fit_delay(recordings: Iterable[Recorded], surface: float, *, given: float) -> FittedValue:
    """`sensor.delay` [s]: the mean over the turns, weighted by their errors, on top of the one that is `given`.

    The given one is kept, with an error that includes the difference, if the two agree within their errors: readings
    that are moved between their samples lose the corners that tell λ.

    Raises NotIdentifiable if no turn determines it.
    """
    turns = ((one, turn, surface) for one in recordings for turn in turns_in_grains(one.track, surface))
    none = "the tool never turns in the grains, and no recording begins at rest there"
    found, misfits = zip(*fit_each(_turn_for_delay, turns, none=none), strict=True)
    values, weights = np.array([m.value for m in found]), np.array([m.error for m in found]) ** -2.0
    mean = float(weights @ values / weights.sum())
    scatter = float(weights @ (values - mean) ** 2) / max(len(values) - 1, 1)
    error = float(np.sqrt(max(1.0, scatter) / weights.sum()))
    if abs(mean) < _DELAY_SEEN * error:
        mean, error = 0.0, float(np.hypot(error, mean))
    source = listed(m._replace(value=given + m.value) for m in found)
    goodness = f"RMS up to {100.0 * max(misfits):.1f} % of the force's range around turns"
    return FittedValue("sensor.delay", (given + mean,), (error,), "s", goodness, source)


def way_down(recording: Recorded, stroke: Indices, values: BedValues) -> Phase:
    """ζ of the part of a stroke below the surface. Raises NotIdentifiable if it is too shallow."""
    depths = values.surface - recording.track.heights[stroke]
    count, depth = int((depths > 0.0).sum()), float(depths.max())
    if count < FEWEST or depth < _SHALLOWEST:
        raise NotIdentifiable(
            f"{recording.track.name}: a penetration of {1e3 * depth:.1f} mm in {count} samples is too shallow; ζ needs"
            f" {1e3 * _SHALLOWEST:g} mm and {FEWEST} samples"
        )
    rows = stroke[depths > 0.0]
    first = recording.before_contact(int(rows[0]), values.surface)
    part = _Part(recording=recording, first=first, rows=rows, axes=_VERTICAL, approach=stroke[depths <= 0.0])
    return _fitted(part, values, ())


def check_strength(way: Phase, shared_error: float) -> Phase:
    """The way down. Raises NotIdentifiable if ζ does not exceed its error, or if the forces do not correlate."""
    part, recording, error = way.part, way.part.recording, way.measurement(shared_error).error
    measured = recording.track.forces[part.rows]
    modelled = part.course(recording, way.values)[part.rows - part.first]
    scale = float(np.linalg.norm(measured) * np.linalg.norm(modelled))
    alike = float(np.sum(measured * modelled)) / scale if scale > 0.0 else 0.0
    if not (way.value > error and alike > _ALIKE):
        raise NotIdentifiable(
            f"{recording.track.name}: the fitted ζ is {way.value:.3f} ± {error:.3f}, and measured and modelled force"
            f" correlate by {alike:.2f}; ζ must exceed its error and the correlation {_ALIKE:g}: check"
            " sensor.quaternion, sensor.sign, surface_height, sensor.bias and mesh.file, as rft doctor does"
        )
    return way

"""Fits the surface, ζ and λ of the grains together. The error of each includes those of the others it depends on.

Each value has its own part of a recording: the surface the first contact, ζ the whole way down, λ the way after a turn.
Grains with memory resist fully only after a distance, so that the first contact that is found depends on λ, and λ and ζ
depend on the surface. The fits are therefore repeated with each other's results until those no longer change.

The errors. Each fit has its own standard error, from the noise and its correlation. Each fit is
repeated with the results of the others changed: these derivatives make a linear system for the errors of all. The
zero of the load cell is an error that all fits share. The effect of pose noise is found by adding more noise and
fitting again (after Cook and Stefanski, Journal of the American Statistical Association 89, 1994).
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.attitude import doubts_of_zeta
from rft_ros.calibration.contact import Contact, fit_contact
from rft_ros.calibration.fitting import (
    FitResults,
    FittedValue,
    Measurement,
    NotIdentifiable,
    fit_each,
    mean_of,
    scatter_of_mean,
)
from rft_ros.calibration.memory_length import SHORTEST, TooShortToResolve, TurnFit, fit_turn, length_by_place
from rft_ros.calibration.penetration import Penetration, deep_enough, difference, fit_penetration, spread_of
from rft_ros.calibration.recorded import BedValues, Recorded, recorded
from rft_ros.calibration.tool_weight import Sensor
from rft_ros.calibration.track import Indices, Track, Turn, down_strokes, turns_in_grains
from rft_ros.rft import Law

__all__ = ["fit_grains"]

Array = NDArray[np.float64]

_ROUNDS = 8  # of fits with each other's results
_SETTLED = 1e-6  # change of the surface [m] below which another round changes nothing
_HEIGHT_STEPS, _LENGTH_STEPS = (5e-5, 1e-3), (0.1, 0.5)
"""Least and greatest change of the surface height [m], and of log λ, for derivatives.

Smaller steps would find no change, since a fit moves from pose to pose.
"""

_GIVEN_SURFACE_ERROR = 0.002
"""Standard deviation [m] of the file's surface height, where a recording does not show the surface."""

_UNKNOWN_LENGTH = 0.7  # standard deviation of log λ where the recordings do not determine it: half to double

_LEFT_AT_CORNERS = 0.5  # share of the noise of a pose that is left at corners after smoothing
_SHAKEN = 2  # number of fits to poses with more noise

_NAME_OF_LENGTH = "medium.mobilization_length"

_SURFACE, _LENGTH, _ZETA = range(3)
"""Rows of the three values in the system of errors."""


class _Coupling(NamedTuple):
    """How errors reach the surface [m], log λ and ζ: from each other, from noise of the poses, from the cell's zero.

    `by`: the derivative of each value's fit by the others, shape [3, 3]. `by_poses`: standard errors, shape [3];
    `by_delay`: what the standard error of the delay changes, shape [3].
    `by_zero`: the derivative by an offset of the load cell [1/N], shape [3, 3]. `ways_down`: those it was computed for.
    """

    by: Array
    by_poses: Array
    by_delay: Array
    by_zero: Array
    ways_down: list[tuple[int, Indices]]


@dataclass(slots=True, eq=False)
class _Fits:
    """The parts of the recordings that identify each value, and the fits to them. No parts: the value is not fitted.

    Turns and ways down have the number of their recording.
    """

    recordings: list[Recorded]
    grains: BedValues
    contacts: list[Contact] = field(default_factory=list)
    turns: list[tuple[int, Turn]] = field(default_factory=list)
    ways_down: list[tuple[int, Indices]] = field(default_factory=list)
    found_contacts: list[Measurement] = field(default_factory=list)
    found_turns: list[TurnFit] = field(default_factory=list)
    coupling: _Coupling | None = None
    delay_error: float = 0.0  # [s]

    def surfaces(self, grains: BedValues) -> list[Measurement]:
        """The surface height at each contact."""
        return [fit_contact(self.recordings[contact.number], contact, grains) for contact in self.contacts]

    def lengths(self, surface: float) -> list[TurnFit]:
        """λ of each turn."""
        pairs = zip(self.turns, self.found_turns, strict=True)
        return [fit_turn(self.recordings[k], turn, surface, start=start) for (k, turn), start in pairs]

    def penetrations(self, grains: BedValues) -> list[Penetration]:
        """ζ of each way down."""
        return [fit_penetration(self.recordings[k], stroke, grains) for k, stroke in self.ways_down]

    def alternate_until_settled(self) -> None:
        """Fit the surface and λ in turns, each with the result of the other, until they no longer change."""
        for _ in range(_ROUNDS):
            before = self.grains
            if self.turns:
                self.found_turns = self.lengths(self.grains.surface)
                length = float(np.exp(np.mean([turn.logarithm for turn in self.found_turns])))
                self.grains = self.grains._replace(length=length)
            if self.contacts:
                self.found_contacts = self.surfaces(self.grains)
                surface = float(np.mean([contact.value for contact in self.found_contacts]))
                self.grains = self.grains._replace(surface=surface)
            changed = abs(self.grains.surface - before.surface)
            if changed < _SETTLED or not (self.turns and self.contacts):
                break

    def surface_for(self, log_length: float) -> float:
        """The surface height [m] as fitted with this log λ; 0 if it is not fitted."""
        grains = self.grains._replace(length=float(np.exp(log_length)))
        return float(np.mean([contact.value for contact in self.surfaces(grains)])) if self.contacts else 0.0

    def log_length_for(self, surface: float) -> float:
        """Log λ as fitted with this height of the surface [m]; 0 if it is not fitted."""
        return float(np.mean([turn.logarithm for turn in self.lengths(surface)])) if self.turns else 0.0

    def zeta_for(self, *, surface: float, log_length: float) -> float:
        """ζ as fitted with this height of the surface [m] and log λ; 0 if it is not fitted."""
        grains = self.grains._replace(surface=surface, length=float(np.exp(log_length)))
        return float(np.mean([way.zeta.value for way in self.penetrations(grains)])) if self.ways_down else 0.0

    def values(self, *, surface: float, log_length: float) -> Array:
        """Surface [m], log λ and ζ, each as fitted with these of the others; 0 for what is not fitted."""
        zeta = self.zeta_for(surface=surface, log_length=log_length)
        return np.array([self.surface_for(log_length), self.log_length_for(surface), zeta])

    def errors(self, own: Array, zero_error: float) -> Array:
        """Standard errors of the surface [m], log λ and ζ, from the own error of each; `zero_error` [N], one axis."""
        if self.coupling is None or len(self.coupling.ways_down) != len(self.ways_down):
            self.coupling = self._coupled(own)
        by, by_poses, by_delay, by_zero, _ = self.coupling
        sources = np.hstack([np.diag(own), np.diag(by_poses), by_delay[:, None], zero_error * by_zero])
        return np.asarray(np.linalg.norm(np.linalg.solve(np.eye(3) - by, sources), axis=1))

    def _coupled(self, own: Array) -> _Coupling:
        surface = self.grains.surface
        log_length = float(np.log(self.grains.length)) if self.grains.has_memory else -np.inf
        # steps as large as the error of what is changed: in a smaller one a fit may not move at all
        height_step, length_step = np.clip(own[_SURFACE], *_HEIGHT_STEPS), np.clip(own[_LENGTH], *_LENGTH_STEPS)
        by = np.zeros((3, 3))  # the derivative of each value's fit by the others
        by[_LENGTH, _SURFACE] = _slope(self.log_length_for, surface, height_step)
        by[_ZETA, _SURFACE] = _slope(lambda z: self.zeta_for(surface=z, log_length=log_length), surface, height_step)
        if self.grains.has_memory:
            by[_SURFACE, _LENGTH] = _slope(self.surface_for, log_length, length_step)
            by[_ZETA, _LENGTH] = _slope(
                lambda logarithm: self.zeta_for(surface=surface, log_length=logarithm), log_length, length_step
            )
        by_zero = np.zeros((3, 3))
        if self.turns:
            by_zero[_LENGTH] = np.mean([turn.by_zero for turn in self.found_turns], axis=0)
        if self.ways_down:
            by_zero[_ZETA] = np.mean([way.by_zero for way in self.penetrations(self.grains)], axis=0)
        return _Coupling(
            by,
            self._by_poses(surface, log_length),
            self._by_delay(surface, log_length),
            by_zero,
            self.ways_down,
        )

    def _by_delay(self, surface: float, log_length: float) -> Array:
        """The effect of a delay as large as its standard error, either way: half the difference of two fits."""
        if self.delay_error == 0.0:
            return np.zeros(3)
        early, late = (
            replace(self, recordings=[one.earlier(side * self.delay_error) for one in self.recordings])
            for side in (1.0, -1.0)
        )
        change = early.values(surface=surface, log_length=log_length) - late.values(
            surface=surface, log_length=log_length
        )
        return 0.5 * change

    def _by_poses(self, surface: float, log_length: float) -> Array:
        """The effect of pose noise on the fitted values: RMS change of fits to poses with twice the noise.

        For λ the effect of a shift of the turn is added, by the noise that smoothing leaves in a pose at a corner.
        """
        changes = []
        for seed in range(_SHAKEN):
            rng = np.random.default_rng(seed)
            shaken = replace(self, recordings=[recording.shaken(rng) for recording in self.recordings])
            if all(a is b for a, b in zip(shaken.recordings, self.recordings, strict=True)):
                return np.zeros(3)
            changes.append(shaken.values(surface=surface, log_length=log_length))
        at = self.values(surface=surface, log_length=log_length)
        found = np.sqrt(np.mean((np.array(changes) - at) ** 2, axis=0))
        if self.turns:
            shifts = [
                _LEFT_AT_CORNERS
                * self.recordings[k].noise()
                * length_by_place(self.recordings[k], turn, surface, found_turn)
                for (k, turn), found_turn in zip(self.turns, self.found_turns, strict=True)
            ]
            found[_LENGTH] = np.hypot(found[_LENGTH], np.linalg.norm(shifts) / len(shifts))
        return np.asarray(found)


def _slope(value: Callable[[float], float], at: float, step: float) -> float:
    """Derivative of a value by central differences."""
    return (value(at + step) - value(at - step)) / (2.0 * step)


def _error_of_mean(values: Sequence[float], errors: Sequence[float]) -> float:
    """Standard error of a mean: the greater of that from the values' scatter and that from their own errors."""
    return max(float(np.linalg.norm(errors)) / len(errors), scatter_of_mean(values))


def _fitted_turn(number: int, recording: Recorded, turn: Turn, surface: float) -> tuple[int, Turn, TurnFit]:
    found = fit_turn(recording, turn, surface)
    found.check(recording, turn)
    return number, turn, found


def _fit_turns(fits: _Fits) -> None:
    """Find the turns that determine λ. Raises NotIdentifiable if none does."""
    surface = fits.grains.surface
    turns = (
        (k, recording, turn, surface)
        for k, recording in enumerate(fits.recordings)
        for turn in turns_in_grains(recording.track, surface)
    )
    none = "the tool never turns in the grains, and no recording begins with it at rest there"
    found = fit_each(_fitted_turn, turns, none=none)
    fits.turns = [(number, turn) for number, turn, _ in found]
    fits.found_turns = [turn for _, _, turn in found]


def _fit_ways_down(fits: _Fits, own: Array, zero_error: float) -> list[Measurement]:
    """ζ of each penetration that determines it, with all of its errors. Raises NotIdentifiable if none does."""
    surface = fits.grains.surface
    strokes = (
        (k, recording, stroke, surface)
        for k, recording in enumerate(fits.recordings)
        for stroke in down_strokes(recording.track, below=surface)
    )
    fits.ways_down = fit_each(deep_enough, strokes, none="no vertical penetration in the grains")
    shared = fits.errors(own, zero_error)[_ZETA]

    def checked(way_down: tuple[int, Indices], found: Penetration) -> tuple[tuple[int, Indices], Measurement]:
        error = float(np.hypot(found.zeta.error, shared))
        found.check(error)
        return way_down, found.zeta._replace(error=error)

    pairs = zip(fits.ways_down, fits.penetrations(fits.grains), strict=True)
    good = fit_each(checked, pairs, none="")
    fits.ways_down = [way_down for way_down, _ in good]
    return [zeta for _, zeta in good]


def fit_grains(
    tracks: Sequence[Track],
    sensor: Sensor,
    law: Law,
    *,
    contacts: Sequence[Contact],
    given: BedValues,
    parts: Collection[str],
    delay_error: float = 0.0,
) -> FitResults:
    """Fit those of surface, zeta and mobilization that are in `parts`; the others are as `given`.

    `delay_error`: standard error [s] of the delay of the load cell, which all errors include.

    `law`: at ζ = 1, without memory and inertia. `contacts`: of these tracks; the surface is fitted to them.
    """
    result, own = FitResults(), np.zeros(3)
    fits = _Fits([recorded(track, sensor.cell, law) for track in tracks], given, delay_error=delay_error)
    if "surface" in parts and contacts:
        fits.contacts = list(contacts)
        fits.grains = given._replace(surface=float(np.mean([contact.surface for contact in contacts])))
    elif "surface" in parts:
        own[_SURFACE] = _GIVEN_SURFACE_ERROR
    if "mobilization" in parts:
        try:
            _fit_turns(fits)
        except TooShortToResolve as reason:
            fits.grains = fits.grains._replace(length=SHORTEST)
            result.not_identifiable[_NAME_OF_LENGTH] = str(reason)
        except NotIdentifiable as reason:
            own[_LENGTH] = _UNKNOWN_LENGTH
            result.not_identifiable[_NAME_OF_LENGTH] = str(reason)
    fits.alternate_until_settled()
    if fits.found_contacts:
        heights = fits.found_contacts
        own[_SURFACE] = _error_of_mean([m.value for m in heights], [m.error for m in heights])
    if fits.turns:
        turns = fits.found_turns
        own[_LENGTH] = _error_of_mean([turn.logarithm for turn in turns], [turn.error for turn in turns])
    strengths: list[Measurement] = []
    if "zeta" in parts:
        with result.or_reason("medium.zeta"):
            strengths = _fit_ways_down(fits, own, sensor.zero_error)
            found = fits.penetrations(fits.grains)
            own[_ZETA] = _error_of_mean([p.zeta.value for p in found], [p.zeta.error for p in found])

    surface_error, length_error, zeta_error = fits.errors(own, sensor.zero_error).tolist()
    if fits.found_contacts:
        with result.or_reason("surface_height"):
            result.fitted.append(_surface_of(fits, surface_error))
    if strengths:
        with result.or_reason("medium.zeta"):
            result.fitted.append(_zeta_of(fits, strengths, zeta_error))
        zeta = float(np.mean([strength.value for strength in strengths]))
        ways_down = [(fits.recordings[k], rows) for k, rows in fits.ways_down]
        result.warnings += doubts_of_zeta(zeta, ways_down, fits.grains.surface)
        with result.or_reason("medium.calibrated_depth"):
            result.fitted.append(_calibrated_depth(fits, surface_error))
    if fits.turns:
        with result.or_reason(_NAME_OF_LENGTH):
            result.fitted.append(_length_of(fits, length_error))
    return result


def _surface_of(fits: _Fits, error: float) -> FittedValue:
    """The height of the surface, as the mean over the contacts. Raises NotIdentifiable for one beyond the parameter."""
    heights = fits.found_contacts
    goodness = f"RMS up to {100 * max(m.misfit for m in heights):.1f} % of the force's rise"
    return mean_of("surface_height", heights, "m", goodness, error=error)


def _zeta_of(fits: _Fits, strengths: Sequence[Measurement], error: float) -> FittedValue:
    """ζ, as the mean over the ways down."""
    tools = [fits.recordings[k].track.tool for k, _ in fits.ways_down]
    words = difference(strengths, [float(np.ptp(tool.corners, axis=0).max()) for tool in tools])
    goodness = f"RMS up to {100 * max(m.misfit for m in strengths):.1f} % of the peak{words}"
    spread = spread_of(strengths, [str(tool.file) for tool in tools])
    return mean_of("medium.zeta", strengths, "", goodness, error=error, spread=spread)


def _calibrated_depth(fits: _Fits, surface_error: float) -> FittedValue:
    """The depth of the deepest way down."""
    deepest = max(fits.penetrations(fits.grains), key=lambda p: p.depth)
    source = f"deepest penetration, {deepest.zeta.bag}"
    return FittedValue("medium.calibrated_depth", (deepest.depth,), (surface_error,), "m", "", source)


def _length_of(fits: _Fits, relative_error: float) -> FittedValue:
    """λ, as the geometric mean over the turns. Raises NotIdentifiable for a λ that the parameter does not take."""
    length, turns = fits.grains.length, fits.found_turns
    goodness = f"RMS {100.0 * np.mean([t.misfit for t in turns]):.1f} % of the greatest force around turns"
    each = ", ".join(
        f"{fits.recordings[k].track.name} {np.exp(t.logarithm):.3g} ± {np.exp(t.logarithm) * t.error:.2g}"
        for (k, _), t in zip(fits.turns, turns, strict=True)
    )
    return FittedValue(_NAME_OF_LENGTH, (length,), (length * relative_error,), "m", goodness, each)

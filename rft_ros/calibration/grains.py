"""Fits the surface, ζ and λ of the grains together. The error of each includes those of the others it depends on.

Each value has its own phase of a recording: the surface the first contact, ζ the whole way down, λ the way after a
turn. Grains with memory resist fully only after a distance, so that the first contact that is found depends on λ, and
λ and ζ depend on the surface. The fits are therefore repeated with each other's results until those no longer change.

The errors. Each fit has its own standard error, from the noise and its correlation. To first order, each fit follows a
change of the model or of the data: of the others' values, of the load cell's zero, which all fits share, of the delay,
and of the poses, to which noise is added (after Cook and Stefanski, Journal of the American Statistical Association 89,
1994). The changes by the others' values make a linear system for the errors of all.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.attitude import doubts_of_zeta
from rft_ros.calibration.fitting import (
    FitResults,
    FittedValue,
    Measurement,
    NotIdentifiable,
    fit_each,
    mean_of,
    scatter_of_mean,
)
from rft_ros.calibration.phases import (
    SHORTEST,
    Contact,
    Phase,
    TooShortToResolve,
    check_strength,
    first_contact,
    turn_for_length,
    way_down,
)
from rft_ros.calibration.recorded import BedValues, Recorded
from rft_ros.calibration.track import down_strokes, turns_in_grains

__all__ = ["difference", "fit_grains", "spread_of"]

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

_SHAKEN = 2  # number of fits to poses with more noise
_NO_EFFECT = np.zeros(7 + _SHAKEN)
_NOTEWORTHY = 0.25  # greatest relative difference of ζ between penetrations without a note
_GROWS = 0.8  # least correlation of ζ with the size of the tool that is reported

_NAME_OF_LENGTH = "medium.mobilization_length"

_SURFACE, _LENGTH, _ZETA = range(3)
"""Rows of the three values in the system of errors."""


@dataclass(slots=True, eq=False)
class _Fits:
    """The phases of the recordings that determine each value. No phase: the value is not fitted."""

    values: BedValues
    contacts: list[Phase] = field(default_factory=list)
    turns: list[Phase] = field(default_factory=list)
    ways_down: list[Phase] = field(default_factory=list)

    def alternate_until_settled(self) -> None:
        """Fit the surface and λ in turns, each with the result of the other, until they no longer change."""
        for _ in range(_ROUNDS):
            before = self.values.surface
            if self.turns:
                self.turns = [turn.again(surface=before) for turn in self.turns]
                self.values = self.values._replace(log_length=_mean(self.turns))
            if self.contacts:
                self.contacts = [contact.again(log_length=self.values.log_length) for contact in self.contacts]
                self.values = self.values._replace(surface=_mean(self.contacts))
            if abs(self.values.surface - before) < _SETTLED or not (self.turns and self.contacts):
                break

    def errors(self, own: Array, effects: Callable[[Phase], Array]) -> Array:
        """Standard errors of the surface [m], log λ and ζ, from the own error of each; `effects`: see `_effects`."""
        groups = (self.contacts, self.turns, self.ways_down)
        found = np.array(
            [np.mean([effects(one) for one in group], axis=0) if group else _NO_EFFECT for group in groups]
        )
        by = np.pad(found[:, :2], ((0, 0), (0, 1)))  # the derivative of each value's fit by the others
        sources = np.hstack([np.diag(own), found[:, 2:]])
        return np.asarray(np.linalg.norm(np.linalg.solve(np.eye(3) - by, sources), axis=1))


def _effects(one: Phase, own: Array, *, zero_error: float, delay_error: float) -> Array:
    """What changes the value of a phase, shape [9].

    Derivatives by the surface height [1/m] and by log λ; changes by a standard error of the load cell's zero along each
    axis [N] and of its delay [s], and by friction; changes by noise of the poses, of which more is added `_SHAKEN`
    times.
    """
    recording, found = one.part.recording, _NO_EFFECT.copy()
    # steps as large as the error of what is changed: in a smaller one a fit may not move at all
    steps = np.clip(own[_SURFACE], *_HEIGHT_STEPS), np.clip(own[_LENGTH], *_LENGTH_STEPS)
    for k, (name, step) in enumerate(zip(("surface", "log_length"), steps, strict=True)):
        at = getattr(one.values, name)
        if name not in one.free and np.isfinite(at):
            found[k] = (one.change(**{name: at + step}) - one.change(**{name: at - step})) / (2.0 * step)
    found[2:5] = [zero_error * one.by_force(axis) for axis in np.eye(3)]
    found[5] = one.by_force(recording.by_delay(delay_error)) if delay_error > 0.0 else 0.0
    found[6] = one.by_force(recording.friction)
    for seed in range(_SHAKEN):
        shaken = recording.shaken(np.random.default_rng(seed))
        if shaken is recording:
            break
        found[7 + seed] = one.change(shaken) / _SHAKEN**0.5
    return found


def _mean(phases: Sequence[Phase]) -> float:
    return float(np.mean([phase.value for phase in phases]))


def _own_error(phases: Sequence[Phase]) -> float:
    """Standard error of a mean: the greater of that from the values' scatter and that from their own errors."""
    errors = [phase.error for phase in phases]
    return max(float(np.linalg.norm(errors)) / len(errors), scatter_of_mean([phase.value for phase in phases]))


def fit_grains(
    recordings: Sequence[Recorded],
    *,
    contacts: Sequence[Contact],
    given: BedValues,
    parts: Collection[str],
    zero_error: float,
    delay_error: float,
) -> FitResults:
    """Fit those of surface, zeta and mobilization that are in `parts`; the others are as `given`.

    `recordings`: without memory and inertia. `contacts`: of these; the surface is fitted to them. All errors include
    the standard errors of the load cell's zero [N], one axis, and of its delay [s].
    """
    result, own = FitResults(), np.zeros(3)
    fits = _Fits(given)
    if "surface" in parts and contacts:
        fits.values = given._replace(surface=float(np.mean([contact.surface for contact in contacts])))
    elif "surface" in parts:
        own[_SURFACE] = _GIVEN_SURFACE_ERROR
    if "mobilization" in parts:
        turns = (
            (recording, turn, fits.values)
            for recording in recordings
            for turn in turns_in_grains(recording.track, fits.values.surface)
        )
        none = "the tool never turns in the grains, and no recording begins with it at rest there"
        try:
            fits.turns = fit_each(turn_for_length, turns, none=none)
            fits.values = fits.values._replace(log_length=_mean(fits.turns))
        except TooShortToResolve as reason:
            fits.values = fits.values._replace(log_length=float(np.log(SHORTEST)))
            result.not_identifiable[_NAME_OF_LENGTH] = str(reason)
        except NotIdentifiable as reason:
            own[_LENGTH] = _UNKNOWN_LENGTH
            result.not_identifiable[_NAME_OF_LENGTH] = str(reason)
    if "surface" in parts:
        starts = (fits.values._replace(surface=contact.surface) for contact in contacts)
        fits.contacts = [
            first_contact(recordings[contact.number], contact.rows, start)
            for contact, start in zip(contacts, starts, strict=True)
        ]
        if fits.contacts:
            fits.values = fits.values._replace(surface=_mean(fits.contacts))
    fits.alternate_until_settled()
    for row, phases in ((_SURFACE, fits.contacts), (_LENGTH, fits.turns)):
        if phases:
            own[row] = _own_error(phases)

    @cache
    def effects(one: Phase) -> Array:
        return _effects(one, own, zero_error=zero_error, delay_error=delay_error)

    strengths: list[Measurement] = []
    if "zeta" in parts:
        strokes = (
            (recording, stroke, fits.values)
            for recording in recordings
            for stroke in down_strokes(recording.track, below=fits.values.surface)
        )
        with result.or_reason("medium.zeta"):
            fits.ways_down = fit_each(way_down, strokes, none="no vertical penetration in the grains")
            shared = float(fits.errors(own, effects)[_ZETA])
            good = fit_each(_strength, ((way, shared) for way in fits.ways_down), none="")
            fits.ways_down, strengths = ([*found] for found in zip(*good, strict=True))
            own[_ZETA] = _own_error(fits.ways_down)

    surface_error, length_error, zeta_error = fits.errors(own, effects).tolist()
    if fits.contacts:
        with result.or_reason("surface_height"):
            result.fitted.append(_surface_of(fits, contacts, surface_error))
    if strengths:
        with result.or_reason("medium.zeta"):
            result.fitted.append(_zeta_of(fits, strengths, zeta_error))
        ways_down = [(way.part.recording, np.append(way.part.approach, way.part.rows)) for way in fits.ways_down]
        result.warnings += doubts_of_zeta(_mean(fits.ways_down), ways_down, fits.values.surface)
        with result.or_reason("medium.calibrated_depth"):
            result.fitted.append(_calibrated_depth(fits, surface_error))
    if fits.turns:
        with result.or_reason(_NAME_OF_LENGTH):
            result.fitted.append(_length_of(fits, length_error))
    return result


def _strength(way: Phase, shared_error: float) -> tuple[Phase, Measurement]:
    """ζ of a way down with its own and the shared error. Raises NotIdentifiable if it is not to be believed."""
    error = float(np.hypot(way.error, shared_error))
    check_strength(way, error)
    peak = float(np.abs(way.part.observed(way.part.recording)).max())
    return way, way.measurement(error, way.misfit(peak))


def _surface_of(fits: _Fits, contacts: Sequence[Contact], error: float) -> FittedValue:
    """The height of the surface, as the mean over the contacts. Raises NotIdentifiable for one beyond the parameter."""
    pairs = zip(fits.contacts, contacts, strict=True)
    heights = [phase.measurement(phase.error, contact.misfit) for phase, contact in pairs]
    goodness = f"RMS up to {100 * max(m.misfit for m in heights):.1f} % of the force's rise"
    return mean_of("surface_height", heights, "m", goodness, error=error)


def _zeta_of(fits: _Fits, strengths: Sequence[Measurement], error: float) -> FittedValue:
    """ζ, as the mean over the ways down."""
    tools = [way.part.recording.track.tool for way in fits.ways_down]
    words = difference(strengths, [float(np.ptp(tool.corners, axis=0).max()) for tool in tools])
    goodness = f"RMS up to {100 * max(m.misfit for m in strengths):.1f} % of the peak{words}"
    spread = spread_of(strengths, [str(tool.file) for tool in tools])
    return mean_of("medium.zeta", strengths, "", goodness, error=error, spread=spread)


def _calibrated_depth(fits: _Fits, surface_error: float) -> FittedValue:
    """The depth of the deepest way down."""
    depths = [fits.values.surface - way.part.recording.heights[way.part.rows].min() for way in fits.ways_down]
    deepest = int(np.argmax(depths))
    source = f"deepest penetration, {fits.ways_down[deepest].part.where}"
    return FittedValue("medium.calibrated_depth", (float(depths[deepest]),), (surface_error,), "m", "", source)


def _length_of(fits: _Fits, relative_error: float) -> FittedValue:
    """λ, as the geometric mean over the turns. Raises NotIdentifiable for a λ that the parameter does not take."""
    length, lengths, misfits = fits.values.length, [], []
    for turn in fits.turns:
        of_turn = float(np.exp(turn.value))
        lengths.append(f"{turn.part.recording.track.name} {of_turn:.3g} ± {of_turn * turn.error:.2g}")
        misfits.append(turn.misfit(float(np.linalg.norm(turn.part.observed(turn.part.recording), axis=1).max())))
    goodness = f"RMS {100.0 * np.mean(misfits):.1f} % of the greatest force around turns"
    return FittedValue(_NAME_OF_LENGTH, (length,), (length * relative_error,), "m", goodness, ", ".join(lengths))


def spread_of(found: Sequence[Measurement], tools: Sequence[str]) -> float:
    """Relative scatter of ζ between the tools; if there is only one tool, between its measurements.

    `tools`: the name of the tool of each measurement.
    """
    values = np.array([measurement.value for measurement in found])
    of_tools = [values[[name == tool for name in tools]].mean() for tool in dict.fromkeys(tools)]
    if len(of_tools) == 1:
        return float(np.std(values, ddof=1) / values.mean()) if len(values) > 1 else 0.0
    return float(max(abs(values.mean() / zeta - 1.0) for zeta in of_tools))


def difference(found: Sequence[Measurement], sizes: Sequence[float] = ()) -> str:
    """Words on a ζ that differs between penetrations; none where it does not. `sizes` of their tools [m]."""
    low = min(found, key=lambda measurement: measurement.value)
    high = max(found, key=lambda measurement: measurement.value)
    apart = high.value - low.value
    grows = ""
    if len(sizes) == len(found) and np.ptp(sizes) > 0.1 * max(sizes):
        values = np.array([measurement.value for measurement in found])
        if np.corrcoef(sizes, values)[0, 1] > _GROWS:
            grows = f"; ζ grows with the tool's size, {1e3 * min(sizes):.0f} to {1e3 * max(sizes):.0f} mm wide"
    # That ζ follows the size is evidence of its own, so that fewer standard errors are enough.
    certain = (2.0 if grows else 3.0) * float(np.hypot(low.error, high.error))
    if apart <= max(_NOTEWORTHY * low.value, certain):
        return ""
    percent = f"{100 * apart / low.value:.0f} %"
    return f"; ζ differs by {percent}: tools of different size, and grains that differ, need a ζ of their own{grows}"

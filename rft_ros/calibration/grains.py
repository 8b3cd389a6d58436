"""Fits the surface, ζ and λ of the grains together. The error of each includes those of the others it depends on.

Each value has its own phase of a recording: the surface the first contact, ζ the whole way down, λ the way after a
turn. Grains with memory resist fully only after a distance, so that the first contact that is found depends on λ, and
λ and ζ depend on the surface. The fits are therefore repeated with each other's results until those no longer change.

The errors. Each fit has its own standard error, from the noise and its correlation. To first order, each fit follows a
change of the model or of the data: of the others' values, of the load cell's zero, which all fits share, of the delay,
and of the poses, to which noise is added (after Cook and Stefanski, Journal of the American Statistical Association 89,
1994). The changes by the others' values make a linear system for the errors of all. A parametric bootstrap (the
fitted curves with noise of first order like the residuals, fitted again twenty times) covers as well on synthetic
recordings. In real sand, where the misfit is no such noise, its error of λ is a thirtieth of this one, while two trials
differ by 17 %; and calibration would take five to seven times as long.
"""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import FitResults, Measurement, NotIdentifiable, fit_each, listed
from rft_ros.calibration.motions import motion_fit, motion_phases, sentence_on
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
from rft_ros.calibration.recorded import SHAKEN, BedValues, Recorded
from rft_ros.calibration.track import down_strokes, turns_in_grains

Array = NDArray[np.float64]

GIVEN_SURFACE_ERROR = 0.002
"""Standard deviation [m] of the file's surface height, where a recording does not show the surface."""

_ROUNDS = 8  # of fits with each other's results
_SETTLED = 1e-6  # change of the surface [m] below which another round changes nothing
# standard deviation of log λ where the recordings do not determine it: half to double
_UNKNOWN_LENGTH = 0.7
_NOTEWORTHY = 0.25  # greatest relative difference of ζ between penetrations without a note
_GROWS = 0.8  # least correlation of ζ with the size of the tool that is reported

_STEPS = {"surface": (5e-5, 1e-3), "log_length": (0.1, 0.5)}
"""Least and greatest change of the surface height [m], and of log λ, for derivatives.

Smaller steps would find no change, since a fit moves from pose to pose.
"""


class Given(NamedTuple):
    """Values that the fits of the grains begin with, and standard errors of what they take as given; 0 for exact.

    Errors of the surface height [m], of the load cell's zero along each axis [N], and of its delay [s].
    """

    values: BedValues
    surface_error: float
    zero_error: float
    delay_error: float


class _Fits(NamedTuple):
    """First contacts and turns, and the values that both give: those that none determines are given."""

    contacts: list[Phase]
    turns: list[Phase]
    values: BedValues


def fit_grains(
    result: FitResults,
    recordings: Sequence[Recorded],
    *,
    contacts: Sequence[Contact],
    given: Given,
    parts: Collection[str],
) -> None:
    """Fit those of surface, zeta and mobilization that are in `parts`, into `result`.

    `recordings`: without memory and inertia. `contacts`: those of them to which the surface is fitted.
    """
    begin = given.values
    if contacts:
        begin = begin._replace(surface=float(np.mean([contact.surface for contact in contacts])))
    turns: list[Phase] = []
    # of the surface [m], log λ and ζ, without each other's
    own_errors = np.array([given.surface_error, 0.0, 0.0])
    if "mobilization" in parts:
        try:
            turns = _fitted_turns(recordings, begin)
            begin = begin._replace(log_length=_mean(turns))
        except NotIdentifiable as reason:
            result.not_identifiable["medium.mobilization_length"] = str(reason)
            if isinstance(reason, TooShortToResolve):
                begin = begin._replace(log_length=float(np.log(SHORTEST)))
            else:
                own_errors[1] = _UNKNOWN_LENGTH
    at_contacts = [
        first_contact(
            recordings[contact.number], contact.rows, begin._replace(surface=contact.surface)
        )
        for contact in contacts
    ]
    fits = _settled(_Fits(at_contacts, turns, begin))
    if contacts:
        own_errors[0] = _own_error(fits.contacts)
    if turns:
        own_errors[1] = _own_error(fits.turns)
    ways_down: list[Phase] = []
    if "zeta" in parts:
        with result.or_reason("medium.zeta"):
            ways_down = _fitted_ways_down(recordings, fits.values)
    errors = _errors(fits, ways_down, own_errors, given)
    surface_error, length_error, zeta_error = errors.tolist()
    if contacts:
        _add_surface(result, fits, contacts, surface_error)
    if ways_down:
        with result.or_reason("medium.zeta"):
            kept = fit_each(check_strength, ((way, zeta_error) for way in ways_down), none="")
            _add_zeta(result, kept, shared_error=zeta_error, surface_error=surface_error)
            _add_motions(
                result, recordings, fits.values, zeta=_mean(kept), errors=errors, given=given
            )
    if turns:
        _add_length(result, fits, length_error)


def _fitted_turns(recordings: Sequence[Recorded], values: BedValues) -> list[Phase]:
    turns = (
        (one, turn, values)
        for one in recordings
        for turn in turns_in_grains(one.track, values.surface)
    )
    none = "the tool never turns in the grains, and no recording begins with it at rest there"
    return fit_each(turn_for_length, turns, none=none)


def _fitted_ways_down(recordings: Sequence[Recorded], values: BedValues) -> list[Phase]:
    ways = (
        (one, way, values)
        for one in recordings
        for way in down_strokes(one.track, below=values.surface)
    )
    return fit_each(way_down, ways, none="no vertical penetration in the grains")


def _mean(phases: Sequence[Phase]) -> float:
    return float(np.mean([phase.value for phase in phases]))


def _settled(fits: _Fits) -> _Fits:
    """Fit λ and the surface in turns, each with the result of the other, until they no longer change."""
    for _ in range(_ROUNDS):
        surface_before = fits.values.surface
        fits = _again(fits)
        if abs(fits.values.surface - surface_before) < _SETTLED:
            break
    return fits


def _again(fits: _Fits) -> _Fits:
    """The turns fitted with the surface of the contacts, and then these with the λ of the turns."""
    values = fits.values
    turns = [turn.again(values) for turn in fits.turns]
    if turns:
        values = values._replace(log_length=_mean(turns))
    contacts = [contact.again(values) for contact in fits.contacts]
    if contacts:
        values = values._replace(surface=_mean(contacts))
    return _Fits(contacts, turns, values)


def _own_error(phases: Sequence[Phase]) -> float:
    """Standard error of a mean: the greater of that from the values' scatter and that from their own errors."""
    count = len(phases)
    from_errors = float(np.linalg.norm([phase.error for phase in phases])) / count
    if count == 1:
        return from_errors
    scatter = float(np.std([phase.value for phase in phases], ddof=1))
    return max(from_errors, scatter / float(np.sqrt(count)))


def _errors(fits: _Fits, ways_down: Sequence[Phase], own_errors: Array, given: Given) -> Array:
    """Standard errors of the surface [m], log λ and ζ, shape [3]: to first order each follows the others.

    `own_errors`: those without the others' errors. That of ζ is what all ways down share.
    """
    effects = np.zeros((3, 7 + SHAKEN))
    for row, phases in enumerate((fits.contacts, fits.turns, ways_down)):
        if phases:
            effects[row] = np.mean(
                [_effects(phase, own_errors, given) for phase in phases], axis=0
            )
    by_others = np.zeros((3, 3))
    by_others[:, :2] = effects[:, :2]
    sources = np.hstack([np.diag(own_errors), effects[:, 2:]])
    return np.asarray(np.linalg.norm(np.linalg.solve(np.eye(3) - by_others, sources), axis=1))


def _effects(phase: Phase, own_errors: Array, given: Given) -> Array:
    """What changes the value of a phase, shape [7 + SHAKEN].

    Derivatives by the surface height [1/m] and by log λ; changes by a standard error of the load cell's zero along each
    axis [N] and of its delay [s], and by friction; changes by noise of the poses, of which more is added `SHAKEN`
    times.
    """
    recording = phase.recording
    slopes = []
    for (name, (least, most)), own_error in zip(_STEPS.items(), own_errors[:2], strict=True):
        at = getattr(phase.values, name)
        if name in phase.free or not np.isfinite(at):
            slopes.append(0.0)
            continue
        # a step as large as the error of what is changed: in a smaller one a fit may not move at all
        step = float(np.clip(own_error, least, most))
        slopes.append(
            (phase.change(**{name: at + step}) - phase.change(**{name: at - step})) / (2.0 * step)
        )
    by_zero = [given.zero_error * phase.by_force(axis) for axis in np.eye(3)]
    by_delay = phase.by_force(recording.by_delay(given.delay_error))
    by_friction = phase.by_force(recording.friction)
    by_noise = np.zeros(SHAKEN)
    for k, shaken in enumerate(recording.shaken):
        by_noise[k] = phase.change(shaken) / SHAKEN**0.5
    return np.array([*slopes, *by_zero, by_delay, by_friction, *by_noise])


def _add_surface(
    result: FitResults, fits: _Fits, contacts: Sequence[Contact], error: float
) -> None:
    result.add(
        "surface_height",
        fits.values.surface,
        error,
        unit="m",
        goodness=f"RMS up to {100 * max(contact.misfit for contact in contacts):.1f} % of the force's rise",
        source=listed(contact.measurement() for contact in fits.contacts),
    )


def _add_length(result: FitResults, fits: _Fits, log_error: float) -> None:
    misfit = np.mean([turn.misfit for turn in fits.turns])
    lengths = [
        Measurement(turn.recording.track.name, turn.values.length, turn.values.length * turn.error)
        for turn in fits.turns
    ]
    result.add(
        "medium.mobilization_length",
        fits.values.length,
        fits.values.length * log_error,
        unit="m",
        goodness=f"RMS {100.0 * misfit:.1f} % of the greatest force around turns",
        source=listed(lengths),
    )


def _add_zeta(
    result: FitResults, ways_down: Sequence[Phase], *, shared_error: float, surface_error: float
) -> None:
    """Add ζ, as the mean over the ways down, what makes it doubtful, and the depth of the deepest way."""
    zeta = _mean(ways_down)
    surface = ways_down[0].values.surface
    strengths = [way.measurement(shared_error) for way in ways_down]
    tools = [way.recording.track.tool for way in ways_down]
    words = difference(strengths, [tool.size for tool in tools])
    result.add(
        "medium.zeta",
        zeta,
        float(np.hypot(_own_error(ways_down), shared_error)),
        unit="",
        goodness=f"RMS up to {100 * max(way.misfit for way in ways_down):.1f} % of the peak{words}",
        source=listed(strengths),
        spread=spread_of(strengths, [str(tool.file) for tool in tools]),
    )
    deepest = min(ways_down, key=_lowest)
    result.add(
        "medium.calibrated_depth",
        surface - _lowest(deepest),
        surface_error,
        unit="m",
        goodness="",
        source=f"deepest penetration, {deepest.recording.track.name}",
    )


def _add_motions(
    result: FitResults,
    recordings: Sequence[Recorded],
    values: BedValues,
    *,
    zeta: float,
    errors: Array,
    given: Given,
) -> None:
    """Add what each kind of motion tells. `errors`: of the surface [m], log λ and the ζ of the ways down."""
    for kind, phases in motion_phases(recordings, values).items():
        effects = np.mean([_effects(phase, errors, given) for phase in phases], axis=0)
        by_causes = np.concatenate([effects[:2] * errors[:2], effects[2:]])
        fit = motion_fit(
            kind, phases, written_zeta=zeta, own_error=_own_error(phases), by_causes=by_causes
        )
        result.motions.append(fit)
    sentence = sentence_on(result.motions)
    if sentence:
        result.warnings.append(sentence)


def _lowest(way: Phase) -> float:
    heights = way.recording.track.heights[way.part.rows]
    return float(heights.min())


def spread_of(found: Sequence[Measurement], tools: Sequence[str]) -> float:
    """Relative scatter of ζ between the tools; if there is only one tool, between its measurements.

    `tools`: the name of the tool of each measurement.
    """
    values = np.array([measurement.value for measurement in found])
    of_tools = [values[[name == tool for name in tools]].mean() for tool in dict.fromkeys(tools)]
    if len(values) == 1:
        return 0.0
    if len(of_tools) == 1:
        return float(np.std(values, ddof=1) / values.mean())
    return float(max(abs(values.mean() / zeta - 1.0) for zeta in of_tools))


def difference(found: Sequence[Measurement], sizes: Sequence[float] = ()) -> str:
    """Words on a ζ that differs between penetrations; none where it does not. `sizes` of their tools [m]."""
    low = min(found, key=lambda measurement: measurement.value)
    high = max(found, key=lambda measurement: measurement.value)
    apart = high.value - low.value
    certain = 3.0 * float(np.hypot(low.error, high.error))
    grows = ""
    if len(sizes) == len(found) and np.ptp(sizes) > 0.1 * max(sizes):
        zetas = [measurement.value for measurement in found]
        if np.corrcoef(sizes, zetas)[0, 1] > _GROWS:
            grows = f"; ζ grows with the tool's size, {1e3 * min(sizes):.0f} to {1e3 * max(sizes):.0f} mm wide"
            certain *= 2.0 / 3.0  # that ζ follows the size is evidence of its own
    if apart <= max(_NOTEWORTHY * low.value, certain):
        return ""
    percent = f"{100 * apart / low.value:.0f} %"
    return f"; ζ differs by {percent}: tools of different size, and grains that differ, need a ζ of their own{grows}"

"""Fits the surface, ζ and λ of the grains together. The error of each includes those of the others it depends on.

Each value has its own phase of a recording: the surface the first contact, ζ the whole way down, λ the way after a
turn. Grains with memory resist fully only after a distance, so that the first contact that is found depends on λ, and
λ and ζ depend on the surface. The fits are therefore repeated with each other's results until those no longer change.

The errors. Each fit has its own standard error, from the noise and its correlation. To first order, each fit follows a
change of the model or of the data: of the others' values, of the delay of the load cell, which all fits share, and of
friction. The changes by the others' values make a linear system for the errors of all. A parametric bootstrap (the
fitted curves with noise of first order like the residuals, fitted again twenty times) covers as well on synthetic
recordings. In real sand, where the misfit is no such noise, its error of λ is a thirtieth of this one, while two trials
differ by 17 %; and calibration would take five to seven times as long.
"""

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import (
    FitResults,
    Measurement,
    NotIdentifiable,
    fit_each,
    listed,
)
from rft_ros.calibration.motions import motion_fit, motion_phases, sentences_on
from rft_ros.calibration.phases import (
    MIN_LENGTH_M,
    Contact,
    Phase,
    TooShortToResolve,
    check_strength,
    first_contact,
    turn_for_length,
    way_down,
)
from rft_ros.calibration.recorded import BedValues, Recorded
from rft_ros.calibration.track import Track, down_strokes, turns_in_grains

Array = NDArray[np.float64]

FILE_SURFACE_ERROR_M = 0.002
"""Standard deviation of the file's surface height, where a recording does not show the surface."""

MAX_SURFACE_ERROR_M = 0.01
"""An error of ζ by such a surface is of the size of ζ in a usual depth of some centimetres."""

_MAX_ROUNDS_COUNT = 8
"""Fits of the surface and of λ in turn, each with the result of the other."""

_MAX_SURFACE_CHANGE_M = 1e-6
"""Change of the surface below which another round changes nothing."""

_UNKNOWN_LENGTH_ERROR_RATIO = 0.7
"""Standard deviation of log λ where the recordings do not determine it: half to double."""

_SHARED_CAUSES_COUNT = 2
"""Causes of errors that all fits share."""

_MAX_ZETA_DIFFERENCE_RATIO = 0.25
"""Greatest relative difference of ζ between penetrations without a note."""

_MIN_SIZE_CORRELATION_FACTOR = 0.8
"""Least correlation of ζ with the size of the tool that is reported."""

_STEPS = {"surface": (5e-5, 1e-3), "log_length": (0.1, 0.5)}
"""Least and greatest change of the surface height [m], and of log λ, for derivatives.

Smaller steps would find no change, since a fit moves from pose to pose.
"""


class Given(NamedTuple):
    """Values that the fits of the grains begin with, and standard errors of what they take as given; 0 for exact.

    Errors of the surface height [m], and of the delay of the load cell [s].
    """

    values: BedValues
    surface_error: float
    delay_error: float


@dataclass(frozen=True, kw_only=True, eq=False)
class _Bed:
    """First contacts and turns that are fitted with the `values` of both; those that neither determines are given.

    `length_error`: standard error of log λ if there are no turns.
    """

    contacts: list[Phase]
    turns: list[Phase]
    values: BedValues
    given_values: Given
    length_error: float

    def again(self) -> "_Bed":
        """The turns fitted with the surface of the contacts, and then these with the λ of the turns."""
        turns = [turn.again(self.values) for turn in self.turns]
        values = self.values
        if turns:
            values = values._replace(log_length=_length(turns).mean)
        contacts = [contact.again(values) for contact in self.contacts]
        if contacts:
            values = values._replace(surface=_mean(contacts))
        return replace(self, contacts=contacts, turns=turns, values=values)

    @cached_property
    def own_errors(self) -> tuple[float, float]:
        """Standard errors of the surface height [m] and of log λ without those of each other."""
        surface = _own_error(self.contacts) if self.contacts else self.given_values.surface_error
        return surface, _length(self.turns).error if self.turns else self.length_error

    @cached_property
    def changes(self) -> Array:
        """What each cause of errors changes in the surface height [m] and in log λ, shape [2, causes].

        To first order, each of the two follows the other, too.
        """
        slopes = np.zeros((2, 2))
        direct_changes = np.zeros((2, 2 + _SHARED_CAUSES_COUNT))
        weights = (None, _length(self.turns).weights if self.turns else None)
        for row, phases in enumerate((self.contacts, self.turns)):
            if phases:
                phase_slopes = [self._slopes(phase) for phase in phases]
                slopes[row] = np.average(phase_slopes, axis=0, weights=weights[row])
                phase_changes = [self._by_causes(phase) for phase in phases]
                direct_changes[row] = np.average(phase_changes, axis=0, weights=weights[row])
            direct_changes[row, row] = self.own_errors[row]
        return np.asarray(np.linalg.solve(np.eye(2) - slopes, direct_changes))

    def change(self, phases: Sequence[Phase]) -> Array:
        """What each cause changes in the mean value of some phases, shape [causes]."""
        changes = [self._slopes(phase) @ self.changes + self._by_causes(phase) for phase in phases]
        return np.asarray(np.mean(changes, axis=0))

    def _slopes(self, phase: Phase) -> Array:
        """Derivatives of a phase's value by the surface height [1/m] and by log λ, shape [2]."""
        slopes = []
        for (name, limits), error in zip(_STEPS.items(), self.own_errors, strict=True):
            # a step as large as the error of what is changed: in a smaller one a fit may not move at all
            slopes.append(phase.slope(name, float(np.clip(error, *limits))))
        return np.array(slopes)

    def _by_causes(self, phase: Phase) -> Array:
        """What each cause changes in a phase's value with the same surface and λ, shape [causes].

        None for the first two, which are the own errors of surface and log λ. Then a standard error of the load cell's
        delay, and friction.
        """
        recording = phase.recording
        delay_change = phase.by_force(recording.by_delay(self.given_values.delay_error))
        friction_change = phase.by_force(recording.friction)
        return np.array([0.0, 0.0, delay_change, friction_change])


def fit_grains(
    result: FitResults,
    recordings: Sequence[Recorded],
    *,
    contacts: Sequence[Contact],
    given_values: Given,
    parts: Collection[str],
) -> None:
    """Fit those of surface, zeta and mobilization that are in `parts`, into `result`.

    `contacts`: those of the recordings to which the surface is fitted.
    """
    begin = given_values.values
    turns: list[Phase] = []
    length_error = 0.0
    if "mobilization" in parts:
        try:
            none = (
                "the tool never turns in the grains, and no recording begins with it at rest there"
            )
            turns = _fitted(turn_for_length, turns_in_grains, recordings, begin, none=none)
            begin = begin._replace(log_length=_length(turns).mean)
        except NotIdentifiable as reason:
            result.not_identifiable["medium.mobilization_length"] = str(reason)
            if isinstance(reason, TooShortToResolve):
                begin = begin._replace(log_length=float(np.log(MIN_LENGTH_M)))
            else:
                length_error = _UNKNOWN_LENGTH_ERROR_RATIO
    at_contacts = [
        first_contact(recordings[c.number], c.rows, begin._replace(surface=c.surface))
        for c in contacts
    ]
    bed = _Bed(
        contacts=at_contacts,
        turns=turns,
        values=begin._replace(surface=_mean(at_contacts)) if at_contacts else begin,
        given_values=given_values,
        length_error=length_error,
    )
    bed = _settled(bed, surface_of_turns=begin.surface)
    surface_error, log_error = np.linalg.norm(bed.changes, axis=1).tolist()
    if contacts:
        _add_surface(result, bed, contacts, surface_error)
    if "zeta" in parts:
        with result.or_reason("medium.zeta"):
            _add_zeta(result, recordings, bed, surface_error)
    if turns:
        _add_length(result, bed, log_error)


def _fitted(
    fit: Callable[..., Phase],
    parts_of: Callable[[Track, float], Iterable[Any]],
    recordings: Sequence[Recorded],
    values: BedValues,
    *,
    none: str,
) -> list[Phase]:
    """`fit` of each part below the surface; `none`: why there are no parts."""
    parts = (
        (one, part, values) for one in recordings for part in parts_of(one.track, values.surface)
    )
    return fit_each(fit, parts, none=none)


def _mean(phases: Sequence[Phase]) -> float:
    return float(np.mean([phase.value for phase in phases]))


class _Length(NamedTuple):
    """log λ of several turns: their mean, its standard error, and the weights of the turns, shape [n], of sum 1."""

    mean: float
    error: float
    weights: Array


def _length(turns: Sequence[Phase]) -> _Length:
    """The mean of log λ, in which a turn that hardly determines it counts little.

    Each turn has its own error and a scatter that all share, by the moments of DerSimonian and Laird (1986).
    """
    values = np.array([turn.value for turn in turns])
    precisions = 1.0 / np.square([turn.fit.error for turn in turns])
    share = precisions / precisions.sum()
    excess = precisions @ (values - share @ values) ** 2 - (len(turns) - 1)
    scatter = max(excess, 0.0) / (precisions.sum() - precisions @ share) if len(turns) > 1 else 0.0
    weights = 1.0 / (1.0 / precisions + scatter)
    error = weights.sum() ** -0.5
    return _Length(float(weights @ values / weights.sum()), float(error), weights / weights.sum())


def _settled(bed: _Bed, surface_of_turns: float) -> _Bed:
    """Fit λ and the surface in turns, each with the result of the other, until they no longer change.

    `surface_of_turns`: the height with which the turns were fitted [m].
    """
    for _ in range(_MAX_ROUNDS_COUNT):
        if abs(bed.values.surface - surface_of_turns) < _MAX_SURFACE_CHANGE_M:
            break
        surface_of_turns = bed.values.surface
        bed = bed.again()
    return bed


def _own_error(phases: Sequence[Phase]) -> float:
    """Standard error of a mean: the greater of that from the values' scatter and that from their own errors."""
    count = len(phases)
    propagated_error = float(np.linalg.norm([phase.fit.error for phase in phases])) / count
    if count == 1:
        return propagated_error
    scatter = float(np.std([phase.value for phase in phases], ddof=1))
    return max(propagated_error, scatter / float(np.sqrt(count)))


def _add_surface(result: FitResults, bed: _Bed, contacts: Sequence[Contact], error: float) -> None:
    misfit = max(contact.misfit for contact in contacts)
    if not error <= MAX_SURFACE_ERROR_M:
        millimetres = f"{1e3 * error:.3g} mm, and must be at most {1e3 * MAX_SURFACE_ERROR_M:g} mm"
        likely_causes = "are the positions rounded, or does the bed differ between the contacts?"
        result.not_identifiable["surface_height"] = f"its error is {millimetres}: {likely_causes}"
        return
    result.add(
        "surface_height",
        bed.values.surface,
        error,
        goodness=f"RMS up to {100 * misfit:.1f} % of the force's rise",
        source=listed(contact.measurement() for contact in bed.contacts),
    )


def _add_length(result: FitResults, bed: _Bed, log_error: float) -> None:
    if log_error >= 1.0:
        delay_error = f"{1e3 * bed.given_values.delay_error:.2g} ms of the delay of the load cell"
        result.not_identifiable["medium.mobilization_length"] = (
            f"λ is {1e3 * bed.values.length:.3g} mm ± {100 * log_error:.0f} %, with {delay_error}, and must exceed its"
            " error: record poses and readings at a higher rate, or more turns"
        )
        return
    misfit = np.mean([turn.misfit for turn in bed.turns])
    lengths = [
        turn.measurement()._replace(
            value=turn.values.length, error=turn.values.length * turn.fit.error
        )
        for turn in bed.turns
    ]
    result.add(
        "medium.mobilization_length",
        bed.values.length,
        bed.values.length * log_error,
        goodness=f"RMS {100.0 * misfit:.1f} % of the greatest force around turns",
        source=listed(lengths),
    )


def _add_zeta(
    result: FitResults, recordings: Sequence[Recorded], bed: _Bed, surface_error: float
) -> None:
    """Add ζ as the mean over the ways down, what makes it doubtful, the greatest depth, and each kind of motion.

    Raises NotIdentifiable if no way down determines ζ.
    """
    none = "no vertical penetration in the grains"
    every_way = _fitted(way_down, down_strokes, recordings, bed.values, none=none)
    shared_error = float(np.linalg.norm(bed.change(every_way)))
    ways = fit_each(check_strength, ((way, shared_error) for way in every_way), none="")
    strengths = [way.measurement(shared_error) for way in ways]
    tools = [way.recording.track.tool for way in ways]
    misfit = max(way.misfit for way in ways)
    words = difference(strengths, [tool.size for tool in tools])
    zeta = _mean(ways)
    result.add(
        "medium.zeta",
        zeta,
        float(np.hypot(_own_error(ways), shared_error)),
        unit="",
        goodness=f"RMS up to {100 * misfit:.1f} % of the peak{words}",
        source=listed(strengths),
        spread=spread_of(strengths, [str(tool.file) for tool in tools]),
    )
    if "medium.zeta" in result.not_identifiable:
        return
    deepest = min(ways, key=lambda way: way.recording.lowest(way.part.rows))
    result.add(
        "medium.calibrated_depth",
        bed.values.surface - deepest.recording.lowest(deepest.part.rows),
        surface_error,
        goodness="",
        source=f"deepest penetration, {deepest.recording.name}",
    )
    for kind, phases in motion_phases(recordings, bed.values).items():
        kind_fit = motion_fit(
            kind,
            phases,
            written_zeta=zeta,
            own_error=_own_error(phases),
            changes_by_cause=bed.change(phases),
        )
        result.motions.append(kind_fit)
    result.warnings += sentences_on(result.motions)


def spread_of(measurements: Sequence[Measurement], tools: Sequence[str]) -> float:
    """How far ζ is from that of a tool, relative to it; if there is only one tool, from one of its measurements.

    `tools`: the name of the tool of each measurement.
    """
    names = tools if len(set(tools)) > 1 else range(len(measurements))
    values = np.array([measurement.value for measurement in measurements])
    zeta_means = [values[[name == one for name in names]].mean() for one in dict.fromkeys(names)]
    return float(max(abs(values.mean() / zeta - 1.0) for zeta in zeta_means))


def difference(measurements: Sequence[Measurement], sizes: Sequence[float]) -> str:
    """Words on a ζ that differs between penetrations; none where it does not. `sizes` of their tools [m]."""
    zetas = [measurement.value for measurement in measurements]
    low = measurements[int(np.argmin(zetas))]
    high = measurements[int(np.argmax(zetas))]
    apart = high.value - low.value
    certain = 3.0 * float(np.hypot(low.error, high.error))
    grows = ""
    if (
        np.ptp(sizes) > 0.1 * max(sizes)
        and np.corrcoef(sizes, zetas)[0, 1] > _MIN_SIZE_CORRELATION_FACTOR
    ):
        grows = f"; ζ grows with the tool's size, {1e3 * min(sizes):.0f} to {1e3 * max(sizes):.0f} mm wide"
        certain *= 2.0 / 3.0  # that ζ follows the size is evidence of its own
    if apart <= max(_MAX_ZETA_DIFFERENCE_RATIO * low.value, certain):
        return ""
    percent = f"{100 * apart / low.value:.0f} %"
    return f"; ζ differs by {percent}: tools of different size, and grains that differ, need a ζ of their own{grows}"

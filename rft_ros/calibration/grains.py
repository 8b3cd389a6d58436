"""Fits the surface, ζ and λ of the grains together. The error of each includes those of the others it depends on.

Each value has its own phase of a recording: the surface the first contact, ζ the whole way down, λ the way after a
turn. Grains with memory resist fully only after a distance, so that the first contact that is found depends on λ, and
λ and ζ depend on the surface. The fits are therefore repeated with each other's results until those no longer change.

The errors. Each fit has its own standard error, from the noise and its correlation. To first order, each fit follows a
change of the model or of the data: of the others' values, of the load cell's zero, which all fits share, of the delay,
and of the poses, to which noise is added (after Cook and Stefanski, Journal of the American Statistical Association 89,
1994). The changes by the others' values make a linear system for the errors of all.
"""

from collections.abc import Collection, Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import FitResults, Measurement, NotIdentifiable, fit_each, listed
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
from rft_ros.calibration.suspicion import doubts_of_zeta
from rft_ros.calibration.track import down_strokes, turns_in_grains

__all__ = ["difference", "fit_grains", "spread_of"]

Array = NDArray[np.float64]

_ROUNDS = 8  # of fits with each other's results
_SETTLED = 1e-6  # change of the surface [m] below which another round changes nothing
_LIMITS_OF_STEPS = {"surface": (5e-5, 1e-3), "log_length": (0.1, 0.5)}
"""Least and greatest change of the surface height [m], and of log λ, for derivatives.

Smaller steps would find no change, since a fit moves from pose to pose.
"""

_GIVEN_SURFACE_ERROR = 0.002
"""Standard deviation [m] of the file's surface height, where a recording does not show the surface."""

_UNKNOWN_LENGTH = 0.7  # standard deviation of log λ where the recordings do not determine it: half to double

_NOTEWORTHY = 0.25  # greatest relative difference of ζ between penetrations without a note
_GROWS = 0.8  # least correlation of ζ with the size of the tool that is reported

_NAMES = {"surface": "surface_height", "log_length": "medium.mobilization_length", "zeta": "medium.zeta"}
"""The values that phases determine, in the order of the system of errors, and the parameters that take them."""


def _mean(phases: Sequence[Phase]) -> float:
    return float(np.mean([phase.value for phase in phases]))


def _own_error(phases: Sequence[Phase]) -> float:
    """Standard error of a mean: the greater of that from the values' scatter and that from their own errors."""
    values, errors = [phase.value for phase in phases], [phase.error for phase in phases]
    scatter = float(np.std(values, ddof=1)) / len(values) ** 0.5 if len(values) > 1 else 0.0
    return max(float(np.linalg.norm(errors)) / len(errors), scatter)


def _settled(phases: dict[str, list[Phase]], values: BedValues) -> BedValues:
    """Fit λ and the surface in turns, each with the result of the other, until they no longer change."""
    for _ in range(_ROUNDS):
        before = values.surface
        for name in ("log_length", "surface"):
            if phases[name]:
                phases[name] = [phase.again(values) for phase in phases[name]]
                values = values._replace(**{name: _mean(phases[name])})
        if abs(values.surface - before) < _SETTLED or not (phases["log_length"] and phases["surface"]):
            break
    return values


def fit_grains(
    result: FitResults,
    recordings: Sequence[Recorded],
    *,
    contacts: Sequence[Contact],
    given: BedValues,
    parts: Collection[str],
    zero_error: float,
    delay_error: float,
) -> None:
    """Fit those of surface, zeta and mobilization that are in `parts`, into `result`; the others are as `given`.

    `recordings`: without memory and inertia. `contacts`: of these; the surface is fitted to them. All errors include
    the standard errors of the load cell's zero [N], one axis, and of its delay [s].
    """
    values, own = given, dict.fromkeys(_NAMES, 0.0)
    phases: dict[str, list[Phase]] = {name: [] for name in _NAMES}
    if "surface" not in parts:
        contacts = ()
    elif contacts:
        values = given._replace(surface=float(np.mean([contact.surface for contact in contacts])))
    else:
        own["surface"] = _GIVEN_SURFACE_ERROR
    if "mobilization" in parts:
        turns = ((r, turn, values) for r in recordings for turn in turns_in_grains(r.track, values.surface))
        none = "the tool never turns in the grains, and no recording begins with it at rest there"
        try:
            phases["log_length"] = fit_each(turn_for_length, turns, none=none)
            values = values._replace(log_length=_mean(phases["log_length"]))
        except NotIdentifiable as reason:
            result.not_identifiable[_NAMES["log_length"]] = str(reason)
            if isinstance(reason, TooShortToResolve):
                values = values._replace(log_length=float(np.log(SHORTEST)))
            else:
                own["log_length"] = _UNKNOWN_LENGTH
    for contact in contacts:
        start = values._replace(surface=contact.surface)
        phases["surface"].append(first_contact(recordings[contact.number], contact.rows, start))
    if contacts:
        values = values._replace(surface=_mean(phases["surface"]))
    values = _settled(phases, values)
    own |= {name: _own_error(found) for name, found in phases.items() if found}

    @cache
    def effects(phase: Phase) -> Array:
        return _effects(phase, own, zero_error=zero_error, delay_error=delay_error)

    def errors(phases: dict[str, list[Phase]]) -> Array:
        """Standard errors of the surface [m], log λ and ζ: to first order each follows the others."""
        found = np.zeros((3, 7 + SHAKEN))
        for row, group in zip(found, phases.values(), strict=True):
            if group:
                row[:] = np.mean([effects(phase) for phase in group], axis=0)
        by_others = np.pad(found[:, :2], ((0, 0), (0, 1)))
        sources = np.hstack([np.diag([*own.values()]), found[:, 2:]])
        return np.asarray(np.linalg.norm(np.linalg.solve(np.eye(3) - by_others, sources), axis=1))

    shared = 0.0  # the error of ζ that all ways down share
    if "zeta" in parts:
        ways = ((r, stroke, values) for r in recordings for stroke in down_strokes(r.track, below=values.surface))
        with result.or_reason(_NAMES["zeta"]):
            found = fit_each(way_down, ways, none="no vertical penetration in the grains")
            shared = float(errors({**phases, "zeta": found})[2])
            phases["zeta"] = fit_each(check_strength, ((way, shared) for way in found), none="")
            own["zeta"] = _own_error(phases["zeta"])

    surface_error, length_error, zeta_error = errors(phases).tolist()
    if contacts:
        heights, rise = [phase.measurement() for phase in phases["surface"]], max(c.misfit for c in contacts)
        goodness = f"RMS up to {100 * rise:.1f} % of the force's rise"
        result.add(
            _NAMES["surface"], values.surface, surface_error, unit="m", goodness=goodness, source=listed(heights)
        )
    if phases["zeta"]:
        strengths = [way.measurement(shared) for way in phases["zeta"]]
        _add_zeta(result, phases["zeta"], strengths, values.surface, zeta_error=zeta_error, surface_error=surface_error)
    if phases["log_length"]:
        turns_fitted, length = phases["log_length"], values.length
        goodness = f"RMS {100.0 * np.mean([t.misfit for t in turns_fitted]):.1f} % of the greatest force around turns"
        lengths = [
            Measurement(t.part.recording.track.name, t.values.length, t.values.length * t.error) for t in turns_fitted
        ]
        result.add(
            _NAMES["log_length"], length, length * length_error, unit="m", goodness=goodness, source=listed(lengths)
        )


def _add_zeta(
    result: FitResults,
    ways_down: Sequence[Phase],
    strengths: Sequence[Measurement],
    surface: float,
    *,
    zeta_error: float,
    surface_error: float,
) -> None:
    """Add ζ, as the mean over the ways down, what makes it doubtful, and the depth of the deepest way."""
    tools = [way.part.recording.track.tool for way in ways_down]
    words = difference(strengths, [float(np.ptp(tool.corners, axis=0).max()) for tool in tools])
    goodness = f"RMS up to {100 * max(way.misfit for way in ways_down):.1f} % of the peak{words}"
    spread, zeta = spread_of(strengths, [str(tool.file) for tool in tools]), _mean(ways_down)
    result.add(_NAMES["zeta"], zeta, zeta_error, unit="", goodness=goodness, source=listed(strengths), spread=spread)
    approaches = [(way.part.recording, np.append(way.part.approach, way.part.rows)) for way in ways_down]
    result.warnings += doubts_of_zeta(zeta, approaches, surface)
    depth, where = max((surface - r.track.heights[rows].min(), r.track.name) for r, rows in approaches)
    source = f"deepest penetration, {where}"
    result.add("medium.calibrated_depth", float(depth), surface_error, unit="m", goodness="", source=source)


def _effects(phase: Phase, own: dict[str, float], *, zero_error: float, delay_error: float) -> Array:
    """What changes the value of a phase, shape [9].

    Derivatives by the surface height [1/m] and by log λ; changes by a standard error of the load cell's zero along each
    axis [N] and of its delay [s], and by friction; changes by noise of the poses, of which more is added `SHAKEN`
    times.
    """
    recording, found = phase.part.recording, np.zeros(7 + SHAKEN)
    for k, (name, limits) in enumerate(_LIMITS_OF_STEPS.items()):
        # a step as large as the error of what is changed: in a smaller one a fit may not move at all
        at, step = getattr(phase.values, name), float(np.clip(own[name], *limits))
        if name not in phase.free and np.isfinite(at):
            found[k] = (phase.change(**{name: at + step}) - phase.change(**{name: at - step})) / (2.0 * step)
    found[2:5] = [zero_error * phase.by_force(axis) for axis in np.eye(3)]
    found[5] = phase.by_force(recording.by_delay(delay_error))
    found[6] = phase.by_force(recording.friction)
    for k, shaken in enumerate(recording.shaken):
        found[7 + k] = phase.change(shaken) / SHAKEN**0.5
    return found


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

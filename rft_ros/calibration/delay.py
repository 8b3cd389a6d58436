"""The delay of the load cell, from turns in the grains and the moments at rest around them.

When the force changes is the delay, how fast is λ: a turn is fitted over both. A first contact does not determine the
delay, as another height of the surface gives the same force.
"""

from collections.abc import Iterable

import numpy as np

from rft_ros.calibration.fitting import FittedValue, Measurement, NotIdentifiable, fit_each, listed
from rft_ros.calibration.phases import LOG_LENGTHS, MAX_MISFIT_RATIO, Part, fitted
from rft_ros.calibration.recorded import MAX_DELAY_S, BedValues, Recorded
from rft_ros.calibration.smoothing import MAX_SAMPLE_GAP_S
from rft_ros.calibration.track import MIN_SAMPLES_COUNT, Turn, turns_in_grains
from rft_ros.rft import FORCE

_DELAYS_S = np.linspace(-MAX_DELAY_S, MAX_DELAY_S, 101)
"""Delays that are tried before the best one is refined."""

_MAX_DELAY_ERROR_S = 0.05
"""Greatest accepted standard error of the delay of one turn."""

_DELAY_RESOLUTION_S = 1e-3
"""Delays of synthetic recordings are found 1.4 ms too early on average, with poses at 500 Hz 0.4 ms."""


def _part_of(recording: Recorded, turn: Turn) -> Part:
    """The turn with the moments around it. Raises NotIdentifiable if there are too few."""
    time = recording.track.time
    moving = time[turn.rows]
    rows_about = np.flatnonzero(
        (time >= moving[0] - MAX_DELAY_S) & (time <= moving[-1] + MAX_DELAY_S)
    )
    nearby_rows = rows_about[rows_about >= turn.first]
    turn_rows = nearby_rows[(nearby_rows >= turn.rows[0]) & (nearby_rows <= turn.rows[-1])]
    # at rest the force may relax: only its first and last moments count
    next_index = np.clip(np.searchsorted(moving, time[turn_rows]), 1, len(moving) - 1)
    time_since = np.abs(time[turn_rows] - moving[next_index - 1])
    time_until = np.abs(moving[next_index] - time[turn_rows])
    rows = turn_rows[np.minimum(time_since, time_until) <= MAX_DELAY_S]
    if len(rows) < MIN_SAMPLES_COUNT or np.diff(time[nearby_rows]).max() > MAX_SAMPLE_GAP_S:
        raise NotIdentifiable(
            f"{turn.where}: {len(rows)} samples around a turn; the delay needs {MIN_SAMPLES_COUNT} without a gap"
        )
    moments = recording.moments_about(rows, first=turn.first)
    return Part(
        recording=recording.coarse,
        moments=moments,
        rows=rows,
        axes=FORCE,
        zeros=True,
        between_lengths=True,
    )


def _best_tried(part: Part, surface: float) -> BedValues:
    """Of `_DELAYS_S` and `LOG_LENGTHS` those of the least misfit, with any scale of the force and zeros."""
    measured_force = part.observed - part.observed.mean(axis=0)
    best = BedValues(surface, log_length=0.0)
    most_explained = -np.inf
    for log_length in LOG_LENGTHS.tolist():
        values = BedValues(surface, log_length)
        force = part.modelled(values, _DELAYS_S)
        force = force - force.mean(axis=1, keepdims=True)
        squares = np.maximum((force**2).sum(axis=(1, 2)), 1e-300)
        explained_squares = (force * measured_force).sum(axis=(1, 2)) ** 2 / squares
        if explained_squares.max() > most_explained:
            most_explained = float(explained_squares.max())
            best = values._replace(delay=float(_DELAYS_S[explained_squares.argmax()]))
    return best


def _turn_for_delay(recording: Recorded, turn: Turn, surface: float) -> tuple[Measurement, float]:
    """The delay [s] at one turn, and its misfit. Raises NotIdentifiable if the turn does not determine it."""
    part = _part_of(recording, turn)
    start = _best_tried(part, surface)
    phase = fitted(part, start, ("delay", "log_length"))
    # where the turn lies
    between_poses = float(np.median(np.diff(recording.track.time[part.rows]))) / 12.0**0.5
    friction_error = phase.by_force(recording.friction)
    error = float(
        np.linalg.norm([phase.fit.error, _DELAY_RESOLUTION_S, between_poses, friction_error])
    )
    misfit = phase.fit.rms / max(float(np.ptp(part.observed, axis=0).max()), 1e-300)
    sure = error < _MAX_DELAY_ERROR_S and abs(phase.value) < MAX_DELAY_S - error
    if not (sure and misfit < MAX_MISFIT_RATIO and phase.scale > 0.0):
        raise NotIdentifiable(
            f"{turn.where}: the fitted delay is {phase.value:.3f} ± {error:.2g} s with a residual of"
            f" {100.0 * misfit:.0f} % of the force's range; its error must be below {_MAX_DELAY_ERROR_S:g} s, and the"
            f" residual below {100.0 * MAX_MISFIT_RATIO:.0f} %"
        )
    return phase.measurement()._replace(error=error), misfit


def fit_delay(
    recordings: Iterable[Recorded], surface: float, *, configured_delay: float
) -> FittedValue:
    """`sensor.delay` [s]: the mean over the turns, weighted by their errors, on top of `configured_delay`.

    Raises NotIdentifiable if no turn determines it.
    """
    turns = (
        (one, turn, surface) for one in recordings for turn in turns_in_grains(one.track, surface)
    )
    none = "the tool never turns in the grains, and no recording begins at rest there"
    turn_fits = fit_each(_turn_for_delay, turns, none=none)
    measurements = [measurement for measurement, _ in turn_fits]
    misfit = max(misfit for _, misfit in turn_fits)
    values = np.array([m.value for m in measurements])
    weights = np.array([m.error for m in measurements]) ** -2.0
    mean = float(weights @ values / weights.sum())
    scatter = float(weights @ (values - mean) ** 2) / max(len(values) - 1, 1)
    error = float(np.sqrt(max(1.0, scatter) / weights.sum()))
    source = listed(m._replace(value=configured_delay + m.value) for m in measurements)
    goodness = f"RMS up to {100.0 * misfit:.1f} % of the force's range around turns"
    return FittedValue("sensor.delay", (configured_delay + mean,), (error,), "s", goodness, source)

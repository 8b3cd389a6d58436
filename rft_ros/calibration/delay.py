"""The delay of the load cell, from turns in the grains and the moments at rest around them.

When the force changes is the delay, how fast is λ: a turn is fitted over both. A first contact does not determine the
delay, as another height of the surface gives the same force.
"""

from collections.abc import Iterable

import numpy as np

from rft_ros.calibration.fitting import FittedValue, Measurement, NotIdentifiable, fit_each, listed
from rft_ros.calibration.phases import LOG_LENGTHS, MOST_UNLIKE, Part, fitted
from rft_ros.calibration.recorded import LATEST, BedValues, Recorded
from rft_ros.calibration.smoothing import GAP
from rft_ros.calibration.track import FEWEST, Turn, turns_in_grains
from rft_ros.rft import FORCE

_DELAYS = np.linspace(-LATEST, LATEST, 101)  # tried before the best one is refined
_UNSURE = 0.05  # greatest accepted standard error of the delay of one turn [s]
_SEEN = 2.0  # standard errors: a smaller delay is not told from the given one
_RESOLUTION = 1e-3  # s: delays of synthetic recordings are found up to 1.6 ms too early


def _part_of(recording: Recorded, turn: Turn) -> Part:
    """The turn with the moments around it. Raises NotIdentifiable if there are too few."""
    time = recording.track.time
    moving = time[turn.rows]
    rows_about = np.flatnonzero((time >= moving[0] - LATEST) & (time <= moving[-1] + LATEST))
    about = rows_about[rows_about >= turn.first]
    within = about[(about >= turn.rows[0]) & (about <= turn.rows[-1])]
    # at rest the force may relax: only its first and last moments count
    after = np.clip(np.searchsorted(moving, time[within]), 1, len(moving) - 1)
    since = np.abs(time[within] - moving[after - 1])
    until = np.abs(moving[after] - time[within])
    rows = within[np.minimum(since, until) <= LATEST]
    if len(rows) < FEWEST or np.diff(time[about]).max() > GAP:
        raise NotIdentifiable(
            f"{turn.where}: {len(rows)} samples around a turn; the delay needs {FEWEST} without a gap"
        )
    moments = recording.moments_about(rows, first=turn.first)
    return Part(
        recording=recording,
        moments=moments,
        rows=rows,
        axes=FORCE,
        zeros=True,
        between_lengths=True,
    )


def _turn_for_delay(recording: Recorded, turn: Turn, surface: float) -> tuple[Measurement, float]:
    """The delay [s] at one turn, and its misfit. Raises NotIdentifiable if the turn does not determine it."""
    part = _part_of(recording, turn)
    starts = [(float(delay), float(log_length)) for log_length in LOG_LENGTHS for delay in _DELAYS]
    found = fitted(part, BedValues(surface, log_length=0.0), ("delay", "log_length"), starts)
    # where the turn lies
    between_poses = float(np.median(np.diff(recording.track.time[part.rows]))) / 12.0**0.5
    by_friction = found.by_force(recording.friction)
    error = float(np.linalg.norm([found.fit.error, _RESOLUTION, between_poses, by_friction]))
    misfit = found.fit.rms / max(float(np.ptp(part.observed, axis=0).max()), 1e-300)
    sure = error < _UNSURE and abs(found.value) < LATEST - error
    if not (sure and misfit < MOST_UNLIKE and found.scale > 0.0):
        raise NotIdentifiable(
            f"{turn.where}: the fitted delay is {found.value:.3f} ± {error:.2g} s with a residual of"
            f" {100.0 * misfit:.0f} % of the force's range; its error must be below {_UNSURE:g} s, and the residual"
            f" below {100.0 * MOST_UNLIKE:.0f} %"
        )
    return found.measurement()._replace(error=error), misfit


def fit_delay(recordings: Iterable[Recorded], surface: float, *, given: float) -> FittedValue:
    """`sensor.delay` [s]: the mean over the turns, weighted by their errors, on top of the one that is `given`.

    The given one is kept, with an error that includes the difference, if the two agree within their errors: readings
    that are moved between their samples lose the corners that tell λ.

    Raises NotIdentifiable if no turn determines it.
    """
    turns = (
        (one, turn, surface) for one in recordings for turn in turns_in_grains(one.track, surface)
    )
    none = "the tool never turns in the grains, and no recording begins at rest there"
    of_turns = fit_each(_turn_for_delay, turns, none=none)
    found = [measurement for measurement, _ in of_turns]
    misfit = max(misfit for _, misfit in of_turns)
    values = np.array([m.value for m in found])
    weights = np.array([m.error for m in found]) ** -2.0
    mean = float(weights @ values / weights.sum())
    scatter = float(weights @ (values - mean) ** 2) / max(len(values) - 1, 1)
    error = float(np.sqrt(max(1.0, scatter) / weights.sum()))
    source = listed(m._replace(value=given + m.value) for m in found)
    goodness = f"RMS up to {100.0 * misfit:.1f} % of the force's range around turns"
    if abs(mean) < _SEEN * error:
        kept_error = float(np.hypot(error, mean))
        return FittedValue("sensor.delay", (given,), (kept_error,), "s", goodness, source)
    return FittedValue("sensor.delay", (given + mean,), (error,), "s", goodness, source)

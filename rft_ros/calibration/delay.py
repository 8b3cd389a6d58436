"""The delay of the load cell's stamps against those of the poses, from changes of direction in the grains.

After a reversal or a start the force changes at once. When it does so is the delay, how fast is λ: each turn is fitted
over both, with a free strength and a free zero of each axis. A first contact tells no delay, since another height of
the surface gives the same force.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import (
    Curve,
    FittedValue,
    Measurement,
    NotIdentifiable,
    best_start,
    fit_curve,
    fit_each,
)
from rft_ros.calibration.memory_length import LOST_MOTION, SHORTEST
from rft_ros.calibration.recorded import BedValues, Recorded
from rft_ros.calibration.track import FEWEST, GAP, Turn, turns_in_grains

__all__ = ["fit_delay"]

Array = NDArray[np.float64]

_LONGEST = 0.25  # greatest delay that is searched, to both sides [s]
_LONGEST_LENGTH = 0.03  # greatest λ that is searched [m]
_DELAYS, _LENGTHS = 26, 5  # delays and values of λ that are tried before the best pair is refined
_STEPS = np.array([5e-4, 0.03])  # changes of the delay [s] and of log λ for derivatives
_LEAST_ERROR = 1e-3  # s: delays of synthetic recordings are found up to 1.6 ms too early
_SEEN = 2.0  # standard errors: a smaller delay is not told from the given one
_UNSURE = 0.05  # greatest accepted standard error of one turn [s]
_UNLIKE = 0.15  # greatest accepted RMS residual, relative to the range of the force


def fit_delay(recordings: Sequence[Recorded], surface: float, *, given: float) -> FittedValue:
    """`sensor.delay` [s]: the mean over the turns, weighted by their errors, on top of the one that is `given`.

    The given one is kept, with an error that includes the difference, if the two agree within their errors: readings
    that are moved between their samples lose the corners that tell λ.

    Raises NotIdentifiable if no turn determines it.
    """
    turns = ((one, turn, surface) for one in recordings for turn in turns_in_grains(one.track, surface))
    found = fit_each(_of_turn, turns, none="the tool never turns in the grains, and no recording begins at rest there")
    values, errors = (np.array([getattr(m, name) for m in found]) for name in ("value", "error"))
    weights = errors**-2.0
    mean = float(weights @ values / weights.sum())
    scatter = float(weights @ (values - mean) ** 2) / max(len(values) - 1, 1)
    error = float(np.sqrt(max(1.0, scatter) / weights.sum()))
    if abs(mean) < _SEEN * error:
        mean, error = 0.0, float(np.hypot(error, mean))
    each = ", ".join(f"{m.bag} {given + m.value:.3f} ± {m.error:.2g}" for m in found)
    misfit = 100.0 * max(m.misfit for m in found)
    goodness = f"RMS up to {misfit:.1f} % of the force's range around turns"
    return FittedValue("sensor.delay", (given + mean,), (error,), "s", goodness, each)


def _of_turn(recording: Recorded, turn: Turn, surface: float) -> Measurement:
    """The delay at one turn. Raises NotIdentifiable if it does not determine it."""
    track = recording.track
    time, ends = track.time, track.time[turn.rows[[0, -1]]]
    wide = np.flatnonzero((time >= ends[0] - _LONGEST) & (time <= ends[1] + _LONGEST))
    wide = wide[wide >= turn.first]
    rows = wide[(wide >= turn.rows[0]) & (wide <= turn.rows[-1])]
    # at rest the force may relax: only its first and last moments count
    after = np.clip(np.searchsorted(turn.rows, rows), 1, len(turn.rows) - 1)
    away = np.minimum(np.abs(time[rows] - time[turn.rows[after - 1]]), np.abs(time[turn.rows[after]] - time[rows]))
    rows = rows[away <= _LONGEST]
    where = f"{track.name}, {time[turn.at]:.1f} s after its beginning"
    if len(rows) < FEWEST or np.diff(time[wide]).max() > GAP:
        raise NotIdentifiable(f"{where}: {len(rows)} samples around a turn; the delay needs {FEWEST} without a gap")
    measured = recording.forces[rows]
    span = float(np.ptp(measured, axis=0).max())

    @cache
    def forces(log_length: float) -> Array:
        return recording.predicted(BedValues(surface, float(np.exp(log_length)), LOST_MOTION), turn.first, wide)

    def columns(parameters: Array) -> Array:
        delay, log_length = parameters.tolist()
        force = [np.interp(time[rows] - delay, time[wide], axis) for axis in forces(log_length).T]
        return np.concatenate([np.stack(force, axis=1)[:, :, None], np.broadcast_to(np.eye(3), (len(rows), 3, 3))], 2)

    low, high = np.array([-_LONGEST, np.log(SHORTEST)]), np.array([_LONGEST, np.log(_LONGEST_LENGTH)])
    curve = Curve(columns, _STEPS, low, high, expected=np.zeros(2), expected_error=np.full(2, np.inf))
    grid = [
        np.array([delay, log_length])
        for log_length in np.linspace(low[1], high[1], _LENGTHS)
        for delay in np.linspace(low[0], high[0], _DELAYS)
    ]
    fit = fit_curve(curve, measured, best_start(curve, measured, grid))
    # the turn lies anywhere between two poses
    error = float(np.hypot(np.hypot(fit.errors[0], _LEAST_ERROR), np.median(np.diff(time[rows])) / 12.0**0.5))
    delay, misfit = float(fit.coefficients[0]), fit.rms / max(span, 1e-12)
    if not (error < _UNSURE and misfit < _UNLIKE and fit.coefficients[2] > 0.0 and abs(delay) < _LONGEST - error):
        raise NotIdentifiable(
            f"{where}: the fitted delay is {delay:.3f} ± {error:.2g} s with a residual of {100.0 * misfit:.0f} % of the"
            f" force's range; its error must be below {_UNSURE:g} s, and the residual below {100.0 * _UNLIKE:.0f} %"
        )
    return Measurement(track.name, delay, error, misfit)

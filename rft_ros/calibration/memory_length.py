"""The mobilization length λ, from the force after the tool reverses, turns or starts from rest in the grains.

A stop alone does not identify λ: the force persists for any λ above 0. The force along the path that follows does, and
so does its build-up if a recording begins with the tool at rest in the grains.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import Curve, NotIdentifiable, best_start, fit_curve
from rft_ros.calibration.recorded import BedValues, Recorded
from rft_ros.calibration.track import Turn

__all__ = ["LOST_MOTION", "LOST_MOTION_ERROR", "SHORTEST", "TooShortToResolve", "TurnFit", "fit_turn"]
__all__ += ["length_by_place"]

Array = NDArray[np.float64]

SHORTEST, _LONGEST = 1e-4, 0.1
"""Range of λ that is searched [m]."""

LOST_MOTION, LOST_MOTION_ERROR = 5e-6, 5e-6
"""Path [m] that an arm loses when it turns back, by backlash or in the dead band of noisy poses, before any fit."""

_MOST_LOST = 2e-4  # greatest lost motion [m]
_GRID = 16  # values of λ that are tried before the best one is refined
_STEPS = np.array([0.03, 1e-6])  # changes of log λ and of the lost motion [m] for derivatives
_MOVED, _HELD = 2e-6, 1e-9  # m: change of the lost motion for `length_by_place`; tolerance when it is held
_UNSURE = 0.75  # greatest accepted standard error of λ, relative to λ
_UNLIKE = 0.15  # greatest accepted RMS residual, relative to the greatest force


class TooShortToResolve(NotIdentifiable):
    """The force follows the turn at once: λ is shorter than the recording can resolve."""


class TurnFit(NamedTuple):
    """log λ [log m] of one turn, its standard error, and the lost motion [m].

    `by_zero`: derivative of log λ by an offset of the load cell, shape [3], world axes [1/N]. `misfit`: RMS residual
    over the greatest force. `scale`: of the measured force over the model's.
    """

    logarithm: float
    error: float
    lost_motion: float
    by_zero: Array
    misfit: float
    scale: float

    def check(self, recording: Recorded, turn: Turn) -> None:
        """Raise NotIdentifiable if the turn does not determine λ."""
        where, length = _place(recording, turn), float(np.exp(self.logarithm))
        if self.logarithm < np.log(SHORTEST) + 0.02 * np.log(_LONGEST / SHORTEST):
            raise TooShortToResolve(
                f"{where}: the force follows the turn at once; λ is below the resolution of {1e3 * length:.2g} mm"
            )
        if self.error > _UNSURE or length > turn.after or self.misfit > _UNLIKE or self.scale <= 0.0:
            raise NotIdentifiable(
                f"{where}: the fitted λ is {1e3 * length:.3g} mm ± {100 * self.error:.0f} %, the force {self.scale:.2g}"
                f" times the model's, its RMS residual {100 * self.misfit:.0f} % of the greatest; λ must be below the"
                f" {1e3 * turn.after:.3g} mm of path after the turn, its error at most {100 * _UNSURE:.0f} %, the"
                f" factor over 0, and the residual at most {100 * _UNLIKE:.0f} %"
            )


def _place(recording: Recorded, turn: Turn) -> str:
    return f"{recording.track.name}, {recording.track.time[turn.at]:.1f} s after its beginning"


def length_by_place(recording: Recorded, turn: Turn, surface: float, found: TurnFit) -> float:
    """Derivative of log λ by the place of the turn [1/m], from a fit with another lost motion that is held."""
    moved = found.lost_motion + _MOVED
    other = fit_turn(recording, turn, surface, start=found._replace(lost_motion=moved), held=True)
    return (other.logarithm - found.logarithm) / _MOVED


def fit_turn(
    recording: Recorded, turn: Turn, surface: float, *, start: TurnFit | None = None, held: bool = False
) -> TurnFit:
    """Fit λ of one turn: least squares of the force's components over log λ, with a free scale. `surface`: height [m].

    `start`: a fit with nearly the same surface, whose lost motion is `held` or fitted again. Raises NotIdentifiable
    where the load cell measures no force.
    """
    measured = recording.forces[turn.rows]
    peak = float(np.linalg.norm(measured, axis=1).max())
    if not peak > 0.0:
        raise NotIdentifiable(f"{_place(recording, turn)}: the load cell measures no force of the grains")

    def columns(parameters: Array) -> Array:
        length, lost_motion = float(np.exp(parameters[0])), float(parameters[1])
        return recording.predicted(BedValues(surface, length, lost_motion), turn.first, turn.rows)[:, :, None]

    low, high = np.array([np.log(SHORTEST), 0.0]), np.array([np.log(_LONGEST), _MOST_LOST])
    expected, error = np.array([0.0, LOST_MOTION]), np.array([np.inf, LOST_MOTION_ERROR])
    if start is not None and held:
        expected, error = np.array([0.0, start.lost_motion]), np.array([np.inf, _HELD])
    curve = Curve(columns, _STEPS, low, high, expected, error)
    if start is None:
        grid = [np.array([logarithm, LOST_MOTION]) for logarithm in np.linspace(low[0], high[0], _GRID)]
        begin = best_start(curve, measured, grid)
    else:
        begin = np.array([start.logarithm, start.lost_motion])
    found = fit_curve(curve, measured, begin)
    logarithm, lost_motion, scale = found.coefficients.tolist()
    by_zero = found.inverse[0].reshape(measured.shape).sum(axis=0)
    return TurnFit(logarithm, float(found.errors[0]), lost_motion, by_zero, found.rms / peak, scale)

"""The mobilization length λ, from the force after the tool reverses, turns or starts from rest in the grains.

A stop alone does not identify λ: the force persists for any λ above 0. The force along the path that follows does, and
so does its build-up if a recording begins with the tool at rest in the grains.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import FittedValue, Measurement, NotIdentifiable, fit_curve, fit_each, mean_of
from rft_ros.calibration.tool_weight import Sensor
from rft_ros.calibration.track import Track, Turn, turns_in_grains
from rft_ros.rft import SLACK, Law, Memory, wrenches_in_time

__all__ = ["fit_memory_length"]

_SHORTEST, _LONGEST = 1e-4, 0.1  # range of λ that is searched [m]
_UNSURE = 0.5  # greatest accepted standard error of λ, relative to λ
_UNLIKE = 0.15  # greatest accepted RMS residual, relative to the greatest force


def _fit_turn(track: Track, turn: Turn, sensor: Sensor, law: Law, surface: float) -> Measurement:
    """λ of one turn: least squares of the force's components over log λ, with a free scale."""
    measured = track.grain_forces(sensor.cell)[turn.rows]
    where = f"{track.name}, {track.time[turn.at]:.1f} s after its beginning"
    peak = float(np.linalg.norm(measured, axis=1).max())
    if not peak > 0.0:
        raise NotIdentifiable(f"{where}: the load cell measures no force of the grains")

    since = slice(turn.first, int(turn.rows[-1]) + 1)
    plates, states = track.tool.plates, track.states[since]
    durations = np.diff(track.time[since], prepend=track.time[turn.first])

    def columns(logarithm: float) -> NDArray[np.float64]:
        """Forces as the node predicts them, from an empty memory on."""
        grains, memory = replace(law, mobilization_length=float(np.exp(logarithm))), Memory(plates, slack=SLACK)
        forces = wrenches_in_time(plates, grains, states, durations, memory, surface_height=surface)[:, :3]
        return forces[turn.rows - turn.first].T.reshape(-1, 1)

    low, high = np.log(_SHORTEST), np.log(_LONGEST)
    found = fit_curve(measured.T.ravel(), columns, low=low, high=high)
    by_zero = found.inverse[0] @ np.repeat([0.0, 0.0, sensor.zero_error], len(measured))
    logarithm, scale = found.coefficients.tolist()
    length, relative, misfit = float(np.exp(logarithm)), float(np.hypot(found.errors[0], by_zero)), found.rms / peak
    if logarithm < low + 0.02 * (high - low):
        raise NotIdentifiable(
            f"{where}: the force follows the turn at once; λ is below the resolution of {1e3 * length:.2g} mm"
        )
    if relative > _UNSURE or length > turn.after or misfit > _UNLIKE or scale <= 0.0:
        raise NotIdentifiable(
            f"{where}: the fitted λ is {1e3 * length:.3g} mm ± {100 * relative:.0f} %, the force {scale:.2g} times the"
            f" model's, its RMS residual {100 * misfit:.0f} % of the greatest; λ must be below the"
            f" {1e3 * turn.after:.3g} mm of path after the turn, its error at most {100 * _UNSURE:.0f} %, the factor"
            f" over 0, and the residual at most {100 * _UNLIKE:.0f} %"
        )
    return Measurement(track.name, length, length * relative, misfit)


def fit_memory_length(tracks: Sequence[Track], sensor: Sensor, law: Law, *, surface: float) -> FittedValue:
    """`medium.mobilization_length`: the mean λ over turns. Raises NotIdentifiable if no turn determines it.

    `law`: at any ζ. `surface`: height [m].
    """
    turns = fit_each(
        _fit_turn,
        ((track, turn, sensor, law, surface) for track in tracks for turn in turns_in_grains(track, surface)),
        none="the tool never turns in the grains, and no recording begins with it at rest there",
    )
    goodness = f"RMS {100.0 * np.mean([t.misfit for t in turns]):.1f} % of the greatest force around turns"
    return mean_of("medium.mobilization_length", turns, "m", goodness)

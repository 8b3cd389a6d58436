"""Whether a tool in another attitude explains the measured force better: a mesh that points the wrong way."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rft_ros.calibration.recorded import Recorded
from rft_ros.calibration.track import Rows
from rft_ros.rft import wrenches

__all__ = ["better_attitude"]

Array = NDArray[np.float64]

_MOST_ROWS = 150  # of a way down that are compared
_BETTER = 0.5  # greatest RMS residual, relative to that of the given attitude, that is named
_POOR = 0.05  # least RMS residual over the peak of the given attitude that is doubted


def _misfit(recording: Recorded, rows: Rows, surface: float, turn: Rotation) -> float:
    """RMS residual over the peak, for ζ of its own, of the tool turned in its frame; it meets the surface as it did."""
    states = recording.track.smooth_states()[rows]
    states[:, 3:7] = (Rotation.from_quat(states[:, 3:7]) * turn).as_quat()
    lowest, _ = recording.track.tool.lowest_points(states)
    height = surface + float(np.mean(lowest - recording.heights[rows]))
    predicted = wrenches(recording.track.tool.plates, recording.law, states, surface_height=height, threads=1)[:, :3]
    measured = recording.forces[rows]
    power, peak = float(np.sum(predicted**2)), float(np.linalg.norm(measured, axis=1).max())
    zeta = max(float(np.sum(predicted * measured)) / power, 0.0) if power > 0.0 else 0.0
    return float(np.sqrt(np.mean(np.sum((measured - zeta * predicted) ** 2, axis=1)))) / peak if peak > 0.0 else 0.0


def better_attitude(ways_down: Sequence[tuple[Recorded, Rows]], surface: float) -> str:
    """A sentence that names the turn by multiples of 90° that explains the ways down far better; none if none does."""

    def misfit(turn: Rotation) -> float:
        each = [(r, rows[:: max(1, len(rows) // _MOST_ROWS)]) for r, rows in ways_down]
        return float(np.mean([_misfit(r, rows, surface, turn) for r, rows in each]))

    given = misfit(Rotation.identity())
    if given < _POOR:
        return ""
    turns = Rotation.create_group("O")
    found = [(misfit(turn), k) for k, turn in enumerate(turns) if turn.magnitude() > 0.1]
    best, k = min(found)
    if best > _BETTER * given:
        return ""
    x, y, z, w = (round(float(v), 4) + 0.0 for v in turns[k].as_quat())
    return (
        f"the tool turned in its frame by the quaternion [{x:g}, {y:g}, {z:g}, {w:g}] explains the ways down better"
        f" (RMS {100 * best:.1f} instead of {100 * given:.1f} % of the peak): check which way the mesh points"
    )

"""Doubts a fitted ζ: dry grains do not have it, or the tool in another attitude explains the measured force better.

Both point to a mesh that points the wrong way. What speaks for another attitude is how the force grows and where it
points. Real grains do not follow the model's growth with depth: under round plates and wheels the pressure grows as
depth to the power of 1.3 to 1.6, in simulated beads more slowly than linearly. A tool that enters with an edge or a tip
also has a force that grows faster. So attitudes are compared after each had the power that suits it, and an attitude
that needs a ζ of no dry grains is not proposed.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rft_ros.calibration.recorded import Recorded
from rft_ros.calibration.track import Rows
from rft_ros.rft import wrenches

__all__ = ["doubts_of_zeta"]

Array = NDArray[np.float64]

_LEAST_ZETA, _GREATEST_ZETA = 0.05, 5.0
"""Range of ζ of dry grains."""

_MOST_ROWS = 150  # of a way down that are compared
_POWERS = np.linspace(-0.3, 0.6, 13)  # of depth by which the force may differ from the model's
_BETTER = 0.5  # greatest RMS residual, relative to the given attitude's, of an attitude that is proposed
_AS_GOOD = 1.5  # the same if the given attitude needs a ζ that dry grains do not have
_POOR = 0.03  # least RMS residual over the peak of a given attitude that is doubted


class _Explained(NamedTuple):
    """How an attitude explains a way down: RMS residual over the peak, with the best power of depth; ζ without one."""

    misfit: float
    zeta: float


def _is_of_dry_grains(zeta: float) -> bool:
    return _LEAST_ZETA <= zeta <= _GREATEST_ZETA


def _explained(recording: Recorded, rows: Rows, surface: float, turn: Rotation) -> _Explained:
    """How the tool turned in its frame explains a way down; its lowest point meets the surface as it did."""
    states, measured = recording.track.smooth_states()[rows], recording.forces[rows]
    depths = np.maximum(surface - recording.heights[rows], 0.0)
    states[:, 3:7] = (Rotation.from_quat(states[:, 3:7]) * turn).as_quat()
    lowest, _ = recording.track.tool.lowest_points(states)
    height = surface + float(np.mean(lowest - recording.heights[rows]))
    predicted = wrenches(recording.track.tool.plates, recording.law, states, surface_height=height, threads=1)[:, :3]
    peak, deepest = float(np.linalg.norm(measured, axis=1).max()), float(depths.max())
    if not (predicted.any() and peak > 0.0 and deepest > 0.0):
        return _Explained(1.0, 0.0)

    def fitted(model: Array) -> tuple[float, Array]:
        zeta = max(float(np.sum(model * measured) / np.sum(model**2)), 0.0)
        return zeta, measured - zeta * model

    below = depths > 0.0
    relative = (depths[below] / deepest)[:, None]
    predicted, measured = predicted[below], measured[below]
    residuals = [fitted(relative**power * predicted)[1] for power in _POWERS]
    least = min(float(np.mean(np.sum(left**2, axis=1))) for left in residuals)
    return _Explained(least**0.5 / peak, fitted(predicted)[0])


def doubts_of_zeta(zeta: float, ways_down: Sequence[tuple[Recorded, Rows]], surface: float) -> list[str]:
    """Sentences: on a `zeta` that no dry grains have, and on a turn of the tool by multiples of 90° that fits better.

    `ways_down`: a recording and its rows below the surface, which lies at `surface` [m].
    """
    thinned = [(recording, rows[:: max(1, len(rows) // _MOST_ROWS)]) for recording, rows in ways_down]

    def explained(turn: Rotation) -> _Explained:
        each = [_explained(recording, rows, surface, turn) for recording, rows in thinned]
        return _Explained(*np.mean(each, axis=0).tolist())

    sentences, plausible = [], _is_of_dry_grains(zeta)
    if not plausible:
        sentences.append(
            f"medium.zeta is {zeta:.3g}; dry grains have {_LEAST_ZETA:g} to {_GREATEST_ZETA:g}: check mesh.scale,"
            " mesh.origin, which way the mesh points, and the units of poses and forces"
        )
    given = explained(Rotation.identity())
    if plausible and given.misfit < _POOR:
        return sentences
    turns = [turn for turn in Rotation.create_group("O") if turn.magnitude() > 0.1]
    found = [(explained(turn), turn) for turn in turns]
    possible = [(other, turn) for other, turn in found if _is_of_dry_grains(other.zeta)]
    if possible:
        best, turn = min(possible, key=lambda pair: pair[0].misfit)
        if best.misfit <= (_BETTER if plausible else _AS_GOOD) * given.misfit:
            x, y, z, w = (round(float(v), 4) + 0.0 for v in turn.as_quat())
            sentences.append(
                f"the tool turned in its frame by the quaternion [{x:g}, {y:g}, {z:g}, {w:g}] explains the ways down"
                f" with a ζ of {best.zeta:.2g} in place of {given.zeta:.2g} and an RMS residual of"
                f" {100 * best.misfit:.1f} in place of {100 * given.misfit:.1f} % of the peak, whatever power of depth"
                " the pressure grows with: check which way the mesh points, and set mesh.quaternion"
            )
    return sentences

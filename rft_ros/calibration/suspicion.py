"""What a calibration doubts: recordings that would become wrong numbers that look right, and which way the tool points.

Recordings that no arm and no load cell can give are refused. The others are judged by the hypotheses of
`rft_ros.diagnosis`. A fitted ζ outside of the range of dry grains, or another attitude of the tool that explains the
force better, point to a mesh that points the wrong way. The evidence is the growth of the force with depth, and its
direction. Real grains do not follow the model's growth with depth: under round plates and wheels the pressure grows
as depth to the power of 1.3 to 1.6, in simulated beads more slowly than linearly. And the surface that was found
belongs to the given attitude: under a tip the force is small at first, and the contact is seen late. So each attitude
is fitted with the power and the surface that suit it, and then they are compared. An attitude whose ζ is outside of
the range of dry grains is not proposed.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rft_ros.calibration.recorded import Recorded
from rft_ros.calibration.track import Indices, Track
from rft_ros.diagnosis import Evidence, diagnose
from rft_ros.diagnosis.poses import REPEATED, repeats
from rft_ros.errors import InputError
from rft_ros.parameters import Settings
from rft_ros.rft import (
    FORCE,
    POSE,
    POSITION,
    SLACK,
    TORQUE,
    Law,
    Memory,
    displacements_followed,
    wrenches,
    wrenches_in_time,
)

__all__ = ["doubts_of_zeta", "refuse_implausible", "suspicions", "without_repeats"]

Array = NDArray[np.float64]

_REFUSED = ("unit of poses", "motion")
_TOLD = ("repeats", "saturation", "lever")  # the fits go on, with a warning
_LARGEST = 1e6  # reading [N], [N m] that the fits can square, and limit of sensor.bias
_FROZEN = 0.5  # share of the path; a load cell that repeats one reading over more is stuck

_LEAST_ZETA, _GREATEST_ZETA = 0.05, 5.0
"""Range of ζ of dry grains."""

_MOST_ROWS = 150  # of a way down that are compared
_DEPTHS = 128  # at which the force of an attitude is computed
_POWERS = np.linspace(-0.3, 0.6, 13)  # of depth by which the force may differ from the model's
_SHIFTS = np.linspace(0.0, 0.3, 7)  # of the surface, upwards, relative to the depth
_BETTER = 0.6  # greatest RMS residual, relative to the given attitude's, of an attitude that is proposed
_AS_GOOD = 2.0  # the same if the given attitude needs a ζ that dry grains do not have
_ALIKE = 0.002  # RMS residuals over the peak that differ by less are alike
_POOR = 0.02  # RMS residual over the peak below which the given attitude is not doubted


def refuse_implausible(track: Track) -> None:
    """Raise InputError for readings beyond any load cell, or of a load cell that repeats itself."""
    largest = float(np.abs(track.readings).max())
    if not largest <= _LARGEST:
        limit = f"the limit is {_LARGEST:g}; check the driver and its unit"
        raise InputError(f"{track.name} has a load-cell reading of {largest:g} N or N m; {limit}")
    steps = np.linalg.norm(np.diff(track.states[:, POSITION], axis=0), axis=1)
    path = float(steps.sum())
    changes = np.flatnonzero((np.diff(track.readings, axis=0) != 0.0).any(axis=1)) + 1
    edges = [0, *changes.tolist(), len(track.time)]
    frozen_path, start = max((float(steps[a : b - 1].sum()), a) for a, b in pairwise(edges))
    if path > 0.0 and frozen_path > _FROZEN * path:
        reading = track.readings[start]
        wrong = "reads 0 N and 0 N m" if not reading.any() else f"repeats one reading ({reading[2]:g} N along its z)"
        share = 100.0 * frozen_path / path
        raise InputError(
            f"{track.name}: the load cell {wrong} from {track.time[start]:.1f} s on, over {share:.0f} % of the"
            " tool's path; check that its driver runs and that ~/wrench_measured is its topic, then record again"
        )


def without_repeats(track: Track) -> Track:
    """The recording without the moments at which a moving tool has the pose of the moment before.

    A driver that publishes faster than it measures sends them. Their readings belong to poses that nobody measured.
    """
    changed, moving, often = repeats(track.time, track.states[:, POSE])
    if often <= REPEATED:
        return track
    new = np.isin(np.arange(len(track.time)), changed)
    moves = np.append(np.append(False, moving), False)[np.cumsum(new)]  # between two changes that follow each other
    rows = np.flatnonzero(new | ~moves)
    return replace(track, time=track.time[rows], states=track.states[rows], readings=track.readings[rows])


def suspicions(sent: Track, track: Track, settings: Settings, law: Law, *, surface: float) -> list[str]:
    """What is probably wrong with a recording, as sentences. `sent`: with the repeats that `track` is without.

    `law`: of the parameters, with their λ. Raises InputError for poses in millimetres, and if the force in the air
    depends on the motion: every fit would believe it.
    """
    plates = track.tool.plates
    if law.mobilization_length > 0.0:
        moved = displacements_followed(track.states, reach=plates.reach, dead_band=SLACK)
        predicted = wrenches_in_time(
            plates, law, track.states, Memory(plates), displacements=moved, surface_height=surface
        )
    else:
        predicted = wrenches(plates, law, track.states, surface_height=surface)
    place = track.rotations @ np.array(track.cell.position)
    torque = predicted[:, TORQUE] - np.cross(place, predicted[:, FORCE])
    in_cell = [np.einsum("nji,nj->ni", track.sensor_rotations, part) for part in (predicted[:, FORCE], torque)]
    evidence = Evidence(
        settings=settings,
        load_cell=track.cell,
        tool=track.tool,
        time=track.time,
        state=track.states,
        depth=surface - track.heights,
        speed=np.add(*track.speeds(track.states)),
        predicted=np.hstack(in_cell),
        measured=track.compensated,
        pose_time=sent.time,
        poses=sent.states[:, POSE],
    )
    wrong = [(name, f"{track.name}: {finding.text}") for name, finding in diagnose(evidence) if not finding.ok]
    for name, sentence in wrong:
        if name in _REFUSED:
            raise InputError(sentence)
    return [sentence for name, sentence in wrong if name in _TOLD]


class _Explained(NamedTuple):
    """RMS residual over the peak, with the power of depth and the surface that suit an attitude best; ζ without."""

    misfit: float
    zeta: float


def _is_of_dry_grains(zeta: float) -> bool:
    return _LEAST_ZETA <= zeta <= _GREATEST_ZETA


def _explained(recording: Recorded, rows: Indices, surface: float, turn: Rotation) -> _Explained:
    """How the tool turned in its frame explains a way down."""
    deepest = surface - float(recording.track.heights[rows].min())
    # higher up no surface that is tried lies, and the load cell may have drifted
    rows = rows[recording.track.heights[rows] < surface + float(_SHIFTS.max()) * deepest]
    rows = rows[:: max(1, len(rows) // _MOST_ROWS)]
    measured, below = recording.track.forces[rows], surface - recording.track.heights[rows]
    peak = float(np.linalg.norm(measured, axis=1).max())
    if not peak > 0.0:
        return _Explained(0.0, 0.0)
    depths = np.linspace(0.0, deepest * (1.0 + float(_SHIFTS.max())), _DEPTHS)
    forces = recording.track.forces_over_depth(recording.law, int(rows[-1]), depths, turn)

    def fitted(power: float, shift: float) -> tuple[float, float]:
        grown = forces * (np.maximum(depths, 1e-9)[:, None] / deepest) ** power
        model = np.column_stack([np.interp(below + shift * deepest, depths, column) for column in grown.T])
        square = float(np.sum(model**2))
        zeta = max(float(np.sum(model * measured)) / square, 0.0) if square > 0.0 else 0.0
        return float(np.mean(np.sum((measured - zeta * model) ** 2, axis=1))), zeta

    least, _ = min(fitted(power, shift) for power in _POWERS for shift in _SHIFTS)
    return _Explained(least**0.5 / peak, fitted(0.0, 0.0)[1])


def doubts_of_zeta(zeta: float, ways_down: Sequence[tuple[Recorded, Indices]], surface: float) -> list[str]:
    """Sentences: on a `zeta` that no dry grains have, and on a turn of the tool by multiples of 90° that fits better.

    `ways_down`: a recording and its rows on the way down, from the air on; the surface lies at `surface` [m].
    """

    def explained(turn: Rotation) -> _Explained:
        each = [_explained(recording, rows, surface, turn) for recording, rows in ways_down]
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
    found = [(explained(turn), turn) for turn in Rotation.create_group("O") if turn.magnitude() > 0.1]
    possible = [(other, turn) for other, turn in found if _is_of_dry_grains(other.zeta)]
    if possible:
        least = min(other.misfit for other, _ in possible)
        # of turns that fit alike a half turn is the likeliest: upside down
        alike = [(other, turn) for other, turn in possible if other.misfit <= 1.2 * least + _ALIKE]
        best, turn = max(alike, key=lambda pair: round(pair[1].magnitude(), 3))
        if best.misfit <= (_BETTER if plausible else _AS_GOOD) * given.misfit:
            x, y, z, w = (round(float(v), 4) + 0.0 for v in turn.as_quat())
            sentences.append(
                f"the tool turned in its frame by the quaternion [{x:g}, {y:g}, {z:g}, {w:g}] explains the ways down"
                f" with a ζ of {best.zeta:.2g} in place of {given.zeta:.2g} and an RMS residual of"
                f" {100 * best.misfit:.1f} in place of {100 * given.misfit:.1f} % of the peak, each with the surface"
                " and the growth with depth that suit it: check which way the mesh points, and set mesh.quaternion"
            )
    return sentences

"""The whole recording replayed with the fitted values: its error by kind of motion, and the ζ of each kind alone.

A kind is that of `rft_ros.rft.motion_kinds`, or rest, where the grains hold their force. The written ζ is that of the
press, the way straight down. Grains that are dragged or rolled on may need another: then one ζ predicts both wrongly.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import MotionFit
from rft_ros.calibration.phases import Part, Phase, fitted
from rft_ros.calibration.recorded import BedValues, Recorded
from rft_ros.calibration.smoothing import MAX_SAMPLE_GAP_S
from rft_ros.calibration.track import MIN_SAMPLES_COUNT, Indices, Track
from rft_ros.rft import FORCE
from rft_ros.rft.frames import ANGULAR_VELOCITY, VELOCITY
from rft_ros.rft.motion_kinds import LEAST_PATH, MOTIONS, kind_of_motion

Array = NDArray[np.float64]

REST = "rest"
"""The kind of a moment at which the tool does not move."""

ZETA_KIND = MOTIONS[0]
"""The kind of motion that the written ζ is for."""

_CORNER_TIME_S = 0.1
"""Time about a change of the kind that counts for neither: velocities are averaged over it."""

_MIN_DIFFERENCE_ERRORS_FACTOR = 3.0
"""Standard errors by which the ζ of two kinds must differ to be reported."""

_MIN_DIFFERENCE_RATIO = 0.1
"""The least relative difference that is reported: beds of the same grains differ by as much."""


def motion_phases(recordings: Sequence[Recorded], values: BedValues) -> dict[str, list[Phase]]:
    """The moments of each kind in each recording, with the ζ that fits them; only kinds that were recorded.

    ζ scales the force of the model, which follows the recording from its beginning.
    """
    phases_by_kind: dict[str, list[Phase]] = {kind: [] for kind in (*MOTIONS, REST)}
    for recording in recordings:
        for kind, rows in _rows_by_kind(recording.track, values.surface).items():
            if kind == REST and values.length == 0.0:
                continue  # without memory the model has no force at rest
            part = Part(recording=recording, moments=recording.moments, rows=rows, axes=FORCE)
            phase = fitted(part, values, ())
            if phase.fit.influence.any():
                phases_by_kind[kind].append(phase)
    return {kind: phases for kind, phases in phases_by_kind.items() if phases}


def _rows_by_kind(track: Track, surface: float) -> dict[str, Indices]:
    """Rows in the grains by kind of motion, without the corners between them. Kinds of a short path are left out."""
    spin = track.smooth[:, ANGULAR_VELOCITY]
    lever = track.rotations @ track.tool.middle
    middle_velocity = track.smooth[:, VELOCITY] + np.cross(spin, lever)
    turn_speed = 0.5 * track.tool.size * np.linalg.norm(spin, axis=1)
    kinds = np.array(
        [kind_of_motion(*row) for row in np.column_stack([middle_velocity, turn_speed]).tolist()]
    )
    kinds = np.where(track.moving, kinds, REST)
    speed = np.linalg.norm(middle_velocity, axis=1) + turn_speed
    time = track.time
    steps = np.diff(time, append=time[-1])
    path = speed * np.minimum(steps, MAX_SAMPLE_GAP_S)
    window_begins = np.searchsorted(time, time - _CORNER_TIME_S)
    window_ends = np.searchsorted(time, time + _CORNER_TIME_S, side="right") - 1
    corners = np.append(0, np.cumsum(kinds[1:] != kinds[:-1]))
    steady = corners[window_begins] == corners[window_ends]
    usable = steady & (track.heights < surface)
    rows_by_kind = {}
    for kind in (*MOTIONS, REST):
        rows = np.flatnonzero(usable & (kinds == kind))
        if len(rows) < MIN_SAMPLES_COUNT:
            continue
        if kind == REST or path[rows].sum() > LEAST_PATH:
            rows_by_kind[kind] = rows
    return rows_by_kind


def motion_fit(
    kind: str,
    phases: Sequence[Phase],
    *,
    written_zeta: float,
    own_error: float,
    changes_by_cause: Array,
) -> MotionFit:
    """What `phases` of one kind tell; errors are those of `MotionFit`."""
    measured_forces = np.concatenate([phase.part.observed for phase in phases])
    modelled_forces = np.concatenate(
        [phase.part.columns(phase.values)[:, :, 0] for phase in phases]
    )
    residuals = measured_forces - written_zeta * modelled_forces
    return MotionFit(
        kind=kind,
        zeta=float(np.mean([phase.value for phase in phases])),
        own_error=own_error,
        changes_by_cause=changes_by_cause,
        rms=float(np.sqrt(np.mean(np.sum(residuals**2, axis=1)))),
        peak=float(np.linalg.norm(measured_forces, axis=1).max()),
    )


def sentences_on(motions: Sequence[MotionFit]) -> list[str]:
    """A sentence on kinds of motion whose ζ differs from that of the press by more than their errors, if any do."""
    press = next((motion for motion in motions if motion.kind == ZETA_KIND), None)
    if press is None or press.zeta <= 0.0:
        return []
    apart = [motion for motion in motions if _differs(motion, press)]
    if not apart:
        return []
    other_zetas = " and ".join(
        f"{motion.zeta:.3g} ± {motion.error:.2g} in {motion.kind}" for motion in apart
    )
    return [
        f"ζ is {press.zeta:.3g} ± {press.error:.2g} in {ZETA_KIND}, but {other_zetas}: medium.zeta is for {ZETA_KIND};"
        " for a job of another motion set medium.zeta to the ζ of that motion, or learn from the load cell"
        " (learning.mode)"
    ]


def _differs(motion: MotionFit, press: MotionFit) -> bool:
    ratio = motion.zeta / press.zeta
    # a cause that both share, such as the surface, changes the ratio by less than either
    ratio_changes = motion.changes_by_cause - ratio * press.changes_by_cause
    change = np.linalg.norm([motion.own_error, ratio * press.own_error, *ratio_changes])
    error = float(change) / press.zeta
    return abs(ratio - 1.0) > max(_MIN_DIFFERENCE_ERRORS_FACTOR * error, _MIN_DIFFERENCE_RATIO)

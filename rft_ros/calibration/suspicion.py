"""What a calibration doubts: recordings that would become wrong numbers that look right.

Recordings that no load cell can give are unusable, and repeated poses are left out. The others are judged by
`rft_ros.diagnosis`: of its findings some refuse the calibration, those that a fit mends are dropped, and the rest are
warnings.
"""

from dataclasses import replace
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.track import Track
from rft_ros.diagnosis import REPEATED, Evidence, Finding, judge, repeats, wrenches_at_cell
from rft_ros.errors import InputError
from rft_ros.parameters import Settings
from rft_ros.rft import FORCE, POSE, POSITION, Law

Array = NDArray[np.float64]

_REFUSED = {
    "units",
    "zero that moves",
    "turn",
    "angle",
    "sign or quaternion",
    "left-handed axes",
    "quaternions",
    "world frame",
}
# a finding that these mend is refused, too: the model is of another cell
_OTHER_CELL = {"sensor.sign", "sensor.frame_source", "mesh.quaternion"}
# a finding that only these mend is none
_FITTED = {"surface_height", "sensor.bias", "sensor.delay", "medium.zeta"}
MIN_AT_LIMIT = 20
"""Readings at the greatest value from which on they may be cut off."""
MIN_NOISES_BELOW_LIMIT = 4.0
"""How near to it other readings would lie, by the noise, if they were not."""

_LARGEST = 1e6  # reading [N], [N m] that the fits can square, and limit of sensor.bias
_FROZEN = 0.5  # share of the path; a load cell that repeats one reading over more is stuck


def refuse_implausible(track: Track) -> None:
    """Raise InputError for readings beyond any load cell, or of a load cell that repeats itself."""
    largest = float(np.abs(track.readings).max())
    if not largest <= _LARGEST:
        limit = f"the limit is {_LARGEST:g}; check the driver and its unit"
        raise InputError(f"{track.name} has a load-cell reading of {largest:g} N or N m; {limit}")
    steps = np.linalg.norm(np.diff(track.states[:, POSITION], axis=0), axis=1)
    changes = np.flatnonzero((np.diff(track.readings, axis=0) != 0.0).any(axis=1)) + 1
    edges = [0, *changes.tolist(), len(track.time)]
    frozen, start = max((float(steps[a : b - 1].sum()), a) for a, b in pairwise(edges))
    share = frozen / max(float(steps.sum()), 1e-12)
    if share > _FROZEN:
        reading = track.readings[start]
        along_z = f"repeats one reading ({reading[2]:g} N along its z)"
        wrong = along_z if reading.any() else "reads 0 N and 0 N m"
        where = f"from {track.time[start]:.1f} s on, over {100.0 * share:.0f} % of the tool's path"
        advice = (
            "check that its driver runs and that ~/wrench_measured is its topic, then record again"
        )
        raise InputError(f"{track.name}: the load cell {wrong} {where}; {advice}")


def cut_off(track: Track) -> list[str]:
    """Sentences on components of the force that stop at a limit of the load cell or its driver.

    There they have no noise while the tool moves: the greatest reading repeats more often than others come near it. A
    simulated recording has no noise either, and repeats its readings where the tool rests.
    """
    found = []
    moves = np.append((np.diff(track.states[:, POSE], axis=0) != 0.0).any(axis=1), False)
    for axis, side in product(range(FORCE.stop), (1.0, -1.0)):
        readings = side * track.readings[moves, axis]
        limit = readings.max(initial=-np.inf)
        below = readings[readings < limit]
        is_unloaded = side * track.readings[0, axis] == limit
        if is_unloaded or len(below) <= 2:  # too few for second differences
            continue
        at_limit = int((readings == limit).sum())
        noise = 1.48 * np.median(np.abs(np.diff(below, 2))) / 6.0**0.5
        near = int((readings >= limit - MIN_NOISES_BELOW_LIMIT * noise).sum()) - at_limit
        if noise > 0.0 and at_limit >= MIN_AT_LIMIT and at_limit > near:
            stops = (
                f"the force along {'xyz'[axis]} stops at {side * limit:.4g} N, {at_limit} times"
            )
            found.append(
                f"{track.name}: saturation: {stops}; set a larger range in the load cell or its driver, or press less"
            )
    return found


def without_repeats(track: Track) -> Track:
    """The recording without the moments at which a moving tool has the pose of the moment before.

    A driver that publishes faster than it measures sends them. Their readings belong to poses that nobody measured.
    The last repeats of a rest are left out, too: the tool may have started after they were measured.
    """
    changed, _, often = repeats(track.time, track.states[:, POSE])
    if often <= REPEATED:
        return track
    rows = np.arange(len(track.time))
    next_change = np.append(changed, np.iinfo(np.int64).max)[np.searchsorted(changed, rows)]
    waits = next_change - rows
    rows = np.flatnonzero((waits == 0) | (waits >= often))
    return replace(
        track, time=track.time[rows], states=track.states[rows], readings=track.readings[rows]
    )


class Doubts(NamedTuple):
    """What is probably wrong with a recording, as sentences: what refuses its calibration, and the rest."""

    refusals: list[str]
    warnings: list[str]


def doubts(sent: Track, track: Track, settings: Settings, law: Law, *, surface: float) -> Doubts:
    """What is probably wrong with a recording. `sent`: with the repeats that `track` is without.

    `law`: of the parameters with their λ, at ζ = 1 and without inertia. What a fit would believe refuses a calibration:
    poses in millimetres, a zero of the load cell that moves, readings that are cut off, a load cell of another sign or
    in other axes, a turned mesh or world, quaternions with w first, and forces that the model does not explain.
    """
    evidence = Evidence(
        settings=replace(settings, surface_height=surface),
        load_cell=track.cell,
        tool=track.tool,
        law=law,
        time=track.time,
        state=track.states,
        depth=surface - track.heights,
        speed=np.add(*track.speeds(track.states)),
        predicted=wrenches_at_cell(track.tool, law, track.cell_along, surface),
        measured=track.compensated,
        pose_time=sent.time,
        poses=sent.states[:, POSE],
    )
    found = Doubts(refusals=cut_off(sent), warnings=[])
    for finding in judge(evidence):
        sentence = f"{track.name}: {finding.text}"
        # `cut_off` judges this by the noise. A peak has noise, although the model may grow beyond it, as where a layer
        # is stronger than the grains above.
        if finding.ok or finding.name == "saturation":
            continue
        if _refuses(finding):
            found.refusals.append(sentence)
        # no fit mends a filter of the driver, whose lag looks like a delay and like a greater λ
        elif "lag" in finding.evidence or not finding.remedy.keys() & _FITTED:
            found.warnings.append(sentence)
    return found


def _refuses(finding: Finding) -> bool:
    """Whether every fit would believe the fault."""
    # no parameter mends an angle of a load cell that transforms place
    remedy = next(filter(None, (finding.remedy, *finding.alike)), {})
    return finding.name in _REFUSED or bool(remedy.keys() & _OTHER_CELL)

"""Refuses recordings whose fit would be wrong without looking wrong.

Recordings that no load cell can give are unusable. The others are judged by `rft_ros.diagnosis` as a cell with the
fitted values: what the fits could not mend is a warning, or refuses the calibration if they would believe it.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.cell_along import CellAlong
from rft_ros.calibration.fitting import FitResults
from rft_ros.calibration.track import Track
from rft_ros.diagnosis import Evidence, examine
from rft_ros.errors import InputError
from rft_ros.parameters import Config, Value, load_parts
from rft_ros.rft import FORCE, POSE, POSITION, TORQUE, rotate_vectors

Array = NDArray[np.float64]

MAX_READING_N = 1e6
"""Greatest reading [N], [N m] that the fits can square, and limit of sensor.bias."""
MIN_DRY_ZETA_FACTOR = 0.1
MAX_DRY_ZETA_FACTOR = 5.0
"""Range of ζ of dry grains: with another, the mesh is turned, or forces are in another unit."""
MIMICKED_BY_FILTER = ("sensor.delay", "medium.mobilization_length")
MAX_FROZEN_SHARE = 0.5
"""Of the path: a load cell that repeats one reading over more is stuck."""


def refuse_implausible(track: Track) -> None:
    """Raise InputError for readings beyond any load cell, or of a load cell that repeats itself."""
    largest = float(np.abs(track.readings).max())
    if not largest <= MAX_READING_N:
        limit = f"the limit is {MAX_READING_N:g}; check the driver and its unit"
        raise InputError(f"{track.name} has a load-cell reading of {largest:g} N or N m; {limit}")
    steps = np.linalg.norm(np.diff(track.states[:, POSITION], axis=0), axis=1)
    changes = np.flatnonzero((np.diff(track.readings, axis=0) != 0.0).any(axis=1)) + 1
    edges = [0, *changes.tolist(), len(track.time)]
    frozen, start = max((float(steps[a : b - 1].sum()), a) for a, b in pairwise(edges))
    share = frozen / max(float(steps.sum()), 1e-12)
    if share > MAX_FROZEN_SHARE:
        reading = track.readings[start]
        along_z = f"repeats one reading ({reading[2]:g} N along its z)"
        wrong = along_z if reading.any() else "reads 0 N and 0 N m"
        where = f"from {track.time[start]:.1f} s on, over {100.0 * share:.0f} % of the tool's path"
        advice = (
            "check that its driver runs and that ~/wrench_measured is its topic, then record again"
        )
        raise InputError(f"{track.name}: the load cell {wrong} {where}; {advice}")


def judge_fitted(result: FitResults, tracks: Sequence[Track], config: Config) -> None:
    """Add what is wrong with the recordings, as cells with the fitted values, to refusals and warnings of the result.

    `tracks`: as sent, with the place of the load cell. The delay and λ are those of the parameters: a filter of the
    driver looks like others.
    """
    values: dict[str, Value] = {fit.name: fit.taken for fit in result.fitted_values}
    for name in MIMICKED_BY_FILTER:
        values.pop(name, None)
    fitted_config = config.changed(values)
    law = fitted_config.medium.law_of(load_parts(fitted_config.medium.parts()))
    if not MIN_DRY_ZETA_FACTOR <= law.zeta <= MAX_DRY_ZETA_FACTOR:
        dry = f"dry grains have {MIN_DRY_ZETA_FACTOR:g} to {MAX_DRY_ZETA_FACTOR:g}"
        to_check = "mesh.quaternion, mesh.scale, sensor.quaternion and the unit of the load cell"
        result.refusals.append(
            f"the recordings give a ζ of {law.zeta:.2g}, and {dry}: check {to_check}"
        )
    for track in tracks:
        cell = fitted_config.sensor.at(track.cell.place)
        readings = track.readings
        if fitted_config.frames.sensor_source == "world":
            to_world = CellAlong(cell, track.states).to_world
            readings = np.hstack(
                [rotate_vectors(to_world, readings[:, part]) for part in (FORCE, TORQUE)]
            )
        evidence = Evidence(
            config=fitted_config,
            load_cell=cell,
            tool=track.tool,
            law=law,
            time=track.time,
            state=track.states,
            readings=readings,
            pose_time=track.time,
            poses=track.states[:, POSE],
        )
        fitted_names = {fit.name for fit in result.fitted_values}
        for finding in examine(evidence, search="misfit"):
            sentence = f"{track.name}: {finding.text}"
            if finding.ok:
                continue
            if finding.spoils_calibration:
                result.refusals.append(sentence)
            elif not (finding.remedy and finding.remedy.keys() <= fitted_names):
                result.warnings.append(sentence)

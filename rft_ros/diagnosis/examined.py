"""Examines a cell twice: by the searches of `judge`, and by one fit of all its numbers, which decides between them.

A cell that fits as it is given has no fault, whatever a single search says. What explains the cell is what is told.
Otherwise the searches stand as they are.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np

from rft_ros.diagnosis.checks import dead_axes, jumps
from rft_ros.diagnosis.evidence import ENOUGH, LEAST_FORCE, Evidence
from rft_ros.diagnosis.finding import Finding
from rft_ros.diagnosis.fit import MOMENTS_COUNT, TOOL_TOLERANCE_SHARE, Setup
from rft_ros.diagnosis.search import Diagnosis, diagnose
from rft_ros.diagnosis.sentences import of_diagnosis
from rft_ros.diagnosis.trial import Trial
from rft_ros.rft import FORCE, POSE

_SENDING_NAMES = {
    "units",
    "mesh",
    "noise",
    "threshold",
    "sensor",
    "rounded poses",
    "repeated poses",
}
"""Findings on what was sent, which need no model."""
_AT_STOPS = "delay"
"""The finding that only stops and turns show: they are short, and hardly count in a fit over stretches of the path."""


def examine(
    e: Evidence, judge: Callable[[Evidence], Iterable[Finding]], *, has_search: bool
) -> Iterator[Finding]:
    """The findings on a cell. `judge`: the searches that are decided between.

    `has_search`: whether the causes of a misfit are searched, which takes seconds.
    """
    hidden = [*jumps(e), *dead_axes(e)]
    if hidden:
        yield from hidden
        return
    findings = list(judge(e))
    sending_findings = [finding for finding in findings if finding.name in _SENDING_NAMES]
    if len(e.time) < ENOUGH or not all(finding.ok for finding in sending_findings):
        yield from findings
        return
    diagnosis = diagnose(followed(e), setup_of(e), has_search=has_search)
    causes = list(of_diagnosis(e, diagnosis))
    names = {finding.name for finding in findings if not finding.ok}
    is_decided = bool(causes) or diagnosis.is_right
    if not (is_decided and _is_pushed(e, diagnosis)):
        yield from findings
    elif {cause.name for cause in causes} == names and all(cause.remedy for cause in causes):
        # they agree, and a search knows its own numbers better, such as a bias from the air alone
        yield from findings
    elif causes:
        yield from sending_findings
        yield from causes
    else:
        yield from (finding for finding in findings if finding.ok or finding.name == _AT_STOPS)


def _is_pushed(e: Evidence, diagnosis: Diagnosis) -> bool:
    """Whether grains push the tool, in the load cell and in the model of the cell as it is mended."""
    measured_force = np.abs(e.raw[:, FORCE] - np.median(e.raw[:, FORCE], axis=0)).max()
    modelled_force = np.abs(diagnosis.fit.model[:, FORCE]).max(initial=0.0)
    return bool(measured_force >= LEAST_FORCE and modelled_force > 0.0)


def followed(e: Evidence) -> Trial:
    """The trial of a cell, without the noise of its poses, at `MOMENTS_COUNT`."""
    readings = e.load_cell.sign * e.raw
    if e.settings.sensor_source == "world":
        to_world = e.cell_along.to_world
        parts = readings.reshape(-1, 2, 3)
        readings = np.einsum("nij,nkj->nki", to_world, parts).reshape(-1, 6)
    trial = Trial(
        time=e.time, poses=e.state[:, POSE], wrench_time=e.time, wrenches=np.asarray(readings)
    )
    return trial.followed(e.tool.plates.reach, MOMENTS_COUNT)


def setup_of(e: Evidence) -> Setup:
    """What is given of a cell, with a reduced tool, and the bias by a replay's tare."""
    cell = e.load_cell
    if e.tare:
        first = e.at(e.time <= e.tare)
        bias = cell.sign * first.measured.mean(axis=0) + np.array(cell.bias)
        fx, fy, fz, tx, ty, tz = bias.tolist()
        cell = replace(cell, bias=(fx, fy, fz, tx, ty, tz))
    return Setup(
        cell=cell,
        tool=e.tool.reduced(TOOL_TOLERANCE_SHARE),
        law=e.law,
        surface=e.settings.surface_height,
        reads_in_world=e.settings.sensor_source == "world",
        has_torque=e.has_torque,
    )

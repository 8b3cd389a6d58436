"""Examines a cell: checks of what was sent, and then the causes of the misfit between load cell and model."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rft_ros.diagnosis.evidence import ENOUGH, Evidence
from rft_ros.diagnosis.finding import Finding
from rft_ros.diagnosis.fit import MOMENTS_COUNT, TOLERANCES, TOOL_TOLERANCE_SHARE, Setup
from rft_ros.diagnosis.hypotheses import Cause, is_still
from rft_ros.diagnosis.poses import (
    jumps,
    noise_of_poses,
    repeated_poses,
    rounded_poses,
    rows_of_new_poses,
    size_of_tool,
    unit_of_poses,
)
from rft_ros.diagnosis.readings import cut_off, dead_axes, mount, threshold
from rft_ros.diagnosis.saturation import saturation
from rft_ros.diagnosis.search import (
    LIMITS,
    MAX_RIGHT_FACTOR,
    MAX_SINGLE_FACTOR,
    Diagnosis,
    Search,
    diagnose,
)
from rft_ros.diagnosis.sentences import of_diagnosis, of_right_cell
from rft_ros.diagnosis.trial import Trial
from rft_ros.rft import FORCE, POSE

MIN_CLEAR_MOMENTS = 10
"""Moments in the air that show the zero of the load cell."""
MIN_PUSH_NOISES = 10.0
"""Change of the measured force over its noise by which a push is seen, whatever its unit."""
SEEN_IN_AIR = {Cause.BIAS, Cause.WEIGHT, Cause.PAYLOAD}
"""Causes that need no push."""


def examine(e: Evidence, search: Search = "full") -> Iterator[Finding]:
    """The findings on a cell; a cause comes before its effects.

    `search`: when causes other than numbers are searched, which takes seconds.
    """
    length_findings = list(_of_lengths(e))
    yield from length_findings
    if not all(finding.ok for finding in length_findings):
        return
    # poses that are too coarse for a velocity and a depth, or too noisy
    pose_findings = list(rounded_poses(e))
    if not pose_findings:
        repeated_findings = list(repeated_poses(e))
        yield from repeated_findings
        pose_findings = [] if repeated_findings else list(noise_of_poses(e))
    yield from pose_findings
    if pose_findings:
        return
    mount_findings = list(mount(e))
    yield from mount_findings
    yield from threshold(e)
    cut_off_findings = list(cut_off(e))
    yield from cut_off_findings
    if 0 < len(e.time) < ENOUGH:
        sentence = f"{len(e.time)} poses have a reading of the load cell, and {ENOUGH} are needed to judge"
        yield Finding(
            name="sign",
            ok=not e.complete,
            said=sentence,
            advice="record the tool in the air, pushed down, and dragged along x and y",
        )
    if cut_off_findings or len(e.time) < ENOUGH:
        yield from _of_default_surface(e)
        return
    if e.place_on_tf and not all(finding.ok for finding in mount_findings):
        e = replace(e, load_cell=e.load_cell.at(e.place_on_tf))
    yield from _of_forces(e, search)


def _of_lengths(e: Evidence) -> Iterator[Finding]:
    """Lengths in another unit, and what hides everything else: a pose that jumps, and a dead axis."""
    unit_findings = list(unit_of_poses(e))
    yield from unit_findings
    yield from size_of_tool(e)
    if not unit_findings:
        yield from jumps(e)
    yield from dead_axes(e)


def _of_default_surface(e: Evidence) -> Iterator[Finding]:
    if "surface_height" not in e.named:
        given = e.config.surface_height
        yield Finding(
            name="surface_height",
            said=f"{given:g} m, the default, since it is not set",
            advice="measure it, or run rft calibrate",
        )


def _of_forces(e: Evidence, search: Search) -> Iterator[Finding]:
    """The causes of the misfit, or what shows that there is none."""
    diagnosis = diagnose(followed(e), setup_of(e), search)
    max_factor = MAX_SINGLE_FACTOR if diagnosis.causes else 1.0
    if diagnosis.fit.per_stretch > max_factor * diagnosis.problem.usual:
        limits = list(saturation(diagnosis.problem, diagnosis.setup))
        yield from limits
        if limits:
            return
    causes = diagnosis.causes
    surface = diagnosis.setup.surface
    # in the cell as it is mended, or as it was sent
    clear_counts = [(low > surface).sum() for low in (diagnosis.problem.model.low, e.height)]
    if max(clear_counts) < MIN_CLEAR_MOMENTS and e.complete and not e.tare:
        yield Finding(
            name="load cell",
            said="it was hardly seen in the air",
            advice="lift the tool out and run again",
        )
    if not _is_pushed(e, diagnosis):
        yield from _of_default_surface(e)
        yield from of_diagnosis(e, [found for found in causes if found.best.cause in SEEN_IN_AIR])
        # if messages are missing, the push may have been among them
        yield Finding(
            name="sign",
            ok=not e.complete,
            said="no push was seen",
            advice="push the tool down into the grains and run again",
        )
    elif causes:
        yield from of_diagnosis(e, causes)
    elif diagnosis.is_explained:
        yield from of_right_cell(e, diagnosis)
    else:
        yield _of_misfit(e, diagnosis, search)


def _of_misfit(e: Evidence, diagnosis: Diagnosis, search: Search) -> Finding:
    """A misfit that no cause explains."""
    misfit = diagnosis.fit.per_stretch
    usual = MAX_RIGHT_FACTOR * diagnosis.problem.usual
    off = 1e3 * float(diagnosis.fit.values["surface"][0] - diagnosis.setup.surface)
    max_off = 1e3 * LIMITS.told_off * TOLERANCES["surface"].value
    to_check = e.place_parameter or "sensor.quaternion"
    searched = "no cause explains it"
    frame = ""
    if is_still(e.trial):
        frame = "; the poses never turn: check that tool_frame turns with the tool"
    if search == "numbers":
        searched = "rft doctor --bag searches the cause"
    return Finding(
        name="misfit",
        said=f"measured and predicted force do not agree: the misfit is {misfit:.2g} (right cells: up to"
        f" {usual:.2g}), and the grains begin {off:+.1f} mm from surface_height (up to {max_off:.0f}"
        f" mm); {searched}",
        evidence={"own": misfit, "usual": usual},
        advice=f"check {to_check}, sensor.sign, mesh.origin, mesh.quaternion and surface_height"
        + frame,
        spoils_calibration=True,
    )


def _is_pushed(e: Evidence, diagnosis: Diagnosis) -> bool:
    """Whether grains push the tool, in the load cell and in the model of the cell as it is mended."""
    force = e.readings[:, FORCE]
    measured_force = np.abs(force - np.median(force, axis=0)).max()
    noise = float(diagnosis.trial.readings.noise[FORCE].max())
    modelled_force = np.abs(diagnosis.fit.model[:, FORCE]).max(initial=0.0)
    return bool(measured_force > MIN_PUSH_NOISES * noise and modelled_force > 0.0)


def followed(e: Evidence) -> Trial:
    """The trial of a cell, without repeats and noise of its poses, at `MOMENTS_COUNT`, with all readings."""
    trial = e.trial.at(rows_of_new_poses(e.time, e.state[:, POSE]))
    return trial.followed(e.tool.plates.reach, MOMENTS_COUNT)


def setup_of(e: Evidence) -> Setup:
    """What is given of a cell, with a reduced tool."""
    return Setup(
        cell=e.load_cell,
        tool=e.tool.reduced(TOOL_TOLERANCE_SHARE),
        law=e.law,
        surface=e.config.surface_height,
        reads_in_world=e.config.frames.sensor_source == "world",
        has_torque=e.has_torque,
    )

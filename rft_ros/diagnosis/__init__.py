"""The judge of a cell, on arrays of what was sent, measured and predicted: for doctor, calibration and replay alike.

A finding is a parameter of the cell whose fit differs from the given value by more than its errors, or another property
of its set-up. Of several explanations the one that leaves the smallest residual is told, and those that fit alike are
named together. What follows a finding is judged as if that were mended, where a parameter mends it.
"""

from collections.abc import Iterator

from rft_ros.diagnosis.attitude import OF_POSES, attitude, mount
from rft_ros.diagnosis.delay import delay_of_load_cell
from rft_ros.diagnosis.evidence import Evidence, evidence_of, predicted
from rft_ros.diagnosis.finding import Finding, in_words
from rft_ros.diagnosis.poses import (
    noise_of_poses,
    repeated_poses,
    size_of_tool,
    surface,
    unit_of_poses,
)
from rft_ros.diagnosis.readings import push, saturation, strength, torque
from rft_ros.diagnosis.zero import threshold, zero, zero_that_moves

__all__ = ["Evidence", "Finding", "evidence_of", "in_words", "judge", "predicted"]


def _all_right(found: list[Finding]) -> bool:
    return all(finding.ok for finding in found)


def judge(e: Evidence) -> Iterator[Finding]:
    """The findings on a cell; a cause comes before its effects."""
    lengths = [*unit_of_poses(e), *size_of_tool(e)]
    yield from lengths
    if not _all_right(lengths):
        return
    repeated = list(repeated_poses(e))
    noise = [] if repeated else list(noise_of_poses(e))
    yield from (*repeated, *noise, *mount(e))
    if not _all_right(noise):
        return
    if not len(e.time):
        yield surface(e, None, 0.0)
        return
    yield from _of_forces(e)


def _of_forces(e: Evidence) -> Iterator[Finding]:
    yield from threshold(e)
    contact = e.contact
    at_contact = e.at_contact() if contact and abs(contact.above) > contact.allowed else e
    told, mended = attitude(at_contact)
    for moves in zero_that_moves(e):
        if (
            told is None
            or told.ok
            or moves.evidence["left"] < told.evidence["left"] / told.evidence["own"]
        ):
            yield moves
            return
    if told is not None and told.name in OF_POSES:
        yield told
        return
    cell = mended or at_contact
    yield surface(
        e, cell.settings.surface_height if contact else None, contact.allowed if contact else 0.0
    )
    if told is not None:
        yield told
    yield from zero(cell)
    if mended is None:
        return
    missing = [*push(cell), *saturation(cell)]
    yield from missing
    if missing:
        return
    yield from delay_of_load_cell(cell)
    yield from torque(cell)
    yield from strength(cell)

"""The judge of a cell, on arrays of what was sent, measured and predicted: for doctor, calibration and replay alike.

A finding is a parameter of the cell whose fit differs from the given value by more than its errors, or another property
of its set-up. Of several explanations the one that leaves the smallest residual is told, and those that fit alike are
named together. What follows a finding is judged as if that were mended, where a parameter mends it.
"""

from collections.abc import Iterator
from dataclasses import replace

from rft_ros.diagnosis.air import BIAS, MASS, MOMENT, SPREAD, columns_in_air, fit_in_air, spread
from rft_ros.diagnosis.attitude import OF_POSES, attitude, mount
from rft_ros.diagnosis.cell_along import CellAlong
from rft_ros.diagnosis.contact import (
    at_contact,
    contact_of,
    height_above,
    press_states,
    wrenches_at_cell,
)
from rft_ros.diagnosis.delay import delay_of_load_cell
from rft_ros.diagnosis.evidence import Evidence, evidence_of
from rft_ros.diagnosis.examined import examine as _examine
from rft_ros.diagnosis.finding import Finding
from rft_ros.diagnosis.poses import (
    REPEATED,
    noise_of_poses,
    repeated_poses,
    repeats,
    rounded_poses,
    size_of_tool,
    surface,
    unit_of_poses,
    without_repeats,
)
from rft_ros.diagnosis.readings import push, saturation, strength, torque
from rft_ros.diagnosis.zero import threshold, zero, zero_that_moves

__all__ = [
    "BIAS",
    "MASS",
    "MOMENT",
    "REPEATED",
    "SPREAD",
    "CellAlong",
    "Evidence",
    "Finding",
    "columns_in_air",
    "evidence_of",
    "examine",
    "fit_in_air",
    "judge",
    "press_states",
    "repeats",
    "spread",
    "wrenches_at_cell",
]


def _all_right(found: list[Finding]) -> bool:
    return all(finding.ok for finding in found)


def examine(e: Evidence, *, has_search: bool = True) -> Iterator[Finding]:
    """The findings on a cell: those of `judge`, unless one fit of all its numbers knows better (module `examined`).

    `has_search`: whether the fit also searches for causes, which takes seconds.
    """
    yield from _examine(e, judge, has_search=has_search)


def judge(e: Evidence) -> Iterator[Finding]:
    """The findings on a cell; a cause comes before its effects."""
    lengths = [*unit_of_poses(e), *size_of_tool(e)]
    yield from lengths
    if not _all_right(lengths):
        return
    coarse = list(rounded_poses(e))
    repeated = [] if coarse else list(repeated_poses(e))
    if not coarse and not repeated:
        coarse = list(noise_of_poses(e))
    yield from (*repeated, *coarse, *mount(e))
    if coarse:
        return
    if repeated:
        e = without_repeats(e)
    if len(e.time):
        yield from _of_forces(e)
    else:
        yield surface(e, None, e.settings.surface_height)


def _of_forces(e: Evidence) -> Iterator[Finding]:
    contact = contact_of(e)
    placed = e
    if contact:
        above = height_above(e, contact)
        e = replace(e, above=max(above, 0.0))
        placed = e if abs(above) <= contact.allowed else at_contact(e, contact)
    yield from threshold(e)
    told, left, cell, is_known = attitude(placed)
    for moves in zero_that_moves(e):
        if told is None or told.ok or moves.evidence["left"] < left:
            yield moves
            return
    if told and told.name in OF_POSES:
        yield told
        return
    yield surface(e, contact, cell.settings.surface_height)
    if told:
        yield told
    if not is_known:
        return
    in_air = list(zero(cell))
    yield from in_air
    missing = [*push(cell), *saturation(cell)]
    yield from missing
    if missing:
        return
    yield from delay_of_load_cell(cell)
    if not any(finding.name == "units of torque" for finding in in_air):
        yield from torque(cell)
    yield from strength(cell)

"""Where the grains begin: the height of the surface at which the measured force begins, and the model's force there."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rft_ros.diagnosis.cell_along import CellAlong
from rft_ros.diagnosis.evidence import ENOUGH, LEAST_FORCE, Array, Evidence, Indices
from rft_ros.parameters import LoadCell
from rft_ros.rft import (
    FORCE,
    SLACK,
    STATE,
    Law,
    Memory,
    displacements_followed,
    wrenches,
    wrenches_in_time,
)
from rft_ros.rft.frames import TWIST
from rft_ros.tool import Tool

_BEGUN = 0.05  # of the greatest force of a descent: a larger one shows that the tool has touched the grains
_ERROR = 0.005  # m, and this share of the depth: together the greatest error of surface_height
_SHARE = 0.1
_DEPTHS = 50  # depths at which the force of a contact is computed
_ALIKE = 0.94  # cosine of the angle by which the tool may turn on its way down
_FALLS = 0.3  # least speed downwards on the way, of the fastest plate's: a tool that turns in the air is on none


class Contact(NamedTuple):
    """Where the measured force begins on the longest descent.

    `way`: the rows of that; `begins`: which of them. The force there is this `share` of that which is deeper by `rise`
    [m], at the end of the way.
    """

    way: Indices
    begins: int
    rise: float
    share: float

    @property
    def allowed(self) -> float:
        """The greatest error of `surface_height` that the contact shows [m]."""
        return _ERROR + _SHARE * self.rise


def wrenches_at_cell(tool: Tool, law: Law, along: CellAlong, surface: float) -> Array:
    """The model's wrench [N], [N m] in the axes of the load cell about its origin, shape [n, 6].

    `surface` [m]: a height, the same everywhere.
    """
    return along.from_world(_wrenches_in_world(tool, law, along.states, surface))


def press_states(tool: Tool, state: Array, depths: Array) -> Array:
    """States of a press straight down in the attitude of a state, shape [13], into grains whose surface lies at z = 0.

    `depths` of the tool's lowest point [m], shape [m]; the states: shape [m, 13].
    """
    states = np.repeat(state[None], len(depths), axis=0)
    states[:, TWIST] = (0.0, 0.0, -1.0, 0.0, 0.0, 0.0)
    states[:, STATE.index("pz")] -= tool.lowest_points(state[None])[0] + depths
    return states


def _wrenches_in_world(tool: Tool, law: Law, states: Array, surface: float) -> Array:
    plates = tool.plates
    if law.mobilization_length <= 0.0:
        return wrenches(plates, law, states, surface_height=surface)
    moved = displacements_followed(states, reach=plates.reach, dead_band=SLACK)
    return wrenches_in_time(
        plates, law, states, Memory(plates), displacements=moved, surface_height=surface
    )


def contact_of(e: Evidence) -> Contact | None:
    """The contact by the longest descent; None if the force does not begin on it.

    What a wrong sign, mounting, weight or unit does not change is compared: the magnitude of the force as it was read,
    with the tool's weight, over that at the beginning of the way.
    """
    way = _descent(e)
    if len(way) < ENOUGH:
        return None
    measured = e.raw[way, FORCE]
    noise = float(np.linalg.norm(np.std(measured[:ENOUGH], axis=0)))
    force = np.linalg.norm(measured - np.median(measured[:ENOUGH], axis=0), axis=1)
    peak = float(force.max())
    share = max(LEAST_FORCE, _BEGUN * peak, 5.0 * noise) / max(peak, 1e-9)
    begins = _onset(force, share)
    if begins is None:
        return None
    rise = float(e.depth[way[-1]] - e.depth[way[begins]])
    return Contact(way, begins, rise, share)


def _descent(e: Evidence) -> Indices:
    """The rows of the longest way down, each deeper than those before, in about the attitude of the deepest one.

    Where the tool turns in the air to show its weight, it also gets deeper, but does not go down.
    """
    deepest_later = np.maximum.accumulate(e.depth[::-1])[::-1]
    way = np.arange(int((deepest_later - e.depth).argmax()), len(e.depth))
    way = way[np.diff(np.maximum.accumulate(e.depth[way]), prepend=-np.inf) > 0.0]
    falls = -e.velocity[way, 2] >= _FALLS * e.speed[way]
    return np.asarray(way[falls & (e.down[way] @ e.down[way[-1]] > _ALIKE)])


def _onset(force: Array, share: float) -> int | None:
    """The row after which the force exceeds this share of its peak, with the fewest exceptions; None without one."""
    if share >= 0.5:
        return None
    loud = np.where(force > share * force.max(), 1, -1)
    row = int(np.argmax(np.append(loud[::-1].cumsum()[::-1], 0)))
    return row if ENOUGH // 2 <= row <= len(force) - ENOUGH // 2 else None


def height_above(e: Evidence, contact: Contact) -> float:
    """How far above the surface the measured force begins [m], by where the model's does on the same way."""
    expected = _onset(np.linalg.norm(e.model[contact.way], axis=1), contact.share)
    depth = e.depth[contact.way]
    at = 0.0 if expected is None else float(depth[expected])
    return at - float(depth[contact.begins])


def at_contact(e: Evidence, contact: Contact) -> Evidence:
    """As if the surface were where the measured force begins, on a way straight down in the deepest attitude."""
    depths = np.linspace(0.0, 2.0 * contact.rise, 2 * _DEPTHS + 1)
    deepest = int(contact.way[-1])
    pressed = press_states(e.tool, e.state[deepest], depths)
    force = np.linalg.norm(_wrenches_in_world(e.tool, e.law, pressed, 0.0)[:, FORCE], axis=1)
    begun = force[1 : _DEPTHS + 1] >= contact.share * force[_DEPTHS + 1 :]
    raised = contact.rise + float(depths[int(np.argmax(begun)) + 1]) - float(e.depth[deepest])
    height = e.settings.surface_height + raised
    return replace(
        e,
        settings=replace(e.settings, surface_height=height),
        depth=e.depth + raised,
        above=0.0,
        predicted=wrenches_at_cell(e.tool, e.law, e.cell_along, height),
    )


def seen(e: Evidence, states: Array, cell: LoadCell) -> Evidence:
    """As if the states and the load cell's place were these, and the surface where the measured force begins."""
    depth = e.settings.surface_height - e.tool.lowest_points(states)[0]
    as_if = replace(e, state=states, load_cell=cell, depth=depth)
    as_if = replace(as_if, measured=e.with_weight - as_if.cell_along.weight)
    contact = contact_of(as_if)
    if contact is None:
        return replace(as_if, predicted=np.zeros_like(e.predicted))
    return at_contact(as_if, contact)

"""Fit the load cell, the surface, ζ and λ to recordings: each with its error, or why it is not identifiable.

The tracks go through steps, each a function, and are named by the last one: as sent; placed, with the place of the
load cell and without repeated poses; timed, with its delay; weighed, with the bias of the load cell and the weight of
the tool. Then the grains are fitted to them, without the force of the grains' inertia.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rft_ros.calibration.delay import fit_delay
from rft_ros.calibration.fitting import FitResults, NotIdentifiable
from rft_ros.calibration.grains import FILE_SURFACE_ERROR_M, Given, fit_grains
from rft_ros.calibration.phases import Contact, find_contacts
from rft_ros.calibration.recorded import BedValues, Recorded
from rft_ros.calibration.suspicion import judge_fitted, refuse_implausible
from rft_ros.calibration.tool_weight import fit_tool_weight
from rft_ros.calibration.track import Track, thinned
from rft_ros.diagnosis import rows_of_new_poses
from rft_ros.errors import InputError
from rft_ros.parameters import (
    Config,
    LoadCell,
    MediumConfig,
    Values,
    load_parts,
)
from rft_ros.rft import FORCE, POSE, Law, rotate_vectors, wrenches
from rft_ros.rft.frames import Placement

PARTS = ("sensor", "surface", "zeta", "mobilization")
"""What can be fitted: delay, bias, mass and centre of mass; surface height; ζ; λ."""

MAX_RATE_HZ = 125.0
"""Moments per second that are fitted: of the rates with which the errors were found right, the least."""

MAX_SURFACE_MOVE_M = 0.02
"""Beds are levelled to some millimetres. A mesh upside down or another TCP moves the surface by the tool's length."""

_CONTACT_ROUNDS_COUNT = 5
"""Fits of the contacts and of the force of inertia in turn, each with the result of the other."""

_MIN_AIR_CLEARANCE_M = 0.002
"""A still tool is in the air if its lowest point is this much above the surface."""


class _Surface(NamedTuple):
    """The surface height [m], the height above which all is air [m], and the first contacts; [] if there are none."""

    height: float
    air: float
    contacts: list[Contact]


def calibrate(
    tracks_sent: Sequence[Track],
    parameters: Config | Values,
    *,
    parts: Collection[str] = PARTS,
    trusts_surface: bool = False,
) -> FitResults:
    """Fit `parts` to the tracks. Other values, and those that are not identifiable, are taken from `parameters`.

    `parameters`: the node's, all or some by name. `trusts_surface`: their surface height is known, so that a fitted one
    far from it shows a fault. If the result has `refusals`, it has no values. Raises InputError for no recordings,
    for one that `refuse_implausible` refuses, and, if
    sensor.frame_source is tf, for one whose transforms give no place of the load cell, or another than the first one's.
    """
    if not tracks_sent:
        raise InputError("there is no recording to calibrate from; give one or more")
    config = Config.of(parameters)
    result = FitResults()
    for track in tracks_sent:
        refuse_implausible(track)
    cell = _placed_cell(config, tracks_sent)
    tracks_on_cell = [replace(track, cell=cell) for track in tracks_sent]
    tracks_placed = [thinned(_without_repeats(track), MAX_RATE_HZ) for track in tracks_on_cell]
    law = _law_of(config.medium)
    surface_placed = _surface(
        result, tracks_placed, law, parts, configured_height=config.surface_height
    )

    length = config.medium.mobilization_length
    tracks_timed = tracks_placed
    delay_error = 0.0
    if "sensor" in parts:
        with result.or_reason("sensor.delay"):
            tracks_timed, delay_error = _timed(
                result, tracks_placed, law, surface_placed, configured_delay=config.sensor.delay
            )
    surface = _surface(result, tracks_timed, law, parts, configured_height=config.surface_height)
    tracks_weighed = tracks_timed
    if "sensor" in parts:
        with result.or_reason("sensor.bias"):
            weighed_cell = fit_tool_weight(
                result, tracks_timed, air=surface.air + _MIN_AIR_CLEARANCE_M
            )
            tracks_weighed = [replace(track, cell=weighed_cell) for track in tracks_timed]

    given_values = Given(
        values=BedValues(surface.height, math.log(length) if length > 0.0 else -math.inf),
        surface_error=0.0 if surface.contacts or "surface" not in parts else FILE_SURFACE_ERROR_M,
        delay_error=delay_error,
    )
    fit_grains(
        result,
        _recordings(tracks_weighed, law, surface),
        contacts=surface.contacts if "surface" in parts else (),
        given_values=given_values,
        parts=parts,
    )
    _check_surface(result, config.surface_height, trusts_surface=trusts_surface)
    judge_fitted(result, tracks_on_cell, config)
    if result.refusals:
        result.fitted_values.clear()
        result.motions.clear()
    return result


def _check_surface(result: FitResults, configured_height: float, *, trusts_surface: bool) -> None:
    """Refuse a surface far from `configured_height` [m], or warn of it if that height is not to be trusted."""
    for fit in result.fitted_values:
        height_offset = fit.values[0] - configured_height
        if fit.name == "surface_height" and abs(height_offset) > MAX_SURFACE_MOVE_M:
            side = "above" if height_offset > 0.0 else "below"
            where = f"{fit.values[0]:.4g} m, {1e3 * abs(height_offset):.0f} mm {side} the file's {configured_height:g}"
            causes = "mesh.origin, mesh.quaternion, mesh.scale and the poses"
            sentence = f"surface_height: the force begins at {where}: check {causes}"
            if trusts_surface:
                remedy = "if the file's surface_height is what is wrong, add --fit surface"
                result.refusals.append(f"{sentence}; {remedy}")
            else:
                result.warnings.append(sentence)


def _placed_cell(config: Config, tracks: Sequence[Track]) -> LoadCell:
    """The load cell of the config, with its place from the recordings' transforms if they are its source."""
    frames = config.frames
    if frames.sensor_source != "tf":
        return config.sensor
    places: list[Placement] = []
    for track in tracks:
        if track.mount is None:
            link = f"tool_frame '{frames.tool}' and sensor_frame '{frames.sensor}'"
            raise InputError(
                f"{track.name}: no fixed transforms link {link}, as sensor.frame_source tf needs"
            )
        places.append(track.mount)
        if not places[0].is_at(track.mount):
            raise InputError(
                f"{tracks[0].name} and {track.name}: their transforms place the load cell differently; calibrate each "
                "of the two mountings on its own"
            )
    return config.sensor.at(places[0])


def _without_repeats(track: Track) -> Track:
    """The recording without the moments at which a moving tool has the pose of the moment before."""
    rows = rows_of_new_poses(track.time, track.states[:, POSE])
    return replace(
        track, time=track.time[rows], states=track.states[rows], readings=track.readings[rows]
    )


def _law_of(medium: MediumConfig) -> Law:
    """The law at ζ = 1, without memory."""
    return replace(medium, zeta=1.0, mobilization_length=0.0).law_of(load_parts(medium.parts()))


def _recordings(tracks: Sequence[Track], law: Law, surface: _Surface) -> list[Recorded]:
    """The tracks without the force of the grains' inertia."""
    slow = replace(law, density=0.0)
    return [
        Recorded(track=_without_inertia(track, law, surface.height), law=slow, air=surface.air)
        for track in tracks
    ]


def _surface(
    result: FitResults,
    tracks: Sequence[Track],
    law: Law,
    parts: Collection[str],
    *,
    configured_height: float,
) -> _Surface:
    """The surface from the first contacts, or `configured_height` [m] if there are none or it is not fitted."""
    try:
        contacts = _contacts(tracks, law)
    except NotIdentifiable as reason:
        if "surface" in parts:
            result.not_identifiable["surface_height"] = str(reason)
        return _Surface(height=configured_height, air=configured_height, contacts=[])
    # before its delay was known there may have been none
    result.not_identifiable.pop("surface_height", None)
    height = _mean_height(contacts) if "surface" in parts else configured_height
    air = max(height, *(contact.surface for contact in contacts))
    return _Surface(height=height, air=air, contacts=contacts)


def _mean_height(contacts: Sequence[Contact]) -> float:
    return float(np.mean([contact.surface for contact in contacts]))


def _contacts(tracks: Sequence[Track], law: Law) -> list[Contact]:
    """The first contacts; the force of inertia and the surface depend on each other, so they are found in turns.

    Raises NotIdentifiable if there are none.
    """
    slow = replace(law, density=0.0)
    contacts = find_contacts(tracks, slow)
    for _ in range(_CONTACT_ROUNDS_COUNT - 1 if law.has_inertia else 0):
        tracks_slow = [_without_inertia(track, law, _mean_height(contacts)) for track in tracks]
        contacts = find_contacts(tracks_slow, slow)
    return contacts


def _without_inertia(track: Track, law: Law, surface: float) -> Track:
    """The recording without the force of the grains' inertia, which ζ does not scale; surface at this height [m]."""
    if not law.has_inertia:
        return track
    full, slow = (
        wrenches(track.tool.plates, each, track.states, surface_height=surface)
        for each in (law, replace(law, density=0.0))
    )
    force = rotate_vectors(track.cell_along.from_world_axes, (full - slow)[:, FORCE])
    readings = track.readings.copy()
    readings[:, FORCE] -= track.cell.sign * force
    return replace(track, readings=readings)


def _timed(
    result: FitResults,
    tracks: Sequence[Track],
    law: Law,
    surface: _Surface,
    *,
    configured_delay: float,
) -> tuple[list[Track], float]:
    """The tracks with the delay of the load cell, and its standard error [s].

    `configured_delay`: the delay of the parameters [s]. Raises NotIdentifiable if no turn determines the delay.
    """
    recordings = _recordings(tracks, law, surface)
    delay = fit_delay(recordings, surface.height, configured_delay=configured_delay)
    result.fitted_values.append(delay)
    late = delay.values[0] - configured_delay
    return [track.without_delay(late) for track in tracks], delay.errors[0]

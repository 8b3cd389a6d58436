"""Fit the load cell, the surface, ζ, λ and α_y to recordings: each with its error, or why it is not identifiable."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rft_ros.calibration.alpha_y import AlphaYFit, AlphaYModel, fit_alpha_y, plate_runs
from rft_ros.calibration.fitting import FitResults, NotIdentifiable
from rft_ros.calibration.grains import fit_grains
from rft_ros.calibration.phases import Contact, find_contacts, fit_delay
from rft_ros.calibration.recorded import BedValues, recorded
from rft_ros.calibration.suspicion import refuse_implausible, suspicions, without_repeats
from rft_ros.calibration.tool_weight import fit_tool_weight
from rft_ros.calibration.track import Track, moved_back
from rft_ros.errors import InputError
from rft_ros.estimator import LoadCell, Settings
from rft_ros.parameters import Values, model_of, settings_of
from rft_ros.rft import FORCE, Law, Treers2021, wrenches

__all__ = ["PARTS", "Calibration", "calibrate"]

PARTS = ("sensor", "surface", "zeta", "mobilization", "alpha_y")
"""What can be fitted: delay, bias, mass and centre of mass; surface height; ζ; λ; α_y."""

_ROUNDS = 5  # of contacts and force of inertia, each with the result of the other
_CLEAR = 0.002  # a still tool is in the air if its lowest point is this much [m] above the surface


@dataclass(slots=True)
class Calibration(FitResults):
    """Results of all fits. `alpha_y`: the fit of α_y, which is written as parameters and a table."""

    alpha_y: AlphaYFit | None = None


def calibrate(
    tracks: Sequence[Track], values: Values, *, parts: Collection[str] = PARTS, alpha_y: AlphaYModel = "auto"
) -> Calibration:
    """Fit `parts` to the tracks. Other values, and those that are not identifiable, are taken from `values`.

    `values`: the node's parameters. Raises InputError for a recording that `refuse_implausible` refuses, and, if
    sensor.frame_source is tf, for one whose transforms give no place of the load cell, or another than the first one's.
    """
    for track in tracks:
        refuse_implausible(track)
    settings, result = settings_of(values), Calibration()
    cell, zero_error = _placed_cell(settings, tracks), 0.0
    sent, tracks = tracks, [without_repeats(replace(track, cell=cell)) for track in tracks]
    # only the law of this model is used, so any tool will do; fits assume level ground
    at_one = {**values, "ground.cell": 0.0, "ground.file": "", "medium.zeta": 1.0}
    inertial = model_of(at_one, tool=tracks[0].tool).law
    law = replace(inertial, density=0.0, mobilization_length=0.0)

    height = air = settings.surface_height
    contacts: list[Contact] = []
    try:  # also if the surface is not fitted, since what counts as air depends on the contacts
        contacts = _contacts(tracks, inertial, law)
    except NotIdentifiable as reason:
        if "surface" in parts:
            result.not_identifiable["surface_height"] = str(reason)
    if contacts:
        if "surface" in parts:
            height = _mean_surface(contacts)
        air = max(height, *(contact.surface for contact in contacts))
    with_memory = replace(law, mobilization_length=values["medium.mobilization_length"])
    for as_sent, track in zip(sent, tracks, strict=True):
        result.warnings += suspicions(as_sent, track, settings, with_memory, surface=height)
    length = float(values["medium.mobilization_length"])
    given = BedValues(settings.surface_height, math.log(length) if length > 0.0 else -math.inf)
    recordings = [recorded(_without_inertia(track, inertial, law, height), law, surface=air) for track in tracks]
    delay_error = 0.0
    if "sensor" in parts:
        with result.or_reason("sensor.delay"):
            fitted_delay = fit_delay(recordings, height, given=settings.load_cell.delay)
            result.fitted.append(fitted_delay)
            delay, delay_error = fitted_delay.values[0] - settings.load_cell.delay, fitted_delay.errors[0]
            tracks = [replace(t, readings=moved_back(t.time, t.readings, delay)) for t in tracks]
            if contacts:
                contacts = _contacts(tracks, inertial, law)
                height = _mean_surface(contacts) if "surface" in parts else height
    tracks = [_without_inertia(track, inertial, law, height) for track in tracks]

    if "sensor" in parts:
        with result.or_reason("sensor.bias"):
            cell, zero_error = fit_tool_weight(result, tracks, air=air + _CLEAR)
            tracks = [replace(track, cell=cell) for track in tracks]
    fit_grains(
        result,
        [replace(one, track=track) for one, track in zip(recordings, tracks, strict=True)],
        contacts=contacts,
        given=given,
        parts=parts,
        zero_error=zero_error,
        delay_error=delay_error,
    )
    if "alpha_y" in parts:
        found = {fit.name: (fit.values[0], fit.errors[0]) for fit in result.fitted}
        height, height_error = found.get("surface_height", (height, 0.0))
        zeta, zeta_error = found.get("medium.zeta", (values["medium.zeta"], 0.0))
        with result.or_reason("alpha_y"):
            if not isinstance(law, Treers2021):
                raise NotIdentifiable(f"law {values['law']} does not use α_y")
            runs = plate_runs(tracks, replace(law, zeta=zeta), surface=height, zero_error=zero_error)
            shared = float(np.hypot(zeta_error / zeta, height_error / np.mean([run.depth for run in runs])))
            result.alpha_y = fit_alpha_y(runs, law.medium, shared_error=shared, model=alpha_y)
            result.fitted.append(result.alpha_y.value)
    return result


def _placed_cell(settings: Settings, tracks: Sequence[Track]) -> LoadCell:
    """The load cell of the settings, with its place from the recordings' transforms if they are its source."""
    if settings.sensor_source != "tf":
        return settings.load_cell
    first = tracks[0]
    for track in tracks:
        if track.mount is None:
            link = f"tool_frame '{settings.tool_frame}' and sensor_frame '{settings.sensor_frame}'"
            raise InputError(f"{track.name}: no fixed transforms link {link}, as sensor.frame_source tf needs")
        if first.mount is not None and not first.mount.is_at(track.mount):
            raise InputError(
                f"{first.name} and {track.name}: their transforms place the load cell differently; calibrate each of "
                "the two mountings on its own"
            )
    assert first.mount is not None
    return replace(settings.load_cell, position=first.mount.position, quaternion=first.mount.quaternion)


def _contacts(recorded: Sequence[Track], inertial: Law, law: Law) -> list[Contact]:
    """The first contacts; the force of inertia and the surface depend on each other, so they are found in turns.

    Raises NotIdentifiable if there are none.
    """
    contacts = find_contacts(recorded, law)
    for _ in range(_ROUNDS - 1 if inertial.has_inertia else 0):
        surface = _mean_surface(contacts)
        tracks = [_without_inertia(track, inertial, law, surface) for track in recorded]
        contacts = find_contacts(tracks, law)
    return contacts


def _mean_surface(contacts: Sequence[Contact]) -> float:
    return float(np.mean([contact.surface for contact in contacts]))


def _without_inertia(track: Track, inertial: Law, law: Law, height: float) -> Track:
    """The recording without the force of the grains' inertia, which ζ does not scale; surface at `height` [m]."""
    if not inertial.has_inertia:
        return track
    fast, slow = (wrenches(track.tool.plates, x, track.states, surface_height=height) for x in (inertial, law))
    force = np.einsum("nji,nj->ni", track.sensor_rotations, (fast - slow)[:, FORCE])
    return replace(track, readings=track.readings - track.cell.sign * np.pad(force, ((0, 0), (0, 3))))

"""Checks of what the load cell sends, which need no model of the grains."""

from collections.abc import Iterator
from itertools import product

import numpy as np

from rft_ros.diagnosis.evidence import ENOUGH, Evidence
from rft_ros.diagnosis.finding import Finding, in_words
from rft_ros.diagnosis.trial import Array, resolutions
from rft_ros.rft import FORCE, POSE

DEAD_SHARE = 1e-3
"""Of the changes of the other axes: those of a dead axis are smaller."""
MIN_TURN_SHARE = 0.25
"""Of the changes of a reading, the share that reverses the one before: two thirds with white noise, none without."""
MIN_NOISE_SHARE = 1e-9
"""Of the greatest reading: rounding makes less."""
MIN_AT_LIMIT = 20
"""Readings at the greatest value from which on they may be cut off."""
MIN_NOISES_BELOW_LIMIT = 4.0
"""How near to it other readings would lie, by the noise, if they were not."""


def dead_axes(e: Evidence) -> Iterator[Finding]:
    """An axis of the force that always reads the same while another has noise: without noise, symmetry does that."""
    force = e.readings[:, FORCE]
    if len(force) < ENOUGH:
        return
    changes = np.ptp(force, axis=0)
    dead = np.flatnonzero(changes <= DEAD_SHARE * changes.max())
    if _has_noise(force[:, changes.argmax()]) and len(dead):
        which = " and ".join("xyz"[axis] for axis in dead)
        yield Finding(
            name="dead axis",
            said=f"the force along {which} reads {force[0, dead[0]]:.3g} N throughout",
            advice="check the load cell's cable and its driver",
            spoils_calibration=True,
        )


def _has_noise(readings: Array) -> bool:
    """Whether readings, shape [n], have noise, as those of a simulation do not."""
    steps = np.diff(readings)
    return bool(np.mean(steps[1:] * steps[:-1] < 0.0) > MIN_TURN_SHARE)


def threshold(e: Evidence) -> Iterator[Finding]:
    """A driver that sets small readings to zero: many are exactly 0, and at rest others have noise."""
    force = e.readings[:, FORCE]
    is_zero = ~force.any(axis=1)
    rest_force = force[(e.speed < e.config.inputs.rest_speed) & ~is_zero]
    if min(is_zero.sum(), len(rest_force)) < ENOUGH:
        return
    usual_steps = np.median(np.abs(np.diff(rest_force, axis=0)), axis=0)
    # readings in coarse steps are 0 without a threshold
    if (usual_steps > resolutions(rest_force)).any():
        yield Finding(
            name="threshold",
            said="the force in the air is exactly 0, with no noise",
            advice="turn the threshold off in the driver; without it the measured contact comes late",
        )


def cut_off(e: Evidence) -> Iterator[Finding]:
    """Components of the force that stop at a limit of the load cell or its driver.

    There they have no noise while the tool moves: the greatest reading repeats more often than others come near it. A
    simulated recording has no noise either, and repeats its readings where the tool rests.
    """
    if len(e.time) < ENOUGH:
        return
    moves = np.append((np.diff(e.state[:, POSE], axis=0) != 0.0).any(axis=1), False)
    rounding = MIN_NOISE_SHARE * float(np.abs(e.readings[:, FORCE]).max())
    for axis, side in product(range(FORCE.stop), (1.0, -1.0)):
        readings = side * e.readings[moves, axis]
        limit = readings.max(initial=-np.inf)
        is_below = readings < limit - rounding
        below = readings[is_below]
        # too few for second differences, or the limit is the zero
        if len(below) <= 2 or side * e.readings[0, axis] >= limit - rounding:
            continue
        at_limit = int((~is_below).sum())
        noise = 1.48 * np.median(np.abs(np.diff(below, 2))) / 6.0**0.5
        near = int((below >= limit - MIN_NOISES_BELOW_LIMIT * noise).sum())
        has_noise = noise > rounding and _has_noise(below)
        if has_noise and at_limit >= MIN_AT_LIMIT and at_limit > near:
            yield saturated(axis, f"stops at {side * limit:.4g} N, {at_limit} times", side * limit)


def saturated(axis: int, said: str, limit: float) -> Finding:
    """The finding on an axis of the force that is at a limit [N]."""
    return Finding(
        name="saturation",
        said=f"the force along {'xyz'[axis]} {said}",
        evidence={"limit": limit},
        advice="set a larger range in the load cell or its driver, or press less",
        spoils_calibration=True,
    )


def mount(e: Evidence) -> Iterator[Finding]:
    """The sensor's place in the parameters against that on /tf_static, if both have it."""
    frames = e.config.frames
    place = e.place_on_tf
    if place is None or frames.sensor_source == "tf" or frames.tool == frames.sensor:
        return
    given = e.load_cell.place
    if given.is_at(place):
        yield Finding(name="sensor", ok=True, said="the parameters and /tf_static agree")
        return
    moved, turn = given.apart(place)
    degrees = float(np.degrees(turn))
    millimetres = 1e3 * moved
    yield Finding(
        name="sensor",
        said=f"the parameters differ from /tf_static by {degrees:.0f} degrees and {millimetres:.0f} mm",
        evidence={"degrees": degrees, "millimetres": millimetres},
        remedy={"sensor.frame_source": "tf"},
        advice=f"set sensor.position: {in_words(place.position)} and sensor.quaternion: {in_words(place.quaternion)}",
    )

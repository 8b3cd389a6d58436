"""Hypotheses on the load cell: its zero, range, axes, sign, units, and place on the tool."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from rft_ros.diagnosis.evidence import ENOUGH, LEAST_FORCE, Array, Evidence, Finding, listed
from rft_ros.estimator.tare import is_offset
from rft_ros.rft import FORCE, TORQUE
from rft_ros.rft.frames import Placement

__all__ = ["axes", "lever", "mount", "push", "saturation", "strength", "unit_of_torque", "unseen_air", "zero"]
__all__ += ["zero_that_moves"]

_ALIKE = 0.5  # least correlation of the measured and the predicted force along an axis
_CARRIES = 0.2  # of the strongest axis's force: an axis with less is not judged
_POOR = 0.05  # misfit of axes beyond which others are tried although every axis agrees
_AS_GOOD, _SLACK = 1.5, 0.02  # misfits up to this factor of the best one plus this are as good
_WEAKEST, _STRONGEST = 0.5, 2.0  # measured over predicted: beds differ by less once they are calibrated
_UNITS = {"kgf": 9.80665, "lbf": 4.44822, "kN": 1e3, "mN": 1e-3, "gf": 9.80665e-3}  # N
_TURNS = Rotation.create_group("O")  # the 24 turns by multiples of 90 degrees
_LEVER, _LEVER_OF_SIZE = 0.01, 0.25  # m, and of the tool's size: the model does not give the lever more exactly
_LONGEST_LEVER = 2.0  # m: a longer one comes from a torque in another unit
_NOISE_OF_LEVER = 0.1  # of the misfit of the torque; with more, no lever is judged
_SHOWS = 0.01  # of the greatest force: over a whole approach a smaller offset shows than in live readings
_EXPLAINED = 0.25  # of a misfit: the greatest rest under a hypothesis that explains it


def zero(e: Evidence) -> Iterator[Finding]:
    """The mean force in the air, which a tared cell does not have."""
    air = ~e.in_grains
    if air.sum() < ENOUGH:
        return
    load, greatest = float(np.linalg.norm(e.force[air].mean(axis=0))), float(np.linalg.norm(e.force, axis=1).max())
    said = f"{load:.3g} N in the air"
    if e.tare:
        said += f"; a replay tares over its first {e.tare:g} s; for the node call ~/tare in the air"
    elif is_offset(load, greatest, share=_SHOWS):
        advice = "tare it there (~/tare, --tare), or calibrate sensor.bias and sensor.mass"
        yield Finding(False, f"load cell: it reads {said}; {advice}; after a tare, check surface_height")
        return
    yield Finding(True, f"load cell: {said}")


def unseen_air(e: Evidence) -> Iterator[Finding]:
    """Whether the load cell's zero was seen."""
    if len(e.time) and e.complete and not e.tare and (~e.in_grains).sum() < ENOUGH:
        yield Finding(False, f"load cell: in the air at fewer than {ENOUGH} poses; lift the tool out and run again")


def zero_that_moves(e: Evidence) -> Iterator[Finding]:
    """A force in the air that reverses with the motion, as of friction in joints or a dragging seal.

    It must not be a drift, which a line in time explains, nor a weight that turns with the tool, nor grains below the
    expected surface, whose force varies while the tool moves one way.
    """
    rows = np.flatnonzero(~e.in_grains)
    if len(rows) < 2 * ENOUGH:
        return
    velocity, force, time = e.velocity[rows], e.force[rows], e.time[rows] - e.time[rows].mean()
    size = np.linalg.norm(velocity, axis=1, keepdims=True)
    main = np.linalg.svd(velocity / np.maximum(size, e.settings.rest_speed), full_matrices=False)[2][0]
    main = main if main[2] >= 0.0 else -main  # up
    way = np.where(e.speed[rows] > e.settings.rest_speed, np.sign(np.round(velocity @ main, 6)), 0.0)
    groups = {name: way == side for name, side in (("at rest", 0.0), ("one way", -1.0), ("back", 1.0))}
    groups = {name: group for name, group in groups.items() if group.sum() >= ENOUGH}
    if len(groups) < 2:
        return
    down = e.to_cell[rows].apply((0.0, 0.0, -1.0))
    known = np.column_stack([np.ones_like(time), time, down])
    columns = np.column_stack([known, way])
    without = force - known @ np.linalg.lstsq(known, force, rcond=None)[0]
    found = np.linalg.lstsq(columns, force, rcond=None)[0]
    rest, of_motion = force - columns @ found, found[-1]
    friction, spread = float(np.linalg.norm(of_motion)), float(np.sqrt((rest**2).sum(axis=1).mean()))
    greatest = float(np.linalg.norm(e.predicted[:, FORCE], axis=1).max(initial=0.0))
    explains = (rest**2).sum() < 0.6 * (without**2).sum() and spread < friction
    if not explains or not is_offset(friction, greatest, share=0.03):
        return
    levels = {name: float(force[group].mean(axis=0) @ of_motion) / friction for name, group in groups.items()}
    shown = ", ".join(f"{level:.3g} N {name}" for name, level in levels.items())
    advice = "use a load cell at the tool, or free the seal; a tare cannot remove it, and calibrate would trust it"
    yield Finding(False, f"zero that moves: the reading in the air depends on the motion: {shown}; {advice}")


def mount(e: Evidence) -> Iterator[Finding]:
    """The sensor's place in the parameters against that on /tf_static, if both have it."""
    s, cell, place = e.settings, e.load_cell, e.place_on_tf
    if place is None or s.sensor_source == "tf" or s.tool_frame == s.sensor_frame:
        return
    given = Placement(cell.position, cell.quaternion)
    if given.is_at(place):
        yield Finding(True, "sensor: the parameters and /tf_static agree")
        return
    moved, turn = given.apart(place)
    differ = f"the parameters differ from /tf_static by {np.degrees(turn):.0f} degrees and {1e3 * moved:.0f} mm"
    there = f"on /tf_static: position {listed(place.position)}, quaternion {listed(place.quaternion)}"
    yield Finding(False, f"sensor: {differ} ({there}); set sensor.frame_source: tf, or correct one of the two")


def push(e: Evidence) -> Iterator[Finding]:
    """Whether grains have pushed the tool: the other hypotheses on forces need it."""
    if not e.push_is_seen:
        # if messages are missing, the push may have been among them
        yield Finding(not e.complete, "sign: no push was seen; push the tool down into the grains and run again")


def saturation(e: Evidence) -> Iterator[Finding]:
    """A component stays at its greatest reading while the prediction, which it followed so far, grows on.

    Readings count from the one in the air, which an offset or the tool's weight moves; without it nothing is known.
    """
    air, wet = ~e.in_grains, e.in_grains
    if min(air.sum(), wet.sum()) < ENOUGH:
        return
    step, zero = np.diff(e.raw, axis=0), np.median(e.raw[air], axis=0)
    noise = 1.48 * np.median(np.abs(step - np.median(step, axis=0)), axis=0) / np.sqrt(2.0)
    weight = e.weight - np.median(e.weight[air], axis=0)  # it varies where the tool turns
    for axis, side in product(range(3), (1.0, -1.0)):
        reading = side * (e.raw[wet, axis] - zero[axis])
        expected = side * (e.predicted[wet, axis] + weight[wet, axis])
        top = float(np.quantile(reading, 0.995))
        below, band = (reading > 0.2 * top) & (reading < 0.9 * top), max(4.0 * noise[axis], 1e-6 * abs(top))
        at = reading >= top - band
        if top < LEAST_FORCE or below.sum() < ENOUGH or at.sum() < ENOUGH:
            continue
        ratio = (reading * expected)[below].sum() / max((expected[below] ** 2).sum(), 1e-12)
        least, low, high = np.quantile(ratio * expected[at] / top, (0.1, 0.2, 0.9))
        if ratio > 0.0 and low > 0.9 and high > 1.15 and high - least > max(0.1, 2.0 * band / top):
            said = f"the force along {'xyz'[axis]} stays at {side * top + zero[axis]:.3g} N"
            beyond = f"the model's grows to {ratio * expected[at].max() / top:.2g} times it"
            advice = "set a larger range in the load cell or its driver, or press less"
            yield Finding(False, f"saturation: {said}; {beyond}; {advice}")


@dataclass(frozen=True, slots=True)
class _Axes:
    """The measured force under a hypothesis on its axes, shape [n, 3], and the remedy."""

    kind: str
    force: Array
    remedy: str


def axes(e: Evidence) -> Iterator[Finding]:
    """Whether measured and predicted force agree along each axis; otherwise the axes or the sign that explain it best.

    The reading may be fixed to the cell, with another sign or turned, or fixed to the world. What explains
    the force nearly as well as the best is named, too.
    """
    predicted, measured = e.push
    carried = np.sqrt((predicted**2).mean(axis=0))
    judged = (carried >= _CARRIES * carried.max()) & (np.abs(predicted).max(axis=0) >= LEAST_FORCE)

    def alike(force: Array) -> Array:
        """Correlation about zero with the predicted force, along each axis that is judged."""
        scale = np.sqrt((predicted**2).sum(axis=0) * (force**2).sum(axis=0))
        return np.asarray(((predicted * force).sum(axis=0) / np.maximum(scale, 1e-12))[judged])

    def misfit(force: Array) -> float:
        """Share of the force's square that no multiple of the predicted force explains."""
        shared = max(float((predicted * force).sum()), 0.0)
        return 1.0 - shared**2 / max(float((predicted**2).sum() * (force**2).sum()), 1e-12)

    own, of_world = misfit(measured), _of_world(e)
    agrees = (alike(measured) >= _ALIKE).all()
    shown = ", ".join(f"{n} {r:.2f}" for n, r in zip(np.array([*"xyz"])[judged], alike(measured), strict=True))
    if agrees and (own < _POOR or misfit(of_world.force) > _EXPLAINED * own):
        yield Finding(True, f"sign: measured and predicted force agree along each axis (correlation {shown})")
        return
    opposite = _Axes("sign", -measured, f"set sensor.sign: {-e.load_cell.sign:g}")
    candidates = [a for a in (opposite, *_turns(e), of_world) if (alike(a.force) >= _ALIKE).all()]
    best = min((misfit(a.force) for a in candidates), default=1.0)
    advice = dict[str, str]()
    for candidate in candidates:  # of turns that explain the force alike, the smallest comes first
        if misfit(candidate.force) <= min(_AS_GOOD * best + _SLACK, own):
            advice.setdefault(candidate.kind, candidate.remedy)
    to_check = e.place_parameter or "sensor.quaternion"
    said = [*advice.values()] or [f"check {to_check}, sensor.sign, mesh.origin, mesh.quaternion and surface_height"]
    which = "; a drag along x and y tells which" if len(said) > 1 else ""
    if "world" in advice and len(said) > 1:
        which = "; a drag along x and y, and a push at another attitude of the tool tell which"
    off = f"measured and predicted force do not agree along each axis (correlation {shown})"
    yield Finding(False, f"sign or quaternion: {off}; {', or '.join(said)}{which}")


def _of_world(e: Evidence) -> _Axes:
    """As if the reading were in world axes; or, if that is set, in the axes of the load cell."""
    if e.settings.sensor_source == "world":
        raw = e.to_cell.inv().apply(e.raw)
        remedy = "set sensor.frame_source: parameter, since the reading's axes turn with the tool"
    else:
        raw = e.to_cell.apply(e.raw)
        remedy = "set sensor.frame_source: world, since the reading's axes are those of world_frame"
    return _Axes("world", e.without_air(np.asarray(raw) - e.weight)[e.pushed], remedy)


def _turns(e: Evidence) -> Iterator[_Axes]:
    """As if the cell were turned, by multiples of 90 degrees; the smallest turns first."""
    to_set = f"correct {e.place_parameter} to a quaternion" if e.place_parameter else "set sensor.quaternion"
    for turn in sorted(_TURNS, key=lambda turn: float(turn.magnitude()))[1:]:
        turned = listed((Rotation.from_quat(e.load_cell.quaternion) * turn).as_quat())
        by = f"as if the cell were turned by {np.degrees(turn.magnitude()):.0f} degrees"
        yield _Axes("turn", turn.apply(e.push[1]), f"{to_set}, such as {turned}, {by}")


def _torques(e: Evidence) -> tuple[Array, Array] | None:
    """Measured and expected torque [N m] at the pushes; None without torque, or without readings in the air.

    Expected is that of the measured force, where the model's acts: the strength of the grains has no part in it.
    """
    if (~e.in_grains).sum() < ENOUGH or not np.any(e.measured[:, 3:] != e.measured[:1, 3:]):
        return None
    (model, force), torque = e.push, e.predicted[e.pushed, TORQUE]
    tool = np.array(Placement(e.load_cell.position, e.load_cell.quaternion).inverse().position)
    about_tool, square = torque - np.cross(tool, model), np.maximum((model**2).sum(axis=1, keepdims=True), 1e-12)
    place = tool + np.cross(model, about_tool) / square
    return e.without_air(e.measured[:, 3:])[e.pushed], np.cross(place, force)


def unit_of_torque(e: Evidence) -> Iterator[Finding]:
    """A torque in N mm beside a force in N."""
    if (both := _torques(e)) is None:
        return
    measured, expected = both
    ratio = float((measured * expected).sum() / max((expected**2).sum(), 1e-12))
    alike = ratio * np.sqrt((expected**2).sum() / max((measured**2).sum(), 1e-12))
    if alike > 0.9 and not 0.03 < ratio < 30.0:
        said = f"the torque is {ratio:.3g} times that of the measured force at its lever"
        yield Finding(False, f"units: {said}; the driver must give N m, and not N mm or kN m")


def lever(e: Evidence) -> Iterator[Finding]:
    """Whether another place of the sensor explains the torque; fitted to half of the moments, judged on the other.

    It must explain what neither a wrong weight of the tool does nor the noise, which the measured force has, too.
    """
    if (both := _torques(e)) is None:
        return
    measured, expected = both
    force, down = e.push[1], e.to_cell[e.pushed].apply((0.0, 0.0, -1.0))
    of_shift, of_weight = _cross(force).reshape(-1, 3), _cross(down).reshape(-1, 3)
    rest, of_shift = (
        part - of_weight @ np.linalg.lstsq(of_weight, part, rcond=None)[0]
        for part in ((measured - expected).ravel(), of_shift)
    )
    noise = 0.5 * (np.diff(rest.reshape(-1, 3), axis=0) ** 2).sum()
    part = np.repeat(np.arange(len(force)) // ENOUGH % 2 == 0, 3)
    if part.all() or noise > _NOISE_OF_LEVER * (rest**2).sum():
        return
    shift = np.linalg.lstsq(of_shift[part], rest[part], rcond=0.1)[0]
    left = ((rest - of_shift @ shift)[~part] ** 2).sum() / max((rest[~part] ** 2).sum(), 1e-12)
    moved = float(np.linalg.norm(shift))
    if left > _EXPLAINED or not _LEVER + _LEVER_OF_SIZE * e.tool.size < moved < _LONGEST_LEVER:
        return
    turned = Rotation.from_quat(e.load_cell.quaternion).apply(shift)
    place = listed(np.round(np.array(e.load_cell.position) + turned, 3))
    said = f"a sensor {1e3 * moved:.0f} mm away explains the torque; {100.0 * np.sqrt(left):.0f} % of the misfit remain"
    what = f"correct {e.place_parameter} to position" if e.place_parameter else "set sensor.position:"
    note = "; it is not known along the force" if np.linalg.cond(of_shift[part]) > 10.0 else ""
    yield Finding(False, f"lever: {said}; {what} {place}{note}")


def _cross(vectors: Array) -> Array:
    """Matrices that give the cross products of n vectors with another one, shape [n, 3, 3]."""
    return np.swapaxes(np.cross(vectors[:, None, :], np.eye(3)), 1, 2)


def strength(e: Evidence) -> Iterator[Finding]:
    """Measured over predicted force; far from 1 it comes from a unit, a scale or the medium."""
    if not e.push_is_seen:
        return
    p, m = e.push
    ratio, advice = float((p * m).sum() / max((p * p).sum(), 1e-12)), ""
    ok = _WEAKEST <= ratio <= _STRONGEST
    if not ok:
        unit = min(_UNITS, key=lambda name: abs(np.log(max(ratio, 1e-9) * _UNITS[name])))
        like = f" (as if it were {unit})" if 0.4 < ratio * _UNITS[unit] < 2.5 else ""
        advice = f"; check mesh.scale and the driver's unit (N){like}, or fit medium.zeta with rft calibrate"
    yield Finding(ok, f"strength: measured over predicted force {ratio:.3g}{advice}")

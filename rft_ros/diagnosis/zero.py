"""What the load cell reads in the air: its bias, the weight that hangs below it, and whether these change."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from rft_ros.diagnosis.air import BIAS, MASS, MOMENT, fit_in_air, noise
from rft_ros.diagnosis.evidence import ENOUGH, Array, Evidence
from rft_ros.diagnosis.finding import Finding
from rft_ros.estimator import is_offset
from rft_ros.parameters import Value
from rft_ros.rft import FORCE

_SHOWS = 0.01  # of the greatest force: over a whole approach a smaller offset shows than in live readings
_MOVES = 0.03  # of the greatest force: a smaller change of the zero is that of a usual load cell, or grains on the tool
_EXPLAINED = 0.4  # of the square of the readings about a constant zero: the greatest rest of one that changes
_MOST = 600  # moments that are fitted
_STEPS = 40  # moments at which the zero may step
_NEAR = 9  # moments about a step in which it may lie
_LIGHT = 0.01  # kg: a smaller mass is none
_LONGEST_CENTER = 1.0  # m: a centre of mass farther away comes from a torque in another unit


def threshold(e: Evidence) -> Iterator[Finding]:
    """A driver that sets small readings to zero: they are exactly 0 in the air, but noisy at rest in the grains."""
    rest = e.at(e.in_grains & (e.speed < e.settings.rest_speed))
    if not (e.air.is_enough and rest.is_enough) or e.air.raw[:, FORCE].any():
        return
    if max(len(np.unique(axis)) for axis in rest.raw[:, FORCE].T) > ENOUGH // 2:
        yield Finding(
            name="threshold",
            said="the force in the air is exactly 0, with no noise",
            advice="turn the threshold off in the driver; without it the measured contact comes late",
        )


class _Course(NamedTuple):
    """How a zero may change in time, shape [n]; `rest`: the square of the residual; `moved`: the change by it [N]."""

    name: str
    course: Array
    rest: float
    moved: float


def _along(air: Evidence, name: str, course: Array) -> _Course:
    """The readings in the air, fitted by a zero that follows a course in time."""
    known = air.columns_in_air[:, FORCE][:, :, [0, 1, 2, MASS]]
    columns = np.concatenate([known, np.eye(3) * course[:, None, None]], axis=2)
    fit = fit_in_air(columns, air.force)
    moved = float(np.linalg.norm(np.ptp(course) * fit.values[-3:]))
    return _Course(name, course, float((fit.residuals**2).sum()), moved)


def _courses(air: Evidence) -> Iterator[tuple[str, Array]]:
    """The ways in which a zero may change: with the motion if this has two, as time, or by a step or in a gap."""
    at_rest = air.settings.rest_speed
    size = np.linalg.norm(air.velocity, axis=1, keepdims=True)
    _, _, ways = np.linalg.svd(air.velocity / np.maximum(size, at_rest), full_matrices=False)
    along = np.sign(np.round(air.velocity @ ways[0], 6))
    motion = np.where(air.speed > at_rest, along, 0.0)
    rest, forth, back = (int((motion == way).sum()) for way in (0.0, 1.0, -1.0))
    if np.ptp(motion) > 0.0 and max(rest, min(forth, back)) >= ENOUGH:
        yield "friction", motion
    yield "drift", air.time - air.time[0]
    n = len(air.time)
    span = np.diff(air.time)
    gaps = np.flatnonzero(span > 5.0 * np.median(span)) + 1
    splits = np.linspace(ENOUGH // 2, n - ENOUGH // 2, _STEPS).astype(int)
    for row in (*splits, *gaps):
        yield "step", np.where(np.arange(n) < row, 0.0, 1.0)


def zero_that_moves(e: Evidence) -> Iterator[Finding]:
    """A zero that reverses with the motion, as by friction; that steps, as the cell is zeroed again; or that drifts.

    Of the three the one that leaves the smallest residual in the air. A weight that turns with the tool is none.
    """
    if len(e.air.time) < 2 * ENOUGH:
        return
    air = e.air.thinned(_MOST)
    courses = [_along(air, name, course) for name, course in _courses(air)]
    best = min(courses, key=lambda course: course.rest)
    still = _along(air, "none", np.zeros(len(air.time))).rest
    scatter = np.sqrt(best.rest / len(air.time))
    # the measured force: the model's ζ may be far from that of the grains
    greatest = float(np.linalg.norm(e.push.force, axis=1).max(initial=0.0))
    is_explained = best.rest <= _EXPLAINED * still and scatter <= 0.5 * best.moved
    if not is_explained or not is_offset(best.moved, greatest, share=_MOVES):
        return
    evidence = {"moved": best.moved, "left": best.rest / max(still, 1e-12)}
    if best.name == "friction":
        changes = f"changes by {best.moved:.3g} N where the motion turns back"
        said = f"the reading in the air depends on the motion: it {changes}"
        advice = "use a load cell at the tool, or free the seal; a tare cannot remove it, and calibrate would trust it"
    else:
        rows = np.flatnonzero(np.diff(best.course)) + 1
        begin = float(air.time[max(int(rows[0]) - _NEAR, 0)])
        end = float(air.time[min(int(rows[-1]) + _NEAR, len(air.time) - 1)])
        said = f"the reading in the air moved by {best.moved:.3g} N between {begin:.3g} and {end:.3g} s"
        advice = "zero the load cell once, before the recording, and let it warm up; calibrate would trust it"
    yield Finding(name="zero that moves", said=said, evidence=evidence, advice=advice)


def zero(e: Evidence) -> Iterator[Finding]:
    """The bias and the weight that the load cell shows in the air, against those of the parameters."""
    if not e.air.is_enough:
        if e.complete and not e.tare:
            said = f"in the air at fewer than {ENOUGH} poses"
            yield Finding(name="load cell", said=said, advice="lift the tool out and run again")
        return
    shown = float((e.air.force**2).sum(axis=1).mean())
    load = float(np.sqrt(max(shown - (noise(e.air.force) ** 2).sum(), 0.0)))
    greatest = float(np.linalg.norm(e.force, axis=1).max())
    said = f"it reads {load:.3g} N in the air"
    evidence = {"load": load}
    if e.tare:
        said += f", which a replay tares over its first {e.tare:g} s; for the node call ~/tare in the air"
    if e.tare or not is_offset(load, greatest, share=_SHOWS):
        yield Finding(name="load cell", ok=True, said=said, evidence=evidence)
        return
    offset = e.load_cell.sign * e.zero[BIAS]
    remedy: dict[str, Value] = {"sensor.bias": tuple((e.load_cell.bias + offset).tolist())}
    if e.zero[MASS:].any():
        yield _weight(e, load, remedy)
        return
    advice = "tare it there (~/tare, --tare)"
    yield Finding(name="load cell", said=said, evidence=evidence, remedy=remedy, advice=advice)


def _weight(e: Evidence, load: float, remedy: dict[str, Value]) -> Finding:
    """Bias, mass and centre of mass, which the attitudes in the air separate.

    `load`: the force in the air [N]. `remedy`: of the bias.
    """
    given = e.load_cell
    mass = float(given.mass + e.zero[MASS])
    if mass < -_LIGHT:
        return Finding(
            name="payload",
            said=f"the driver subtracts {-mass:.2g} kg more than the tool weighs",
            evidence={"too_much": -mass},
            advice="correct the payload in the driver",
        )
    moment = given.mass * np.array(given.center_of_mass) + e.zero[MOMENT]
    center = moment / mass if mass > _LIGHT else np.zeros(3)
    far = float(np.linalg.norm(center))
    if far > _LONGEST_CENTER:
        return Finding(
            name="units of torque",
            said=f"the torque in the air is that of a centre of mass {far:.3g} m away",
            evidence={"far": far},
            advice="the driver must give N m, and not N mm",
        )
    remedy["sensor.mass"] = max(mass, 0.0)
    remedy["sensor.center_of_mass"] = tuple(center.tolist())
    said = f"it reads {load:.3g} N in the air, as of {mass:.3g} kg below it"
    return Finding(name="load cell", said=said, evidence={"mass": mass}, remedy=remedy)

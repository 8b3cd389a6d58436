"""What the load cell reads in the air: its bias, the weight that hangs below it, and whether these change."""

from collections.abc import Iterator

import numpy as np

from rft_ros.diagnosis.evidence import ENOUGH, Array, Evidence, cross, solved
from rft_ros.diagnosis.finding import Finding
from rft_ros.estimator import GRAVITY, is_offset
from rft_ros.parameters import Value
from rft_ros.rft import TORQUE

_SHOWS = 0.01  # of the greatest force: over a whole approach a smaller offset shows than in live readings
_MOVES = 0.03  # of the greatest force: a smaller change of the zero is that of a usual load cell, or grains on the tool
_EXPLAINED = 0.4  # of the square of the readings about a constant zero: the greatest rest of one that changes
_MOST = 600  # moments that are fitted
_STEPS = 40  # moments at which the zero may step
_TURNED = 0.15  # least RMS spread of gravity's direction in the cell, along two axes, that shows the tool's weight
_LIGHT = 0.01  # kg: a smaller mass is none
_UPRIGHT = 4.0  # degrees: the weight's direction is not known better
# m: a centre of mass that is further away comes from a torque in another unit
_LONGEST_CENTER = 1.0


def threshold(e: Evidence) -> Iterator[Finding]:
    """A driver that sets small readings to zero: they are exactly 0 in the air, but noisy at rest in the grains."""
    rest = e.in_grains & (e.speed < e.settings.rest_speed)
    if min(e.in_air.sum(), rest.sum()) < ENOUGH or e.raw[e.in_air].any():
        return
    if max(len(np.unique(axis)) for axis in e.raw[rest].T) > ENOUGH // 2:
        advice = "turn the threshold off in the driver; without it the measured contact comes late"
        yield Finding(
            name="threshold",
            said="the force in the air is exactly 0, with no noise",
            advice=advice,
        )


def zero_that_moves(e: Evidence) -> Iterator[Finding]:
    """A zero that reverses with the motion, as by friction; that steps, as the cell is zeroed again; or that drifts.

    Of the three the one that leaves the smallest residual in the air. A weight that turns with the tool is none.
    """
    rows = np.flatnonzero(e.in_air)
    if len(rows) < 2 * ENOUGH:
        return
    rows = rows[:: -(-len(rows) // _MOST)]
    force = e.force[rows]
    time = e.time[rows]
    velocity = e.velocity[rows]
    known = e.of_zero[rows]

    def fitted(course: Array) -> tuple[float, Array]:
        """The square of the residual where the zero follows a course in time, shape [n], and the change by it [N]."""
        columns = np.concatenate([known, np.eye(3) * course[:, None, None]], axis=2).reshape(
            force.size, -1
        )
        found = solved(columns, force.ravel(), least=1e-3)
        return float(((force.ravel() - columns @ found) ** 2).sum()), np.ptp(course) * found[-3:]

    size = np.linalg.norm(velocity, axis=1, keepdims=True)
    main = np.linalg.svd(velocity / np.maximum(size, e.settings.rest_speed), full_matrices=False)[
        2
    ][0]
    way = np.where(
        e.speed[rows] > e.settings.rest_speed, np.sign(np.round(velocity @ main, 6)), 0.0
    )
    both_ways = min((way > 0.0).sum(), (way < 0.0).sum()) >= ENOUGH or (way == 0.0).sum() >= ENOUGH
    courses = {"friction": way} if np.ptp(way) > 0.0 and both_ways else {}
    courses["drift"] = time - time[0]
    splits = np.linspace(ENOUGH // 2, len(rows) - ENOUGH // 2, _STEPS).astype(int)
    apart = np.flatnonzero(np.diff(time) > 5.0 * np.median(np.diff(time))) + 1
    steps = [np.where(np.arange(len(rows)) < split, 0.0, 1.0) for split in (*splits, *apart)]
    courses["step"] = min(steps, key=lambda step: fitted(step)[0])
    found = {name: fitted(course) for name, course in courses.items()}
    name = min(found, key=lambda name: found[name][0])
    rest, change = found[name]
    moved = float(np.linalg.norm(change))
    spread = np.sqrt(rest / len(rows))
    greatest = float(np.linalg.norm(e.model, axis=1).max(initial=0.0))
    still = fitted(np.zeros(len(rows)))[0]
    if (
        rest > _EXPLAINED * still
        or spread > 0.5 * moved
        or not is_offset(moved, greatest, share=_MOVES)
    ):
        return
    evidence = {"moved": moved, "left": rest / max(still, 1e-12)}
    if name == "friction":
        said = "the reading in the air depends on the motion: it changes by {moved:.3g} N where the motion turns back"
        advice = "use a load cell at the tool, or free the seal; a tare cannot remove it, and calibrate would trust it"
    else:
        after = int(np.argmax(courses["step"]))
        evidence |= (
            {"from": time[max(after - 9, 0)], "to": time[min(after + 9, len(time) - 1)]}
            if name == "step"
            else {"from": time[0], "to": time[-1]}
        )
        said = "the reading in the air moved by {moved:.3g} N between {from:.3g} and {to:.3g} s"
        advice = "zero the load cell once, before the recording, and let it warm up; calibrate would trust it"
    yield Finding(name="zero that moves", said=said, evidence=evidence, advice=advice)


def zero(e: Evidence) -> Iterator[Finding]:
    """The bias and the weight that the load cell shows in the air, against those of the parameters."""
    air = e.in_air
    if air.sum() < ENOUGH:
        if len(e.time) and e.complete and not e.tare:
            said = f"in the air at fewer than {ENOUGH} poses"
            yield Finding(name="load cell", said=said, advice="lift the tool out and run again")
        return
    shown = float(np.sqrt((e.force[air] ** 2).sum(axis=1).mean()))
    noise = float(np.linalg.norm(np.std(np.diff(e.force[air], axis=0), axis=0))) / 2.0**0.5
    load = float(np.sqrt(max(shown**2 - noise**2, 0.0)))
    greatest = float(np.linalg.norm(e.force, axis=1).max())
    said = "it reads {load:.3g} N in the air"
    evidence = {"load": load}
    if e.tare:
        said += f", which a replay tares over its first {e.tare:g} s; for the node call ~/tare in the air"
    if e.tare or not is_offset(load, greatest, share=_SHOWS):
        yield Finding(name="load cell", ok=True, said=said, evidence=evidence)
        return
    spread = np.linalg.svd(e.down[air] - e.down[air].mean(axis=0), compute_uv=False) / np.sqrt(
        air.sum()
    )
    if spread[1] >= _TURNED:
        yield from _weight(e, evidence)
        return
    bias = np.array(e.load_cell.bias) + e.load_cell.sign * e.measured[air].mean(axis=0)
    advice = "tare it there (~/tare, --tare)"
    yield Finding(
        name="load cell",
        said=said,
        evidence=evidence,
        remedy={"sensor.bias": tuple(bias.tolist())},
        advice=advice,
    )


def _weight(e: Evidence, evidence: dict[str, float]) -> Iterator[Finding]:
    """Bias, mass and centre of mass, which the attitudes in the air separate; and which way the weight hangs."""
    cell = e.load_cell
    air = e.in_air
    columns = np.concatenate(
        [np.broadcast_to(np.eye(3), (air.sum(), 3, 3)), e.to_cell[air].as_matrix()], axis=2
    )
    found = np.linalg.lstsq(columns.reshape(-1, 6), e.force[air].ravel(), rcond=None)[0]
    weight = found[3:] - (0.0, 0.0, GRAVITY * cell.mass)
    mass = float(-weight[2] / GRAVITY)
    arms = np.concatenate([columns[:, :, :3], GRAVITY * cross(-e.down[air])], axis=2)
    moments = np.linalg.lstsq(arms.reshape(-1, 6), e.measured[air, TORQUE].ravel(), rcond=None)[0]
    bias = np.array(cell.bias) + cell.sign * np.concatenate([found[:3], moments[:3]])
    remedy: dict[str, Value] = {"sensor.bias": tuple(bias.tolist())}
    evidence |= {"mass": mass}
    name = "load cell"
    said = "it reads {load:.3g} N in the air, as of {mass:.3g} kg below it"
    advice = ""
    center = np.zeros(3)
    if mass < -_LIGHT:
        name = "payload"
        said = "the driver subtracts {too_much:.2g} kg more than the tool weighs"
        evidence |= {"too_much": -mass}
        remedy = {}
        advice = "correct the payload in the driver"
    else:
        mass = max(mass, 0.0)
        if mass > _LIGHT:
            center = (moments[3:] + cell.mass * np.array(cell.center_of_mass)) / mass
        remedy |= {"sensor.mass": mass, "sensor.center_of_mass": tuple(center.tolist())}
    far = float(np.linalg.norm(center))
    if far > _LONGEST_CENTER:
        evidence |= {"far": far}
        said = "the torque in the air is that of a centre of mass {far:.3g} m away"
        yield Finding(
            name="units of torque",
            said=said,
            evidence=evidence,
            advice="the driver must give N m, and not N mm",
        )
        return
    yield Finding(name=name, said=said, evidence=evidence, remedy=remedy, advice=advice)
    tilt = np.degrees(np.arctan2(np.linalg.norm(weight[:2]), abs(weight[2])))
    if abs(mass) > 10.0 * _LIGHT and tilt > _UPRIGHT:
        yield Finding(
            name="world",
            said="the tool's weight hangs {tilt:.0f} degrees from -z of world_frame",
            evidence={"tilt": float(tilt)},
            advice="give the poses in a frame whose z points up",
        )

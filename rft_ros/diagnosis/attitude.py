"""Which way the load cell, the tool and the world point: of all explanations the one of the smallest residual is told.

The residual has three parts. That of directions depends neither on the strength of the grains nor on its growth with
depth. That of the growth is taken with the power of depth and the surface that suit an explanation best: under real
plates and wheels the pressure grows as depth to the power of 1.3 to 1.6, in simulated beads more slowly than linearly.
The third is that of the tool's weight in the air, if its attitude changes there.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import permutations, product

import numpy as np
from scipy.optimize import fmin
from scipy.spatial.transform import Rotation

from rft_ros.diagnosis.evidence import ENOUGH, Array, Evidence
from rft_ros.diagnosis.finding import Finding, in_words
from rft_ros.parameters import Value
from rft_ros.rft import FORCE, POSITION, QUATERNION, TORQUE, VELOCITY
from rft_ros.rft.frames import ANGULAR_VELOCITY, Placement

LEAST_ZETA = 0.05
MOST_ZETA = 5.0
"""Range of ζ of dry grains."""

OF_POSES = ("world frame", "quaternions")
"""Names of findings that leave nothing known of the surface and the load cell."""

_POWERS = np.linspace(-0.3, 0.6, 10)  # of depth by which the force may differ from the model's
_FAINT = 0.05  # of the greatest predicted force: the direction of a smaller one is not compared
_TURNED = 0.15  # least RMS change of gravity's direction in the cell that shows the tool's weight
# of the greatest predicted force: a smaller change of the force in the air counts little
_OF_PEAK = 0.02
_BETTER = 0.5  # greatest residual, of that of the set-up as given, of an explanation that is told
_SURER = 0.3  # the same for angles that are not multiples of 90 degrees
_SUREST = 0.1  # the same of a turned mesh: grains unlike the model change the growth, too
_TOLD = 0.02  # least decrease of the residual that is told
_TOLD_OF_MESH = 0.005  # the same of a turned mesh, which changes the growth
_ANGLE = np.radians(4.0)  # real grains push plates up to 3 degrees out of the model's direction
# between measured and predicted force, where a tilted world is tried
_LEAST_ANGLE = np.radians(1.5)
_AS_GOOD = 1.5  # residuals up to this factor of the smallest one, plus a share of the set-up's as given, are alike
_SLACK = 0.02
_SLACK_OF_ANGLES = 0.15  # the same of angles, whose smallest residual is not found exactly
_TORQUE_ALIKE = 0.3  # difference of correlations
_NO_TURN = 0.01  # weight of no turn, where pushes do not tell the angle about their own direction
_OPPOSED = 0.3  # residual of the directions that is never that of the grains
_MOST_ROWS = 350  # moments at which explanations are compared
_FEWER_ROWS = 200  # the same of tilts
_AXES = [
    np.eye(3)[list(order)] * np.array(signs)[:, None]
    for order in permutations(range(3))
    for signs in product((1.0, -1.0), repeat=3)
]  # the 48 ways in which three axes can be named and signed
_TURNS = sorted(
    (Rotation.from_matrix(a) for a in _AXES if np.linalg.det(a) > 0.0), key=Rotation.magnitude
)[1:]
_MIRRORS = sorted((a for a in _AXES if np.linalg.det(a) < 0.0), key=np.trace)[
    :0:-1
]  # but for the turn of all signs


@dataclass(frozen=True, kw_only=True)
class _Explanation:
    """One cause of the measured forces, the residual that it leaves, and how it mends the evidence.

    `remedy` and `advice`: as of `Finding`. `shown`: further numbers for the sentence.
    """

    name: str
    residual: float
    mended: Callable[[Evidence], Evidence]
    remedy: Mapping[str, Value] = field(default_factory=dict)
    advice: str = ""
    shown: Mapping[str, float] = field(default_factory=dict)
    least: float = _TOLD
    share: float = _BETTER
    slack: float = _SLACK


def mount(e: Evidence) -> Iterator[Finding]:
    """The sensor's place in the parameters against that on /tf_static, if both have it."""
    s = e.settings
    place = e.place_on_tf
    if place is None or s.sensor_source == "tf" or s.tool_frame == s.sensor_frame:
        return
    given = Placement(e.load_cell.position, e.load_cell.quaternion)
    if given.is_at(place):
        yield Finding(name="sensor", ok=True, said="the parameters and /tf_static agree")
        return
    moved, turn = given.apart(place)
    yield Finding(
        name="sensor",
        said="the parameters differ from /tf_static by {degrees:.0f} degrees and {millimetres:.0f} mm",
        evidence={"degrees": float(np.degrees(turn)), "millimetres": 1e3 * moved},
        remedy={"sensor.frame_source": "tf"},
        alike=({"sensor.position": place.position, "sensor.quaternion": place.quaternion},),
    )


def _directions(e: Evidence) -> Array:
    """Mean product of the predicted and the measured direction in the cell's axes, shape [3, 3]: alike, its trace is 1.

    Moments of small forces weigh less.
    """
    model, force = e.push
    expected = np.linalg.norm(model, axis=1)
    measured = np.linalg.norm(force, axis=1)
    weight = np.where(expected > _FAINT * expected.max(), np.sqrt(expected * measured), 0.0)
    scale = weight / np.maximum(expected * measured, 1e-12)
    return np.asarray(np.einsum("n,ni,nj->ij", scale, model, force) / max(weight.sum(), 1e-12))


def _of_growth(e: Evidence) -> float:
    """Share of the force's square that no power of depth explains."""
    model, force = e.push
    expected = np.linalg.norm(model, axis=1)
    measured = np.linalg.norm(force, axis=1)
    depth = e.depth[e.pushed] / e.depth.max()
    grown = expected * depth ** _POWERS[:, None]
    shared = (grown @ measured) ** 2 / np.maximum((grown**2).sum(axis=1), 1e-12)
    return float(1.0 - shared.max() / max(measured @ measured, 1e-12))


def _of_weight(e: Evidence, axes: Array | None = None) -> float:
    """Share of the square of the force in the air that no weight explains; small changes there count little.

    `axes`: as if the reading were in these.
    """
    air = e.in_air
    if air.sum() < ENOUGH:
        return 0.0
    down = e.down[air] - e.down[air].mean(axis=0)
    if (down**2).sum() < len(down) * _TURNED**2:
        return 0.0
    force = e.with_weight[air, FORCE]
    force = (force - force.mean(axis=0)) @ (np.eye(3) if axes is None else axes).T
    square = float((force**2).sum())
    shared = float((force * down).sum()) ** 2 / float((down**2).sum())
    small = len(force) * (_OF_PEAK * float(np.abs(e.model).max())) ** 2
    return (square - shared) / max(square + small, 1e-12)


def zeta_of(e: Evidence) -> float:
    """ζ that suits the force while the tool is pushed."""
    model, force = e.push
    return float(e.law.zeta * (model * force).sum() / max((model**2).sum(), 1e-12))


def residual(e: Evidence) -> float:
    """That of a set-up; 2 where no push is seen."""
    if not e.push_is_seen:
        return 2.0
    return 1.0 - float(np.trace(_directions(e))) + _of_growth(e) + _of_weight(e)


def _of_axes(e: Evidence) -> Iterator[_Explanation]:
    """Another sign or turn of the load cell, readings in world axes, or left-handed axes; simple ones come first."""
    alike = _directions(e)
    growth = _of_growth(e)

    def left(axes: Array) -> float:
        return growth + 1.0 - float((axes * alike).sum()) + _of_weight(e, axes)

    def turned(turn: Rotation) -> _Explanation:
        x, y, z, w = (
            (Rotation.from_quat(e.load_cell.quaternion) * turn).as_quat(canonical=True).tolist()
        )
        return _Explanation(
            name="turn",
            residual=left(turn.as_matrix()),
            mended=lambda e: e.with_cell(replace(e.load_cell, quaternion=(x, y, z, w))),
            remedy={"sensor.quaternion": (x, y, z, w)},
            shown={"angle": float(np.degrees(turn.magnitude()))},
        )

    sign = -e.load_cell.sign
    yield _Explanation(
        name="sign",
        residual=left(-np.eye(3)),
        mended=lambda e: e.with_cell(replace(e.load_cell, sign=sign)),
        remedy={"sensor.sign": sign},
    )
    yield from map(turned, _TURNS)
    other = _read_in_other_axes(e)
    yield _Explanation(
        name="axes of the reading",
        residual=growth + 1.0 - float(np.trace(_directions(other))) + _of_weight(other),
        mended=_read_in_other_axes,
        remedy={"sensor.frame_source": other.settings.sensor_source},
    )
    for axes in _MIRRORS:
        yield _Explanation(
            name="left-handed axes",
            residual=left(axes),
            mended=lambda e: e,
            advice="correct the driver, whose axes are left-handed: no quaternion does it",
        )
    left_vectors, _, right_vectors = np.linalg.svd(alike + _NO_TURN * np.eye(3))
    handed = np.diag([1.0, 1.0, np.linalg.det(left_vectors @ right_vectors)])
    turn = Rotation.from_matrix(left_vectors @ handed @ right_vectors)
    if turn.magnitude() > _LEAST_ANGLE:
        yield replace(
            turned(turn), name="angle", least=0.5 * _ANGLE**2, share=_SURER, slack=_SLACK_OF_ANGLES
        )


def _read_in_other_axes(e: Evidence) -> Evidence:
    """As if the reading were in world axes; or, if that is set, in the axes of the load cell."""
    in_world = e.settings.sensor_source == "world"
    turn = e.to_cell.inv() if in_world else e.to_cell
    reading = np.hstack([turn.apply(e.with_weight[:, part]) for part in (FORCE, TORQUE)])
    settings = replace(e.settings, sensor_source="parameters" if in_world else "world")
    return replace(e, settings=settings, measured=reading - (e.with_weight - e.measured))


def _of_quaternions(e: Evidence) -> Iterator[_Explanation]:
    """Quaternions with w first."""

    def mended(e: Evidence) -> Evidence:
        state = e.state.copy()
        state[:, QUATERNION] = np.roll(e.state[:, QUATERNION], -1, axis=1)
        return e.seen(state, e.load_cell)

    advice = "give the poses' quaternions as x y z w: as if w came first, the tool is upside down"
    yield _Explanation(
        name="quaternions", residual=residual(mended(e)), mended=mended, advice=advice
    )


def _in_world(e: Evidence, turn: Rotation) -> _Explanation:
    """As if the world frame were turned."""

    def mended(e: Evidence) -> Evidence:
        state = e.state.copy()
        for part in (POSITION, VELOCITY, ANGULAR_VELOCITY):
            state[:, part] = turn.apply(state[:, part])
        state[:, QUATERNION] = (turn * Rotation.from_quat(state[:, QUATERNION])).as_quat()
        return e.seen(state, e.load_cell)

    x, y, z = turn.inv().apply((0.0, 0.0, 1.0)).tolist()
    return _Explanation(
        name="world frame",
        residual=residual(mended(e)),
        mended=mended,
        advice=f"give the poses in a frame whose z points up: up is about [{x:.2f}, {y:.2f}, {z:.2f}] in world_frame",
        shown={"angle": float(np.degrees(np.arccos(np.clip(z, -1.0, 1.0))))},
    )


def _of_world(e: Evidence) -> Iterator[_Explanation]:
    """A world frame of a ceiling or a wall."""
    for axis, degrees in (("x", 180.0), ("x", 90.0), ("x", -90.0), ("y", 90.0), ("y", -90.0)):
        yield _in_world(e, Rotation.from_euler(axis, degrees, degrees=True))


def _tilted_world(e: Evidence) -> Iterator[_Explanation]:
    """A world frame that is tilted by any angle."""

    def turn(tilt: Array) -> Rotation:
        return Rotation.from_rotvec((*tilt, 0.0))

    def misfit(tilt: Array) -> float:
        return _in_world(few, turn(tilt)).residual

    few = e.thinned(_FEWER_ROWS)

    ways = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    starts = [
        size * np.array([np.cos(way), np.sin(way)]) for size in (0.1, 0.25, 0.5) for way in ways
    ]
    start = min(starts, key=misfit)
    simplex = start + np.array([(0.0, 0.0), (0.1, 0.0), (0.0, 0.1)])
    tilt = fmin(
        misfit, start, xtol=2e-3, ftol=1e-5, maxfun=60, disp=False, initial_simplex=simplex
    )
    if float(np.linalg.norm(tilt)) > _ANGLE:
        yield replace(
            _in_world(e, turn(tilt)), least=0.5 * _ANGLE**2, share=_SURER, slack=_SLACK_OF_ANGLES
        )


def mesh_turns(e: Evidence) -> Iterator[_Explanation]:
    """The tool turned in its frame by multiples of 90 degrees, if the grains are dry ones with it.

    Of turns that fit alike, upside down comes first.
    """
    for turn in _TURNS[::-1]:

        def mended(e: Evidence, turn: Rotation = turn) -> Evidence:
            state = e.state.copy()
            state[:, QUATERNION] = (Rotation.from_quat(state[:, QUATERNION]) * turn).as_quat()
            back = Placement((0.0, 0.0, 0.0), tuple(turn.inv().as_quat(canonical=True).tolist()))
            place = back.of(Placement(e.load_cell.position, e.load_cell.quaternion))
            return e.seen(
                state, replace(e.load_cell, position=place.position, quaternion=place.quaternion)
            )

        x, y, z, w = (
            (turn * Rotation.from_matrix(e.tool.frame.rotation)).as_quat(canonical=True).tolist()
        )
        as_if = mended(e)
        if as_if.push_is_seen and LEAST_ZETA <= zeta_of(as_if) <= MOST_ZETA:
            yield _Explanation(
                name="mesh turned",
                residual=residual(as_if),
                mended=mended,
                remedy={"mesh.quaternion": (x, y, z, w)},
                shown={"zeta": zeta_of(as_if)},
                least=_TOLD_OF_MESH,
                share=_SUREST,
            )


def attitude(e: Evidence) -> tuple[Finding | None, Evidence | None]:
    """What the directions and the growth of the force say of a cell whose surface is that of the measured contact.

    Also the evidence as if that were mended; None if it is not known how.
    """
    few = e.thinned(_MOST_ROWS)
    if len(few.time) < ENOUGH or _is_unsure(few):
        return None, e
    own = residual(few)
    found = list(_of_axes(few)) if few.push_is_seen else []
    least = min([own, *(x.residual for x in found)])
    if least < 0.5 * own:
        found += _of_quaternions(few)
    if least > _TOLD_OF_MESH:
        found += _of_world(few)
        if few.in_air.sum() >= ENOUGH:  # otherwise an offset of the load cell may be the cause
            found += mesh_turns(few)
    if any(x.name == "angle" for x in found) and (own < _OPPOSED or least > _TOLD):
        found += _tilted_world(few)
    told = [
        x
        for x in found
        if x.residual <= min(x.share * own, _OPPOSED) and own - x.residual >= x.least
    ]
    if not told:
        return _unexplained(few, own), e
    best = min(x.residual for x in told)
    alike = _by_torque(few, [x for x in told if x.residual <= _AS_GOOD * best + x.slack * own])
    first = {x.name: x for x in reversed(alike)}
    for rare in ("quaternions", "left-handed axes"):
        if first.keys() - {"angle", rare}:
            first.pop(rare, None)
    if first.keys() - {"angle", "world frame"}:
        first.pop("angle", None)
    main, *others = sorted(first.values(), key=lambda x: (round(x.residual, 3), alike.index(x)))
    finding = _told(e, main, others, own)
    return finding, None if others or not finding.remedy else main.mended(e)


def _by_torque(e: Evidence, alike: list[_Explanation]) -> list[_Explanation]:
    """Those whose torque correlates with the model's about as well as any's, since it tells a mirror from a turn."""

    def correlation(x: _Explanation) -> float:
        cell = x.mended(e)
        model = cell.predicted[cell.pushed, TORQUE]
        torque = cell.clean[cell.pushed, TORQUE]
        return float(
            (model * torque).sum() / max(np.sqrt((model**2).sum() * (torque**2).sum()), 1e-12)
        )

    found = [correlation(x) for x in alike]
    return [x for x, r in zip(alike, found, strict=True) if r > max(found) - _TORQUE_ALIKE]


def _told(e: Evidence, main: _Explanation, others: list[_Explanation], own: float) -> Finding:
    remedies = [x.remedy for x in (main, *others) if x.remedy]
    advice = [x.advice for x in (main, *others) if x.advice]
    if e.place_parameter and remedies and "sensor.quaternion" in remedies[0]:
        advice.append(
            f"correct {e.place_parameter} to the quaternion {in_words(remedies.pop(0)['sensor.quaternion'])}"
        )
    if others:
        advice.append("drag it along x and y, and push at another attitude, to see which")
    said = "measured and predicted force do not agree (residual {own:.2g}; with the remedy {left:.2g})"
    if "angle" in main.shown:
        said += ", by {angle:.0f} degrees"
    if "zeta" in main.shown:
        said += ", with a ζ of {zeta:.2g}"
    return Finding(
        name=main.name,
        said=said,
        evidence={"own": own, "left": main.residual, **main.shown},
        remedy=remedies[0] if remedies else {},
        alike=tuple(remedies[1:]),
        advice=", or ".join(advice),
    )


def _unexplained(e: Evidence, own: float) -> Finding | None:
    """Whether measured and predicted force agree, where no explanation is better than the set-up as given."""
    if not e.push_is_seen:
        return None
    apart = 1.0 - float(np.trace(_directions(e)))
    evidence = {
        "own": own,
        "left": own,
        "degrees": float(np.degrees(np.arccos(np.clip(1.0 - apart, -1.0, 1.0)))),
    }
    said = "measured and predicted force point {degrees:.0f} degrees apart on average"
    if apart < _OPPOSED:
        return Finding(name="sign", ok=True, said=said, evidence=evidence)
    if e.in_air.sum() < ENOUGH:  # an offset of the load cell may be the cause
        return None
    to_check = e.place_parameter or "sensor.quaternion"
    advice = f"check {to_check}, sensor.sign, mesh.origin, mesh.quaternion and surface_height"
    return Finding(name="sign or quaternion", said=said, evidence=evidence, advice=advice)


def _is_unsure(e: Evidence) -> bool:
    """Whether a force in the air, which may be a bias or a weight, leaves the direction of the pushes unknown."""
    if not e.in_air.any() or not e.push_is_seen:
        return False
    down = e.down[e.in_air]
    if (
        np.linalg.norm(np.std(down, axis=0)) > 2.0 * _TURNED
    ):  # the attitudes tell a weight from a bias
        return False
    turned = np.linalg.norm(e.down[e.pushed] - down.mean(axis=0), axis=1).mean()
    unknown = np.linalg.norm(e.force[e.in_air].mean(axis=0)) * turned
    return bool(unknown > _OPPOSED * np.linalg.norm(e.push[1], axis=1).mean())

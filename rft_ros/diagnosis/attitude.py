"""Which way the load cell, the tool and the world point: the explanation of the smallest residual is told."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import fmin
from scipy.spatial.transform import Rotation

from rft_ros.diagnosis.air import SPREAD
from rft_ros.diagnosis.contact import seen
from rft_ros.diagnosis.evidence import Array, Evidence
from rft_ros.diagnosis.finding import Finding, in_words
from rft_ros.diagnosis.residual import directions, is_dry, residual, zeta_of
from rft_ros.parameters import Value
from rft_ros.rft import POSITION, QUATERNION, TORQUE, VELOCITY, quaternion_products
from rft_ros.rft.frames import ANGULAR_VELOCITY, Placement

OF_POSES = ("world frame", "quaternions")
"""Names of findings that leave nothing known of the surface and the load cell."""

_ANGLE = np.radians(4.0)  # real grains push plates up to 3 degrees out of the model's direction
# least angle between measured and predicted force at which a cell or world turned by any angle is tried
_TRIED = np.radians(1.5)
_AS_GOOD = 1.5  # residuals up to this factor of the smallest one, and a slack, are alike
_TORQUE_ALIKE = 0.3  # explanations whose torques' correlations differ by up to this are alike
# rounds of alignment: a turn changes the weight that is subtracted, and so the directions
_ALIGNED = 3
_NO_TURN = 0.01  # weight of no turn, where pushes do not tell the angle about their own direction
_OPPOSED = 0.3  # residual of the directions that is never that of the grains
_TOLERANCE = 0.025  # of the tool with which explanations are compared
# plates at all of the moments together; between moments that lie far apart the model would not follow the path
_MOST_PLATES = 100_000
_LEAST_ROWS = 350  # moments, also of a tool of many plates
_NONE = Rotation.identity()


def _turns_of_axes() -> list[Rotation]:
    """The 23 turns that swap or reverse axes, by their angle: 90, 120 and 180 degrees."""
    turns = [turn for turn in Rotation.create_group("O") if turn.magnitude() > 0.1]
    return sorted(turns, key=lambda turn: round(turn.magnitude(), 3))


_TURNS = _turns_of_axes()
# by where the tool's z axis points then: down, to a side, up; in each of these by the angle
_TURNS_OF_MESH = sorted(_TURNS, key=lambda turn: round(turn.as_matrix()[2, 2]))
# those of one axis come first; that of all three, which is another sign of the force, is none of them
_MIRRORS = [-turn.as_matrix() for turn in reversed(_TURNS)]


class _Rule(NamedTuple):
    """When explanations of a kind are told.

    `least`: decrease of the residual; `share`: greatest residual, of that of the set-up as given; `slack`: the share
    of that residual by which alike ones may differ.
    """

    least: float
    share: float
    slack: float


_USUAL = _Rule(least=0.02, share=0.5, slack=0.02)
_OF_ANGLES = _Rule(least=0.5 * _ANGLE**2, share=0.3, slack=0.15)  # of which none fits exactly
_OF_MESH = _Rule(least=0.005, share=0.1, slack=0.02)  # grains unlike the model change growth, too


@dataclass(frozen=True, kw_only=True)
class _Explanation:
    """One cause of the measured forces, the residual that it leaves, and how it mends the evidence.

    `remedy` and `advice`: as of `Finding`. `shown`: further numbers for the sentence.
    """

    name: str
    residual: float
    mended: Callable[[Evidence], Evidence] = lambda e: e
    remedy: Mapping[str, Value] = field(default_factory=dict)
    advice: str = ""
    shown: Mapping[str, float] = field(default_factory=dict)
    rule: _Rule = _USUAL

    @classmethod
    def of(
        cls, e: Evidence, mended: Callable[[Evidence], Evidence], **more: Any
    ) -> "_Explanation":
        """The explanation that `mended` mends, with its residual."""
        return cls(residual=residual(mended(e)), mended=mended, **more)

    def is_told(self, own: float) -> bool:
        """Whether it leaves so much less than the residual of the set-up as given."""
        most = min(self.rule.share * own, _OPPOSED)
        return self.residual <= most and own - self.residual >= self.rule.least


class Attitude(NamedTuple):
    """What is told of the attitudes, if anything, and the share of the residual that it leaves.

    `cell`: the evidence as if that were mended. `is_known`: whether it is, or needs not be.
    """

    told: Finding | None
    left: float
    cell: Evidence
    is_known: bool


def mount(e: Evidence) -> Iterator[Finding]:
    """The sensor's place in the parameters against that on /tf_static, if both have it."""
    s = e.settings
    place = e.place_on_tf
    if place is None or s.sensor_source == "tf" or s.tool_frame == s.sensor_frame:
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


def _quaternion(turn: Rotation) -> tuple[float, float, float, float]:
    x, y, z, w = turn.as_quat(canonical=True).tolist()
    return x, y, z, w


def _turned_cell(e: Evidence, turn: Rotation, **more: Any) -> _Explanation:
    quaternion = _quaternion(Rotation.from_quat(e.load_cell.quaternion) * turn)
    remedy: Mapping[str, Value] = {"sensor.quaternion": quaternion}
    advice = ""
    if e.place_parameter:
        remedy = {}
        advice = f"correct {e.place_parameter} to the quaternion {in_words(quaternion)}"
    return _Explanation.of(
        e,
        lambda e: e.with_cell(replace(e.load_cell, quaternion=quaternion)),
        remedy=remedy,
        advice=advice,
        shown={"angle": float(np.degrees(turn.magnitude()))},
        **more,
    )


def _of_axes(e: Evidence) -> Iterator[_Explanation]:
    """Another sign or turn of the load cell, readings in world axes, or left-handed axes; simple ones come first."""
    sign = -e.load_cell.sign
    yield _Explanation.of(
        e,
        lambda e: e.with_cell(replace(e.load_cell, sign=sign)),
        name="sign",
        remedy={"sensor.sign": sign},
    )
    for turn in _TURNS:
        yield _turned_cell(e, turn, name="turn")
    source = "parameters" if e.settings.sensor_source == "world" else "world"
    remedy = {"sensor.frame_source": source}
    yield _Explanation.of(e, _read_in_other_axes, name="axes of the reading", remedy=remedy)
    for axes in _MIRRORS:
        left = residual(e.read_in(axes))
        advice = "correct the driver, whose axes are left-handed: no quaternion does it"
        yield _Explanation(name="left-handed axes", residual=left, advice=advice)
    turn = _NONE
    for _ in range(_ALIGNED):
        shown = directions(e.read_in(turn.as_matrix())) + _NO_TURN * np.eye(3)
        turn = Rotation.align_vectors(np.eye(3), shown)[0] * turn
    if turn.magnitude() > _TRIED:
        yield _turned_cell(e, turn, name="angle", rule=_OF_ANGLES)


def _read_in_other_axes(e: Evidence) -> Evidence:
    """As if the reading were in world axes; or, if that is set, in the axes of the load cell."""
    in_world = e.settings.sensor_source == "world"
    along = e.cell_along
    axes = along.to_world if in_world else along.from_world_axes
    settings = replace(e.settings, sensor_source="parameters" if in_world else "world")
    return replace(e.read_in(axes), settings=settings)


def _w_first(e: Evidence) -> Evidence:
    """As if the poses' quaternions had w first."""
    states = e.state.copy()
    states[:, QUATERNION] = np.roll(e.state[:, QUATERNION], -1, axis=1)
    return seen(e, states, e.load_cell)


def _quaternions(e: Evidence) -> _Explanation:
    advice = "give the poses' quaternions as x y z w: as if w came first, the tool is upside down"
    return _Explanation.of(e, _w_first, name="quaternions", advice=advice)


def _turned(e: Evidence, *, world: Rotation = _NONE, tool: Rotation = _NONE) -> Evidence:
    """As if the world frame and the tool in its frame were turned."""
    states = e.state.copy()
    for part in (POSITION, VELOCITY, ANGULAR_VELOCITY):
        states[:, part] = states[:, part] @ world.as_matrix().T
    of_world = quaternion_products(world.as_quat(), states[:, QUATERNION])
    states[:, QUATERNION] = quaternion_products(of_world, tool.as_quat())
    back = Placement(quaternion=_quaternion(tool.inv()))
    return seen(e, states, e.load_cell.at(back.of(e.load_cell.place)))


def _turned_world(e: Evidence, turn: Rotation, **more: Any) -> _Explanation:
    x, y, z = turn.inv().apply((0.0, 0.0, 1.0)).tolist()
    up = f"up is about [{x:.2f}, {y:.2f}, {z:.2f}] in world_frame"
    return _Explanation.of(
        e,
        partial(_turned, world=turn),
        name="world frame",
        advice=f"give the poses in a frame whose z points up: {up}",
        shown={"angle": float(np.degrees(np.arccos(np.clip(z, -1.0, 1.0))))},
        **more,
    )


def _of_world(e: Evidence) -> Iterator[_Explanation]:
    """A world frame of a ceiling or a wall."""
    for axis, degrees in (("x", 180.0), ("x", 90.0), ("x", -90.0), ("y", 90.0), ("y", -90.0)):
        yield _turned_world(e, Rotation.from_euler(axis, degrees, degrees=True))


def _tilted_world(e: Evidence) -> Iterator[_Explanation]:
    """A world frame that is tilted by any angle."""

    def turn(tilt: Array) -> Rotation:
        return Rotation.from_rotvec((*tilt, 0.0))

    def misfit(tilt: Array) -> float:
        return residual(_turned(e, world=turn(tilt)))

    ways = np.linspace(0.0, 2.0 * np.pi, 6, endpoint=False)
    tilts = np.column_stack([np.cos(ways), np.sin(ways)])
    # from 7 and 20 degrees alone, the refinement ended at 6 where the tilt was 15
    start = min([*(0.12 * tilts), *(0.23 * tilts), *(0.35 * tilts)], key=misfit)
    simplex = start + np.array([(0.0, 0.0), (0.1, 0.0), (0.0, 0.1)])
    tilt = fmin(
        misfit, start, xtol=0.01, ftol=1e-4, maxfun=40, disp=False, initial_simplex=simplex
    )
    if float(np.linalg.norm(tilt)) > _ANGLE:
        yield _turned_world(e, turn(tilt), rule=_OF_ANGLES)


def mesh_turns(e: Evidence) -> Iterator[_Explanation]:
    """The tool turned in its frame by multiples of 90 degrees, if the grains are dry ones with it.

    Of turns that fit alike, upside down comes first.
    """
    for turn in _TURNS_OF_MESH:
        mended = partial(_turned, tool=turn)
        as_if = mended(e)
        if as_if.push_is_seen and is_dry(zeta_of(as_if)):
            of_mesh = turn * Rotation.from_matrix(e.tool.frame.rotation)
            yield _Explanation(
                name="mesh turned",
                residual=residual(as_if),
                mended=mended,
                remedy={"mesh.quaternion": _quaternion(of_mesh)},
                shown={"zeta": zeta_of(as_if)},
                rule=_OF_MESH,
            )


def fewer(e: Evidence) -> Evidence:
    """The evidence with fewer plates and at fewer moments, which are spread evenly.

    At most half of the moments are in motion in the grains; the rest are in the air.
    """
    tool = e.tool.reduced(_TOLERANCE)
    count = max(_LEAST_ROWS, _MOST_PLATES // len(tool.plates))
    moving = np.flatnonzero((e.speed > e.settings.rest_speed) & ~e.in_air)
    moving = moving[:: max(1, -(-2 * len(moving) // count))]
    air = np.flatnonzero(e.in_air)
    air = air[:: max(1, -(-len(air) // (count - len(moving))))]
    return replace(e.at(np.sort(np.concatenate([moving, air]))), tool=tool)


def attitude(e: Evidence) -> Attitude:
    """What the directions and the growth of the force say of a cell whose surface is that of the measured contact."""
    few = fewer(e)
    if not few.is_enough or _is_unsure(few):
        return Attitude(None, 1.0, e, is_known=True)
    own = residual(few)
    told = [x for x in _explanations(few, own) if x.is_told(own)]
    if not told:
        return Attitude(_unexplained(few, own), 1.0, e, is_known=True)
    main, *others = _alike(few, told, own)
    finding = _finding(main, others, own)
    is_known = bool(finding.remedy) and not others
    cell = main.mended(e) if is_known else e
    return Attitude(finding, main.residual / own, cell, is_known)


def _explanations(e: Evidence, own: float) -> list[_Explanation]:
    """Those that may leave less than the residual of the set-up as given; costly ones only where others leave much."""
    if own < _OF_ANGLES.least:
        return []
    found = list(_of_axes(e)) if e.push_is_seen else []
    least = min([own, *(x.residual for x in found)])
    if least < 0.5 * own:
        found.append(_quaternions(e))
    if least > _OF_MESH.least:
        found += _of_world(e)
        if e.air.is_enough:  # otherwise an offset of the load cell may be the cause
            found += mesh_turns(e)
    if any(x.name == "angle" for x in found) and (own < _OPPOSED or least > _USUAL.least):
        found += _tilted_world(e)
    return found


def _alike(e: Evidence, told: list[_Explanation], own: float) -> list[_Explanation]:
    """The best explanation of each name among those that fit about as well as the best one, which comes first.

    Rare causes give way to others, and any angle to another cause, but for those that it resembles at one attitude.
    """
    best = min(x.residual for x in told)
    near = [x for x in told if x.residual <= _AS_GOOD * best + x.rule.slack * own]
    by_torque = _by_torque(e, near)
    first = {x.name: x for x in reversed(by_torque)}
    for rare in ("quaternions", "left-handed axes"):
        if first.keys() - {"angle", rare}:
            first.pop(rare, None)
    if first.keys() - {"angle", "world frame", "axes of the reading"}:
        first.pop("angle", None)
    return sorted(first.values(), key=lambda x: (round(x.residual, 3), by_torque.index(x)))


def _by_torque(e: Evidence, near: list[_Explanation]) -> list[_Explanation]:
    """Those whose torque correlates with the model's about as well as any's, since it tells a mirror from a turn."""

    def correlation(x: _Explanation) -> float:
        push = x.mended(e).push
        model = push.predicted[:, TORQUE]
        torque = push.measured[:, TORQUE]
        square = (model**2).sum() * (torque**2).sum()
        return float((model * torque).sum() / max(np.sqrt(square), 1e-12))

    found = [correlation(x) for x in near]
    return [x for x, r in zip(near, found, strict=True) if r > max(found) - _TORQUE_ALIKE]


def _finding(main: _Explanation, others: list[_Explanation], own: float) -> Finding:
    advice = [x.advice for x in (main, *others) if x.advice]
    if others:
        advice.append("drag it along x and y, and push at another attitude, to see which")
    residuals = f"residual {own:.2g}; with the remedy {main.residual:.2g}"
    said = f"measured and predicted force do not agree ({residuals})"
    if "angle" in main.shown:
        said += f", by {main.shown['angle']:.0f} degrees"
    if "zeta" in main.shown:
        said += f", with a ζ of {main.shown['zeta']:.2g}"
    return Finding(
        name=main.name,
        said=said,
        evidence={"own": own, "left": main.residual, **main.shown},
        remedy=main.remedy,
        alike=tuple(x.remedy for x in others),
        advice=", or ".join(advice),
    )


def _unexplained(e: Evidence, own: float) -> Finding | None:
    """Whether measured and predicted force agree, where no explanation is better than the set-up as given."""
    if not e.push_is_seen:
        return None
    alike = float(np.trace(directions(e)))
    degrees = float(np.degrees(np.arccos(np.clip(alike, -1.0, 1.0))))
    evidence = {"own": own, "left": own, "degrees": degrees}
    said = f"measured and predicted force point {degrees:.0f} degrees apart on average"
    if 1.0 - alike < _OPPOSED:
        return Finding(name="sign", ok=True, said=said, evidence=evidence)
    if not e.air.is_enough:  # an offset of the load cell may be the cause
        return None
    to_check = e.place_parameter or "sensor.quaternion"
    advice = f"check {to_check}, sensor.sign, mesh.origin, mesh.quaternion and surface_height"
    return Finding(name="sign or quaternion", said=said, evidence=evidence, advice=advice)


def _is_unsure(e: Evidence) -> bool:
    """Whether a force in the air, which may be a bias or a weight, leaves the direction of the pushes unknown."""
    if not len(e.air.time) or not e.push_is_seen:
        return False
    if np.linalg.norm(np.std(e.air.down, axis=0)) > 2.0 * SPREAD:
        return False  # the attitudes tell a weight from a bias
    turned = np.linalg.norm(e.push.down - e.air.down.mean(axis=0), axis=1).mean()
    unknown = np.linalg.norm(e.air.force.mean(axis=0)) * turned
    return bool(unknown > _OPPOSED * np.linalg.norm(e.push.force, axis=1).mean())

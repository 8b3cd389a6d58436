"""What may be wrong with a cell: hypotheses that compete by the misfit that they leave.

Each one mends a trial or its set-up and frees parameters of the fit. To add a fault, add a `Cause` and a `Hypothesis`
to `HYPOTHESES`.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from itertools import product
from typing import Any, Literal

import numpy as np
from scipy.optimize import fmin
from scipy.spatial.transform import Rotation

from rft_ros.diagnosis.coarse import GROUP, Coarse, coarse, coarse_surface
from rft_ros.diagnosis.fit import Fit, Problem, Setup, fit
from rft_ros.diagnosis.trial import Array, Trial
from rft_ros.estimator import GRAVITY
from rft_ros.parameters import Value
from rft_ros.rft import FORCE, POSITION, QUATERNION, TORQUE, Plates
from rft_ros.rft.plates import AREA, FIRST_CORNER, NORMAL, SECOND_CORNER
from rft_ros.tool import Tool
from rft_ros.tool.check import INCH_MM


class Cause(Enum):
    """What is wrong with a cell: the title of its finding, and after a colon which of those that share it."""

    SIGN = "sign"
    TURN = "turn"
    SIGN_AND_TURN = "sign and turn"
    ANGLE = "angle"
    AXES_OF_READING = "axes of the reading"
    LEVER = "lever"
    BIAS = "load cell: bias"
    WEIGHT = "load cell: weight"
    PAYLOAD = "payload"
    DELAY = "delay"
    FILTER = "delay: filter"
    SURFACE = "surface_height"
    STRENGTH = "strength"
    UNIT = "strength: unit"
    TORQUE_UNIT = "units of torque"
    MESH_TURNED = "mesh turned"
    MESH_UNIT = "mesh"
    TCP = "TCP"
    QUATERNIONS = "quaternions"
    WORLD = "world frame"
    NOT_TURNING = "frame does not turn"
    STIFFNESS = "yielding arm"
    ZERO_MOVES = "zero that moves"
    NUMBERS = "several numbers"

    @property
    def title(self) -> str:
        """The name of its finding."""
        return str(self.value).partition(":")[0]


@dataclass(frozen=True, kw_only=True, eq=False)
class Variant:
    """A trial and its set-up as a hypothesis mends them, and the values of parameters that do.

    `number`: by how much it is wrong, and `zero_motion`: how a zero moves, for the sentence.
    """

    trial: Trial
    setup: Setup
    remedy: Mapping[str, Value] = field(default_factory=dict)
    number: float = 0.0
    zero_motion: Literal["", "step", "drift", "friction"] = ""


Family = Callable[[Trial, Setup, Array], Variant]
Mend = Callable[[Trial, Setup], Iterator[Variant]]


def _as_given(trial: Trial, setup: Setup) -> Iterator[Variant]:
    yield Variant(trial=trial, setup=setup)


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """A cause: how it mends a trial, the numbers that it frees, and how much rarer it is, in units of the misfit.

    A `family` has a variant for each point of a continuous parameter: it is tried at `points`, and from the best one on
    by a `step`. `searches_surface`: each variant begins at the height that fits it best. `is_possible`: of a trial,
    whether it may have the cause.
    """

    cause: Cause
    free: tuple[str, ...] = ()
    mend: Mend = _as_given
    rarity: float = 0.0
    family: Family | None = None
    points: tuple[tuple[float, ...], ...] = ()
    step: float = 0.0
    searches_surface: bool = False
    is_possible: Callable[[Trial], bool] = lambda _: True

    @property
    def is_of_numbers(self) -> bool:
        """Whether it frees numbers of the cell and changes nothing else."""
        return self.mend is _as_given and self.family is None

    def variants(self, trial: Trial, setup: Setup) -> list[Variant]:
        """The variants of a trial that it mends; those of a family at its points."""
        if not self.is_possible(trial):
            return []
        if self.family is None:
            return list(self.mend(trial, setup))
        return [self.family(trial, setup, np.array(point)) for point in self.points]


def _rescaled(tool: Tool, factor: float) -> Tool:
    """The tool of a mesh in another unit: it is `factor` times as large, about its frame's origin."""
    rows = tool.plates.rows.copy()
    rows[:3] *= factor
    rows[AREA] *= factor**2
    rows[FIRST_CORNER] *= factor
    rows[SECOND_CORNER] *= factor
    return replace(
        tool,
        frame=replace(tool.frame, scale=tool.frame.scale * factor),
        plates=Plates.of_rows(rows),
        corners=tool.corners * factor,
    )


def quaternion_of(turn: Rotation) -> tuple[float, float, float, float]:
    """The quaternion xyzw of a turn, with w at least 0."""
    x, y, z, w = turn.as_quat(canonical=True).tolist()
    return x, y, z, w


def _other_cell(trial: Trial, setup: Setup, *, sign: float, turn: Rotation) -> Variant:
    """The load cell with the other sign if `sign` is -1, and turned in its own axes."""
    quaternion = quaternion_of(Rotation.from_quat(setup.cell.quaternion) * turn)
    cell = replace(setup.cell, sign=sign * setup.cell.sign, quaternion=quaternion)
    remedy: dict[str, Value] = {}
    if sign < 0.0:
        remedy["sensor.sign"] = cell.sign
    if turn.magnitude() > 0.0:
        remedy["sensor.quaternion"] = cell.quaternion
    return Variant(trial=trial, setup=replace(setup, cell=cell), remedy=remedy)


def _sign(trial: Trial, setup: Setup) -> Iterator[Variant]:
    yield _other_cell(trial, setup, sign=-1.0, turn=Rotation.identity())


def _turn(trial: Trial, setup: Setup) -> Iterator[Variant]:
    for turn in GROUP:
        yield _other_cell(trial, setup, sign=1.0, turn=turn)


def _sign_and_turn(trial: Trial, setup: Setup) -> Iterator[Variant]:
    for turn in GROUP:
        yield _other_cell(trial, setup, sign=-1.0, turn=turn)


def _angle(trial: Trial, setup: Setup) -> Iterator[Variant]:
    """The turn that aligns the measured force best."""
    cell_turn = Rotation.from_quat(setup.cell.quaternion)
    turn = cell_turn.inv() * coarse(Problem(trial, setup)).best_turn * cell_turn
    if turn.magnitude() > np.radians(5.0):
        yield _other_cell(trial, setup, sign=1.0, turn=turn)


def _axes_of_reading(trial: Trial, setup: Setup) -> Iterator[Variant]:
    source = "parameters" if setup.reads_in_world else "world"
    yield Variant(
        trial=trial,
        setup=replace(setup, reads_in_world=not setup.reads_in_world),
        remedy={"sensor.frame_source": source},
    )


MIN_UNIT_FACTOR = 10.0
"""Torque over that of the force at the tool's distance, or the other way round, as of another unit."""


def _torque_unit(trial: Trial, setup: Setup) -> Iterator[Variant]:
    """Torque in N mm or kN m: much greater or smaller than a force at the tool's distance makes."""
    changes = trial.readings.wrenches - np.median(trial.readings.wrenches, axis=0)
    force, torque = (np.sqrt((changes[:, part] ** 2).sum()) for part in (FORCE, TORQUE))
    distance = float(np.linalg.norm(np.array(setup.cell.position) - setup.tool.middle))
    ratio = torque / max(force * (distance + 0.5 * setup.tool.size), 1e-12)
    factors = []
    if ratio > MIN_UNIT_FACTOR:
        factors.append(1e-3)
    if ratio < 1.0 / MIN_UNIT_FACTOR:
        factors.append(1e3)
    for factor in factors:
        yield Variant(trial=trial, setup=replace(setup, units=(1.0, factor)), number=factor)


UNITS_N = {"kgf": 9.80665, "lbf": 4.44822, "kN": 1e3, "mN": 1e-3}


def _unit(trial: Trial, setup: Setup) -> Iterator[Variant]:
    for newtons in UNITS_N.values():
        yield Variant(trial=trial, setup=replace(setup, units=(newtons, newtons)), number=newtons)


MAX_LAG_S = 0.5


def _filter(trial: Trial, setup: Setup, point: Array) -> Variant:
    lag = min(float(np.exp(point[0])), MAX_LAG_S)
    return Variant(trial=trial, setup=replace(setup, lag=lag), number=1e3 * lag)


SAME_SHAPE = 0.01
"""Difference of moments, over the tool's size, up to which two turns of it look the same."""


def _shape(tool: Tool, turn: Rotation) -> Array:
    """Moments of a turned tool's plates, which those of one that looks the same in that turn share."""
    area = tool.plates.rows[AREA]
    parts = []
    for vectors, scale in (
        (tool.plates.rows[POSITION], tool.size),
        (tool.plates.rows[NORMAL], 1.0),
    ):
        vectors_turned = turn.apply(np.array(vectors.T)) / scale
        parts += [vectors_turned.T @ area, ((vectors_turned.T * area) @ vectors_turned).ravel()]
    return np.asarray(np.concatenate(parts) / area.sum())


def _turns_of_mesh(tool: Tool) -> list[Rotation]:
    """The turns of `GROUP` about the mesh's own axes that give the tool different shapes, in the axes of the tool."""
    of_mesh = Rotation.from_matrix(tool.frame.rotation)
    shapes = [_shape(tool, Rotation.identity())]
    turns = []
    for turn_of_mesh in GROUP:
        turn = of_mesh * turn_of_mesh * of_mesh.inv()
        shape = _shape(tool, turn)
        if min(np.abs(shape - other_shape).max() for other_shape in shapes) > SAME_SHAPE:
            shapes.append(shape)
            turns.append(turn)
    return turns


def _mesh_turned(trial: Trial, setup: Setup) -> Iterator[Variant]:
    for turn in _turns_of_mesh(setup.tool):
        yield Variant(
            trial=trial.posed(trial.position, trial.rotation * turn),
            setup=_turned_poses(setup, turn),
            remedy={
                "mesh.quaternion": quaternion_of(
                    turn * Rotation.from_matrix(setup.tool.frame.rotation)
                )
            },
        )


def _turned_poses(setup: Setup, turn: Rotation) -> Setup:
    """The cell as seen from a tool frame that is turned: the mesh is, and the load cell stays."""
    back = turn.inv()
    position = tuple(back.apply(setup.cell.position).tolist())
    quaternion = quaternion_of(back * Rotation.from_quat(setup.cell.quaternion))
    return replace(setup, cell=replace(setup.cell, position=position, quaternion=quaternion))


MAX_SHIFT_M = 0.15


def _tcp(trial: Trial, setup: Setup, point: Array) -> Variant:
    """The poses are those of another point of the tool: the mesh lies elsewhere in its frame, by a `point` [m]."""
    tool = setup.tool
    point = point * min(1.0, MAX_SHIFT_M / max(float(np.linalg.norm(point)), 1e-9))
    shift = tool.frame.rotation @ point
    place = trial.position + trial.rotation.apply(shift)
    cell = replace(setup.cell, position=tuple((np.array(setup.cell.position) - shift).tolist()))
    origin = np.array(tool.frame.origin) - point / tool.frame.scale
    return Variant(
        trial=trial.posed(place, trial.rotation),
        setup=replace(setup, cell=cell),
        remedy={"mesh.origin": tuple(np.round(origin, 3).tolist())},
        number=1e3 * float(np.linalg.norm(point)),
    )


def _mesh_unit(trial: Trial, setup: Setup) -> Iterator[Variant]:
    for factor in (1e-3, 1.0 / INCH_MM, INCH_MM, 1e3):
        tool = setup.tool
        scale = tool.frame.scale * factor
        yield Variant(
            trial=trial,
            setup=replace(setup, tool=_rescaled(tool, factor)),
            remedy={"mesh.scale": float(f"{scale:.6g}")},
            number=factor,
        )


def _w_first(trial: Trial, setup: Setup) -> Iterator[Variant]:
    quaternions = np.roll(trial.poses[:, QUATERNION], -1, axis=1)
    yield Variant(trial=trial.posed(trial.position, Rotation.from_quat(quaternions)), setup=setup)


def _world(trial: Trial, setup: Setup, point: Array) -> Variant:
    """The world frame is turned by a rotation vector with no part along z [rad]."""
    turn = Rotation.from_rotvec((point[0], point[1], 0.0))
    return Variant(
        trial=trial.posed(turn.apply(trial.position), turn * trial.rotation),
        setup=setup,
        number=float(np.degrees(np.linalg.norm(point))),
    )


def _stiffness(trial: Trial, setup: Setup, point: Array) -> Variant:
    """The tool is where the arm yields to the measured force, by up to exp(`point[0]`) [m]."""
    raw = trial.readings.at(trial.time) - np.array(setup.cell.bias)
    if setup.reads_in_world:
        force = setup.cell.sign * raw[:, FORCE]
    else:
        force = trial.rotation.apply(raw[:, FORCE] @ setup.in_tool.T)
    force = force + np.array((0.0, 0.0, GRAVITY * setup.cell.mass))
    most = float(np.exp(point[0]))
    peak = float(np.quantile(np.linalg.norm(force, axis=1), 0.99)) + 1e-9
    place = trial.position + most / peak * force
    return Variant(
        trial=trial.posed(place, trial.rotation), setup=setup, number=1e-3 * peak / most
    )


MAX_STILL_DEGREES = 2.0
"""Turn of a frame that does not turn."""
TURNS_PER_M = (-20.0, -10.0, 10.0, 20.0, 40.0)
"""Turns over the way [rad/m] that are tried; a wheel of 50 mm that does not slip has 20."""


def is_still(trial: Trial) -> bool:
    """Whether the poses never turn."""
    turns = trial.rotation[0].inv() * trial.rotation
    return bool(np.degrees(turns.magnitude().max()) < MAX_STILL_DEGREES)


def _rolling(trial: Trial, setup: Setup, point: Array) -> Variant:
    """The tool turns with its way along the ground, by a `point` [rad/m], and the load cell with it."""
    way = trial.position[:, :2] - trial.position[0, :2]
    (ahead_x, ahead_y), _ = np.linalg.svd(way - way.mean(axis=0), full_matrices=False)[2]
    far = way @ (ahead_x, ahead_y)
    forward = np.sign(far[np.abs(far).argmax()])
    axle = forward * np.array((-ahead_y, ahead_x, 0.0))
    turn = Rotation.from_rotvec(point[0] * forward * far[:, None] * axle)
    angle = float(np.degrees(point[0] * np.abs(far).max()))
    return Variant(
        trial=trial.posed(trial.position, turn * trial.rotation), setup=setup, number=angle
    )


def _wheel(trial: Trial, setup: Setup, point: Array) -> Variant:
    """The same below a load cell that does not turn, as on a wheel's knuckle."""
    variant = _rolling(trial, setup, point)
    if setup.reads_in_world:
        return variant
    still = quaternion_of(trial.rotation[0] * Rotation.from_quat(setup.cell.quaternion))
    cell = replace(setup.cell, quaternion=still)
    return replace(variant, setup=replace(setup, cell=cell, reads_in_world=True))


MIN_STEP_SHARE = 0.03
"""Of the time of a trial, before and after a step of the zero."""


def _step(trial: Trial, setup: Setup, point: Array) -> Variant:
    """The zero steps at a share of the time; before the first moment a step would be a bias."""
    time = trial.time
    share = float(np.clip(point[0], MIN_STEP_SHARE, 1.0 - MIN_STEP_SHARE))
    begin = float(time[0] + share * (time[-1] - time[0]))
    zero_columns = np.eye(6) * (time > begin)[:, None, None]
    return Variant(
        trial=trial,
        setup=replace(setup, zero_columns=zero_columns),
        number=begin,
        zero_motion="step",
    )


def _drift(trial: Trial, setup: Setup) -> Iterator[Variant]:
    share = (trial.time - trial.time[0]) / max(trial.time[-1] - trial.time[0], 1e-9)
    zero_columns = np.eye(6) * share[:, None, None]
    yield Variant(
        trial=trial, setup=replace(setup, zero_columns=zero_columns), zero_motion="drift"
    )


SLIP_SHARES = (0.1, 0.25)
"""Vertical speed, over the usual one, above which a seal slips and its friction is whole; below, it is none."""


def _friction(trial: Trial, setup: Setup) -> Iterator[Variant]:
    """The zero follows the direction of the motion along the vertical: a force there, or along axes of the tool."""
    sinking = np.gradient(trial.position[:, 2], trial.time)
    usual = float(np.quantile(np.abs(sinking), 0.9))
    tool_axes = np.repeat(np.eye(3)[None], len(trial), axis=0)
    for axes, share in product((trial.down[:, :, None], tool_axes), SLIP_SHARES):
        way = np.where(np.abs(sinking) > share * usual, np.sign(sinking), 0.0)
        zero_columns = np.zeros((len(trial), 6, 6))
        zero_columns[:, FORCE, : axes.shape[2]] = -way[:, None, None] * axes
        yield Variant(
            trial=trial, setup=replace(setup, zero_columns=zero_columns), zero_motion="friction"
        )


def _ways(angle: float, count: int) -> tuple[tuple[float, float], ...]:
    """Rotation vectors of an angle [degrees] in some directions."""
    ways = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return tuple(
        (np.radians(angle) * np.cos(way), np.radians(angle) * np.sin(way)) for way in ways
    )


WORLDS = (*_ways(180.0, 1), *_ways(90.0, 4), *_ways(12.0, 6), *_ways(25.0, 6))
SHIFTS = tuple(
    tuple(float(x) for x in way * far * axis)
    for axis in np.eye(3)
    for far in (0.015, 0.04)
    for way in (1.0, -1.0)
)


HYPOTHESES = (
    Hypothesis(cause=Cause.SURFACE, free=("surface",)),
    Hypothesis(cause=Cause.BIAS, free=("force_bias", "torque_bias")),
    Hypothesis(
        cause=Cause.WEIGHT, free=("mass", "moment", "force_bias", "torque_bias"), rarity=3.0
    ),
    Hypothesis(
        cause=Cause.PAYLOAD, free=("mass", "moment", "force_bias", "torque_bias"), rarity=4.0
    ),
    Hypothesis(cause=Cause.DELAY, free=("delay",)),
    Hypothesis(cause=Cause.STRENGTH, free=("zeta",)),
    Hypothesis(cause=Cause.LEVER, free=("lever",)),
    Hypothesis(cause=Cause.SIGN, mend=_sign),
    Hypothesis(
        cause=Cause.SIGN,
        mend=_sign,
        free=("mass", "moment", "force_bias", "torque_bias"),
        rarity=6.0,
    ),
    Hypothesis(cause=Cause.TURN, mend=_turn, rarity=3.0),
    Hypothesis(cause=Cause.SIGN_AND_TURN, mend=_sign_and_turn, free=("moment",), rarity=6.0),
    Hypothesis(cause=Cause.ANGLE, free=("turn",), rarity=3.0),
    Hypothesis(cause=Cause.ANGLE, mend=_angle, free=("turn",), rarity=8.0),
    Hypothesis(cause=Cause.AXES_OF_READING, mend=_axes_of_reading, rarity=1.0),
    Hypothesis(cause=Cause.TORQUE_UNIT, mend=_torque_unit),
    # the bias of the file may be in either unit
    Hypothesis(cause=Cause.UNIT, mend=_unit, free=("force_bias", "torque_bias"), rarity=4.0),
    Hypothesis(
        cause=Cause.FILTER,
        family=_filter,
        points=tuple((float(np.log(lag)),) for lag in (0.02, 0.06, 0.15)),
        step=0.4,
        rarity=2.0,
    ),
    Hypothesis(
        cause=Cause.ZERO_MOVES,
        family=_step,
        points=tuple((float(point),) for point in np.linspace(0.06, 0.94, 18)),
        step=0.02,
        free=("zero_change",),
        rarity=4.0,
    ),
    Hypothesis(cause=Cause.ZERO_MOVES, mend=_drift, free=("zero_change",), rarity=3.0),
    Hypothesis(cause=Cause.ZERO_MOVES, mend=_friction, free=("zero_change",), rarity=3.0),
    Hypothesis(cause=Cause.MESH_TURNED, mend=_mesh_turned, rarity=3.0),
    Hypothesis(cause=Cause.MESH_UNIT, mend=_mesh_unit),
    Hypothesis(cause=Cause.TCP, family=_tcp, points=SHIFTS, step=0.01, rarity=4.0),
    Hypothesis(cause=Cause.QUATERNIONS, mend=_w_first, rarity=2.0),
    Hypothesis(
        cause=Cause.WORLD,
        family=_world,
        points=WORLDS,
        step=0.08,
        free=("surface",),
        rarity=3.0,
        searches_surface=True,
    ),
    *(
        Hypothesis(
            cause=Cause.NOT_TURNING,
            family=family,
            points=tuple((turns,) for turns in TURNS_PER_M),
            step=3.0,
            rarity=4.0,
            is_possible=is_still,
        )
        for family in (_rolling, _wheel)
    ),
    Hypothesis(
        cause=Cause.STIFFNESS,
        family=_stiffness,
        points=tuple((float(np.log(most)),) for most in (0.0015, 0.004, 0.01)),
        step=0.4,
        rarity=4.0,
    ),
)

CELL_NUMBERS = ("surface", "force_bias", "torque_bias", "mass", "moment", "delay", "zeta", "lever")
"""The numbers of a cell that may be wrong beside another cause, and together."""
HYPOTHESES_OF_NUMBERS = [
    one for one in HYPOTHESES if {*one.free} <= {*CELL_NUMBERS} and one.is_of_numbers
]
ALONE = {Cause.ZERO_MOVES, Cause.TCP, Cause.STIFFNESS, Cause.MESH_UNIT, Cause.NOT_TURNING}
"""Causes with so much freedom that they are told alone only."""
SEVERAL_CAUSES = (
    *(
        replace(one, free=(*CELL_NUMBERS, *one.free), searches_surface=True)
        for one in HYPOTHESES
        if one not in HYPOTHESES_OF_NUMBERS and one.cause not in ALONE
    ),
    Hypothesis(cause=Cause.NUMBERS, free=CELL_NUMBERS),
)
"""The hypotheses of several causes at once: any of the numbers, and at most one other cause."""

COARSE_MOMENTS_COUNT = 180


@dataclass(frozen=True, eq=False)
class Explanation:
    """A hypothesis as it fits best: the mended variant, its fit, and the problem of that."""

    hypothesis: Hypothesis
    variant: Variant
    problem: Problem
    fit: Fit

    @property
    def cost(self) -> float:
        """The misfit, with the rarity of the cause."""
        return self.fit.misfit + self.hypothesis.rarity

    @property
    def cause(self) -> Cause:
        """The cause."""
        return self.hypothesis.cause


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A variant of a hypothesis that may fit: how it is made again for another trial, and where its fit starts."""

    hypothesis: Hypothesis
    again: Callable[[Trial, Setup], Variant]
    start: Mapping[str, Any]
    cost: float = 0.0


def explained(
    problem: Problem, base: Coarse, hypotheses: Sequence[Hypothesis] = HYPOTHESES
) -> list[Explanation]:
    """The hypotheses that may be true, each as it fits best, the best one first.

    All are fitted to few moments first. `problem`, `base`: of the cell as given, with at most `MOMENTS_COUNT`.
    """
    few_moments = problem.trial.thinned(COARSE_MOMENTS_COUNT)
    few_setup = problem.setup.thinned(COARSE_MOMENTS_COUNT)
    coarse_problem = Problem(few_moments, few_setup)
    candidates: list[_Candidate] = []
    for hypothesis in hypotheses:
        for candidate in _promising(hypothesis, coarse_problem, base):
            result = _fitted(candidate, coarse_problem, steps=COARSE_STEPS_COUNT).fit
            cost = result.misfit + hypothesis.rarity
            candidates.append(replace(candidate, start=result.values, cost=cost))
    candidates.sort(key=lambda one: one.cost)
    limit = KEPT_FACTOR * candidates[0].cost + KEPT_MISFIT_COUNT
    kept = [one for one in candidates[:FITTED_COUNT] if one.cost <= limit]
    results: dict[tuple[Cause, str], Explanation] = {}
    for candidate in kept:
        explanation = _fitted(candidate, problem, steps=FINAL_STEPS_COUNT)
        key = explanation.cause, str(sorted(explanation.variant.remedy.items()))
        if key not in results or explanation.cost < results[key].cost:
            results[key] = explanation
    return sorted(results.values(), key=lambda one: one.cost)


def explained_by_delay(problem: Problem, base: Coarse) -> Explanation:
    """A delay, as it fits best."""
    hypothesis = next(one for one in HYPOTHESES if one.cause is Cause.DELAY)
    (candidate,) = (one for one in _promising(hypothesis, problem, base) if one.start)
    return _fitted(candidate, problem, steps=FINAL_STEPS_COUNT)


def _fitted(candidate: _Candidate, problem: Problem, *, steps: int) -> Explanation:
    """The candidate, fitted. `problem`: of the cell as given."""
    variant = candidate.again(problem.trial, problem.setup)
    problem = problem.beside(variant.trial, variant.setup)
    free = candidate.hypothesis.free
    results = [fit(problem, free, start=candidate.start, steps=steps)]
    if "delay" in free and steps == FINAL_STEPS_COUNT:
        late = results[0].values["delay"]
        starts = [{**results[0].values, "delay": late + off} for off in DELAY_STEPS_S]
        results += [fit(problem, free, start=start, steps=steps) for start in starts]
    result = min(results, key=lambda one: one.misfit)
    return Explanation(candidate.hypothesis, variant, problem, result)


COARSE_STEPS_COUNT = 6
FINAL_STEPS_COUNT = 12
DELAY_STEPS_S = (-0.02, -0.01, 0.01, 0.02)
"""Off a fitted delay, where the fit starts again: between two readings at a sharp stop it finds no way."""
KEPT_FACTOR = 1.6
KEPT_MISFIT_COUNT = 10.0
FITTED_COUNT = 6
REFINEMENTS_COUNT = 9


def _promising(hypothesis: Hypothesis, problem: Problem, base: Coarse) -> Iterator[_Candidate]:
    """The variants of a hypothesis that may fit. `problem`: of the cell as given."""
    trial = problem.trial
    setup = problem.setup

    def numbered(k: int, start: Mapping[str, Any]) -> _Candidate:
        return _Candidate(hypothesis, lambda t, s: hypothesis.variants(t, s)[k], start)

    if hypothesis.is_of_numbers:
        yield numbered(0, {})
        if "surface" in hypothesis.free:
            yield numbered(0, {"surface": base.surface})
        if "delay" in hypothesis.free:
            yield numbered(0, {"delay": base.delay})
        if {"surface", "delay"} <= {*hypothesis.free}:
            yield numbered(0, {"surface": base.surface, "delay": base.delay})
        return
    variants = hypothesis.variants(trial, setup)

    def cost_of(variant: Variant) -> tuple[float, Mapping[str, Any]]:
        problem_of_variant = problem.beside(variant.trial, variant.setup)
        start: Mapping[str, Any] = {}
        if hypothesis.searches_surface:
            start = {"surface": coarse_surface(problem_of_variant)}
        return fit(problem_of_variant, hypothesis.free, start=start, steps=2).misfit, start

    if not variants:
        return
    results = [cost_of(variant) for variant in variants]
    order = np.argsort([cost for cost, _ in results])[:3]
    family = hypothesis.family
    if family is None:
        for k in order:
            yield numbered(int(k), results[k][1])
        return
    point = np.array(hypothesis.points[order[0]])
    simplex = point + hypothesis.step * np.vstack([np.zeros(len(point)), np.eye(len(point))])

    def cost_at(point: Array) -> float:
        return cost_of(family(trial, setup, point))[0]

    best = fmin(
        cost_at,
        point,
        maxfun=REFINEMENTS_COUNT * len(point),
        disp=False,
        initial_simplex=simplex,
    )
    start = cost_of(family(trial, setup, best))[1]
    yield _Candidate(hypothesis, lambda t, s: family(t, s, best), start)

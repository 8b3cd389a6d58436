"""Finds what is wrong with a cell: the hypothesis that explains its misfit, or several at once."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from rft_ros.diagnosis.coarse import Coarse, coarse
from rft_ros.diagnosis.fit import NUISANCES, TOLERANCES, Fit, Problem, Setup, fit, rows_of
from rft_ros.diagnosis.hypotheses import (
    ALONE,
    CELL_NUMBERS,
    HYPOTHESES_OF_NUMBERS,
    MAX_LAG_S,
    SEVERAL_CAUSES,
    Cause,
    Explanation,
    Hypothesis,
    Variant,
    explained,
    explained_by_delay,
    quaternion_of,
)
from rft_ros.diagnosis.trial import Trial


@dataclass(frozen=True, slots=True)
class Limits:
    """When a cause is told.

    `max_off`: greatest deviation in tolerances of a cell that needs no search. `min_gain` of the misfit, and
    `min_gain_share` of the misfit beyond noise: the model's errors are alike along a motion, so that a wrong cause can
    take up to half of it. `told_off`: least deviation in tolerances of a number, or of a tilted world, that is told;
    `far_off`: of a number that is told whatever its share, since the model's errors move none so far.
    `tie` and `tie_share` of the misfit: causes within this of the best one fit alike. `max_error` in tolerances of a
    number that the trial determines: a straight press determines neither lever nor mass; `max_error_off`: of one that
    is off and written to a file, or, as a share of what it is off, `max_error_share`: the error of a weight grows with
    it.
    """

    max_off: float = 1.0
    min_gain: float = 5.0
    min_gain_share: float = 0.5
    told_off: float = 2.0
    far_off: float = 3.0
    tie: float = 4.0
    tie_share: float = 0.15
    max_error: float = 2.0
    max_error_off: float = 1.0
    max_error_share: float = 0.025


LIMITS = Limits()
MOVED_BY = {Cause.WORLD: ("surface",)}
"""Numbers of the cell that a cause moves: they are no cause of their own beside it."""
HIDDEN_IN = {Cause.BIAS: ("mass", "moment"), Cause.SURFACE: ("lever",)}
"""Numbers whose error looks like a cause where the motion does not determine them.

At one attitude a weight is a bias. Along a straight press another TCP is another surface; its lever tells them apart.
"""
NUMBERS_SEEN_IN_AIR = {"mass", "moment", "force_bias", "torque_bias"}
"""Numbers that need no grains, whose force the model may have wrong."""
MAX_COARSE_DELAY_S = 0.015
"""Delay by the coarse search, one of its steps, that is none."""
MAX_SINGLE_FACTOR = 1.5
"""Misfit over the usual one up to which one cause explains a cell, and several are not searched."""
MAX_RIGHT_FACTOR = 5.0
"""Misfit over the usual one that no right cell has, nor one that a single cause explains: real plates have up to 3."""
MAX_LEFT_SHARE = 0.3
"""Of the misfit as given, by a cause that is told although it leaves more than right cells: few drifts are linear."""


@dataclass(frozen=True, eq=False)
class Found:
    """A cause that is told, and others that fit alike; `setup_before` and `fit_before`: of the cell as given."""

    best: Explanation
    ties: tuple[Explanation, ...]
    setup_before: Setup
    fit_before: Fit


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The causes in the order of what they explain, and the cell as if they were mended, with its fit."""

    causes: tuple[Found, ...]
    trial: Trial
    setup: Setup
    problem: Problem
    fit: Fit

    @property
    def is_explained(self) -> bool:
        """Whether what is left is less than any wrong cell leaves, in grains unlike the model, too.

        Those have the surface where it should be.
        """
        factor = self.fit.per_stretch / self.problem.usual
        surface_off = deviations(self.problem, self.fit)["surface"]
        return factor <= 1.0 or (factor <= MAX_RIGHT_FACTOR and surface_off <= LIMITS.told_off)


Search = Literal["full", "misfit", "numbers"]
"""When causes other than numbers are searched: for each deviation, for a misfit that right cells have not, or never."""


def diagnose(trial: Trial, setup: Setup, search: Search = "full") -> Diagnosis:
    """Find the causes of a cell's misfit.

    `trial`: followed, of at most `MOMENTS_COUNT`.
    """
    problem = Problem(trial, setup)
    base = coarse(problem)
    result = fit(problem)
    if _needs_nothing(problem, result) and not _is_late(problem, base, result):
        return Diagnosis((), trial, setup, problem, result)
    is_right = result.per_stretch <= problem.usual
    if search == "numbers" or (search == "misfit" and is_right):
        return _by_numbers(problem, base, result)
    return _searched(problem, base, result)


def _is_late(problem: Problem, base: Coarse, result: Fit) -> bool:
    """Whether a delay would be told: stops show it, which are short and hardly count in the whole misfit."""
    if abs(base.delay) <= MAX_COARSE_DELAY_S:
        return False
    return _is_told(explained_by_delay(problem, base), result)


def _by_numbers(problem: Problem, base: Coarse, result: Fit) -> Diagnosis:
    """The numbers of the cell that are wrong, if nothing else is. `base`, `result`: of the cell as given."""
    starts: list[Mapping[str, float]] = [{}, {"surface": base.surface, "delay": base.delay}]
    fits = [fit(problem, CELL_NUMBERS, start=start) for start in starts]
    x = Explanation(
        Hypothesis(cause=Cause.NUMBERS, free=CELL_NUMBERS),
        Variant(trial=problem.trial, setup=problem.setup),
        problem,
        min(fits, key=lambda one: one.misfit),
    )
    best, numbers = _needed(x)
    is_explained = best.fit.per_stretch <= MAX_SINGLE_FACTOR * problem.usual
    if numbers and is_explained and _is_told(best, result):
        return _mended_by(best, tuple(_found_numbers(best, numbers, problem.setup, result)))
    return Diagnosis((), problem.trial, problem.setup, problem, result)


def _searched(problem: Problem, base: Coarse, result: Fit) -> Diagnosis:
    """The cause that explains the misfit, or several at once. `base`, `result`: of the cell as given.

    One cause may leave more than right cells do, as in grains unlike the model; several must not.
    """
    setup = problem.setup
    candidates = [x for x in explained(problem, base) if _is_plausible(x)]
    best = next((x for x in candidates if _is_told(x, result)), None)
    if best and best.fit.per_stretch <= MAX_SINGLE_FACTOR * best.problem.usual:
        whole, numbers = _with_deviating(best)
        found = Found(best, _ties(best, candidates), setup, result)
        return _mended_by(whole, (found, *_found_numbers(whole, numbers, setup, result)))
    several = _several(problem, base, result) if result.per_stretch > problem.usual else None
    if several:
        return several
    if best and (
        best.fit.per_stretch <= MAX_RIGHT_FACTOR * best.problem.usual
        or best.cost <= MAX_LEFT_SHARE * result.misfit
    ):
        return _mended_by(best, (Found(best, _ties(best, candidates), setup, result),))
    return Diagnosis((), problem.trial, setup, problem, result)


def _mended_by(x: Explanation, causes: tuple[Found, ...]) -> Diagnosis:
    return Diagnosis(causes, x.variant.trial, mended(x), x.problem, x.fit)


def _ties(best: Explanation, others: Sequence[Explanation]) -> tuple[Explanation, ...]:
    """Those that fit like the best one."""
    limit = best.cost + LIMITS.tie + LIMITS.tie_share * best.fit.misfit
    return tuple(x for x in others if x.cost <= limit and _is_other(x, best))


def _several(problem: Problem, base: Coarse, result: Fit) -> Diagnosis | None:
    """Several causes that together leave no more than right cells do: numbers, and at most one other cause."""
    setup = problem.setup
    explanations = explained(problem, base, SEVERAL_CAUSES)
    candidates = [
        x for x in explanations if x.fit.per_stretch <= x.problem.usual and _is_plausible(x)
    ]
    if not candidates:
        return None
    best, numbers = _needed(candidates[0])
    if best.fit.per_stretch > best.problem.usual or not _is_told(best, result):
        return None
    found = []
    if best.cause is not Cause.NUMBERS:
        own = replace(best.hypothesis, free=_own_names(best))
        other_causes = [x for x in candidates if x.variant is not best.variant]
        found.append(
            Found(replace(best, hypothesis=own), _ties(best, other_causes), setup, result)
        )
    found += _found_numbers(best, numbers, setup, result)
    return _mended_by(best, tuple(found)) if found else None


def _found_numbers(
    best: Explanation, numbers: Sequence[Hypothesis], setup: Setup, result: Fit
) -> Iterator[Found]:
    """The numbers that are wrong in an explanation. `setup`, `result`: of the cell as given."""
    variant = replace(best.variant, remedy={})
    for hypothesis in numbers:
        yield Found(replace(best, hypothesis=hypothesis, variant=variant), (), setup, result)


def _with_deviating(x: Explanation) -> tuple[Explanation, list[Hypothesis]]:
    """An explanation, and the numbers that deviate beside it although what is given holds them."""
    numbers = [
        hypothesis
        for hypothesis in _deviating(x)
        if not {*hypothesis.free} & {*x.hypothesis.free} and hypothesis.cause is not Cause.LEVER
    ]
    if not numbers or x.cause in ALONE:
        return x, []
    free = (*x.hypothesis.free, *(name for hypothesis in numbers for name in hypothesis.free))
    whole = replace(
        x,
        hypothesis=replace(x.hypothesis, free=free),
        fit=fit(x.problem, free, start=x.fit.values),
    )
    is_better = x.fit.misfit - whole.fit.misfit >= LIMITS.min_gain * len(numbers)
    return (whole, numbers) if is_better else (x, [])


def _own_names(x: Explanation) -> tuple[str, ...]:
    moved_names = MOVED_BY.get(x.cause, ())
    return tuple(n for n in x.hypothesis.free if n not in CELL_NUMBERS or n in moved_names)


def _needed(x: Explanation) -> tuple[Explanation, list[Hypothesis]]:
    """An explanation with only those of its numbers free that it needs, and their hypotheses."""
    numbers = list(_deviating(x))
    best = _with_numbers(x, numbers)
    for hypothesis in numbers:
        fewer = _with_numbers(best, [other for other in numbers if other is not hypothesis])
        is_enough = fewer.fit.per_stretch <= fewer.problem.usual
        if is_enough and fewer.fit.misfit - best.fit.misfit < LIMITS.min_gain:
            best = fewer
            numbers = [other for other in numbers if other is not hypothesis]
    return best, numbers


def _with_numbers(x: Explanation, numbers: Sequence[Hypothesis]) -> Explanation:
    """The explanation with these numbers free, beside its own."""
    free = (*_own_names(x), *(name for hypothesis in numbers for name in hypothesis.free))
    return replace(
        x,
        hypothesis=replace(x.hypothesis, free=free),
        fit=fit(x.problem, free, start=x.fit.values),
    )


def _deviating(x: Explanation) -> Iterator[Hypothesis]:
    """The hypotheses of numbers that differ from the given ones by more than their tolerances."""
    is_weight_known = not {"mass", "moment"} & {*undetermined(x)}
    is_other_weight = is_weight_known and (_is_off("mass", x) or _is_off("moment", x))
    for hypothesis in HYPOTHESES_OF_NUMBERS:
        match hypothesis.cause:
            case Cause.WEIGHT | Cause.PAYLOAD:
                is_needed = is_other_weight and _weighs_like(hypothesis.cause, x)
            case Cause.BIAS:
                is_off = _is_off("force_bias", x) or _is_off("torque_bias", x)
                is_needed = is_off and not is_other_weight
            case Cause.LEVER:
                is_needed = _is_off("lever", x) and "lever" not in undetermined(x)
            case _:
                is_needed = any(_is_off(name, x) for name in hypothesis.free)
        if is_needed and not {*hypothesis.free} & {*MOVED_BY.get(x.cause, ())}:
            yield hypothesis


def _gain_in_air(x: Explanation, as_given: Fit) -> float:
    """How much of the misfit in the air a cause takes: there the model is not wrong.

    What the numbers that are seen there were off counts, too.
    """
    problem = x.problem
    in_air = (problem.model.low > float(x.fit.values["surface"][0]))[:, None]
    misfit_before, _ = problem.misfit(in_air * as_given.residuals)
    misfit_after, _ = problem.misfit(in_air * x.fit.residuals)
    numbers_off = sum(
        float(np.sum(((as_given.values[name] - problem.given()[rows]) / problem.scale[rows]) ** 2))
        for name in x.hypothesis.free
        if name in NUMBERS_SEEN_IN_AIR
        for rows in [rows_of(name)]
    )
    return misfit_before - misfit_after + numbers_off


def _is_off(name: str, x: Explanation) -> bool:
    """Whether a number differs from the given one by more than its tolerance."""
    rows = rows_of(name)
    scale = x.problem.scale[rows]
    off = np.abs(x.fit.values[name] - x.problem.given()[rows])
    return bool(np.any(off > LIMITS.told_off * scale))


def undetermined(x: Explanation, max_error: float = LIMITS.max_error) -> list[str]:
    """The numbers that an explanation frees, and that the trial does not determine to `max_error` tolerances."""
    names = []
    for name in x.hypothesis.free:
        if name in NUISANCES:
            continue
        scale = x.problem.scale[rows_of(name)]
        if np.any(x.fit.errors[name] > max_error * scale):
            names.append(name)
    return names


def unsure_numbers(x: Explanation) -> list[str]:
    """The numbers that keep a remedy out of the file.

    These are the undetermined ones, those that are off and not known well enough to be written (`Limits`), and those
    that hide in the cause and are off. The last ones come first.
    """
    hidden = HIDDEN_IN.get(x.cause, ())
    free = (*hidden, *x.hypothesis.free)
    joint = x
    if hidden:
        joint = replace(
            x,
            hypothesis=replace(x.hypothesis, free=free),
            fit=fit(x.problem, {*CELL_NUMBERS, *free}, start=x.fit.values),
        )
    vague_names = [
        name for name in undetermined(joint, LIMITS.max_error_off) if _is_vague(name, joint)
    ]
    uncertain_names = {*hidden, *vague_names}
    unsure = {*undetermined(joint), *(name for name in uncertain_names if _is_off(name, joint))}
    return [name for name in free if name in unsure]


def _is_vague(name: str, x: Explanation) -> bool:
    """Whether the error of a number is more than a small share of what it is off."""
    off = np.abs(x.fit.values[name] - x.problem.given()[rows_of(name)])
    return bool(x.fit.errors[name].max() > LIMITS.max_error_share * off.max())


def _needs_nothing(problem: Problem, result: Fit) -> bool:
    """Whether the misfit is usual and no number far off; λ may be farther off, since it differs between grains."""
    off = deviations(problem, result)
    length_off = off.pop("length")
    is_near = max(off.values()) <= LIMITS.max_off and length_off <= LIMITS.told_off
    return is_near and result.per_stretch <= problem.usual


def deviations(problem: Problem, result: Fit) -> dict[str, float]:
    """The greatest deviation of each number from its given value, in tolerances."""
    given_values = problem.given()
    return {
        name: float(
            np.abs(
                (result.values[name] - given_values[rows_of(name)]) / problem.scale[rows_of(name)]
            ).max()
        )
        for name in TOLERANCES
        if name not in NUISANCES
    }


def _is_told(x: Explanation, as_given: Fit) -> bool:
    """Whether a cause is plausible, and explains what the model cannot be wrong about.

    That is the force in the air, or most of the misfit. A zero that moves does so in the air, too. A number that the
    trial does not determine gains in the air by the noise: another delay meets other noise, a shorter lever has less.
    """
    gain = as_given.misfit - x.cost
    if not _is_plausible(x) or gain < LIMITS.min_gain:
        return False
    takes_most = gain >= LIMITS.min_gain_share * (as_given.misfit - x.problem.misfit_of_noise)
    takes_most |= _is_far_off(x)
    is_vague = x.hypothesis.is_of_numbers and bool(undetermined(x))
    is_shown_in_air = not is_vague and _gain_in_air(x, as_given) >= LIMITS.min_gain
    return is_shown_in_air or (takes_most and x.cause is not Cause.ZERO_MOVES)


def _is_far_off(x: Explanation) -> bool:
    """Whether numbers explain a cell that are farther off than the errors of the model move them."""
    is_explained = x.hypothesis.is_of_numbers and x.fit.per_stretch <= x.problem.usual
    given_values = x.problem.given()
    for name in x.hypothesis.free:
        rows = rows_of(name)
        off = np.abs(x.fit.values[name] - given_values[rows]) / x.problem.scale[rows]
        is_known = x.fit.errors[name] <= LIMITS.max_error_off * x.problem.scale[rows]
        if is_explained and np.any(is_known & (off > LIMITS.far_off)):
            return True
    return False


def _is_plausible(x: Explanation) -> bool:
    """Whether a cell can be wrong in the way that a cause mends, and by enough to be told."""
    match x.cause:
        case Cause.WEIGHT | Cause.PAYLOAD:
            return _weighs_like(x.cause, x) and _is_any_off(x)
        case Cause.TORQUE_UNIT:
            # in a smaller unit any torque nearly vanishes, and with it its misfit
            return x.fit.per_stretch <= MAX_RIGHT_FACTOR * x.problem.usual
        case Cause.WORLD:
            return x.variant.number >= LIMITS.told_off * TOLERANCES["turn"].value
        case Cause.TCP:
            # it moves the place where the grains' force acts
            return 1e-3 * x.variant.number >= LIMITS.told_off * TOLERANCES["lever"].value
        case Cause.FILTER:
            # it holds a reading back by its time constant, as a delay does; the longest one tried is a longer λ
            least_lag = LIMITS.told_off * float(x.problem.scale[rows_of("delay")][0])
            return least_lag <= x.variant.setup.lag < MAX_LAG_S
    return _is_any_off(x) if x.hypothesis.is_of_numbers else True


def _weighs_like(cause: Cause, x: Explanation) -> bool:
    """Whether the fitted mass is one of a weight that hangs there, or, of a payload, below 0."""
    has_weight = float(x.fit.values["mass"][0]) >= -TOLERANCES["mass"].value
    return has_weight is (cause is Cause.WEIGHT)


def _is_any_off(x: Explanation) -> bool:
    return any(_is_off(name, x) for name in x.hypothesis.free if name not in NUISANCES)


TURN_CAUSES = {Cause.TURN, Cause.SIGN_AND_TURN, Cause.MESH_TURNED}
"""Causes of which several turns may fit alike."""

# causes of which the first contains the second: the rarer one is not told beside it
_CONTAINS = {
    (Cause.PAYLOAD, Cause.BIAS),
    (Cause.BIAS, Cause.PAYLOAD),
    (Cause.BIAS, Cause.ZERO_MOVES),
    (Cause.ANGLE, Cause.TURN),
    (Cause.TURN, Cause.ANGLE),
    (Cause.SURFACE, Cause.WORLD),
    (Cause.AXES_OF_READING, Cause.NOT_TURNING),
}


def _is_other(x: Explanation, best: Explanation) -> bool:
    """Whether an explanation is another one than the best, and not one that contains it."""
    if x.cause.title == best.cause.title:
        return x.cause in TURN_CAUSES and x.variant.remedy != best.variant.remedy
    return (best.cause, x.cause) not in _CONTAINS


def mended(x: Explanation) -> Setup:
    """The set-up with the numbers that an explanation frees."""
    setup = x.variant.setup
    cell = setup.cell
    values = x.fit.values
    free = x.hypothesis.free
    into_sensor = setup.in_tool.T
    if "force_bias" in free:
        bias = np.append(into_sensor @ values["force_bias"], into_sensor @ values["torque_bias"])
        fx, fy, fz, tx, ty, tz = bias.tolist()
        cell = replace(cell, bias=(fx, fy, fz, tx, ty, tz))
    if "moment" in free:
        mass = max(float(values["mass"][0]), 0.0) if "mass" in free else cell.mass
        center = np.zeros(3)
        if mass > 0.01:
            center = cell.sign * (into_sensor @ values["moment"]) / mass
        x_center, y_center, z_center = center.tolist()
        cell = replace(cell, mass=mass, center_of_mass=(x_center, y_center, z_center))
    if "lever" in free:
        place = np.array(cell.position) + values["lever"]
        cell = replace(cell, position=tuple(place.tolist()))
    if "turn" in free:
        turned_axes = Rotation.from_rotvec(values["turn"]) * Rotation.from_quat(cell.quaternion)
        cell = replace(cell, quaternion=quaternion_of(turned_axes))
    if "delay" in free:
        cell = replace(cell, delay=cell.delay + float(values["delay"][0]))
    law = setup.law
    if "zeta" in free:
        law = replace(law, zeta=x.fit.zeta)
    surface = setup.surface
    if "surface" in free:
        surface = float(values["surface"][0])
    late = setup.late + float(values["delay"][0]) if "delay" in free else setup.late
    return replace(setup, cell=cell, law=law, surface=surface, late=late)

"""Finds what is wrong with a cell: the hypotheses that explain its misfit, one after the other."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from rft_ros.diagnosis.coarse import coarse
from rft_ros.diagnosis.fit import NUISANCES, TOLERANCES, Fit, Problem, Setup, fit, rows_of
from rft_ros.diagnosis.hypotheses import (
    COARSE_MOMENTS_COUNT,
    Cause,
    Explanation,
    explained,
    quaternion_of,
)
from rft_ros.diagnosis.trial import Trial


@dataclass(frozen=True, slots=True)
class Limits:
    """When a cause is told.

    `max_off`: greatest deviation in tolerances of a cell that needs no search. `min_gain` of the misfit by numbers, and
    `max_ratio` of the misfit by another cause. `told_off`: least deviation in
    tolerances of a number that is told, `told_ratio`: of ζ; `min_tilt_degrees`: of a world that is tilted, since grains
    push plates up to 3° out of the model's direction. `tie` and `tie_share` of the misfit: causes within this of the
    best one fit alike. `max_error` in tolerances of a number that is written to a file: a straight press determines
    neither lever nor mass.
    """

    max_off: float = 1.0
    min_gain: float = 5.0
    max_ratio: float = 0.6
    told_off: float = 2.0
    told_ratio: float = 2.1
    min_tilt_degrees: float = 6.0
    tie: float = 4.0
    tie_share: float = 0.15
    max_error: float = 2.0


LIMITS = Limits()
MAX_COARSE_DELAY_S = 0.021
"""Delay by the coarse search, one of its steps, that is none."""
MAX_MISFIT_FACTOR = 3.0
"""Misfit over the usual one that no right cell has."""
MIN_MASS_KG = 0.02
"""A smaller negative mass is none."""
CAUSES_COUNT = 3
"""Causes that are searched: of several faults at once the fit is no better than the searches of `judge`."""


@dataclass(frozen=True, eq=False)
class Found:
    """A cause that is told, and others that fit alike; `setup_before` and `fit_before`: without it."""

    best: Explanation
    ties: tuple[Explanation, ...]
    setup_before: Setup
    fit_before: Fit


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The causes in the order of what they explain, and the cell as if they were mended, with its fit.

    `is_right`: whether the cell as given needs no mending: without a search no number may deviate, and after one the
    misfit must be that of right cells.
    """

    causes: tuple[Found, ...]
    trial: Trial
    setup: Setup
    problem: Problem
    fit: Fit
    is_right: bool


def diagnose(trial: Trial, setup: Setup, *, has_search: bool = True) -> Diagnosis:
    """Find the causes of a cell's misfit; without a search, say only whether it has any.

    `trial`: followed, of at most `MOMENTS_COUNT`.
    """
    delay = _coarse_delay(trial, setup)
    if "delay" in setup.unknown:
        setup = replace(setup, late=setup.late + delay)
        delay = 0.0
    problem = Problem(trial, setup)
    result = fit(problem)
    # stops show a delay; they are short, and hardly count in the whole misfit
    is_right = _needs_nothing(problem, result) and abs(delay) <= MAX_COARSE_DELAY_S
    if is_right or not has_search:
        return Diagnosis((), trial, setup, problem, result, is_right)
    return _found_along(trial, setup, result)


def _coarse_delay(trial: Trial, setup: Setup) -> float:
    few_moments = Problem(trial.thinned(COARSE_MOMENTS_COUNT), setup.thinned(COARSE_MOMENTS_COUNT))
    return coarse(few_moments).delay


def _found_along(trial: Trial, setup: Setup, result: Fit) -> Diagnosis:
    """The causes one after the other, each as if those before were mended. `result`: of the cell as given.

    Of several causes at once those are told that leave no more than right cells do.
    """
    problem = Problem(trial, setup)
    is_right = result.per_stretch <= problem.usual
    chain = [Diagnosis((), trial, setup, problem, result, is_right)]
    while len(chain) <= CAUSES_COUNT:
        candidates = explained(trial, setup)
        told_causes = [x for x in candidates if _is_told(x, result)]
        if not told_causes:
            break
        best, *other_causes = told_causes
        limit = best.cost + LIMITS.tie + LIMITS.tie_share * best.fit.misfit
        ties = tuple(x for x in other_causes if x.cost <= limit and _is_other(x, best))
        causes = (*chain[-1].causes, Found(best, ties, setup, result))
        trial = best.variant.trial
        setup = mended(best)
        problem = Problem(trial, setup)
        result = fit(problem)
        # what no parameter mends is left as the explanation does
        fit_left = best.fit if not is_mended_by_parameters(best) else result
        chain.append(Diagnosis(causes, trial, setup, problem, fit_left, is_right=False))
        # a small rest is no ground for another cause
        if ties or fit_left is best.fit or result.per_stretch <= problem.usual:
            break
    for diagnosis in reversed(chain[1:]):
        factor = MAX_MISFIT_FACTOR if len(diagnosis.causes) == 1 else 1.0
        if diagnosis.fit.per_stretch <= factor * diagnosis.problem.usual:
            return diagnosis
    return chain[0]


def is_mended_by_parameters(x: Explanation) -> bool:
    """Whether values of parameters mend a cause: if none do, nothing more is known of the cell."""
    if x.cause is Cause.PAYLOAD:
        return False
    return bool(x.variant.remedy) or (x.hypothesis.is_of_numbers and not undetermined(x))


def undetermined(x: Explanation) -> list[str]:
    """The numbers that an explanation frees, and that the trial does not determine."""
    names = []
    for name in x.hypothesis.free:
        if name in NUISANCES or name in x.problem.setup.unknown:
            continue
        scale = x.problem.scale[rows_of(name)]
        if name == "zeta":
            scale = TOLERANCES[name].value * np.abs(x.fit.values[name])
        if np.any(x.fit.errors[name] > LIMITS.max_error * scale):
            names.append(name)
    return names


def _needs_nothing(problem: Problem, result: Fit) -> bool:
    off = deviations(problem, result)
    return result.per_stretch <= problem.usual and max(off.values(), default=0.0) <= LIMITS.max_off


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
        if name not in NUISANCES and name not in problem.setup.unknown
    }


def _is_told(x: Explanation, as_given: Fit) -> bool:
    gain = as_given.misfit - x.cost
    is_explained = x.fit.per_stretch <= max(
        x.problem.usual, LIMITS.max_ratio * as_given.per_stretch
    )
    if not is_explained:
        return False
    unknown = (*NUISANCES, *x.problem.setup.unknown)
    free = [name for name in x.hypothesis.free if name not in unknown]
    if x.cause is Cause.LEVER and undetermined(x):
        return False
    # in a smaller unit any torque nearly vanishes, and with it its misfit
    if x.cause is Cause.TORQUE_UNIT and x.fit.per_stretch > x.problem.usual:
        return False
    if x.cause in (Cause.WEIGHT, Cause.PAYLOAD):
        has_weight = float(x.fit.values["mass"][0]) >= -MIN_MASS_KG
        if has_weight is not (x.cause is Cause.WEIGHT):
            return False
    if x.hypothesis.is_of_numbers:
        given_values = x.problem.given()
        for name in free:
            rows = rows_of(name)
            off = np.abs(x.fit.values[name] - given_values[rows])
            if name == "zeta":
                ratio = float(x.fit.values[name][0] / given_values[rows][0])
                if max(ratio, 1.0 / ratio) > LIMITS.told_ratio:
                    return gain >= LIMITS.min_gain
            elif np.any(off > LIMITS.told_off * x.problem.scale[rows]):
                return gain >= LIMITS.min_gain
        return False
    if x.cause is Cause.WORLD and x.variant.number < LIMITS.min_tilt_degrees:
        return False
    return gain >= x.hypothesis.min_gain


TURN_CAUSES = {Cause.TURN, Cause.SIGN_AND_TURN, Cause.MESH_TURNED}
"""Causes of which several turns may fit alike."""

# causes of which the first contains the second: the rarer one is not told beside it
_CONTAINS = {
    (Cause.WEIGHT, Cause.BIAS),
    (Cause.PAYLOAD, Cause.BIAS),
    (Cause.BIAS, Cause.WEIGHT),
    (Cause.BIAS, Cause.ZERO_MOVES),
    (Cause.ANGLE, Cause.TURN),
    (Cause.TURN, Cause.ANGLE),
    (Cause.SURFACE, Cause.WORLD),
    (Cause.FILTER, Cause.DELAY),
    (Cause.DELAY, Cause.FILTER),
}


def _is_other(x: Explanation, best: Explanation) -> bool:
    """Whether an explanation is another one than the best, and not one that contains it."""
    if x.cause is best.cause:
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
        law = replace(law, zeta=float(values["zeta"][0]))
    surface = setup.surface
    if "surface" in free:
        surface = float(values["surface"][0])
    late = setup.late + float(values["delay"][0]) if "delay" in free else setup.late
    return replace(setup, cell=cell, law=law, surface=surface, late=late)

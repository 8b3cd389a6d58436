"""A coarse search of what a fit by small steps does not find: surface, delay, and the orientation of the load cell.

Force alone is compared, and bias, mass and ζ are fitted for each candidate by linear least squares.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from rft_ros.diagnosis.fit import Problem, rows_of
from rft_ros.diagnosis.trial import Array
from rft_ros.estimator import GRAVITY
from rft_ros.rft import FORCE

DELAYS_S = [0.01 * step for step in range(-40, 41)]
"""Delays that are tried: at stops the misfit falls within 20 ms of the right one only."""
LENGTHS_M = (1e-4, 6e-4, 3e-3)
"""λ that are tried with the delays: a start in grains of another λ looks like a delay."""
SURFACES_COUNT = 14
MAX_ZETA_FACTOR = 5.0
"""ζ over the given one, or the other way round, that is tried."""
FREEDOM_FACTOR = 3.0
"""How many tolerances bias and mass may be off."""
ALIGNMENTS_COUNT = 4

GROUP = sorted(
    (turn for turn in Rotation.create_group("O") if turn.magnitude() > 0.1),
    key=lambda turn: round(turn.magnitude(), 3),
)
"""The 23 turns that swap or reverse axes, by their angle."""
ORIENTATIONS = np.array(
    [sign * turn.as_matrix() for sign in (1.0, -1.0) for turn in (Rotation.identity(), *GROUP)]
)


@dataclass(frozen=True, eq=False)
class Coarse:
    """The height of the surface [m] and the delay [s] that fit the force best, each with the other as given.

    `best_turn`: of the readings in tool axes, at the height that fits best with any orientation.
    """

    surface: float
    delay: float
    best_turn: Rotation


def coarse(problem: Problem) -> Coarse:
    """Try heights and delays with all orientations at once."""
    setup = problem.setup
    surfaces = _surfaces(problem)
    priors = _priors(problem)
    zeta = setup.law.zeta
    now = _readings(problem, 0.0, ORIENTATIONS)
    here = [_columns(problem, setup.surface, length) for length in (setup.length, *LENGTHS_M)]
    costs = np.array(
        [_costs(_columns(problem, height, setup.length), now, priors, zeta) for height in surfaces]
    )
    delay_costs = [
        min(float(_costs(length, given, priors, zeta)[0]) for length in here)
        for given in (_readings(problem, late, ORIENTATIONS[:1]) for late in DELAYS_S)
    ]
    best_surface = surfaces[int(costs.min(axis=1).argmin())]
    best_turn = _aligned(problem, float(best_surface), _weight(problem) ** 2)
    return Coarse(
        surface=float(surfaces[costs[:, 0].argmin()]),
        delay=DELAYS_S[int(np.argmin(delay_costs))],
        best_turn=best_turn,
    )


def coarse_surface(problem: Problem) -> float:
    """The height that fits best with the load cell as it is given [m]."""
    surfaces = _surfaces(problem)
    readings = _readings(problem, 0.0, ORIENTATIONS[:1])
    priors = _priors(problem)
    setup = problem.setup
    costs = [
        _costs(_columns(problem, height, setup.length), readings, priors, setup.law.zeta)[0]
        for height in surfaces
    ]
    return float(surfaces[int(np.argmin(costs))])


def _weight(problem: Problem) -> Array:
    """Of the force of each moment, shape [n]."""
    return np.asarray(np.sqrt(problem.count_of / 3.0) / problem.error[:, 0])


def _readings(problem: Problem, late: float, orientations: Array) -> Array:
    """Weighted forces without the given bias and weight, in k orientations of the load cell, shape [3 n, k]."""
    in_tool = problem.setup.in_tool
    # an orientation turns the reading in the axes of the load cell
    turns = np.einsum("ij,kjl,ml->kim", in_tool, orientations, in_tool)
    bias = problem.given()[rows_of("force_bias")]
    forces = (problem.reading(late)[:, FORCE] - bias) @ np.swapaxes(turns, 1, 2)
    grains = forces - problem.setup.cell.mass * GRAVITY * problem.trial.down
    return np.asarray((_weight(problem)[:, None] * grains).reshape(len(turns), -1).T)


def _columns(problem: Problem, height: float, length: float) -> Array:
    """What a unit of bias, mass and ζ adds to the weighted forces, shape [3 n, 5]."""
    unit_forces = np.empty((len(problem.trial.down), 3, 5))
    unit_forces[:, :, :3] = np.eye(3)
    unit_forces[:, :, 3] = GRAVITY * problem.trial.down
    unit_forces[:, :, 4] = problem.basis(height, length).wrench[:, FORCE]
    return np.asarray((_weight(problem)[:, None, None] * unit_forces).reshape(-1, 5))


def _surfaces(problem: Problem) -> Array:
    """Heights at which the surface may lie [m]: the given one first."""
    bottom = float(problem.model.low.min())
    top = float(problem.model.low.max())
    heights = bottom + (top - bottom) * np.linspace(0.03, 1.0, SURFACES_COUNT)
    return np.append(problem.setup.surface, heights)


def _priors(problem: Problem) -> Array:
    """Inverse squares of how far bias, mass and ζ may be off, shape [5]."""
    bias = FREEDOM_FACTOR * problem.scale[rows_of("force_bias")]
    mass = FREEDOM_FACTOR * problem.scale[rows_of("mass")]
    return np.asarray(np.append(np.append(bias, mass) ** -2.0, 1e-9))


def _costs(columns: Array, readings: Array, priors: Array, zeta: float) -> Array:
    """The misfit of readings in several orientations, shape [k], with bias, mass and a plausible ζ that fit best."""

    def solved(columns: Array, readings: Array, priors: Array) -> tuple[Array, Array]:
        right = columns.T @ readings
        values = np.linalg.solve(columns.T @ columns + np.diag(priors), right)
        costs: Array = (readings**2).sum(axis=0) - (right * values).sum(axis=0)
        return np.asarray(values), costs

    values, costs = solved(columns, readings, priors)
    plausible = np.clip(values[4], zeta / MAX_ZETA_FACTOR, zeta * MAX_ZETA_FACTOR)
    is_off = plausible != values[4]
    if is_off.any():
        rest = readings[:, is_off] - columns[:, 4:] * plausible[is_off]
        _, costs[is_off] = solved(columns[:, :4], rest, priors[:4])
    return np.asarray(costs)


def _aligned(problem: Problem, height: float, weight: Array) -> Rotation:
    """The turn of the readings that aligns them with the model's force and weight, with ζ in turns."""
    mass = problem.setup.cell.mass
    gravity = GRAVITY * problem.trial.down
    reading = problem.reading(0.0)[:, FORCE] - problem.given()[rows_of("force_bias")]
    model_force = problem.basis(height, problem.setup.length).wrench[:, FORCE]
    zeta = problem.setup.law.zeta

    def centred(force: Array) -> Array:
        return np.asarray(force - np.average(force, axis=0, weights=weight))

    turn = Rotation.identity()
    for _ in range(ALIGNMENTS_COUNT):
        expected_force = centred(zeta * model_force + mass * gravity)
        left_vectors, _, right_vectors = np.linalg.svd(
            (weight[:, None] * centred(reading)).T @ expected_force
        )
        handedness = np.diag(
            (1.0, 1.0, float(np.sign(np.linalg.det(left_vectors @ right_vectors))))
        )
        turn = Rotation.from_matrix(right_vectors.T @ handedness @ left_vectors.T)
        grains = centred(turn.apply(reading) - mass * gravity)
        shape = centred(model_force)
        square = max(float(weight @ (shape**2).sum(axis=1)), 1e-12)
        zeta = max(
            float(weight @ (grains * shape).sum(axis=1)) / square, 0.1 * problem.setup.law.zeta
        )
    return turn

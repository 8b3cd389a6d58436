"""A component of the force that stays at its greatest reading, with its noise, while the model's force grows on.

A limit without noise is seen without a model (module `readings`).
"""

from collections.abc import Iterator
from itertools import product

import numpy as np

from rft_ros.diagnosis.finding import Finding
from rft_ros.diagnosis.fit import FLOOR_SHARE, Problem, Setup
from rft_ros.diagnosis.readings import saturated
from rft_ros.estimator import GRAVITY
from rft_ros.rft import FORCE

MIN_AT_LIMIT = 10
"""Moments in motion at the limit that show it: at rest a force without a limit stays, too."""
MIN_BELOW_LIMIT = 6
"""Moments below it that show how much the model's force is in the unit of the readings."""
NOISES_AT_LIMIT = 4.0
"""How near to the greatest reading others are at the limit, by the noise."""
MIN_EXCESS_FACTOR = 5.0
"""How far the model's force grows above the limit, in standard errors of the whole force.

A side force of a limit's size is within the error of the force that the grains push with along another axis.
"""


def saturation(problem: Problem, setup: Setup) -> Iterator[Finding]:
    """Axes of the force at their limits, in both of their directions. `setup`: of the cell as it is mended."""
    trial = problem.trial
    readings = trial.readings.at(trial.time + setup.late)[:, FORCE]
    axes = setup.cell_axes(trial)
    weight = np.einsum("nji,nj->ni", axes, setup.cell.mass * GRAVITY * trial.down)
    low = problem.model.low
    is_high = low >= np.quantile(low, 0.9)
    change = readings - np.median((readings - weight)[is_high], axis=0)
    world_force = problem.basis(setup.surface, setup.length).wrench[:, FORCE]
    expected = np.einsum("nji,nj->ni", axes, world_force)
    moves = np.array(problem.model.kinds) != "rest"
    moves[problem.unknown_rows(setup.surface)] = False
    for axis, side in product(range(3), (1.0, -1.0)):
        reading = side * change[:, axis]
        force = side * expected[:, axis]
        hanging_force = side * weight[:, axis]
        limit = float(np.quantile(reading, 0.995))
        band = NOISES_AT_LIMIT * float(trial.readings.noise[axis])
        at_limit = moves & (reading >= limit - max(band, 1e-6 * abs(limit)))
        below = (reading > 0.2 * limit) & (reading < 0.9 * limit)
        is_seen = at_limit.sum() >= MIN_AT_LIMIT and below.sum() >= MIN_BELOW_LIMIT
        is_force = limit > max(band, FLOOR_SHARE * np.abs(change).max())
        if not (is_seen and is_force):
            continue
        # the model's force in the unit of the readings
        scale = ((reading - hanging_force) * force)[below].sum() / max(
            (force[below] ** 2).sum(), 1e-12
        )
        modelled_force = scale * force + hanging_force
        growth = modelled_force[at_limit] / limit
        low_growth, high_growth = np.quantile(growth, (0.2, 0.9))
        excess = np.quantile(((modelled_force - limit) / problem.error[:, 0])[at_limit], 0.9)
        if scale > 0.0 and low_growth > 0.9 and excess > MIN_EXCESS_FACTOR:
            stays = float(readings[at_limit, axis].mean())
            sentence = (
                f"stays at {stays:.3g} N where the model's grows on, to {high_growth:.2g} times it"
            )
            yield saturated(axis, sentence, stays)

"""How well a set-up explains the measured forces: a residual of three parts, 0 if it does.

That of directions depends neither on the strength of the grains nor on its growth with depth. That of the growth is
taken with the power of depth and the surface that suit an explanation best: under real plates and wheels the pressure
grows as depth to the power of 1.3 to 1.6, in simulated beads more slowly than linearly. The third is that of the tool's
weight in the air, if its attitude changes there.
"""

import numpy as np

from rft_ros.diagnosis.air import SPREAD
from rft_ros.diagnosis.evidence import Array, Evidence
from rft_ros.rft import FORCE

LEAST_ZETA = 0.05
MOST_ZETA = 5.0
"""Range of ζ of dry grains."""

_POWERS = np.linspace(-0.3, 0.6, 10)  # of depth by which the force may differ from the model's
_FAINT = 0.05  # of the greatest predicted force: the direction of a smaller one is not compared
# of the greatest predicted force: a smaller change of the force in the air counts little
_OF_PEAK = 0.02


def directions(e: Evidence) -> Array:
    """Mean product of the predicted and the measured direction in the cell's axes, shape [3, 3]: alike, its trace is 1.

    Moments of small forces weigh less.
    """
    model = e.push.model
    expected = np.linalg.norm(model, axis=1)
    size = np.sqrt(expected * np.linalg.norm(e.push.force, axis=1))
    weight = np.where(expected > _FAINT * expected.max(), size, 0.0)
    scale = weight / np.maximum(size, 1e-6) ** 2
    product = (scale[:, None] * model).T @ e.push.force
    return np.asarray(product / max(weight.sum(), 1e-12))


def _of_growth(e: Evidence) -> float:
    """Share of the force's square that no power of depth explains."""
    expected = np.linalg.norm(e.push.model, axis=1)
    measured = np.linalg.norm(e.push.force, axis=1)
    depth = e.push.depth / e.push.depth.max()
    grown = expected * depth ** _POWERS[:, None]
    shared = (grown @ measured) ** 2 / np.maximum((grown**2).sum(axis=1), 1e-12)
    return float(1.0 - shared.max() / max(measured @ measured, 1e-12))


def _of_weight(e: Evidence) -> float:
    """Share of the square of the force in the air that no weight explains; small changes there count little."""
    if not e.air.is_enough:
        return 0.0
    down = e.air.down - e.air.down.mean(axis=0)
    if (down**2).sum() < len(down) * SPREAD**2:
        return 0.0
    force = e.air.with_weight[:, FORCE]
    force = force - force.mean(axis=0)
    square = float((force**2).sum())
    shared = float((force * down).sum()) ** 2 / float((down**2).sum())
    small = len(force) * (_OF_PEAK * float(np.abs(e.model).max())) ** 2
    return (square - shared) / max(square + small, 1e-12)


def residual(e: Evidence) -> float:
    """That of a set-up; 2 where no push is seen."""
    if not e.push_is_seen:
        return 2.0
    return 1.0 - float(np.trace(directions(e))) + _of_growth(e) + _of_weight(e)


def zeta_of(e: Evidence) -> float:
    """ζ that suits the force while the tool is pushed."""
    model = e.push.model
    return float(e.law.zeta * (model * e.push.force).sum() / max((model**2).sum(), 1e-12))


def is_dry(zeta: float) -> bool:
    """Whether dry grains have such a ζ."""
    return LEAST_ZETA <= zeta <= MOST_ZETA

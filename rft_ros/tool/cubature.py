"""Fewer plates for a known scene: empirical cubature (An, Kim, James, ACM Trans. Graph. 27(5), 2008).

Selects some of a tool's plates and scales their areas so that they reproduce the whole tool's wrench over the scene.
A greedy search adds the plate most like the missing wrench. The areas are a non-negative least-squares fit.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import Plates, plate_forces, rotation_matrix
from rft_ros.tool.random_motions import LAWS

__all__ = ["chosen_plates"]

Array = NDArray[np.float64]

_MOST_NUMBERS = 30_000_000  # in the matrix of all plates' wrenches; beyond it, every k-th state is used
_FAINT = 1e-3  # of the strongest plate: weaker ones would get meaningless areas
_RIDGE = 1e-10  # of the plates' squared norms; keeps the equations solvable for plates that are alike


def chosen_plates(plates: Plates, states: Array) -> Iterator[Plates]:
    """Selections of plates, each one plate larger, that reproduce the wrench of all plates over `states`.

    `states`: shape [n, 13], units as `rft_ros.rft.STATE`. Ends when one more plate does not improve the fit.
    """
    every = 1 + len(LAWS) * 6 * len(states) * len(plates) // _MOST_NUMBERS
    matrix = _wrenches_of_plates(plates, states[::every])
    target = matrix.sum(axis=1)
    norm = np.linalg.norm(matrix, axis=0)
    if not norm.max() > 0.0:
        return
    per_norm = np.where(norm > _FAINT * norm.max(), 1.0 / np.maximum(norm, _FAINT * norm.max()), 0.0)
    rows = plates.rows
    chosen: list[int] = []
    missing = target
    while True:
        gain = (missing @ matrix) * per_norm
        gain[chosen] = 0.0
        best = int(np.argmax(gain))
        if gain[best] <= 0.0:
            return
        chosen.append(best)
        factors = _factors(matrix[:, chosen] * per_norm[chosen], target)
        chosen = [plate for plate, factor in zip(chosen, factors, strict=True) if factor > 0.0]
        factors = factors[factors > 0.0] * per_norm[chosen]
        missing = target - matrix[:, chosen] @ factors
        few = rows[:, chosen]
        few[6] *= factors
        yield Plates(few)


def _wrenches_of_plates(plates: Plates, states: Array) -> Array:
    """Force, and torque over the tool's reach, of each plate at each state by each law; shape [laws 6 n, plates]."""
    cases = [(law, state) for law in LAWS for state in states]
    out = np.empty((len(cases), 6, len(plates)))
    for wrench, (law, state) in zip(out, cases, strict=True):
        force = plate_forces(plates, law, state)
        wrench[:3] = force.T
        wrench[3:] = np.cross(plates.packed[:3].T @ rotation_matrix(state[3:7]).T, force).T / plates.reach
    return out.reshape(-1, len(plates))


def _factors(matrix: Array, target: Array) -> Array:
    """Non-negative least squares by the normal equations: the columns are few, and of unit length."""
    from scipy.optimize import nnls

    gram = matrix.T @ matrix + _RIDGE * np.eye(matrix.shape[1])
    right = matrix.T @ target
    factors = np.linalg.solve(gram, right)
    if (factors > 0.0).all():
        return np.asarray(factors, dtype=np.float64)
    lower = np.linalg.cholesky(gram)
    return np.asarray(nnls(lower.T, np.linalg.solve(lower, right))[0])

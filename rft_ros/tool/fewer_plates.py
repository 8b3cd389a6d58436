"""Fewer plates: for any motion by merging neighbours, for a known scene by selection.

Merging: k-means, weighted by area, groups plates by position over the tool's radius and by outward normal, so that
groups are small where the tool bends and large where it is flat. A group keeps its area and, for the refined rule, its
second moments about the centroid and the spread of its normals.

Selection: empirical cubature (An, Kim, James, ACM Trans. Graph. 27(5), 2008). A greedy search adds the plate most like
the missing wrench; the areas are a non-negative least-squares fit.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import MEDIA, Law, Plates, alpha_y_model, plate_forces, rotation_matrix, treers2021

__all__ = ["LAWS", "Merger", "chosen_plates"]

Array = NDArray[np.float64]
Labels = NDArray[np.int64]

LAWS: tuple[Law, ...] = tuple(
    treers2021(MEDIA["generic"], alpha_y_model(name, MEDIA["generic"])) for name in ("constant", "linear")
)
"""Laws that plates are chosen with: plates chosen with one α_y model have errors of 2 % with the other."""

_CELLS = 4096  # k-means groups at most this many; a finer tool is first divided into cells
_ROUNDS = 6  # of k-means; more change the error less than its scatter
_CANCELLED = 1e-6  # length of a mean normal below which it has no direction, as of the two sides of a plate

_MOST_NUMBERS = 30_000_000  # in the matrix of all plates' wrenches; beyond it, every k-th state is used
_FAINT = 1e-3  # of the strongest plate: weaker ones would get meaningless areas
_RIDGE = 1e-10  # of the plates' squared norms; keeps the equations solvable for plates that are alike


class Merger:
    """Merges plates into any smaller number of plates; the work common to all numbers is done once."""

    def __init__(self, plates: Plates) -> None:
        self._rows = rows = plates.rows
        place = rows[:3] - (rows[:3] @ rows[6] / rows[6].sum())[:, None]
        radius = float(np.linalg.norm(place, axis=0).max())
        features = np.vstack([place / (radius or 1.0), rows[3:6]]).T
        self._cells = _halved(features, rows[6], _CELLS)
        self._areas = np.bincount(self._cells, rows[6]).astype(np.float64)
        self._features = _means(self._cells, rows[6], features)

    @property
    def most(self) -> int:
        """The largest number of plates that `merged` can return."""
        return len(self._areas)

    def merged(self, count: int) -> Plates:
        """About `count` plates, at most `count`."""
        groups = _halved(self._features, self._areas, count)
        for _ in range(_ROUNDS if count < self.most else 0):
            means = _means(groups, self._areas, self._features)
            nearest = (0.5 * (means * means).sum(axis=1) - self._features @ means.T).argmin(axis=1)
            groups = np.unique(nearest, return_inverse=True)[1].reshape(-1)
        return Plates(_united(self._rows, groups[self._cells]))


def _means(groups: Labels, weights: Array, values: Array) -> Array:
    """Weighted mean of each group, shape [groups, k]; values: shape [n, k]."""
    totals = [np.bincount(groups, weights * column) for column in values.T]
    return np.stack(totals, axis=1) / np.bincount(groups, weights)[:, None]


def _halved(features: Array, areas: Array, parts: int) -> Labels:
    """Group of each row, shape [n]: repeated halving along the widest feature into about equal areas."""
    if parts >= len(features):
        return np.arange(len(features))

    def halved(members: Labels, parts: int) -> list[Labels]:
        if parts == 1:
            return [members]
        here = features[members]
        ordered = members[np.argsort(here[:, np.argmax(np.ptp(here, axis=0))], kind="stable")]
        low = parts // 2
        area = np.cumsum(areas[ordered])
        cut = int(np.clip(np.searchsorted(area, area[-1] * low / parts), low, len(ordered) - (parts - low)))
        return halved(ordered[:cut], low) + halved(ordered[cut:], parts - low)

    groups = np.empty(len(features), dtype=np.int64)
    for group, members in enumerate(halved(np.arange(len(features)), parts)):
        groups[members] = group
    return groups


def _united(rows: Array, groups: Labels) -> Array:
    """One plate for each group, rows as `Plates.rows`; a group of one plate is that plate."""
    area = np.bincount(groups, rows[6])
    out = np.vstack([_means(groups, rows[6], rows[:6].T).T, area])
    one, alone = np.unique(groups, return_index=True)[1], np.bincount(groups) == 1  # one plate of each group
    cancelled = np.linalg.norm(out[3:6], axis=0) < _CANCELLED
    out[3:6, cancelled] = rows[3:6, one[cancelled]]
    out[3:6] /= np.linalg.norm(out[3:6], axis=0)
    if len(rows) > 7:
        # half angle of a fade with the variance of the group's normals
        tilt = np.arccos(np.clip((rows[3:6] * out[3:6, groups]).sum(axis=0), -1.0, 1.0))
        half = np.arcsin(np.minimum(0.5 / rows[13], 1.0))
        angle = np.sqrt(_means(groups, rows[6], (1.5 * tilt**2 + half**2)[:, None])[:, 0])
        out = np.vstack([out, _triangles(rows, groups, out), 0.5 / np.sin(np.minimum(angle, 0.5 * np.pi))])
    out[:, alone] = rows[:, one[alone]]
    return out


def _triangles(rows: Array, groups: Labels, united: Array) -> Array:
    """Two corners, relative to the centroid, of a triangle with each group's second moments, shape [6, m].

    Equal moments give a submerged plate the depth integral and the centre of pressure of its parts.
    """
    normal = united[3:6].T
    side = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
    side /= np.linalg.norm(side, axis=1)[:, None]
    axes = np.stack([side, np.cross(normal, side)], axis=1)  # shape [m, 2, 3]
    vectors = rows[:3] - united[:3, groups], rows[7:10], rows[10:13]
    away, first, second = (np.einsum("nak,kn->na", axes[groups], vector) for vector in vectors)
    moments = away[:, :, None] * away[:, None]
    for corner in (first, second, -first - second):
        moments += corner[:, :, None] * corner[:, None] / 12.0
    size, direction = np.linalg.eigh(_means(groups, rows[6], moments.reshape(-1, 4)).reshape(-1, 2, 2))
    spread = direction * np.sqrt(np.maximum(size, 0.0))[:, None]
    # a triangle inscribed in the unit circle has moments of 1/8; corners at a quarter turn, and a third further
    turn = np.pi * np.array([0.5, 0.5 + 2.0 / 3.0])
    corners = np.einsum("mab,bc,mak->ckm", spread, np.sqrt(8.0) * np.stack([np.cos(turn), np.sin(turn)]), axes)
    return np.asarray(corners.reshape(6, -1))


def chosen_plates(plates: Plates, states: Array) -> Iterator[Plates]:
    """Selections of plates, each one plate larger, that reproduce the wrench of all plates over `states`.

    `states`: shape [n, 13], units as `rft_ros.rft.STATE`. Ends when one more plate does not improve the fit.
    """
    from scipy.optimize import nnls

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
        # by the normal equations: the columns are few, and of unit length
        columns = matrix[:, chosen] * per_norm[chosen]
        lower = np.linalg.cholesky(columns.T @ columns + _RIDGE * np.eye(len(chosen)))
        factors = nnls(lower.T, np.linalg.solve(lower, columns.T @ target))[0]
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

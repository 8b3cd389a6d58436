"""Fewer plates for any motion: neighbours with similar normals become one plate.

k-means, weighted by area, groups plates by position over the tool's radius and by outward normal: groups are small
where the tool bends and large where it is flat. A group keeps its area and, for the refined rule, its second moments
about the centroid and the spread of its normals.
"""

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import Plates

__all__ = ["Merger"]

Array = NDArray[np.float64]
Labels = NDArray[np.int64]

_CELLS = 4096  # k-means groups at most this many; a finer tool is first divided into cells
_CANCELLED = 1e-6  # length of a mean normal below which it has no direction, as of the two sides of a plate
_ROUNDS = 6  # of k-means; more change the error less than its scatter


class Merger:
    """Merges plates into any smaller number of plates; the work common to all numbers is done once."""

    def __init__(self, plates: Plates) -> None:
        self._rows = rows = plates.rows
        center = rows[:3] @ rows[6] / rows[6].sum()
        place = rows[:3] - center[:, None]
        radius = float(np.linalg.norm(place, axis=0).max())
        features = np.vstack([place / (radius or 1.0), rows[3:6]]).T
        self._cells = _halved(features, rows[6], _CELLS)
        self._areas = _totals(self._cells, rows[6])
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
    total = _totals(groups, weights)
    return np.stack([_totals(groups, weights * column) / total for column in values.T], axis=1)


def _totals(groups: Labels, weights: Array) -> Array:
    return np.asarray(np.bincount(groups, weights), dtype=np.float64)


def _halved(features: Array, areas: Array, parts: int) -> Labels:
    """Group of each row, shape [n]: repeated halving along the widest feature into about equal areas."""
    groups = np.arange(len(features))
    if parts >= len(features):
        return groups
    first = 0

    def halve(members: Labels, parts: int) -> None:
        nonlocal first
        if parts == 1:
            groups[members] = first
            first += 1
            return
        here = features[members]
        ordered = members[np.argsort(here[:, np.argmax(np.ptp(here, axis=0))], kind="stable")]
        low = parts // 2
        area = np.cumsum(areas[ordered])
        cut = int(np.searchsorted(area, area[-1] * low / parts))
        cut = min(max(cut, low), len(ordered) - (parts - low))
        halve(ordered[:cut], low)
        halve(ordered[cut:], parts - low)

    halve(groups.copy(), parts)
    return groups


def _united(rows: Array, groups: Labels) -> Array:
    """One plate for each group, rows as `Plates.rows`; a group of one plate is that plate."""
    area = _totals(groups, rows[6])
    out = np.vstack([_means(groups, rows[6], rows[:6].T).T, area[None]])
    alone, first = np.unique(groups, return_index=True)[1], np.bincount(groups) == 1
    cancelled = np.linalg.norm(out[3:6], axis=0) < _CANCELLED
    out[3:6, cancelled] = rows[3:6, alone[cancelled]]
    out[3:6] /= np.linalg.norm(out[3:6], axis=0)
    if len(rows) > 7:
        cosine = np.clip((rows[3:6] * out[3:6, groups]).sum(axis=0), -1.0, 1.0)
        out = np.vstack([out, _triangles(rows, groups, out), _fade(rows, groups, np.arccos(cosine))])
    out[:, first] = rows[:, alone[first]]
    return out


def _triangles(rows: Array, groups: Labels, united: Array) -> Array:
    """Two corners, relative to the centroid, of a triangle with each group's second moments, shape [6, m].

    Equal moments give a submerged plate the depth integral and the centre of pressure of its parts.
    """
    normal = united[3:6].T
    side = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
    side /= np.linalg.norm(side, axis=1)[:, None]
    axes = np.stack([side, np.cross(normal, side)], axis=1)  # shape [m, 2, 3]
    of_plate = axes[groups]
    away = np.einsum("nak,kn->na", of_plate, rows[:3] - united[:3, groups])
    corners = np.stack([rows[7:10], rows[10:13], -rows[7:10] - rows[10:13]], axis=1)  # shape [3, corner, n]
    inside = np.einsum("nak,kcn->nac", of_plate, corners)
    moments = away[:, :, None] * away[:, None] + np.einsum("nac,nbc->nab", inside, inside) / 12.0
    mean = _means(groups, rows[6], moments.reshape(-1, 4)).reshape(-1, 2, 2)
    size, direction = np.linalg.eigh(mean)
    spread = direction * np.sqrt(np.maximum(size, 0.0))[:, None]
    # a triangle inscribed in the unit circle has moments of 1/8; corners at a quarter turn, and a third further
    turn = np.pi * np.array([0.5, 0.5 + 2.0 / 3.0])
    two = np.einsum("mab,bc,mak->cmk", spread, np.sqrt(8.0) * np.stack([np.cos(turn), np.sin(turn)]), axes)
    return np.concatenate([two[0].T, two[1].T])


def _fade(rows: Array, groups: Labels, angles: Array) -> Array:
    """1 / (2 sin θ) of each group, shape [1, m]: θ such that a fade over ±θ has the variance of the group's normals."""
    half = np.arcsin(np.minimum(0.5 / rows[13], 1.0))
    variance = _means(groups, rows[6], (1.5 * angles**2 + half**2)[:, None])[:, 0]
    return np.asarray(0.5 / np.sin(np.minimum(np.sqrt(variance), 0.5 * np.pi)))[None]

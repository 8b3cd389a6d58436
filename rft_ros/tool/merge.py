"""Fewer plates for any motion: neighbours that face alike become one.

Plates are grouped by place and outward normal, a tool's radius counting as much as a unit of the normal, so that the
groups are small where the tool bends and large where it is flat (k-means, weighted by area). A group keeps its area
and, for the refined rule, its second moments about the centroid and the spread of its normals.
"""

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import Plates

__all__ = ["Merger"]

Array = NDArray[np.float64]
Labels = NDArray[np.int64]

_CELLS = 4096  # what the grouping looks at, at most: finer plates are halved down to that first
_ROUNDS = 6  # of k-means; more change the error by less than its scatter


class Merger:
    """Merges the same plates to any number of them; what is common to all numbers is done once."""

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
        """More plates than this it cannot make."""
        return len(self._areas)

    def merged(self, count: int) -> Plates:
        """About `count` plates, never more."""
        groups = _halved(self._features, self._areas, count)
        for _ in range(_ROUNDS if count < self.most else 0):
            means = _means(groups, self._areas, self._features)
            nearest = (0.5 * (means * means).sum(axis=1) - self._features @ means.T).argmin(axis=1)
            groups = np.unique(nearest, return_inverse=True)[1].reshape(-1)
        return Plates.from_rows(_united(self._rows, groups[self._cells]))


def _means(groups: Labels, weights: Array, values: Array) -> Array:
    """Weighted mean of each group, shape [groups, k]; values: shape [n, k]."""
    total = _totals(groups, weights)
    return np.stack([_totals(groups, weights * column) / total for column in values.T], axis=1)


def _totals(groups: Labels, weights: Array) -> Array:
    return np.asarray(np.bincount(groups, weights), dtype=np.float64)


def _halved(features: Array, areas: Array, parts: int) -> Labels:
    """Groups 0 .. of like features and about the same area: halved along the widest feature, again and again."""
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
    """One plate for each group, rows as `Plates.rows`; a group of one stays as it is."""
    area = _totals(groups, rows[6])
    out = np.vstack([_means(groups, rows[6], rows[:6].T).T, area[None]])
    out[3:6] /= np.linalg.norm(out[3:6], axis=0)
    if len(rows) > 7:
        cosine = np.clip((rows[3:6] * out[3:6, groups]).sum(axis=0), -1.0, 1.0)
        out = np.vstack([out, _triangles(rows, groups, out), _fade(rows, groups, np.arccos(cosine))])
    alone, first = np.unique(groups, return_index=True)[1], np.bincount(groups) == 1
    out[:, first] = rows[:, alone[first]]
    return out


def _triangles(rows: Array, groups: Labels, united: Array) -> Array:
    """Two corners from the centroid of a triangle with the second moments of each group in its plane, shape [6, m].

    With them the depth's integral and the centre of pressure of a submerged plate are those of its parts.
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
    # of a unit circle's inscribed triangle the moments are 1/8: corners at a quarter turn, and a third further
    turn = np.pi * np.array([0.5, 0.5 + 2.0 / 3.0])
    two = np.einsum("mab,bc,mak->cmk", spread, np.sqrt(8.0) * np.stack([np.cos(turn), np.sin(turn)]), axes)
    return np.concatenate([two[0].T, two[1].T])


def _fade(rows: Array, groups: Labels, angles: Array) -> Array:
    """1 / (2 sin θ) for each group, shape [1, m]: the fade of θ either way varies as its normals do across a line."""
    half = np.arcsin(np.minimum(0.5 / rows[13], 1.0))
    variance = _means(groups, rows[6], (1.5 * angles**2 + half**2)[:, None])[:, 0]
    return np.asarray(0.5 / np.sin(np.minimum(np.sqrt(variance), 0.5 * np.pi)))[None]

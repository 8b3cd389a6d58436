"""Plate elements: the tool's surface as flat pieces, each a point (published rule) or a triangle (refined rule).

The kernel visits them in blocks of neighbours and skips blocks in which no plate is wet or leads: about half of a
body's plates trail, and a tool is seldom fully submerged. Skipping single plates would prevent vectorisation.
"""

from dataclasses import dataclass, field, fields
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["BLOCK", "INTEGRATIONS", "ROUNDING", "Blocks", "Integration", "Plates"]

BLOCK = 16
"""Plates in a block, of which the kernel asks together whether they are wet and lead."""

ROUNDING = 1e-12
"""Relative margin of the bounds of blocks against rounding."""

Integration = Literal["centroid", "refined"]
INTEGRATIONS: tuple[Integration, ...] = ("centroid", "refined")
"""The integration rules: see `Plates.integration`."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """Plates in the kernel's order, padded to whole blocks by copies without area.

    `rows`: shape [blocks * (7 or 14) * BLOCK], block by block its rows: those of `Plates.packed`, and for the refined
    rule two corners relative to the centroid [m] and 1 / (2 sin θ), θ the half angle. `order`: the plate in each place
    before the padding, shape [n]. `bounds`: shape [20, blocks]: boxes (middle, half of the sides) of the normals, of
    r x n [m] and of the positions [m]; area [m²]; sine of the greatest half angle.
    """

    rows: Array
    order: NDArray[np.int64]
    bounds: Array

    def __post_init__(self) -> None:
        for array in (self.rows, self.order, self.bounds):
            array.flags.writeable = False

    def __reduce__(self) -> tuple[Any, ...]:
        # unpickled arrays are writable, so `__post_init__` must run
        return Blocks, (self.rows, self.order, self.bounds)


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Plates:
    """Plate elements in the tool frame.

    ``Plates(rows)`` takes rows as in `rows`, selected, merged or weighted by area; shape [7, n] or [14, n]. Raises
    ValueError for another shape, no plates, values that are not finite, negative areas and zero normals.

    `packed`: shape [7, n], C-contiguous rows x, y, z [m] of the centroid, outward unit normal nx, ny, nz, area [m²].
    `reach`: greatest distance of any point of a plate from the tool frame's origin [m].
    `integration`: ``centroid``, the published rule: depth and velocity at the centroid; a plate either leads or not.
    ``refined``: each plate is a triangle; depth is integrated over its part below the surface, the force acts at its
    centre of pressure, and the leading share grows continuously over its half angle (`from_triangles`).
    `blocks`: the same plates in the kernel's order. `form`: what the kernel takes of them.
    """

    packed: Array
    reach: float
    integration: Integration
    blocks: Blocks
    form: tuple[Array, Array, bool, float] = field(repr=False)

    def __init__(self, rows: ArrayLike) -> None:
        r = np.array(rows, dtype=np.float64, order="C")
        if r.ndim != 2 or len(r) not in (7, 14):
            raise ValueError(f"plates have 7 rows, or 14 for the refined rule; got shape {r.shape}")
        if r.shape[1] == 0:
            raise ValueError("a tool needs at least one plate element; got none")
        if not np.isfinite(r[:7]).all():
            raise ValueError("plate centroids, normals and areas must be finite numbers")
        length = np.linalg.norm(r[3:6], axis=0)
        if (r[6] < 0.0).any() or (length == 0.0).any():
            raise ValueError("plate areas must not be negative, and normals not zero")
        if not np.isfinite(r[7:]).all() or not (r[13:] >= 0.5).all():
            raise ValueError("rows of refined plates must be finite, and the last one at least 1/2")
        r[3:6] /= length
        far = np.zeros(r.shape[1])  # of a plate's points from its centroid
        if len(r) > 7:
            first, second = r[7:10], r[10:13]
            far = np.sqrt(np.max([(e * e).sum(axis=0) for e in (first, second, first + second)], axis=0))
        reach = float((np.linalg.norm(r[:3], axis=0) + far).max())
        self._set(np.ascontiguousarray(r[:7]), reach, "centroid" if len(r) == 7 else "refined", _blocks(r, far))

    def _set(self, packed: Array, reach: float, integration: Integration, blocks: Blocks) -> "Plates":
        packed.flags.writeable = False
        form = blocks.rows, blocks.bounds, integration == "refined", reach
        for f, value in zip(fields(self), (packed, reach, integration, blocks, form), strict=True):
            object.__setattr__(self, f.name, value)
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self.packed, self.reach, self.integration, self.blocks)

    @classmethod
    def from_arrays(cls, centroids: ArrayLike, normals: ArrayLike, areas: ArrayLike) -> "Plates":
        """Plates for the published rule: centroids [m], normals, shape [n, 3], made unit length; areas [m²], shape [n].

        Raises ValueError as `Plates`.
        """
        r, n, a = (np.asarray(values, dtype=np.float64) for values in (centroids, normals, areas))
        if r.ndim != 2 or r.shape[1] != 3 or n.shape != r.shape or a.shape != r.shape[:1]:
            raise ValueError(
                f"plates need centroids [n, 3], normals [n, 3] and areas [n]; got {r.shape}, {n.shape}, {a.shape}"
            )
        return cls(np.vstack([r.T, n.T, a[None]]))

    @classmethod
    def from_triangles(cls, triangles: ArrayLike, half_angles: ArrayLike) -> "Plates":
        """Plates for the refined rule: corners [m], shape [n, 3, 3], counter-clockwise seen from outside.

        `half_angles`: shape [n], over 0 up to π/2 [rad]: a plate represents surface whose normals differ from its own
        by up to this angle, and counts by the share of them that leads. Raises ValueError as `Plates`.
        """
        t = np.asarray(triangles, dtype=np.float64)
        theta = np.asarray(half_angles, dtype=np.float64)
        if t.ndim != 3 or t.shape[1:] != (3, 3) or theta.shape != t.shape[:1]:
            raise ValueError(f"plates need triangles [n, 3, 3] and half_angles [n]; got {t.shape}, {theta.shape}")
        if not ((theta > 0.0) & (theta <= 0.5 * np.pi)).all():
            raise ValueError("half_angles must lie over 0 and up to π/2")
        center = t.mean(axis=1)
        doubled = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
        areas = 0.5 * np.linalg.norm(doubled, axis=1)
        edges = (t - center[:, None])[:, :2].reshape(len(t), 6)
        return cls(np.column_stack([center, doubled, areas, edges, 0.5 / np.sin(theta)]).T)

    def __len__(self) -> int:
        return self.packed.shape[1]

    @property
    def rows(self) -> Array:
        """The numbers of each plate, shape [7 or 14, n]; units and axes as in `Blocks.rows`."""
        by_block = self.blocks.rows.reshape(self.blocks.bounds.shape[1], -1, BLOCK)
        rows = np.empty((by_block.shape[1], len(self)))
        rows[:, self.blocks.order] = np.hstack(list(by_block))[:, : len(self)]
        return rows

    @property
    def area(self) -> float:
        """Total area [m²]."""
        return float(self.packed[6].sum())


def _restored(packed: Array, reach: float, integration: Integration, blocks: Blocks) -> Plates:
    """Unpickled plates; `Plates` itself would normalise the normals again and change their last bits."""
    return Plates.__new__(Plates)._set(packed, reach, integration, blocks)


def _blocks(rows: Array, far: Array) -> Blocks:
    """Sort plates, shape [7 or 14, n], units as in `Blocks.rows`, into blocks of similar normals and positions.

    `far`: greatest distance of each plate's points from its centroid [m], shape [n].
    """
    n = rows.shape[1]
    center = rows[:3] - rows[:3].mean(axis=1, keepdims=True)
    size = np.abs(center).max()
    # a tool's length weighs as much as a quarter turn of the normal
    order = _neighbours(np.vstack([rows[3:6], center / size if size > 0.0 else center]))
    padding = -n % BLOCK
    packed = np.ascontiguousarray(np.hstack([rows[:, order], np.repeat(rows[:, order[-1:]], padding, axis=1)]))
    packed[6, n:] = 0.0
    bounds = _bounds(packed, np.concatenate([far[order], np.zeros(padding)]))
    return Blocks(packed.reshape(len(rows), -1, BLOCK).swapaxes(0, 1).ravel(), order, bounds)


def _neighbours(features: Array) -> NDArray[np.int64]:
    """An order in which every `BLOCK` consecutive columns are similar, by recursive halving along the widest row."""

    def ordered(columns: NDArray[np.int64]) -> list[NDArray[np.int64]]:
        if len(columns) <= BLOCK:
            return [columns]
        here = features[:, columns]
        widest = int(np.argmax(np.ptp(here, axis=1)))
        half = BLOCK * -(-len(columns) // (2 * BLOCK))
        by_size = columns[np.argsort(here[widest], kind="stable")]
        return ordered(by_size[:half]) + ordered(by_size[half:])

    return np.concatenate(ordered(np.arange(features.shape[1])))


def _bounds(rows: Array, extents: Array) -> Array:
    by_block = rows.reshape(len(rows), -1, BLOCK)
    place, normal, area = by_block[:3], by_block[3:6], by_block[6]
    moment = np.cross(place, normal, axis=0)
    far = extents.reshape(-1, BLOCK)

    def box(vectors: Array, more: Array) -> Array:
        low, high = (vectors - more).min(axis=2), (vectors + more).max(axis=2)
        return np.vstack([0.5 * (low + high), 0.5 * (high - low) * (1.0 + ROUNDING)])

    fade = 0.5 / by_block[13].min(axis=1) if len(rows) > 7 else np.zeros(by_block.shape[1])
    boxes = box(normal, np.zeros_like(far)), box(moment, far), box(place, far)
    return np.ascontiguousarray(np.vstack([*boxes, area.sum(axis=1), fade]))

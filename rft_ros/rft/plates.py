"""Plate elements: the tool's surface as flat pieces, each a point (published rule) or a triangle (refined rule).

The kernel visits them in blocks of neighbours and skips blocks in which no plate is wet or leads: about half of a
body's plates trail, and a tool is seldom fully submerged. Skipping single plates would prevent vectorisation.
"""

from dataclasses import dataclass, fields
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

BLOCK = 16
"""Plates in a block. The kernel tests the plates of a block together: are any below the surface, and leading?"""

ROUNDING = 1e-12
"""Relative margin of the bounds of blocks against rounding."""

Integration = Literal["centroid", "refined"]
INTEGRATIONS: tuple[Integration, ...] = ("centroid", "refined")
"""The integration rules: see `Plates.integration`."""

CENTROID = slice(0, 3)
NORMAL = slice(3, 6)
AREA = 6
FIRST_CORNER = slice(7, 10)
SECOND_CORNER = slice(10, 13)
HALF_ANGLE = 13
"""The rows of plates, as in `Plates.rows`.

FIRST_CORNER, SECOND_CORNER and HALF_ANGLE exist for the refined rule only. The corners are relative to the centroid
[m]. HALF_ANGLE holds 1 / (2 sin θ), θ the half angle.
"""
ROWS_OF_CENTROID = 7
ROWS_OF_REFINED = 14
"""Numbers of a plate for each rule."""

BOUND_NORMAL = 0
BOUND_MOMENT = 6
BOUND_POSITION = 12
BOUND_AREA = 18
BOUND_SINE = 19
"""The rows of `Plates.bounds`. BOUND_NORMAL, BOUND_MOMENT and BOUND_POSITION each begin six rows: the middle of a box
(3) and half of its sides (3)."""

BOUNDS = 20
"""Rows of `Plates.bounds`."""

Array = NDArray[np.float64]


class PackedPlates(NamedTuple):
    """Plates for the compiled loop. `rows`: `Plates.blocks`; `bounds`, `reach`: as in `Plates`."""

    rows: Array
    bounds: Array
    is_refined: bool
    reach: float


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Plates:
    """Plate elements in the tool frame.

    ``Plates(rows)`` takes rows as in `rows`, selected, merged or weighted by area. Raises ValueError for another shape,
    no plates, values that are not finite, negative areas and zero normals.

    `rows`: shape [7, n]: x, y, z [m] of the centroid, outward unit normal nx, ny, nz, area [m²]. For the refined rule
    shape [14, n]: also two corners relative to the centroid [m] and 1 / (2 sin θ), θ the half angle.
    `reach`: greatest distance of any point of a plate from the tool frame's origin [m]. `area`: of all plates [m²].
    `blocks`: `rows` reordered for the kernel: blocks of 16 plates, each stored row by row; the last is padded with
    plates of zero area. `order`: the index in `rows` of each plate in the kernel's order, shape [n].
    `bounds`: shape [20, blocks]: boxes (middle, half of the sides) of the normals, of r x n [m] and of the positions
    [m]; area [m²]; sine of the greatest half angle.
    """

    rows: Array
    reach: float
    area: float
    blocks: Array
    order: NDArray[np.int64]
    bounds: Array

    def __init__(self, rows: ArrayLike) -> None:
        r = _checked(rows)
        r[NORMAL] /= np.linalg.norm(r[NORMAL], axis=0)
        self._arrange(r)

    @classmethod
    def of_rows(cls, rows: ArrayLike) -> "Plates":
        """Plates of the `rows` of others, with every bit kept: their normals have unit length already.

        Raises ValueError as `Plates`.
        """
        plates = object.__new__(cls)
        plates._arrange(_checked(rows))
        return plates

    def _arrange(self, r: Array) -> None:
        """Fill the fields from checked rows."""
        extents = np.zeros(r.shape[1])
        if len(r) == ROWS_OF_REFINED:
            first = r[FIRST_CORNER]
            second = r[SECOND_CORNER]
            extents = np.sqrt(
                np.max([(e * e).sum(axis=0) for e in (first, second, first + second)], axis=0)
            )
        reach = float((np.linalg.norm(r[CENTROID], axis=0) + extents).max())
        self._set(r, reach, float(r[AREA].sum()), *_in_blocks(r, extents))

    def _set(self, *values: object) -> None:
        for f, value in zip(fields(self), values, strict=True):
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            object.__setattr__(self, f.name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, tuple(getattr(self, f.name) for f in fields(self))

    @property
    def centroids(self) -> Array:
        """x, y, z of the centroids [m], shape [3, n]."""
        return self.rows[CENTROID]

    @property
    def normals(self) -> Array:
        """Outward unit normals, shape [3, n]."""
        return self.rows[NORMAL]

    @property
    def areas(self) -> Array:
        """Areas [m²], shape [n]."""
        return self.rows[AREA]

    @property
    def integration(self) -> Integration:
        """The rule that these plates are for.

        ``centroid``, the published rule: depth and velocity at the centroid; a plate either leads or not. ``refined``:
        each plate is a triangle; depth is integrated over its part below the surface, the force acts at its centre of
        pressure, and the leading share grows continuously over its half angle (`from_triangles`).
        """
        return "centroid" if len(self.rows) == ROWS_OF_CENTROID else "refined"

    @property
    def packed(self) -> PackedPlates:
        """The same for the compiled loop."""
        return PackedPlates(
            rows=self.blocks,
            bounds=self.bounds,
            is_refined=len(self.rows) == ROWS_OF_REFINED,
            reach=self.reach,
        )

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
            raise ValueError(
                f"plates need triangles [n, 3, 3] and half_angles [n]; got {t.shape}, {theta.shape}"
            )
        if not ((theta > 0.0) & (theta <= 0.5 * np.pi)).all():
            raise ValueError("half_angles must lie over 0 and up to π/2")
        center = t.mean(axis=1)
        area_normals = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
        areas = 0.5 * np.linalg.norm(area_normals, axis=1)
        edges = (t - center[:, None])[:, :2].reshape(len(t), 6)
        return cls(np.column_stack([center, area_normals, areas, edges, 0.5 / np.sin(theta)]).T)

    def __len__(self) -> int:
        return self.rows.shape[1]


def _checked(rows: ArrayLike) -> Array:
    """A copy of the rows of plates. Raises ValueError as `Plates`."""
    r = np.array(rows, dtype=np.float64, order="C")
    if r.ndim != 2 or len(r) not in (ROWS_OF_CENTROID, ROWS_OF_REFINED):
        raise ValueError(f"plates have 7 rows, or 14 for the refined rule; got shape {r.shape}")
    if r.shape[1] == 0:
        raise ValueError("a tool needs at least one plate element; got none")
    if not np.isfinite(r[:ROWS_OF_CENTROID]).all():
        raise ValueError("plate centroids, normals and areas must be finite numbers")
    length = np.linalg.norm(r[NORMAL], axis=0)
    if (r[AREA] < 0.0).any() or (length == 0.0).any():
        raise ValueError("plate areas must not be negative, and normals not zero")
    if not np.isfinite(r).all() or not (r[HALF_ANGLE:] >= 0.5).all():
        raise ValueError("rows of refined plates must be finite, and the last one at least 1/2")
    return r


def _restored(*values: object) -> Plates:
    """Unpickled plates: read-only again, with normals of the same last bits."""
    plates = object.__new__(Plates)
    plates._set(*values)
    return plates


def _in_blocks(rows: Array, extents: Array) -> tuple[Array, NDArray[np.int64], Array]:
    """`Plates.blocks`, `order` and `bounds`: plates of similar normals and positions in each block.

    `extents`: greatest distance of each plate's points from its centroid [m], shape [n].
    """
    n = rows.shape[1]
    center = rows[CENTROID] - rows[CENTROID].mean(axis=1, keepdims=True)
    size = np.abs(center).max()
    # a tool's length weighs as much as a quarter turn of the normal
    order = _neighbours(np.vstack([rows[NORMAL], center / size if size > 0.0 else center]))
    padded_order = np.append(order, np.repeat(order[-1:], -n % BLOCK))
    ordered_rows = np.ascontiguousarray(rows[:, padded_order])
    ordered_rows[AREA, n:] = 0.0
    blocks = ordered_rows.reshape(len(rows), -1, BLOCK).swapaxes(0, 1).ravel()
    return blocks, order, _bounds(ordered_rows, extents[padded_order])


def _neighbours(features: Array) -> NDArray[np.int64]:
    """An order in which every `BLOCK` consecutive columns are similar, by recursive halving along the widest row."""

    def ordered(columns: NDArray[np.int64]) -> list[NDArray[np.int64]]:
        if len(columns) <= BLOCK:
            return [columns]
        here = features[:, columns]
        widest = int(np.argmax(np.ptp(here, axis=1)))
        half = BLOCK * -(-len(columns) // (2 * BLOCK))
        sorted_columns = columns[np.argsort(here[widest], kind="stable")]
        return ordered(sorted_columns[:half]) + ordered(sorted_columns[half:])

    return np.concatenate(ordered(np.arange(features.shape[1])))


def _bounds(rows: Array, extents: Array) -> Array:
    blocks = rows.reshape(len(rows), -1, BLOCK)
    position = blocks[CENTROID]
    normal = blocks[NORMAL]
    area = blocks[AREA]
    moment = np.cross(position, normal, axis=0)
    extent = extents.reshape(-1, BLOCK)

    def box(vectors: Array, margin: Array) -> Array:
        low = (vectors - margin).min(axis=2)
        high = (vectors + margin).max(axis=2)
        return np.vstack([0.5 * (low + high), 0.5 * (high - low) * (1.0 + ROUNDING)])

    sine = np.zeros(blocks.shape[1])
    if len(rows) == ROWS_OF_REFINED:
        sine = 0.5 / blocks[HALF_ANGLE].min(axis=1)
    boxes = box(normal, np.zeros_like(extent)), box(moment, extent), box(position, extent)
    return np.ascontiguousarray(np.vstack([*boxes, area.sum(axis=1), sine]))

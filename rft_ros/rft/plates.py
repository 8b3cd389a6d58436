"""Plate elements: the tool's surface as flat pieces, each a point (published rule) or a triangle (ours)."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rft_ros.rft.blocks import Blocks, blocks_of

__all__ = ["INTEGRATIONS", "Integration", "Plates"]

Integration = Literal["centroid", "refined"]
INTEGRATIONS: tuple[Integration, ...] = ("centroid", "refined")
"""The rules of integration: see `Plates.integration`."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Plates:
    """Plate elements in the tool frame, packed once for the kernel.

    `packed`: shape [7, n], C-contiguous rows x, y, z [m] of the centroid, outward unit normal nx, ny, nz, area [m²].
    `reach`: greatest distance of a plate's point from the tool frame's origin [m].
    `integration`: ``centroid``, the published rule: depth and velocity are taken at the centroid, and a plate leads or
    does not. ``refined``: each plate is a triangle; depth is integrated over its part below the surface, the force acts
    at its centre of pressure, and it begins to lead over the angle that it stands for (`from_triangles`).
    `blocks`: the same plates as the kernel visits them.
    """

    packed: Array
    reach: float
    integration: Integration
    blocks: Blocks

    @classmethod
    def from_arrays(cls, centroids: ArrayLike, normals: ArrayLike, areas: ArrayLike) -> "Plates":
        """Plates for the published rule: centroids [m], normals, shape [n, 3], made unit length; areas [m²], shape [n].

        Raises ValueError on wrong shapes, no plates, values that are not finite, negative areas and zero normals.
        """
        r = np.asarray(centroids, dtype=np.float64)
        n = np.asarray(normals, dtype=np.float64)
        a = np.asarray(areas, dtype=np.float64)
        if r.ndim != 2 or r.shape[1] != 3 or n.shape != r.shape or a.shape != r.shape[:1]:
            raise ValueError(
                f"plates need centroids [n, 3], normals [n, 3] and areas [n]; got {r.shape}, {n.shape}, {a.shape}"
            )
        return cls._packed(r, n, a)

    @classmethod
    def from_triangles(cls, triangles: ArrayLike, half_angles: ArrayLike) -> "Plates":
        """Plates for the refined rule: corners [m], shape [n, 3, 3], counter-clockwise seen from outside.

        `half_angles`: shape [n], over 0 up to π/2 [rad]: a plate stands for surface whose normals differ from its own
        by up to this angle, and leads in proportion to the share of them that does. Raises ValueError as `from_arrays`.
        """
        t = np.asarray(triangles, dtype=np.float64)
        theta = np.asarray(half_angles, dtype=np.float64)
        if t.ndim != 3 or t.shape[1:] != (3, 3) or theta.shape != t.shape[:1]:
            raise ValueError(f"plates need triangles [n, 3, 3] and half_angles [n]; got {t.shape}, {theta.shape}")
        if not ((theta > 0.0) & (theta <= 0.5 * np.pi)).all():
            raise ValueError("half_angles must lie over 0 and up to π/2")
        center = t.mean(axis=1)
        doubled = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
        edges = (t - center[:, None])[:, :2].reshape(len(t), 6)
        refined = np.column_stack([edges, 0.5 / np.sin(theta)])
        return cls._packed(center, doubled, 0.5 * np.linalg.norm(doubled, axis=1), refined)

    @classmethod
    def from_rows(cls, rows: ArrayLike) -> "Plates":
        """Plates from what `rows` of others holds, chosen, merged or weighted by area; shape [7, n] or [14, n].

        Units and axes as in `packed` and `Blocks.rows`: x, y, z [m], unit normal, area [m²]; refined plates have more.
        Raises ValueError as `from_arrays`.
        """
        r = np.asarray(rows, dtype=np.float64)
        if r.ndim != 2 or len(r) not in (7, 14):
            raise ValueError(f"plates have 7 rows, or 14 for the refined rule; got shape {r.shape}")
        if not np.isfinite(r[7:]).all() or not (r[13:] >= 0.5).all():
            raise ValueError("rows of refined plates must be finite, and the last one at least 1/2")
        return cls._packed(r[:3].T, r[3:6].T, r[6], r[7:].T if len(r) > 7 else None)

    @classmethod
    def _packed(cls, r: Array, n: Array, a: Array, refined: Array | None = None) -> "Plates":
        if len(r) == 0:
            raise ValueError("a tool needs at least one plate element; got none")
        if not (np.isfinite(r).all() and np.isfinite(n).all() and np.isfinite(a).all()):
            raise ValueError("plate centroids, normals and areas must be finite numbers")
        length = np.linalg.norm(n, axis=1)
        if (a < 0.0).any() or (length == 0.0).any():
            raise ValueError("plate areas must not be negative, and normals not zero")
        packed = np.ascontiguousarray(np.vstack([r.T, (n / length[:, None]).T, a[None]]))
        packed.flags.writeable = False
        rows = packed if refined is None else np.vstack([packed, refined.T])
        blocks = blocks_of(rows)
        reach = float((np.linalg.norm(r, axis=1) + blocks.extents).max())
        return cls(packed, reach, "centroid" if refined is None else "refined", blocks)

    def __len__(self) -> int:
        return self.packed.shape[1]

    @property
    def rows(self) -> Array:
        """All that the kernel reads, in the plates' order, shape [7 or 14, n]; units and axes as in `Blocks.rows`."""
        rows = np.empty((len(self.blocks.rows), len(self)))
        rows[:, self.blocks.order] = self.blocks.rows[:, : len(self)]
        return rows

    @property
    def area(self) -> float:
        """Total area [m²]."""
        return float(self.packed[6].sum())

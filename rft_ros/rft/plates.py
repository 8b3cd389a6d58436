"""Plate elements: the tool's surface as centroids, outward unit normals and areas."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Plates"]


@dataclass(frozen=True, slots=True, eq=False)
class Plates:
    """Plate elements in the tool frame, packed once for the kernel.

    `packed`: shape [7, n], C-contiguous rows x, y, z [m], outward unit normal nx, ny, nz, and area [m²].
    `reach`: greatest distance of a centroid from the tool frame's origin [m].
    """

    packed: NDArray[np.float64]
    reach: float

    @classmethod
    def from_arrays(cls, centroids: ArrayLike, normals: ArrayLike, areas: ArrayLike) -> "Plates":
        """Pack centroids [m] and normals, shape [n, 3], and areas [m²], shape [n]; normals are made unit length.

        Raises ValueError on wrong shapes, no plates, values that are not finite, negative areas and zero normals.
        """
        r = np.asarray(centroids, dtype=np.float64)
        n = np.asarray(normals, dtype=np.float64)
        a = np.asarray(areas, dtype=np.float64)
        if r.ndim != 2 or r.shape[1] != 3 or n.shape != r.shape or a.shape != r.shape[:1]:
            raise ValueError(
                f"plates need centroids [n, 3], normals [n, 3] and areas [n]; got {r.shape}, {n.shape}, {a.shape}"
            )
        if len(r) == 0:
            raise ValueError("a tool needs at least one plate element; got none")
        if not (np.isfinite(r).all() and np.isfinite(n).all() and np.isfinite(a).all()):
            raise ValueError("plate centroids, normals and areas must be finite numbers")
        length = np.linalg.norm(n, axis=1)
        if (a < 0.0).any() or (length == 0.0).any():
            raise ValueError("plate areas must not be negative, and normals not zero")
        packed = np.ascontiguousarray(np.vstack([r.T, (n / length[:, None]).T, a[None]]))
        packed.flags.writeable = False
        return cls(packed=packed, reach=float(np.linalg.norm(r, axis=1).max()))

    def __len__(self) -> int:
        return self.packed.shape[1]

    @property
    def area(self) -> float:
        """Total area [m²]."""
        return float(self.packed[6].sum())

"""Where a mesh file's coordinates lie in the tool frame: scale, origin and rotation."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.rft import Plates, rotation_matrix, unit_quaternion
from rft_ros.rft.arguments import number, numbers
from rft_ros.rft.plates import AREA, CENTROID, FIRST_CORNER, HALF_ANGLE, NORMAL, SECOND_CORNER

__all__ = ["IN_TOOL_FRAME", "MILLIMETRE", "MeshFrame"]

Array = NDArray[np.float64]

MILLIMETRE = 0.001
"""The unit [m] of a mesh file that declares none."""


@dataclass(frozen=True, slots=True, eq=False)
class MeshFrame:
    """A point p of the file lies at rotation (p - origin) scale in the tool frame [m].

    `scale`: metres per mesh unit; 0 until a file's own unit is known. `origin`: where the tool frame's origin lies, in
    mesh-file coordinates and units, shape [3]. `rotation`: columns are the file's axes in the tool frame, shape [3, 3].
    """

    scale: float
    origin: Array
    rotation: Array

    @classmethod
    def checked(cls, scale: float, origin: Sequence[float], quaternion: Sequence[float]) -> "MeshFrame":
        """From `mesh.scale`, `mesh.origin` and `mesh.quaternion`. Raises ValueError that names the parameter."""
        unit, shift = number("mesh.scale", scale, least=0.0), numbers("mesh.origin", origin, rows=3)
        given = numbers("mesh.quaternion", quaternion, rows=4)
        turn = unit_quaternion(*given.tolist())
        if turn is None:
            raise InputError(f"mesh.quaternion is {given.tolist()}, of norm {np.linalg.norm(given):g}; it must be 1")
        return cls(unit, shift, rotation_matrix(turn))

    def for_file(self, declared: float | None) -> "MeshFrame":
        """The frame with the unit [m] that a file declares, or None, in place of a scale of 0."""
        return self if self.scale > 0.0 else replace(self, scale=declared or MILLIMETRE)

    def to_tool(self, points: Array) -> Array:
        """Points of the file, shape [n, 3], in the tool frame [m]."""
        placed = (points - self.origin) * self.scale
        return placed if self._keeps_axes() else placed @ self.rotation.T

    def to_file(self, points: Array) -> Array:
        """Points in the tool frame [m], shape [n, 3], in the file's coordinates and units."""
        turned = points if self._keeps_axes() else points @ self.rotation
        return turned / self.scale + self.origin

    def plates_to_tool(self, plates: Plates) -> Plates:
        """Plates in the file's coordinates and units, in the tool frame [m]."""
        rows = self._turned(plates.rows, self.rotation, scale=self.scale)
        rows[CENTROID] = self.to_tool(plates.centroids.T).T
        return Plates(rows)

    def plates_to_file(self, plates: Plates) -> Plates:
        """Plates in the tool frame [m], in the file's coordinates and units."""
        rows = self._turned(plates.rows, self.rotation.T, scale=1.0 / self.scale)
        rows[CENTROID] = self.to_file(plates.centroids.T).T
        return Plates(rows)

    def _turned(self, rows: Array, rotation: Array, *, scale: float) -> Array:
        """Rows as `Plates.rows` with normals, areas and corners turned and scaled; the centroids stay as they are."""
        out = rows.copy()
        out[AREA] *= scale * scale
        corners = (FIRST_CORNER, SECOND_CORNER) if len(rows) > HALF_ANGLE else ()
        for corner in corners:
            out[corner] *= scale
        if not self._keeps_axes():
            for vector in (NORMAL, *corners):
                out[vector] = rotation @ out[vector]
        return out

    def _keeps_axes(self) -> bool:
        """Whether there is no rotation. Coordinates are not multiplied then, so that they keep every bit."""
        return np.array_equal(self.rotation, np.eye(3))


IN_TOOL_FRAME = MeshFrame(1.0, np.zeros(3), np.eye(3))
"""The frame of a mesh whose vertices are in the tool frame [m] already."""

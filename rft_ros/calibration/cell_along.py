"""A load cell along a motion of the tool: its axes at each state, and the weight that it carries there."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator import GRAVITY
from rft_ros.parameters import LoadCell
from rft_ros.rft import (
    FORCE,
    QUATERNION,
    TORQUE,
    rotate_vectors,
    rotation_matrices,
    rotation_matrix,
)

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CellAlong:
    """A load cell at n states of the tool, shape [n, 13], columns `rft_ros.rft.STATE`."""

    cell: LoadCell
    states: Array

    @cached_property
    def to_world(self) -> Array:
        """Rotations from the axes of the load cell to those of the world, shape [n, 3, 3]."""
        tool_rotations = rotation_matrices(self.states[:, QUATERNION])
        return tool_rotations @ rotation_matrix(self.cell.quaternion)

    @property
    def from_world_axes(self) -> Array:
        """Rotations from the axes of the world to those of the load cell, shape [n, 3, 3]."""
        return np.swapaxes(self.to_world, 1, 2)

    @cached_property
    def down(self) -> Array:
        """The direction of gravity in the axes of the load cell, shape [n, 3]."""
        return -self.to_world[:, 2]

    @property
    def gravity(self) -> Array:
        """The acceleration of gravity in the axes of the load cell [m/s²], shape [n, 3]."""
        return GRAVITY * self.down

    @property
    def weight(self) -> Array:
        """The wrench by the weight of the parameters, in the axes of the load cell [N], [N m], shape [n, 6]."""
        force = self.cell.mass * self.gravity
        return np.hstack([force, np.cross(self.cell.center_of_mass, force)])

    def from_world(self, wrenches: Array) -> Array:
        """Wrenches in world axes about the tool frame's origin, in the cell's axes about its own; shape [n, 6]."""
        into_cell = self.from_world_axes
        force = rotate_vectors(into_cell, wrenches[:, FORCE])
        tool = self.cell.place.inverse().position
        torque = rotate_vectors(into_cell, wrenches[:, TORQUE]) + np.cross(tool, force)
        return np.hstack([force, torque])

"""A load cell along a motion of the tool: its axes at each state, and the weight that it carries there."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rft_ros.estimator import GRAVITY
from rft_ros.parameters import LoadCell
from rft_ros.rft import FORCE, QUATERNION, TORQUE

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CellAlong:
    """A load cell at n states of the tool, shape [n, 13], columns `rft_ros.rft.STATE`."""

    cell: LoadCell
    states: Array

    @cached_property
    def to_world(self) -> Rotation:
        """The n turns from the axes of the load cell to those of the world."""
        of_tool = Rotation.from_quat(self.states[:, QUATERNION])
        return of_tool * Rotation.from_quat(self.cell.quaternion)

    @cached_property
    def down(self) -> Array:
        """The direction of gravity in the axes of the load cell, shape [n, 3]."""
        return np.asarray(self.to_world.inv().apply((0.0, 0.0, -1.0)))

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
        into_cell = self.to_world.inv()
        force = into_cell.apply(wrenches[:, FORCE])
        tool = self.cell.place.inverse().position
        torque = into_cell.apply(wrenches[:, TORQUE]) + np.cross(tool, force)
        return np.hstack([force, torque])

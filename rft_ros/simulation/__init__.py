"""Grains for simulators, without ROS: `Grains` for a body whose pose you have, `MujocoGrains` for a body of a model."""

from rft_ros.simulation.grains import Grains, GrainsBatch, GrainsState
from rft_ros.simulation.mujoco_grains import MujocoGrains

__all__ = ["Grains", "GrainsBatch", "GrainsState", "MujocoGrains"]

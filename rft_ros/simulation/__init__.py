"""Grains for simulators, without ROS: `Grains` for a body whose pose you have, `MujocoGrains` for bodies of a model."""

from rft_ros.simulation.grains import Grains, GrainsBatch, GrainsState, free_body
from rft_ros.simulation.mujoco_grains import MujocoGrains

__all__ = ["Grains", "GrainsBatch", "GrainsState", "MujocoGrains", "free_body"]

"""Compile, or load from numba's cache, every kernel that a tick can reach."""

from dataclasses import replace

import numpy as np

from rft_ros.estimator.estimator import Estimator
from rft_ros.estimator.samples import PoseSample
from rft_ros.estimator.settings import Model, Settings
from rft_ros.rft import ALPHA_Y_MODELS, MEDIA, Table, alpha_y_model, plate_forces, treers2021

__all__ = ["warm_up"]


def warm_up(model: Model) -> None:
    """Answer a few poses of the model's tool with each α_y model, so that nothing compiles once samples come."""
    medium = MEDIA[model.medium]
    table = Table(np.zeros(1), np.zeros(1), np.ones((1, 1)))
    for name in ALPHA_Y_MODELS:
        law = treers2021(medium, alpha_y_model(name, medium, table))
        estimator = Estimator(Settings(twist_source="pose_difference"), replace(model, law=law))
        for k in range(1, 5):
            height = 1e3 - 0.001 * k  # in the air, where the kernel does the same work
            estimator.push_pose(PoseSample(k * 10_000_000, "world", (0.0, 0.0, height), (0.0, 0.0, 0.0, 1.0)))
    plate_forces(model.tool.plates, model.law, estimator.state)

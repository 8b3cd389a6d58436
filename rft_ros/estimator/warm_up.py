"""Compile, or load from the cache on disk, every function that a pose can reach."""

import os
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rft_ros.estimator.estimator import Estimator
from rft_ros.estimator.samples import PoseSample
from rft_ros.estimator.settings import Model, Settings
from rft_ros.rft import ALPHA_Y_MODELS, INTEGRATIONS, MEDIA, Integration, Table, alpha_y_model, plate_forces, treers2021
from rft_ros.tool import load_tool

__all__ = ["await_compilation", "fork_compilation", "warm_up", "warm_up_all"]


def warm_up(model: Model) -> None:
    """Answer a few poses with a model, so that nothing compiles when samples come."""
    estimator = Estimator(Settings(twist_source="pose_difference"), model)
    for k in range(1, 5):
        height = 1e3 - 0.001 * k  # in the air, where the kernel is the same
        estimator.push_pose(PoseSample(k * 10_000_000, "world", (0.0, 0.0, height), (0.0, 0.0, 0.0, 1.0)))


def fork_compilation() -> list[int]:
    """Fork a process for each rule of integration, to fill the cache with what `warm_up_all` needs; return their ids.

    On two processors a cold start takes half as long, and the compiler's memory is freed with the processes. Call it
    before anything starts threads.
    """
    processes = []
    for integration in INTEGRATIONS:
        pid = os.fork()
        if pid == 0:
            try:
                _warm_up(integration, memory=False)
            finally:
                os._exit(0)
        processes.append(pid)
    return processes


def await_compilation(processes: Sequence[int]) -> None:
    """Wait for the processes of `fork_compilation`. What is compiled earlier in this process is compiled twice."""
    for process in processes:
        os.waitpid(process, 0)


def warm_up_all(*, memory: bool) -> None:
    """Warm up for all that can be swapped in: each rule of integration with each α_y model, and the markers.

    `memory`: also for media with a mobilization length.
    """
    for integration in INTEGRATIONS:
        _warm_up(integration, memory=memory)


def _warm_up(integration: Integration, *, memory: bool) -> None:
    medium = next(iter(MEDIA.values()))
    table = Table.sampled([0.0], [0.0], [[1.0]])
    state = np.array([0.0, 0.0, 1e3, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0])
    tool = load_tool("plate", integration=integration)
    for name in ALPHA_Y_MODELS:
        law = treers2021(medium, alpha_y_model(name, medium, table))
        model = Model(tool=tool, law=law, medium=medium.name, zeta=1.0, alpha_y=name)
        warm_up(model)
        if memory:
            warm_up(replace(model, mobilization_length=1.0))
    plate_forces(tool.plates, law, state)

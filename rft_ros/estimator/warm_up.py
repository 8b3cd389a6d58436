"""Compile, or load from the cache on disk, every function that a pose can reach."""

import itertools
import os
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numba.core import event

from rft_ros.child_process import start_child
from rft_ros.estimator.estimator import Estimator
from rft_ros.estimator.samples import PoseSample, WrenchSample
from rft_ros.ground import Cloud, HeightMap
from rft_ros.parameters import LearningMode, Model, Settings, Values
from rft_ros.rft import (
    ALPHA_Y_MODELS,
    INTEGRATIONS,
    LEVEL,
    MEDIA,
    Integration,
    Plates,
    Table,
    alpha_y_model,
    law_named,
    plate_forces,
)
from rft_ros.tool import Tool
from rft_ros.tool.refine import FLAT_HALF_ANGLE
from rft_ros.tool.tool import centroid_plates

__all__ = ["compile_kernels", "warm_up", "warm_up_all", "warm_up_for"]

_LAWS = (("agarwal2023", "constant"), *(("treers2021", name) for name in ALPHA_Y_MODELS))
"""Names of each law and α_y model."""


def warm_up(model: Model, *, learning: bool = False) -> None:
    """Answer a few poses with a model, so that nothing compiles when samples come; `learning`: with a load cell."""
    mode: LearningMode = "apply" if learning else "off"
    estimator = Estimator(Settings(twist_source="pose_difference", learning_mode=mode), model)
    for k in range(1, 5):
        height = -1e3 - 0.001 * k  # deep in the grains, where a pose reaches every function
        estimator.push_wrench(WrenchSample(k * 10_000_000, "ft_sensor", (0.0,) * 6))
        if model.ground is not None:
            estimator.push_surface(Cloud(k * 10_000_000, "world", *np.zeros((3, 1))))
        estimator.push_pose(PoseSample(k * 10_000_000, "world", (0.0, 0.0, height), (0.0, 0.0, 0.0, 1.0)))


def warm_up_for(values: Values, *, on_cold_cache: Callable[[], None]) -> None:
    """Warm up for what these parameters need beyond the defaults, and for what can be swapped in while they hold."""
    memory, inertia = bool(values["medium.mobilization_length"]), bool(values["medium.density"])
    learning, ground = values["learning.mode"] != "off", bool(values["ground.cell"])
    if memory or learning or inertia or ground:
        warm_up_all(memory=memory, learning=learning, inertia=inertia, ground=ground, on_cold_cache=on_cold_cache)


def warm_up_all(
    *,
    memory: bool,
    learning: bool = False,
    inertia: bool = False,
    ground: bool = False,
    on_cold_cache: Callable[[], None] = lambda: None,
) -> None:
    """Warm up for whatever can be swapped in: each rule of integration with each law and α_y model, and the markers.

    `memory`: also for media with a mobilization length; `learning`: also for the modes that learn; `inertia`: for media
    with a density, and for no others; `ground`: also for maps of the ground. If numba's cache lacks a kernel,
    `on_cold_cache` is called, and a process on each core fills the cache; the compiler's 100 MB go with them.
    """
    try:
        with event.install_listener("numba:compile", _ColdCache()):
            compile_kernels(0, 1, memory, learning, inertia, ground)
    except _NotCompiledError:
        on_cold_cache()
        parts = min(len(os.sched_getaffinity(0)), len(_LAWS) * len(INTEGRATIONS))
        need = memory, learning, inertia, ground
        processes = [start_child(compile_kernels, part, parts, *need) for part in range(parts)]
        try:
            for process in processes:
                process.wait()
        finally:
            for process in processes:
                process.kill()
        compile_kernels(0, 1, *need)


class _NotCompiledError(Exception):
    pass


class _ColdCache(event.Listener):  # type: ignore[misc]
    """Raises as soon as numba begins to compile what it did not find in its cache."""

    def on_start(self, _event: event.Event) -> None:
        raise _NotCompiledError

    def on_end(self, _event: event.Event) -> None:
        pass


def compile_kernels(part: int, parts: int, memory: bool, learning: bool, inertia: bool, ground: bool) -> None:
    """Compile, or load, one part of the kernels that `warm_up_all` names."""
    medium = next(iter(MEDIA.values()))
    table = Table.sampled([0.0], [0.0], [[1.0]])
    state = np.array([0.0, 0.0, 1e3, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0])
    maps = (None, _inclined()) if ground else (None,)
    # alternately one rule and the other: of two processes each has one rule, whose functions the laws share
    for (law_name, name), integration in list(itertools.product(_LAWS, INTEGRATIONS))[part::parts]:
        tool = _pyramid(integration)
        law = law_named(law_name, medium, alpha_y_model(name, medium, table), density=float(inertia))
        model = Model(tool=tool, law=law, medium=medium.name, zeta=1.0, alpha_y=name)
        for length, map_, learns in itertools.product((0.0, 1.0)[: 1 + memory], maps, (False, True)[: 1 + learning]):
            warm_up(replace(model, mobilization_length=length, ground=map_), learning=learns)
        for slope in (LEVEL, (0.1, 0.0))[: 1 + ground]:
            plate_forces(tool.plates, law, state, slope=slope)


def _pyramid(integration: Integration) -> Tool:
    """A tool of four plates. It comes from no file, since reading one imports trimesh: a second, and 50 MB."""
    vertices = 0.01 * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    refined = Plates.from_triangles(vertices[faces], np.full(4, FLAT_HALF_ANGLE))
    plates = refined if integration == "refined" else centroid_plates(vertices, faces)
    return Tool(
        name="none", file="", plates=plates, facets=plates, vertices=vertices, faces=faces, issues=(), corners=vertices
    )


def _inclined() -> HeightMap:
    """A map that makes the surface an inclined plane: it has machine code of its own."""
    side = 1e4 * np.arange(-5.0, 6.0)
    x, y = np.repeat(side, 11), np.tile(side, 11)
    return HeightMap.unknown(1e4).with_points(x, y, 0.1 * x)

"""Machine code for what a pose can reach: from the cache on disk, or compiled by processes beside this one."""

import itertools
import json
import os
import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numba.core import event

from rft_ros.child_process import lower_priority, start_child
from rft_ros.estimator.estimator import Estimator
from rft_ros.estimator.learning import Learning
from rft_ros.estimator.load_cell import LoadCellFrame
from rft_ros.estimator.motion import PoseDifference
from rft_ros.estimator.quality import prior_belief
from rft_ros.estimator.samples import PoseSample, TwistSample, WrenchSample
from rft_ros.ground import HeightMap
from rft_ros.parameters import LoadCell, Model, Settings
from rft_ros.rft import (
    ALPHA_Y_MODELS,
    INTEGRATIONS,
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

__all__ = ["EVERY_CODE", "Code", "code_of", "compile_jobs", "prepare", "pyramid"]


class Code(NamedTuple):
    """What selects machine code: the names of law, α_y model and rule; memory, learning, a map of the ground or not."""

    law: str
    alpha_y: str
    integration: Integration
    memory: bool
    learning: bool
    ground: bool


_LAWS = (*(("treers2021", name) for name in ALPHA_Y_MODELS), ("agarwal2023", "constant"))

EVERY_CODE = tuple(
    Code(*law, rule, memory, learning=True, ground=True)
    for rule, law, memory in itertools.product(INTEGRATIONS, _LAWS, (False, True))
)


def code_of(model: Model, settings: Settings) -> Code:
    """The code that a model and settings need."""
    return Code(
        model.law_name,
        "constant" if model.law_name == "agarwal2023" else model.alpha_y,
        model.tool.plates.integration,
        memory=model.mobilization_length > 0.0,
        learning=settings.learning_mode != "off",
        ground=model.ground is not None,
    )


def prepare(*codes: Code, at_low_priority: bool = False, on_cold_cache: Callable[[], None] = lambda: None) -> None:
    """Load machine code from the cache on disk, so that nothing compiles when samples come.

    If the cache lacks any, `on_cold_cache` is called, and processes on all cores fill the cache: the compiler's 100 MB
    go with them. Where nothing can be cached, this process compiles.
    """
    poses = [(True, code) for code in codes]
    rest = [(False, code) for code in codes if len(codes) == 1 or not code.memory]
    try:
        with event.install_listener("numba:compile", _ColdCache()):
            return _load(poses + rest)
    except _NotCompiledError:
        on_cold_cache()
    parts = min(len(os.sched_getaffinity(0)), 2 * len(codes))
    processes = []
    try:
        with suppress(OSError):  # no process to be had
            for part in range(parts):
                jobs = json.dumps((poses + rest)[part::parts])
                processes.append(start_child(compile_jobs, jobs, at_low_priority))
        for process in processes:
            process.wait()
    finally:
        for process in processes:
            process.kill()
    return _load(poses + rest)


class _NotCompiledError(Exception):
    pass


class _ColdCache(event.Listener):  # type: ignore[misc]
    """Raises as soon as this thread begins to compile what it did not find in the cache."""

    def __init__(self) -> None:
        self._thread = threading.get_ident()

    def on_start(self, _event: event.Event) -> None:
        if threading.get_ident() == self._thread:
            raise _NotCompiledError

    def on_end(self, _event: event.Event) -> None:
        pass


def compile_jobs(jobs: str, at_low_priority: bool) -> None:
    """In a process beside: compile what `jobs` names, JSON of the argument of `_load`."""
    if at_low_priority:
        lower_priority()
    _load((poses, Code(*code)) for poses, code in json.loads(jobs))


def _load(jobs: Iterable[tuple[bool, Code]]) -> None:
    """Load, or compile, what answers poses, or what else is needed: two halves, which two processes can share."""
    medium = next(iter(MEDIA.values()))
    table = Table.sampled([0.0], [0.0], [[1.0]])
    for poses, code in jobs:
        law, tool = law_named(code.law, medium, alpha_y_model(code.alpha_y, medium, table)), pyramid(code.integration)
        model = Model(
            tool=tool, law=law, medium=medium.name, zeta=1.0, alpha_y=code.alpha_y,
            mobilization_length=float(code.memory), ground=HeightMap.unknown(1.0) if code.ground else None,
        )  # fmt: skip
        if poses:
            _answer_poses(model, learning=code.learning)
            continue
        plate_forces(tool.plates, law, [0.0, 0.0, 1e3, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0])
        difference = PoseDifference()
        difference.span(window=1.0, max_age=1.0)
        for k in range(1, 6):
            difference.push(_pose(k))
        prior_belief(np.zeros(7), zeta_error=0.0, reach=0.0)
        LoadCellFrame(LoadCell()).into_sensor(np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(12))
        if code.learning:
            Learning()
        if code.ground:
            HeightMap.unknown(1.0).with_points(*np.zeros((3, 1)))


def _answer_poses(model: Model, *, learning: bool) -> None:
    """`learning`: with a load cell."""
    estimator = Estimator(Settings(learning_mode="apply" if learning else "off"), model)
    for k in range(1, 5):
        pose = _pose(k)
        estimator.push_twist(TwistSample(pose.stamp, "world", (0.0, 0.0, -0.1), (0.0, 0.0, 0.0)))
        estimator.push_wrench(WrenchSample(pose.stamp, "ft_sensor", (0.0,) * 6))
        estimator.push_pose(pose)


def _pose(k: int) -> PoseSample:
    """Deep in the grains, where a pose reaches every function."""
    return PoseSample(k * 10_000_000, "world", (0.0, 0.0, -1e3 - 0.001 * k), (0.0, 0.0, 0.0, 1.0))


def pyramid(integration: Integration) -> Tool:
    """A tool of four plates. It comes from no file, since reading one imports trimesh: a second, and 50 MB."""
    vertices = 0.01 * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    refined = Plates.from_triangles(vertices[faces], np.full(4, FLAT_HALF_ANGLE))
    plates = refined if integration == "refined" else centroid_plates(vertices, faces)
    return Tool(
        name="none", file="", plates=plates, facets=plates, vertices=vertices, faces=faces, issues=(), corners=vertices
    )

"""Loads the machine code that poses need from the cache on disk, or compiles it in child processes."""

import threading
from collections.abc import Callable
from contextlib import suppress

import numpy as np
from numba.core import event

from rft_ros.child_process import lower_priority, start_child
from rft_ros.estimator.learning import Learning
from rft_ros.estimator.load_cell import LoadCellFrame
from rft_ros.estimator.pose_difference import PoseDifference
from rft_ros.estimator.samples import PoseSample
from rft_ros.estimator.sigma import predict_without_learning
from rft_ros.ground import HeightMap, Support
from rft_ros.parameters import LoadCell, Values
from rft_ros.rft import QUATERNION, Plates, agarwal2023, edge_share, wrenches
from rft_ros.rft.wrench import compile_memory, compile_tractions

__all__ = ["PARTS", "compile_parts", "needed", "prepare"]

_PLATE = Plates.from_arrays([[0.0, 0.0, -1.0]], [[0.0, 0.0, -1.0]], [1.0])
_SINKING = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0])


def _answers() -> None:
    edge_share(_PLATE, _SINKING)
    LoadCellFrame(LoadCell()).into_sensor(_SINKING[QUATERNION], np.zeros(12))
    predict_without_learning(np.zeros(7), 1.0, 0.0, np.zeros(12))


def _ground() -> None:
    level = HeightMap.unknown(1.0).with_points(*np.zeros((3, 1)))
    Support(np.eye(3)).local_surface(level, _SINKING, level=0.0)


_PARTS: dict[str, Callable[[], object]] = {
    "forces": lambda: wrenches(_PLATE, agarwal2023(), _SINKING),
    "answers": _answers,
    "velocity": lambda: PoseDifference().push(PoseSample(1, "", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))),
    "learning": Learning,
    "ground": _ground,
}
PARTS = frozenset(_PARTS)
"""Names of the parts that the machine code is divided into."""


def needed(values: Values) -> frozenset[str]:
    """The parts that an estimator with these parameters needs."""
    unused = set()
    if values["twist_source"] == "topic":
        unused.add("velocity")
    if values["learning.mode"] == "off":
        unused.add("learning")
    if not values["ground.cell"]:
        unused.add("ground")
    return PARTS - unused


def prepare(
    parts: frozenset[str] = PARTS, *, at_low_priority: bool = False, on_cold_cache: Callable[[], None] = lambda: None
) -> None:
    """Load machine code from the cache on disk, so that nothing compiles when samples come.

    If some is missing in the cache, `on_cold_cache` is called, and child processes compile it. The 100 MB of the
    compiler are freed when they end. Where nothing can be cached, this process compiles.
    """
    try:
        with event.install_listener("numba:compile", _ColdCache()):
            return _load(parts)
    except _NotCompiledError:
        on_cold_cache()
    children = []
    try:
        # Two children: the loop over plates takes as long as all else, and each child needs 2 s of CPU to start numba.
        with suppress(OSError):  # the system starts no more processes; then this process compiles below
            for group in (parts & {"forces"}, parts - {"forces"}):
                if group:
                    children.append(start_child(compile_parts, at_low_priority, *sorted(group)))
        for child in children:
            child.wait()
    finally:
        for child in children:
            child.kill()
    return _load(parts)


def compile_parts(at_low_priority: bool, *parts: str) -> None:
    """In a child process: compile these of `PARTS`."""
    if at_low_priority:
        lower_priority()
    # Each child first compiles a part of the loop. The child with the loop then finds the other part in the cache.
    if "forces" in parts:
        compile_memory()
    else:
        compile_tractions()
    _load(frozenset(parts))


def _load(parts: frozenset[str]) -> None:
    for part in sorted(parts):
        _PARTS[part]()


class _NotCompiledError(Exception):
    pass


class _ColdCache(event.Listener):  # type: ignore[misc]
    """Raises when this thread begins to compile a function that is not in the cache."""

    def __init__(self) -> None:
        self._thread = threading.get_ident()

    def on_start(self, _event: event.Event) -> None:
        if threading.get_ident() == self._thread:
            raise _NotCompiledError

    def on_end(self, _event: event.Event) -> None:
        pass

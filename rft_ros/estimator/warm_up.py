"""Loads the machine code that poses need from the cache on disk, or compiles it in child processes."""

import threading
from collections.abc import Callable
from contextlib import suppress

import numpy as np
from numba.core import event

from rft_ros.child_process import start_child
from rft_ros.estimator.learning import Learning
from rft_ros.estimator.load_cell import LoadCellFrame
from rft_ros.estimator.motion import Kinematics
from rft_ros.estimator.samples import PoseSample
from rft_ros.estimator.sigma import predict_without_learning
from rft_ros.estimator.timeline import Timeline
from rft_ros.ground import HeightMap, Support
from rft_ros.parameters import LoadCell, Settings
from rft_ros.rft import QUATERNION, Plates, agarwal2023, wrenches

__all__ = ["forces", "other_loops", "prepare"]

_PLATE = Plates.from_arrays([[0.0, 0.0, -1.0]], [[0.0, 0.0, -1.0]], [1.0])
_SINKING = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0])


def prepare(on_cold_cache: Callable[[], None] = lambda: None) -> None:
    """Load all machine code from the cache on disk, so that nothing compiles when samples come.

    If some is missing in the cache, `on_cold_cache` is called, and child processes compile it. The 100 MB of the
    compiler are freed when they end. Where nothing can be cached, this process compiles.
    """
    try:
        with event.install_listener("numba:compile", _ColdCache()):
            forces()
            return other_loops()
    except _NotCompiledError:
        on_cold_cache()
    children = []
    try:
        with suppress(OSError):  # the system starts no more processes; then this process compiles below
            for loops in (forces, other_loops):  # they take as long as each other
                children.append(start_child(loops))
        for child in children:
            child.wait()
    finally:
        for child in children:
            child.kill()
    forces()
    return other_loops()


def forces() -> None:
    """Run the loop over plates, with all that it is made of."""
    wrenches(_PLATE, agarwal2023(), _SINKING)


def other_loops() -> None:
    """Run the loops around it: of frames, velocities, learning and the ground."""
    LoadCellFrame(LoadCell()).into_sensor(_SINKING[QUATERNION], np.zeros(12))
    predict_without_learning(np.zeros(7), 1.0, 0.0, np.zeros(12))
    pose = PoseSample(1, "", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    Kinematics().velocity(pose, Timeline(), Settings(twist_source="pose_difference"))
    Learning()
    level = HeightMap.unknown(1.0).with_points(*np.zeros((3, 1)))
    Support(np.eye(3)).local_surface(level, _SINKING, level=0.0)


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

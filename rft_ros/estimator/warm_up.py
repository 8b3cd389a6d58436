"""Loads the machine code that an estimator needs from the cache on disk, or compiles it in child processes."""

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
from rft_ros.parameters import Config, InputsConfig, LoadCell
from rft_ros.rft import QUATERNION, Agarwal2023, Plates, wrenches
from rft_ros.rft.frames import Placement
from rft_ros.rft.wrench import compile_memory, compile_tractions

_PLATE = Plates.from_arrays([[0.0, 0.0, -1.0]], [[0.0, 0.0, -1.0]], [1.0])
_SINKING = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0])


def _forces() -> None:
    """The loop over plates, with all that it is made of."""
    wrenches(_PLATE, Agarwal2023(), _SINKING)


def _around() -> None:
    """The loops around it: of frames, the noise of poses and the standard deviation."""
    LoadCellFrame(LoadCell()).into_sensor(_SINKING[QUATERNION], np.zeros(12))
    predict_without_learning(np.zeros(7), 1.0, 0.0, np.zeros(12))
    Kinematics()


def _velocity() -> None:
    pose = PoseSample(1, "", *Placement())
    inputs = InputsConfig(twist_source="pose_difference")
    Kinematics().velocity(pose, Timeline(), inputs, tool_frame="")


def _ground() -> None:
    level = HeightMap.unknown(1.0).with_points(*np.zeros((3, 1)))
    Support(np.eye(3)).local_surface(level, _SINKING, default_height=0.0)


_LOADS: dict[str, Callable[[], object]] = {
    "forces": _forces,
    "around": _around,
    "velocity": _velocity,
    "learning": Learning,
    "ground": _ground,
}
PARTS = frozenset(_LOADS)
"""Names of the parts that the machine code is divided into."""


def needed(config: Config) -> frozenset[str]:
    """The parts that an estimator with these parameters needs."""
    unused = set()
    if config.inputs.twist_source == "topic":
        unused.add("velocity")
    if config.learning.mode == "off":
        unused.add("learning")
    if not config.ground.cell:
        unused.add("ground")
    return PARTS - unused


def prepare(
    parts: frozenset[str] = PARTS, on_cold_cache: Callable[[], None] = lambda: None
) -> None:
    """Load machine code from the cache on disk, so that nothing compiles when samples come.

    If some is missing in the cache, `on_cold_cache` is called, and child processes compile it. The 100 MB of the
    compiler are freed when they end. Where nothing can be cached, this process compiles.
    """
    if _load_cached(parts):
        return
    on_cold_cache()
    children = []
    try:
        with suppress(
            OSError
        ):  # the system starts no more processes; then this process compiles below
            children.append(start_child(_compile_forces))
            children.append(start_child(_compile_others, *sorted(parts - {"forces"})))
        for child in children:
            child.wait()
    finally:
        for child in children:
            child.kill()
    load(*parts)


def prepare_later(parts: frozenset[str]) -> threading.Thread | None:
    """As `prepare`, but what is missing in the cache compiles until the returned thread ends; this one goes on."""
    if _load_cached(parts):
        return None
    thread = threading.Thread(target=_compile_in_child, args=[parts], daemon=True)
    thread.start()
    return thread


def _compile_in_child(parts: frozenset[str]) -> None:
    with suppress(OSError):
        start_child(load, *sorted(parts), low_priority=True).wait()
    load(*parts)


def _compile_forces() -> None:
    compile_memory()  # meanwhile the other child compiles the tractions, which the loop then loads
    load("forces")


def _compile_others(*parts: str) -> None:
    compile_tractions()
    load(*parts)


def load(*parts: str) -> None:
    """Load these of `PARTS`, or compile them in this process."""
    for part in parts:
        _LOADS[part]()


def _load_cached(parts: frozenset[str]) -> bool:
    """Load these of `PARTS` from the cache on disk. Returns False once something is not there."""
    try:
        with event.install_listener("numba:compile", _ColdCache()):
            load(*parts)
    except _NotCompiledError:
        return False
    return True


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

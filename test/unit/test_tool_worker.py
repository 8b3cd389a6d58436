"""The tool worker returns the tool, ready for the kernel, or a sentence."""

import os
import resource
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from rft_ros.errors import InputError
from rft_ros.node import swap
from rft_ros.node.swap import Failed, Swap
from rft_ros.node.tool_worker import ToolWorker
from rft_ros.parameters import Config, MeshConfig
from rft_ros.tool import load_tool


@pytest.fixture(autouse=True)
def compiled(monkeypatch):
    """Machine code may have to compile first, and changes that need more of it would be refused meanwhile."""
    for name in ("prepare", "prepare_later"):
        monkeypatch.setattr(swap, name, lambda *_: None)


def warm_worker(**options):
    """A worker that has loaded once: its imports are over, so its only children are loads (NumPy 1.26 runs lscpu)."""
    started = ToolWorker(**options)
    loaded(started, "plate")
    return started


@pytest.fixture(scope="module")
def worker():
    started = warm_worker()
    yield started
    started.end()


def loaded(worker, file, tolerance=0.0, is_wanted=lambda: True):
    try:
        return worker.load({"tool": MeshConfig(file=file, tolerance=tolerance)}, is_wanted)["tool"]
    finally:
        wait_for_last_load(worker)


def arrays(tool):
    return tool.plates.rows, tool.vertices, tool.faces, tool.corners


def test_a_tool_arrives_unchanged_with_aligned_read_only_arrays(worker):
    tool, back = load_tool("ellipsoid"), loaded(worker, "ellipsoid")
    assert (back.name, back.file, back.issues) == (tool.name, tool.file, tool.issues)
    assert back.plates.reach == tool.plates.reach
    for there, here in zip(arrays(back), arrays(tool), strict=True):
        np.testing.assert_array_equal(there, here)
        assert there.flags.aligned
    assert not back.plates.rows.flags.writeable


def test_what_cannot_be_loaded_is_a_sentence_and_the_worker_continues_at_a_low_priority(worker):
    pid = worker.process.pid
    with pytest.raises(InputError, match=r"gone\.stl"):
        loaded(worker, "gone.stl")
    with pytest.raises(InputError, match="'plate' cannot be loaded"):
        loaded(worker, "plate", "much")
    assert loaded(worker, "sphere").name == "sphere"
    assert worker.process.pid == pid
    assert os.getpriority(os.PRIO_PROCESS, pid) == max(os.getpriority(os.PRIO_PROCESS, 0), 10)


TRIANGLE = (
    "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
)


@pytest.fixture
def big(tmp_path):
    """A mesh that takes longer to load than this process needs to see that it has begun."""
    file = tmp_path / "big.stl"
    file.write_text("solid big\n" + TRIANGLE * 100_000 + "endsolid big\n")
    return str(file)


def test_a_worker_that_ends_at_each_try_fails_its_swap_and_is_replaced(worker, big):
    has_request = threading.Event()

    def is_wanted():
        has_request.set()
        return True

    with ThreadPoolExecutor(1) as thread:
        loading = thread.submit(loaded, worker, big, is_wanted=is_wanted)
        for _ in range(2):
            has_request.wait()  # one that dies before is replaced without a failed try
            first = worker.process
            os.kill(first.pid, signal.SIGKILL)
            while worker.process is first and not loading.done():
                time.sleep(0.001)
            has_request.clear()
        with pytest.raises(
            InputError, match=r"the process that loads mesh.file '.*big.stl' ended; set it again"
        ):
            loading.result()
    assert loaded(worker, "plate").name == "plate"


def test_a_worker_killed_while_idle_is_replaced_at_the_next_swap_once_there_are_descriptors(
    worker,
):
    os.kill(worker.process.pid, signal.SIGKILL)
    os.waitid(os.P_PID, worker.process.pid, os.WEXITED | os.WNOWAIT)
    lowest_free = os.dup(0)
    os.close(lowest_free)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (lowest_free, hard))
    try:
        with pytest.raises(InputError, match="Too many open files"):
            loaded(worker, "plate")
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    assert loaded(worker, "plate").name == "plate"


def test_a_worker_that_was_killed_while_idle_refuses_nothing_even_if_it_dies_only_now(worker):
    """It is dead when the request is sent, and the node cannot know it yet."""
    os.kill(worker.process.pid, signal.SIGSTOP)
    with ThreadPoolExecutor(1) as thread:
        loading = thread.submit(loaded, worker, "sphere")
        time.sleep(0.1)
        os.kill(worker.process.pid, signal.SIGKILL)
        assert loading.result().name == "sphere"


def test_a_worker_that_is_ended_while_it_loads_is_not_started_again(big):
    """As by SIGINT: the node waited for the repeated load."""
    worker = ToolWorker()
    os.kill(worker.process.pid, signal.SIGSTOP)
    first = worker.process.pid
    with ThreadPoolExecutor(1) as thread:
        loading = thread.submit(loaded, worker, big)
        time.sleep(0.1)
        worker.end()
        with pytest.raises(InputError, match="ended"):
            loading.result()
    assert worker.process.pid == first
    assert worker.process.poll() is not None


def loads_of(worker):
    """The processes of loads that have not ended."""
    pid = worker.process.pid
    loads = []
    with suppress(OSError):  # the worker has ended, or this process may open no file
        for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
            with suppress(FileNotFoundError):
                # one that has ended may not be reaped yet
                if ") Z" not in Path(f"/proc/{child}/stat").read_text():
                    loads.append(int(child))
    return loads


def wait_for_last_load(worker):
    """Its process may live a moment longer than its answer, and `load_of` would take it for the next."""
    while loads_of(worker):
        time.sleep(0.001)


def load_of(worker):
    """The process of the load in progress, once it has begun."""
    while not (loads := loads_of(worker)):
        time.sleep(0.001)
    return loads[0]


def test_a_drive_that_gives_nothing_to_read_is_given_up_and_says_so(big):
    worker = warm_worker(longest_stall=2.0)
    with ThreadPoolExecutor(1) as thread:
        loading = thread.submit(loaded, worker, big)
        os.kill(load_of(worker), signal.SIGSTOP)
        with pytest.raises(
            InputError, match=r"mesh\.file '.*big\.stl' gave nothing to read for 2 s; look at"
        ):
            loading.result()
    answer = None
    while answer is None:
        # on a busy machine the next load may starve for these 2 s
        with suppress(InputError):
            answer = loaded(worker, "plate")
    assert answer.name == "plate"
    worker.end()


def test_a_load_that_the_system_kills_says_so_and_starts_no_other_worker(worker, big):
    pid = worker.process.pid
    with ThreadPoolExecutor(1) as thread:
        loading = thread.submit(loaded, worker, big)
        os.kill(load_of(worker), signal.SIGKILL)
        with pytest.raises(InputError, match=r"loads mesh.file '.*big.stl' ended; set it again"):
            loading.result()
    assert loaded(worker, "plate").name == "plate"
    assert worker.process.pid == pid


def swapped(pending):
    # beside other work the process of low priority starves for long
    end = time.monotonic() + 300.0
    while (found := pending.poll()) is None:
        assert time.monotonic() < end
        time.sleep(0.01)
    return found


def test_a_newer_request_takes_the_place_of_one_that_stalls_and_starts_no_other_worker(
    worker, big
):
    """To start a process holds the poses: the GIL is held until the system runs it."""
    config = Config.of({"tolerance": 0.0})
    pending = Swap(worker, config, on_cold_cache=lambda: None)
    pid = worker.process.pid
    with pytest.raises(InputError, match=r"mesh\.file '' is not a shipped mesh"):
        pending.prepare(config.changed({"mesh.file": ""}))
    wait_for_last_load(worker)
    pending.want(pending.prepare(config.changed({"mesh.file": big})))
    os.kill(load_of(worker), signal.SIGSTOP)
    for name in ("ellipsoid", "sphere"):
        pending.want(pending.prepare(config.changed({"mesh.file": name})))
        assert pending.preparing.startswith(f"mesh.file '{name}' for 0 s")
    assert swapped(pending) is pending.prepared
    assert pending.prepared.model.tool.name == "sphere"
    assert worker.process.pid == pid


def test_what_does_not_concern_the_tool_does_not_disturb_its_load(worker):
    config = Config.of({"tolerance": 0.0})
    pending = Swap(worker, config, on_cold_cache=lambda: None)
    process = worker.process.pid
    os.kill(process, signal.SIGSTOP)
    config = config.changed({"mesh.file": "sphere"})
    pending.want(pending.prepare(config))
    changed = {}
    for others in (
        {"learning.mode": "observe"},
        {"twist_source": "pose_difference"},
        {"medium.zeta": 0.5},
    ):
        changed |= others | {"ground.cell": 0.01}
        pending.want(pending.prepare(config.changed({**changed})))
        assert "mesh.file 'sphere' for " in pending.preparing
    os.kill(process, signal.SIGCONT)
    while pending.preparing:
        assert swapped(pending) is pending.prepared
    assert worker.process.pid == process
    assert pending.prepared.model.tool.name == "sphere"
    assert pending.prepared.model.ground is not None
    assert pending.prepared.model.law.zeta == 0.5
    assert pending.prepared.config.learning.mode == "observe"


def test_a_change_that_loads_nothing_waits_for_no_other_thread(worker, monkeypatch):
    """On a busy machine a thread starts tens of milliseconds late, and the poses would wait meanwhile."""
    config = Config.of({"tolerance": 0.0})
    pending = Swap(worker, config, on_cold_cache=lambda: None)
    monkeypatch.setattr(pending, "_check_thread", None)
    change = {"medium.zeta": 0.5, "learning.mode": "apply", "surface_height": 0.1}
    assert pending.prepare(config.changed(change)).model.law.zeta == 0.5


def test_a_change_waits_for_no_other_thread_while_a_mesh_loads(worker, monkeypatch):
    config = Config.of({"tolerance": 0.0})
    pending = Swap(worker, config, on_cold_cache=lambda: None)
    os.kill(worker.process.pid, signal.SIGSTOP)
    config = config.changed({"mesh.file": "sphere"})
    pending.want(pending.prepare(config))
    monkeypatch.setattr(pending, "_check_thread", None)
    assert pending.prepare(config.changed({"medium.zeta": 0.5})).model.law.zeta == 0.5
    assert pending.preparing.startswith("mesh.file 'sphere' for ")
    os.kill(worker.process.pid, signal.SIGCONT)
    assert swapped(pending).model.tool.name == "sphere"


def test_a_tool_that_cannot_be_used_undoes_its_own_parameters_and_no_others(worker, tmp_path):
    bad = tmp_path / "bad.stl"
    bad.write_text("solid nothing\nendsolid nothing\n")
    config = Config.of({"tolerance": 0.0})
    pending = Swap(worker, config, on_cold_cache=lambda: None)
    pending.want(pending.prepare(config.changed({"mesh.file": str(bad), "ground.cell": 0.01})))
    ended = []
    while pending.preparing:
        ended.append(swapped(pending))
    (failed,) = (end for end in ended if isinstance(end, Failed))
    parameters = failed.undo
    assert parameters["mesh.file"] == "plate"
    assert "ground.cell" not in parameters
    assert pending.prepared.model.ground is not None
    assert pending.prepared.model.tool.name == "plate"

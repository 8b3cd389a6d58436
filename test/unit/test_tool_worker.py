"""The tool worker returns the tool, ready for the kernel, or a sentence."""

import os
import resource
import signal
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from rft_ros.errors import InputError
from rft_ros.node.swap import Swap, ToolWorker
from rft_ros.parameters import defaults, files_of
from rft_ros.tool import load_tool


@pytest.fixture(scope="module")
def worker():
    started = ToolWorker()
    yield started
    started.end()


def loaded(worker, file, tolerance=0.0):
    files = files_of({**defaults(), "mesh.file": file, "tolerance": tolerance})
    return worker.load({"tool": files["tool"]})["tool"]


def arrays(tool):
    return tool.plates.packed, tool.vertices, tool.faces, tool.corners


def test_a_tool_arrives_unchanged_with_aligned_read_only_arrays(worker):
    tool, back = load_tool("ellipsoid"), loaded(worker, "ellipsoid")
    assert (back.name, back.file, back.issues) == (tool.name, tool.file, tool.issues)
    assert back.plates.reach == tool.plates.reach
    for there, here in zip(arrays(back), arrays(tool), strict=True):
        np.testing.assert_array_equal(there, here)
        assert there.flags.aligned
    assert not back.plates.packed.flags.writeable


def test_what_cannot_be_loaded_is_a_sentence_and_the_worker_continues_at_a_low_priority(worker):
    pid = worker.process.pid
    with pytest.raises(InputError, match=r"gone\.stl"):
        loaded(worker, "gone.stl")
    with pytest.raises(InputError, match="'plate' cannot be loaded"):
        loaded(worker, "plate", "much")
    assert loaded(worker, "sphere").name == "sphere"
    assert worker.process.pid == pid
    assert os.getpriority(os.PRIO_PROCESS, pid) == max(os.getpriority(os.PRIO_PROCESS, 0), 10)


def test_a_worker_that_ends_while_it_loads_fails_its_swap_and_is_replaced(worker):
    os.kill(worker.process.pid, signal.SIGSTOP)
    with ThreadPoolExecutor(1) as thread:
        loading = thread.submit(loaded, worker, "sphere")
        os.kill(worker.process.pid, signal.SIGKILL)
        with pytest.raises(InputError, match="ended; set it again"):
            loading.result()
    assert loaded(worker, "plate").name == "plate"


def test_a_worker_killed_while_idle_is_replaced_at_the_next_swap_once_there_are_descriptors(worker):
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


def test_a_newer_request_takes_the_place_of_one_that_is_being_loaded(worker):
    values = {**defaults(), "tolerance": 0.0}
    pending = Swap(worker, values, on_cold_cache=lambda: None)
    os.kill(worker.process.pid, signal.SIGSTOP)  # it loads for ever
    for name in ("ellipsoid", "sphere"):
        pending.want({**values, "mesh.file": name})
        assert pending.preparing == f"mesh.file '{name}'"
    while (succeeded := pending.poll()) is None:
        time.sleep(0.01)
    assert succeeded
    assert pending.parts["tool"].name == "sphere"

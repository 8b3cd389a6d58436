"""The tool worker returns the tool, ready for the kernel, or a sentence."""

import os
import resource
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from rft_ros.errors import InputError
from rft_ros.node.tool_worker import ToolWorker
from rft_ros.parameters import ModelFiles
from rft_ros.tool import ToolRequest, load_tool

WAIT = 180.0


def files(*request, **options):
    return ModelFiles(ToolRequest(*request, **options))


@pytest.fixture(scope="module")
def worker():
    started = ToolWorker()
    yield started
    started.close()
    assert not Path(f"/proc/{started.process.pid}").exists()


def loaded(worker, *request):
    return worker.load(files(*request)).result(WAIT).tool


def test_the_first_tool_is_loaded_at_full_priority_and_others_beside_the_node():
    worker, ours = ToolWorker(), os.getpriority(os.PRIO_PROCESS, 0)
    assert os.getpriority(os.PRIO_PROCESS, worker.process.pid) == ours
    for _ in range(2):  # it lowers the priority once the first answer has gone
        loaded(worker, "plate")
    assert os.getpriority(os.PRIO_PROCESS, worker.process.pid) == max(ours, 10)
    worker.close()


def test_a_tool_arrives_unchanged_with_aligned_read_only_arrays(worker):
    tool, back = load_tool("ellipsoid"), loaded(worker, "ellipsoid")
    np.testing.assert_array_equal(back.plates.packed, tool.plates.packed)
    np.testing.assert_array_equal(back.vertices, tool.vertices)
    np.testing.assert_array_equal(back.faces, tool.faces)
    assert (back.name, back.issues, back.plates.reach) == (tool.name, tool.issues, tool.plates.reach)
    assert not back.plates.packed.flags.writeable
    assert back.plates.packed.flags.aligned


def test_what_cannot_be_loaded_is_a_sentence_and_the_worker_continues(worker):
    pid = worker.process.pid
    with pytest.raises(InputError, match=r"gone\.stl"):
        loaded(worker, "gone.stl")
    with pytest.raises(InputError, match="'plate' cannot be loaded"):
        loaded(worker, "plate", 0.001, "nowhere")
    assert loaded(worker, "sphere").name == "sphere"
    assert worker.process.pid == pid


def test_a_request_in_place_of_one_that_is_being_loaded_is_answered_by_a_new_process(worker):
    for _ in range(2):
        pid = worker.process.pid
        os.kill(pid, signal.SIGSTOP)  # it loads for as long as it may
        loading = worker.load(files("sphere"))
        while not loading.running():
            time.sleep(0.01)
        worker.cancel(loading)
        assert loaded(worker, "plate").name == "plate"
        assert loading.exception()
        assert not Path(f"/proc/{pid}").exists()


@pytest.mark.parametrize(
    ("number", "words"), [(signal.SIGKILL, "ended with status -9; set it again"), (signal.SIGALRM, "took over 600 s")]
)
def test_a_worker_that_ends_while_it_loads_fails_its_swap_and_is_replaced(worker, number, words):
    os.kill(worker.process.pid, signal.SIGSTOP)
    loading = worker.load(files("plate"))
    os.kill(worker.process.pid, number)
    os.kill(worker.process.pid, signal.SIGCONT)
    with pytest.raises(InputError, match=words):
        loading.result(WAIT)
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

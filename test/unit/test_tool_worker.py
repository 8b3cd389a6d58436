"""The tool worker returns the tool, ready for the kernel, or a sentence."""

import multiprocessing
import os
import pickle
import resource
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from rft_ros.errors import InputError
from rft_ros.node.tool_worker import ToolWorker, receive, send
from rft_ros.parameters import ModelFiles, ModelParts
from rft_ros.tool import Tool, ToolRequest, load_tool


def files(*request, **options):
    return ModelFiles(ToolRequest(*request, **options))


@pytest.fixture
def worker():
    started = ToolWorker()
    yield started
    started.close()


def answer(polled):
    """The first answer of a worker or of a swap."""
    until = time.monotonic() + 180.0
    while (found := polled.poll()) is None:
        assert time.monotonic() < until, "no answer"
        time.sleep(0.01)
    return found.tool if isinstance(found, ModelParts) else found


def loaded(worker, request):
    worker.load(request)
    return answer(worker)


def test_a_tool_arrives_unchanged_with_aligned_read_only_arrays():
    tool = load_tool("ellipsoid")
    here, there = multiprocessing.Pipe()
    send(there, tool)
    back = receive(here)
    there.close()
    np.testing.assert_array_equal(back.plates.packed, tool.plates.packed)
    np.testing.assert_array_equal(back.vertices, tool.vertices)
    np.testing.assert_array_equal(back.faces, tool.faces)
    assert back.lowest_point(np.eye(3)) == tool.lowest_point(np.eye(3))
    assert (back.name, back.issues, back.plates.reach) == (tool.name, tool.issues, tool.plates.reach)
    assert not back.plates.packed.flags.writeable
    assert back.plates.packed.flags.aligned


def test_tools_load_one_after_the_other_and_a_bad_one_in_between_is_a_sentence(worker):
    for name in ("plate", "sphere"):
        tool = loaded(worker, files(name))
        assert isinstance(tool, Tool)
        assert len(tool.plates) == len(load_tool(name).plates)
        assert "gone.stl" in loaded(worker, files("gone.stl"))


def test_a_later_request_replaces_one_that_is_being_loaded(worker):
    worker.load(files("wheel"))
    tool = loaded(worker, files("plate"))
    assert isinstance(tool, Tool)
    assert tool.name == "plate"
    assert worker.poll() is None


def test_workers_that_were_replaced_have_ended_when_the_last_one_is_closed(worker):
    pids = []
    for _ in range(3):
        worker.load(files("plate"))
        pids.append(worker.pid)
    worker.close()
    assert len(set(pids)) == 3
    assert not any(Path(f"/proc/{pid}").exists() for pid in pids)


def test_the_first_tool_is_loaded_at_full_priority_and_others_beside_the_node(worker):
    ours = os.getpriority(os.PRIO_PROCESS, 0)
    assert os.getpriority(os.PRIO_PROCESS, worker.pid) == ours
    assert worker.load_now(files("plate")).tool.name == "plate"
    until = time.monotonic() + 180.0
    while os.getpriority(os.PRIO_PROCESS, worker.pid) != min(ours + 10, 19):
        assert time.monotonic() < until
        time.sleep(0.01)
    with pytest.raises(InputError, match=r"gone\.stl"):
        worker.load_now(files("gone.stl"))


def test_an_unexpected_exception_in_the_worker_is_a_sentence_and_the_worker_continues(worker):
    pid = worker.pid
    assert "mesh.file 'plate' cannot be loaded" in loaded(worker, files("plate", origin="nowhere"))
    assert isinstance(loaded(worker, files("plate")), Tool)
    assert worker.pid == pid


def test_a_killed_worker_fails_its_swap_and_is_replaced(worker):
    worker.load(files("wheel"))
    os.kill(worker.pid, signal.SIGKILL)
    assert "ended with status -9" in answer(worker)
    assert isinstance(loaded(worker, files("plate")), Tool)


@pytest.mark.parametrize("free", [0, 1])
def test_without_free_descriptors_a_swap_fails_and_the_next_one_with_some_succeeds(worker, free):
    """With 0 free, the socket cannot be duplicated; with 1, the descriptor of the tool's memory does not arrive."""
    worker.load(files("plate"))
    lowest_free = os.dup(0)
    os.close(lowest_free)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (lowest_free + free, hard))
    try:
        assert "cannot be read" in answer(worker)
        assert isinstance(loaded(worker, files("plate")), str)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    assert isinstance(loaded(worker, files("plate")), Tool)


def test_a_damaged_answer_fails_its_swap(worker, monkeypatch):
    monkeypatch.setattr("rft_ros.node.tool_worker.receive", lambda _: pickle.loads(b"damaged"))
    assert "cannot be read (UnpicklingError: " in loaded(worker, files("plate"))
    monkeypatch.undo()
    assert isinstance(loaded(worker, files("plate")), Tool)


def test_a_worker_killed_while_idle_is_replaced_at_the_next_swap(worker):
    assert isinstance(loaded(worker, files("plate")), Tool)
    os.kill(worker.pid, signal.SIGKILL)
    os.waitid(os.P_PID, worker.pid, os.WEXITED | os.WNOWAIT)
    assert isinstance(loaded(worker, files("sphere")), Tool)


def test_a_tool_that_takes_too_long_fails_with_a_sentence_and_the_worker_is_replaced():
    worker = ToolWorker(deadline=0.01)
    try:
        pid = worker.pid
        assert "mesh.file 'plate' took over 0.01 s to load" in loaded(worker, files("plate"))
        assert worker.pid != pid
    finally:
        worker.close()

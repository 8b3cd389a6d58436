"""The node's threads ask for short slices, and its worker processes for the usual ones."""

import ctypes
import importlib
import os
import platform
import struct
import threading

import pytest

from rft_ros.child_process import lower_priority, start_child
from rft_ros.time_slice import request_short_slices

_GET = {"x86_64": 315, "aarch64": 275}.get(platform.machine())
_ATTRIBUTES = struct.Struct("=IIQiIQQQII")  # sched_getattr(2)


def slice_ns():
    """The slice that this thread has asked for; 0 where the kernel takes no request (before 6.12)."""
    buffer = ctypes.create_string_buffer(_ATTRIBUTES.size)
    assert ctypes.CDLL(None).syscall(_GET, 0, buffer, _ATTRIBUTES.size, 0) == 0
    return _ATTRIBUTES.unpack(buffer.raw)[5]


def in_a_new_process(function):
    """The result of a function there: this process keeps its priority and its slices."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.write(write, repr(function()).encode())
        os._exit(0)
    os.close(write)
    with os.fdopen(read) as pipe:
        found = pipe.read()
    os.waitpid(child, 0)
    return found


def in_a_new_thread(function):
    found = []
    thread = threading.Thread(target=lambda: found.append(function()))
    thread.start()
    thread.join()
    return found[0]


@pytest.mark.skipif(
    _GET is None or slice_ns() == 0, reason="this kernel takes no length of a slice"
)
def test_threads_started_later_have_short_slices_and_a_process_of_low_priority_the_usual_ones():
    def slices():
        usual = slice_ns()
        request_short_slices()
        short = in_a_new_thread(slice_ns)
        lower_priority()
        return short < usual, slice_ns() == usual, os.getpriority(os.PRIO_PROCESS, 0) > 0

    assert in_a_new_process(slices) == "(True, True, True)"


def test_a_child_of_low_priority_has_it_before_its_imports(tmp_path, monkeypatch):
    """Imports take a second of a core, for which the poses of a node on a busy machine would wait."""
    (tmp_path / "priority_probe.py").write_text(
        "import os\n"
        "from pathlib import Path\n"
        "Path(__file__).with_name(str(os.getpid())).write_text(str(os.getpriority(os.PRIO_PROCESS, 0)))\n"
        "def work():\n"
        "    pass\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    work = importlib.import_module("priority_probe").work
    child = start_child(work, low_priority=True)
    assert child.wait() == 0
    assert int((tmp_path / str(child.pid)).read_text()) > 0

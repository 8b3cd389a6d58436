"""A process beside the node that loads and checks tools, so that a swap costs the ticks nothing.

A busy thread in the node would cost one tick in six (docs/architecture.md), and a new process spends most of its time
on imports, which hold up the ticks of a machine with few cores. So `start_preparer` forks one before ROS starts, with
everything imported; for each request it forks a child, on processor time that nobody else wants. A tool's arrays lie
in a file of their own, which the node maps: reading 9 MB would hold up a tick for 5 ms.
"""

import ctypes
import gc
import mmap
import os
import pickle
import select
import signal
import socket
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from rft_ros.errors import InputError
from rft_ros.tool import Tool, ToolRequest

__all__ = ["Preparation", "Preparer", "read_tool", "start_preparer", "write_tool"]

_ALIGNMENT = 64
_TOOL, _ARRAYS, _REFUSED = "tool", "arrays", "refused"
_LONGEST = 1 << 16
_CANCEL = b"cancel"
_PR_SET_THP_DISABLE = 41


def write_tool(folder: Path, tool: Tool) -> None:
    """Write a tool for `read_tool`; the file `tool` appears last, and whole."""
    spans: list[tuple[int, int]] = []
    with (folder / _ARRAYS).open("wb") as arrays:

        def keep(buffer: pickle.PickleBuffer) -> None:
            arrays.write(b"\0" * (-arrays.tell() % _ALIGNMENT))
            start = arrays.tell()
            arrays.write(buffer.raw())
            spans.append((start, arrays.tell()))

        head = pickle.dumps(tool, protocol=5, buffer_callback=keep)
    _write_whole(folder / _TOOL, pickle.dumps((head, spans)))


def _write_whole(file: Path, data: bytes) -> None:
    part = file.with_suffix(".part")
    part.write_bytes(data)
    part.rename(file)


def read_tool(folder: Path) -> Tool:
    """The tool in a folder; its arrays stay in the mapped file, which may be deleted."""
    head, spans = pickle.loads((folder / _TOOL).read_bytes())
    with (folder / _ARRAYS).open("rb") as arrays:
        view = memoryview(mmap.mmap(arrays.fileno(), 0, access=mmap.ACCESS_READ))
    tool: Tool = pickle.loads(head, buffers=[view[start:end] for start, end in spans])
    return tool


class Preparation:
    """A tool on its way: `poll` until it answers."""

    def __init__(self, request: ToolRequest, requests: socket.socket) -> None:
        self.request = request
        self._requests = requests
        self._folder = tempfile.TemporaryDirectory(prefix="rft_ros_")
        with suppress(OSError):  # `poll` tells
            requests.send(pickle.dumps((request, self._folder.name)))

    def poll(self) -> Tool | str | None:
        """The tool, or a sentence that says why there is none, or None while it is being prepared."""
        folder = Path(self._folder.name)
        answer: Tool | str
        if (folder / _TOOL).exists():
            answer = read_tool(folder)
        elif (folder / _REFUSED).exists():
            answer = (folder / _REFUSED).read_text(encoding="utf-8")
        elif self._preparer_lives():
            return None
        else:
            answer = "the process that prepares meshes was ended from outside: start the node again to swap meshes"
        self._folder.cleanup()
        return answer

    def _preparer_lives(self) -> bool:
        try:
            return self._requests.recv(1) != b""  # it never sends: end of file, or nothing yet
        except BlockingIOError:
            return True
        except OSError:
            return False

    def cancel(self) -> None:
        """End the child, if it still runs, and remove its folder."""
        with suppress(OSError):
            self._requests.send(_CANCEL)
        self._folder.cleanup()


class Preparer:
    """The forked process, at the other end of a socket; it ends when the socket closes."""

    def __init__(self, pid: int, requests: socket.socket) -> None:
        self.pid = pid
        self._requests = requests
        requests.setblocking(False)

    def prepare(self, request: ToolRequest) -> Preparation:
        """Begin to load a tool; one that is still on its way is given up."""
        return Preparation(request, self._requests)

    def close(self) -> None:
        """End the process."""
        self._requests.close()
        with suppress(ChildProcessError):
            os.waitpid(self.pid, 0)


def start_preparer() -> Preparer:
    """Fork the process. Call it before anything starts threads: a fork carries over only the one that calls."""
    import scipy.spatial  # noqa: F401
    import trimesh  # noqa: F401

    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    pid = os.fork()
    if pid == 0:
        ours.close()
        _serve(theirs)
    theirs.close()
    return Preparer(pid, ours)


def _serve(requests: socket.socket) -> NoReturn:
    for number in (signal.SIGINT, signal.SIGTERM):  # Ctrl-C reaches the whole group; the node decides when to end
        signal.signal(number, signal.SIG_IGN)
    _stay_out_of_the_way()
    gc.collect()
    gc.freeze()
    child: _Child | None = None
    while True:
        watched = [requests.fileno()] + ([child.ended] if child else [])
        ready, _, _ = select.select(watched, [], [])
        if requests.fileno() in ready:
            data = requests.recv(_LONGEST)
            if child:
                child.kill()
                child = None
            if not data:
                os._exit(0)
            if data != _CANCEL:
                request, folder = pickle.loads(data)
                child = _Child(request, folder, requests)
        elif child:
            child.bury()
            child = None


def _stay_out_of_the_way() -> None:
    """Run on processor time that nobody else wants, on one processor, and ask the kernel for small pages.

    What a process of idle priority does inside the kernel still delays others; clearing a page of 2 MB is the worst.
    """
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    with suppress(OSError):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_THP_DISABLE, 1, 0, 0, 0)


class _Child:
    """A fork of the preparer that loads one tool."""

    def __init__(self, request: ToolRequest, folder: str, requests: socket.socket) -> None:
        self._folder = Path(folder)
        self._pid = os.fork()
        if self._pid == 0:
            requests.close()
            _answer(request, self._folder)
        self.ended = os.pidfd_open(self._pid)

    def kill(self) -> None:
        os.kill(self._pid, signal.SIGKILL)
        self.bury()

    def bury(self) -> None:
        """Wait for its end, and answer for it if it could not."""
        os.close(self.ended)
        _, status = os.waitpid(self._pid, 0)
        if status != 0 and self._folder.exists():
            with suppress(OSError):
                _refuse(self._folder, f"preparing the mesh ended with status {os.waitstatus_to_exitcode(status)}")


def _refuse(folder: Path, sentence: str) -> None:
    _write_whole(folder / _REFUSED, sentence.encode())


def _answer(request: ToolRequest, folder: Path) -> NoReturn:
    try:
        write_tool(folder, request.load())
    except InputError as error:
        _refuse(folder, str(error))
    except BaseException as error:  # a forked child must not go on as its parent
        with suppress(OSError):
            _refuse(folder, f"preparing the mesh '{request.file}' failed: {type(error).__name__}: {error}")
    os._exit(0)

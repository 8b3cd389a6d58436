"""Tool swaps, and the process beside the node that loads tools: a thread in the node would delay one tick in six."""

import mmap
import os
import pickle
import subprocess
import time
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from multiprocessing.reduction import recv_handle, send_handle
from pathlib import Path

from rft_ros.child_process import start_child
from rft_ros.errors import InputError
from rft_ros.installation import program
from rft_ros.tool import Tool, ToolRequest

_DEADLINE = 600.0  # s; its low priority makes it slow beside other work
_EXIT = 0.5  # s, for a worker that closed its connection to end
_NICENESS = 10  # the worker gets a tenth of a busy core, and all of an idle one
_ALIGNMENT = 64


class ToolWorker:
    """Loads one tool at a time in a process beside the node, started early so that no tool waits for its imports.

    The process has a low priority after its first tool, which the node waits for. It is replaced if it dies, exceeds
    the deadline [s], or gets a new request while it loads.
    """

    def __init__(self, *, deadline: float = _DEADLINE) -> None:
        self._deadline = deadline
        self.loading: ToolRequest | None = None
        self._killed: list[subprocess.Popen[bytes]] = []
        self._start(1)

    def _start(self, urgent: int) -> None:
        """`urgent`: the number of tools to load before the priority is lowered."""
        self._connection, theirs = Pipe()
        with theirs:
            self._process = start_child(serve, theirs.fileno(), urgent, pass_fds=[theirs.fileno()])

    @property
    def pid(self) -> int:
        """Process id of the worker."""
        return self._process.pid

    def load(self, request: ToolRequest) -> None:
        """Begin to load a tool; `poll` answers."""
        self.cancel()
        if self._process.poll() is not None:
            self._replace()
        with suppress(OSError):  # `poll` reports it
            self._connection.send(request)
        self.loading = request
        self._expires = time.monotonic() + self._deadline

    def load_now(self, request: ToolRequest) -> Tool:
        """Load a tool and wait for it. Raises InputError if it cannot be used."""
        self.load(request)
        self._connection.poll(self._deadline)
        answer = self.poll()
        if not isinstance(answer, Tool):
            raise InputError(answer or f"mesh.file '{request.file}' did not load")
        return answer

    def cancel(self) -> None:
        """Abandon the tool that is being loaded, if any."""
        if self.loading is not None:
            self._replace()

    def poll(self) -> Tool | str | None:
        """The loaded tool, or a sentence on why loading failed; None while loading or idle."""
        if self.loading is None:
            return None
        answer: Tool | str
        try:
            if self._connection.poll():
                answer = receive_tool(self._connection)
            elif time.monotonic() < self._expires:
                return None
            else:
                answer = (
                    f"mesh.file '{self.loading.file}' took over {self._deadline:g} s to load; "
                    f"give it fewer facets with '{program('rft')} reduce'"
                )
                self._replace()
        except Exception as error:  # any: the worker ended, no descriptor is left here, or the pickle is damaged
            try:
                why = f"ended with status {self._process.wait(_EXIT)}"
            except subprocess.TimeoutExpired:
                why = f"gave an answer that cannot be read ({type(error).__name__}: {error})"
            answer = f"the process that loads meshes {why}; set mesh.file again"
            self._replace()
        self.loading = None
        return answer

    def _replace(self) -> None:
        self._process.kill()
        self._leave()
        self._killed = [process for process in self._killed if process.poll() is None]
        self._killed.append(self._process)  # its end takes up to 30 ms, which a tick must not wait for
        with suppress(OSError):  # no descriptor or process to be had: `poll` reports it, the next `load` tries again
            self._start(0)

    def _leave(self) -> None:
        if self._process.stdin:
            self._process.stdin.close()
        self._connection.close()
        self.loading = None

    def close(self) -> None:
        """End the process."""
        self._leave()
        for process in (self._process, *self._killed):
            process.kill()
            process.wait()


class ToolSwap:
    """One tool in force and a stack of requested ones; the newest is being loaded.

    Once it is loaded, it comes into force and the stack is cleared. If it fails, the request before it is next.
    """

    def __init__(self, in_force: ToolRequest, worker: ToolWorker) -> None:
        self._worker = worker
        self._in_force = in_force
        self._stack: list[ToolRequest] = []
        self.last_failure = ""
        """Why the last swap failed; empty once one has succeeded."""

    @property
    def wanted(self) -> ToolRequest:
        """The newest request, else the tool in force: the values that the parameters should have."""
        return self._stack[-1] if self._stack else self._in_force

    @property
    def preparing(self) -> str:
        """`mesh.file` of the tool that is being loaded; empty if none is."""
        return self._worker.loading.file if self._worker.loading else ""

    def knows(self, request: ToolRequest) -> bool:
        """Whether this tool is in force or requested."""
        return request == self._in_force or request in self._stack

    def want(self, request: ToolRequest) -> None:
        """Request a tool: load it, unless it is in force or being loaded already."""
        if request == self._in_force:
            self._stack.clear()
            self._worker.cancel()
        elif request != self._worker.loading:
            self._stack = [r for r in self._stack if r != request] + [request]
            self._worker.load(request)

    def poll(self) -> Tool | ToolRequest | None:
        """The tool that came into force or the request that failed since the last call, else None."""
        answer = self._worker.poll()
        if answer is None:
            return None
        if isinstance(answer, Tool):
            self._in_force = self._stack[-1]
            self._stack.clear()
            self.last_failure = ""
            return answer
        self.last_failure = answer
        return self._stack.pop()


def send_tool(connection: Connection, answer: Tool | str) -> None:
    """Send a tool or a sentence. A tool's arrays go into anonymous memory, which the receiver maps.

    Reading 9 MB from the pipe would delay a tick by 5 ms.
    """
    spans: list[tuple[int, int]] = []
    with os.fdopen(os.memfd_create("rft_tool"), "wb") as memory:

        def keep(buffer: pickle.PickleBuffer) -> None:
            memory.write(b"\0" * (-memory.tell() % _ALIGNMENT))
            start = memory.tell()
            memory.write(buffer.raw())
            spans.append((start, memory.tell()))

        head = pickle.dumps(answer, protocol=5, buffer_callback=keep)
        memory.flush()
        connection.send((head, spans))
        if spans:
            send_handle(connection, memory.fileno(), None)


def receive_tool(connection: Connection) -> Tool | str:
    """What `send_tool` sent; a tool's arrays are read-only views of the mapped memory."""
    head, spans = connection.recv()
    buffers: list[memoryview] = []
    if spans:
        with os.fdopen(recv_handle(connection), "rb") as memory:
            view = memoryview(mmap.mmap(memory.fileno(), 0, access=mmap.ACCESS_READ))
        buffers = [view[start:end] for start, end in spans]
    answer: Tool | str = pickle.loads(head, buffers=buffers)
    return answer


def serve(descriptor: int, urgent: int) -> None:
    """In the worker: answer requests on a connection until the node closes it; the first `urgent` at full priority."""
    connection = Connection(descriptor)
    if not urgent:
        _lower_priority()
    import scipy.spatial  # noqa: F401
    import trimesh  # noqa: F401

    with suppress(EOFError, OSError):
        while True:
            request: ToolRequest = connection.recv()
            send_tool(connection, _load(request))
            urgent -= 1
            if urgent == 0:
                _lower_priority()


def _lower_priority() -> None:
    os.nice(_NICENESS)
    with suppress(OSError):  # a kernel that groups sessions applies niceness within a session only
        Path("/proc/self/autogroup").write_text(str(_NICENESS))


def _load(request: ToolRequest) -> Tool | str:
    try:
        return request.load()
    except InputError as error:
        return str(error)
    except Exception as error:  # whatever a mesh library raises at a damaged file
        return f"mesh.file '{request.file}' cannot be loaded: {type(error).__name__}: {error}"

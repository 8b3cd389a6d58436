"""Swaps of what a model takes from files, and the process beside the node that loads it.

A thread in the node would delay one tick in six.
"""

import mmap
import os
import pickle
import subprocess
import time
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from multiprocessing.reduction import recv_handle, send_handle

from rft_ros.child_process import lower_priority, start_child
from rft_ros.errors import InputError
from rft_ros.installation import program
from rft_ros.parameters import ModelFiles, ModelParts

_DEADLINE = 600.0  # s; its low priority makes it slow beside other work
_EXIT = 0.5  # s, for a worker that closed its connection to end
_ALIGNMENT = 64


class ToolWorker:
    """Loads one model's files at a time in a process beside the node, started early so that none wait for its imports.

    The process has a low priority after the first ones, which the node waits for. It is replaced if it dies, exceeds
    the deadline [s], or gets a new request while it loads.
    """

    def __init__(self, *, deadline: float = _DEADLINE) -> None:
        self._deadline = deadline
        self.loading: ModelFiles | None = None
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

    def load(self, request: ModelFiles) -> None:
        """Begin to load files; `poll` answers."""
        self.cancel()
        if self._process.poll() is not None:
            self._replace()
        with suppress(OSError):  # `poll` reports it
            self._connection.send(request)
        self.loading = request
        self._expires = time.monotonic() + self._deadline

    def load_now(self, request: ModelFiles) -> ModelParts:
        """Load files and wait for them. Raises InputError if they cannot be used."""
        self.load(request)
        self._connection.poll(self._deadline)
        answer = self.poll()
        if not isinstance(answer, ModelParts):
            raise InputError(answer or f"{request} did not load")
        return answer

    def cancel(self) -> None:
        """Abandon what is being loaded, if anything."""
        if self.loading is not None:
            self._replace()

    def poll(self) -> ModelParts | str | None:
        """What was loaded, or a sentence on why loading failed; None while loading or idle."""
        if self.loading is None:
            return None
        answer: ModelParts | str
        try:
            if self._connection.poll():
                answer = receive(self._connection)
            elif time.monotonic() < self._expires:
                return None
            else:
                answer = (
                    f"{self.loading} took over {self._deadline:g} s to load; "
                    f"give the mesh fewer facets with '{program('rft')} reduce'"
                )
                self._replace()
        except Exception as error:  # any: the worker ended, no descriptor is left here, or the pickle is damaged
            try:
                why = f"ended with status {self._process.wait(_EXIT)}"
            except subprocess.TimeoutExpired:
                why = f"gave an answer that cannot be read ({type(error).__name__}: {error})"
            answer = f"the process that loads {self.loading} {why}; set it again"
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
    """The files in force, `parts` which they became, and a stack of requested ones; the newest is being loaded.

    Once it is loaded, it comes into force and the stack is cleared. If it fails, the request before it is next.
    """

    def __init__(self, in_force: ModelFiles, parts: ModelParts, worker: ToolWorker) -> None:
        self._worker = worker
        self.in_force = in_force
        self.parts = parts
        self._stack: list[ModelFiles] = []
        self.code = ""
        """The machine code that is being loaded beside files; empty if none is."""
        self.last_failure = ""
        """Why the last swap failed; empty once one has succeeded."""

    @property
    def wanted(self) -> ModelFiles:
        """The newest request, else the files in force: the values that the parameters should have."""
        return self._stack[-1] if self._stack else self.in_force

    @property
    def preparing(self) -> str:
        """What is being loaded; empty if nothing is."""
        return str(self._worker.loading or self.code)

    def missing(self, request: ModelFiles) -> ModelFiles:
        """Those of a request's files that are not in force."""
        return ModelFiles._make(None if new == old else new for new, old in zip(request, self.in_force, strict=True))

    def knows(self, request: ModelFiles) -> bool:
        """Whether these files are in force or requested."""
        return not any(self.missing(request)) or request in self._stack

    def want(self, request: ModelFiles) -> None:
        """Request files: load those that are not in force, unless they are being loaded already."""
        missing = self.missing(request)
        if not any(missing):
            self.in_force = request
            self._stack.clear()
            self._worker.cancel()
        elif missing != self._worker.loading:
            self._stack = [r for r in self._stack if r != request] + [request]
            self._worker.load(missing)

    def poll(self) -> ModelParts | ModelFiles | None:
        """What came into force or the request that failed since the last call, else None."""
        answer = self._worker.poll()
        if answer is None:
            return None
        if isinstance(answer, ModelParts):
            loaded, self.in_force = self.missing(self._stack[-1]), self._stack[-1]
            self._stack.clear()
            self.last_failure = ""
            parts = zip(loaded, answer, self.parts, strict=True)
            self.parts = ModelParts._make(old if file is None else new for file, new, old in parts)
            return self.parts
        self.last_failure = answer
        return self._stack.pop()


def send(connection: Connection, answer: ModelParts | str) -> None:
    """Send what was loaded or a sentence. Arrays go into anonymous memory, which the receiver maps.

    Reading 9 MB from the pipe would delay a tick by 5 ms.
    """
    spans: list[tuple[int, int]] = []
    with os.fdopen(os.memfd_create("rft_parts"), "wb") as memory:

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


def receive(connection: Connection) -> ModelParts | str:
    """What `send` sent; arrays are read-only views of the mapped memory."""
    head, spans = connection.recv()
    buffers: list[memoryview] = []
    if spans:
        with os.fdopen(recv_handle(connection), "rb") as memory:
            view = memoryview(mmap.mmap(memory.fileno(), 0, access=mmap.ACCESS_READ))
        buffers = [view[start:end] for start, end in spans]
    answer: ModelParts | str = pickle.loads(head, buffers=buffers)
    return answer


def serve(descriptor: int, urgent: int) -> None:
    """In the worker: answer requests on a connection until the node closes it; the first `urgent` at full priority."""
    connection = Connection(descriptor)
    if not urgent:
        lower_priority()
    import scipy.spatial  # noqa: F401
    import trimesh  # noqa: F401

    with suppress(EOFError, OSError):
        while True:
            request: ModelFiles = connection.recv()
            send(connection, _load(request))
            urgent -= 1
            if urgent == 0:
                lower_priority()


def _load(request: ModelFiles) -> ModelParts | str:
    try:
        return request.load()
    except InputError as error:
        return str(error)
    except Exception as error:  # whatever a mesh library raises at a damaged file; its words may quote the file
        return f"{request} cannot be loaded: {type(error).__name__}"

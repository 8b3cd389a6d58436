"""Swaps of what a model takes from files, and the process beside the node that loads it.

Loading in a thread of the node would delay one tick in six.
"""

import signal
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe

from rft_ros.child_process import lower_priority, start_child
from rft_ros.errors import InputError
from rft_ros.installation import program
from rft_ros.parameters import ModelFiles, ModelParts

_LONGEST = 600  # s; its low priority makes it slow beside other work


class ToolWorker:
    """Loads one model's files at a time in a process beside the node, started early so that none wait for its imports.

    A thread waits for its answer: 100,000 plates that came through the pipe in the node's own thread would delay a tick
    by 30 ms; in this one 50,000 delay it by 3 to 15 ms. The process has a low priority after the first files, which the
    node waits for. It is replaced if it dies or gets a new request while it loads.
    """

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1)
        self._start(0)

    def _start(self, low_priority: int) -> None:
        self._connection, theirs = Pipe()
        with theirs:
            self.process = start_child(serve, theirs.fileno(), low_priority, pass_fds=[theirs.fileno()])

    def load(self, request: ModelFiles) -> "Future[ModelParts]":
        """Load files in place of those that are being loaded; InputError if they cannot be used."""
        return self._thread.submit(self._answer, request)

    def cancel(self, loading: "Future[ModelParts]") -> None:
        """Give up what is being loaded."""
        if not loading.cancel() and not loading.done():
            self.process.kill()
            self._thread.submit(self._replace)  # before the next request, which may otherwise reach the dying process

    def _answer(self, request: ModelFiles) -> ModelParts:
        try:
            if self.process.poll() is not None:
                self._replace()
            self._connection.send(request)
            answer: ModelParts | str = self._connection.recv()
        except Exception as error:  # the worker ended, no descriptor or process is to be had, a damaged pickle
            self.process.kill()
            status = self.process.wait()
            if status == -signal.SIGALRM:
                small = f"give the mesh fewer facets with '{program('rft')} reduce'"
                raise InputError(f"{request} took over {_LONGEST} s to load; {small}") from None
            ended = isinstance(error, EOFError | ConnectionError)
            why = f"ended with status {status}" if ended else f"failed ({error})"
            raise InputError(f"the process that loads {request} {why}; set it again") from None
        if isinstance(answer, str):
            raise InputError(answer)
        return answer

    def _replace(self) -> None:
        self._end()
        self._start(1)

    def _end(self) -> None:
        self.process.kill()
        self.process.communicate()
        self._connection.close()

    def close(self) -> None:
        """End the process."""
        self._thread.shutdown(wait=False, cancel_futures=True)
        self._end()


class ToolSwap:
    """The files in force, `parts` which they became, and a stack of requested ones; the newest is being loaded.

    Once it is loaded, it comes into force and the stack is cleared. If it fails, the request before it is next.
    """

    def __init__(self, in_force: ModelFiles, parts: ModelParts, worker: ToolWorker) -> None:
        self.in_force, self.parts = in_force, parts
        self._worker = worker
        self._stack: list[ModelFiles] = []
        self._loading: tuple[ModelFiles, Future[ModelParts]] | None = None
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
        return str(self._loading[0]) if self._loading else self.code

    def missing(self, request: ModelFiles) -> ModelFiles:
        """Those of a request's files that are not in force."""
        return ModelFiles._make(None if new == old else new for new, old in zip(request, self.in_force, strict=True))

    def knows(self, request: ModelFiles) -> bool:
        """Whether these files are in force or requested."""
        return not any(self.missing(request)) or request in self._stack

    def want(self, request: ModelFiles) -> None:
        """Request files: load those that are not in force, unless they are being loaded already."""
        missing = self.missing(request)
        self._stack = [r for r in self._stack if r != request] + [request] if any(missing) else []
        if self._loading and self._loading[0] != missing:
            self._worker.cancel(self._loading[1])
            self._loading = None
        if not any(missing):
            self.in_force = request
        elif self._loading is None:
            self._loading = missing, self._worker.load(missing)

    def poll(self) -> ModelParts | ModelFiles | None:
        """What came into force or the request that failed since the last call, else None."""
        if self._loading is None or not self._loading[1].done():
            return None
        (loaded, future), self._loading = self._loading, None
        try:
            answer = future.result()
        except InputError as error:
            self.last_failure = str(error)
            return self._stack.pop()
        self.in_force, self.last_failure = self._stack[-1], ""
        self._stack.clear()
        parts = zip(loaded, answer, self.parts, strict=True)
        self.parts = ModelParts._make(old if file is None else new for file, new, old in parts)
        return self.parts


def serve(descriptor: int, low_priority: int) -> None:
    """In the worker: answer requests on a connection until the node closes it; after the first one at low priority."""
    connection = Connection(descriptor)
    if low_priority:
        lower_priority()
    import scipy.spatial  # noqa: F401
    import trimesh  # noqa: F401

    with suppress(EOFError, OSError):
        while True:
            request: ModelFiles = connection.recv()
            signal.alarm(_LONGEST)
            answer = loaded(request)
            signal.alarm(0)
            connection.send(answer)
            lower_priority()


def loaded(request: ModelFiles) -> ModelParts | str:
    """What was loaded, or a sentence on why it cannot be used."""
    try:
        return request.load()
    except InputError as error:
        return str(error)
    except Exception as error:  # whatever a mesh library raises at a damaged file; its words may quote the file
        return f"{request} cannot be loaded: {type(error).__name__}"

"""What a change of parameters needs and the node does not have: loaded beside the node, which answers meanwhile."""

from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe

from rft_ros.child_process import lower_priority, start_child
from rft_ros.errors import InputError
from rft_ros.estimator.warm_up import prepare
from rft_ros.installation import program
from rft_ros.parameters import ModelFiles, ModelParts

_LONGEST = 600.0  # s; its low priority makes the worker slow beside other work


class ToolWorker:
    """A process that loads one model's files at a time, started early so that none wait for its imports.

    The process has a low priority after the first files, which the node waits for. It is replaced if it ends.
    """

    def __init__(self) -> None:
        self._start(low_priority=False)

    def _start(self, *, low_priority: bool) -> None:
        self._connection, theirs = Pipe()
        with theirs:
            self.process = start_child(_serve, theirs.fileno(), low_priority, pass_fds=[theirs.fileno()])

    def load(self, request: ModelFiles) -> ModelParts:
        """Load files; InputError if they cannot be used, take too long, or are given up."""
        try:
            if self.process.poll() is not None:
                self._connection.close()
                self._start(low_priority=True)
            self._connection.send(request)
            if not self._connection.poll(_LONGEST):
                small = f"give the mesh fewer facets with '{program('rft')} reduce'"
                raise InputError(f"{request} took over {_LONGEST:g} s to load; {small}")
            answer: ModelParts | str = self._connection.recv()
        except (OSError, EOFError, InputError) as error:  # no descriptor or process is to be had, or one of above
            self.end()
            ended = isinstance(error, EOFError | ConnectionError)
            why = f"the process that loads {request} ended" if ended else str(error)
            raise InputError(f"{why}; set it again") from None
        if isinstance(answer, str):
            raise InputError(answer)
        return answer

    def end(self) -> None:
        """End the process; what it loads is given up."""
        self.process.kill()
        self.process.wait()


def _serve(descriptor: int, low_priority: int) -> None:
    """In the process: answer requests until the node closes the connection; after the first one at low priority."""
    connection = Connection(descriptor)
    if low_priority:
        lower_priority()
    import scipy.spatial  # noqa: F401
    import trimesh  # noqa: F401

    with suppress(EOFError, OSError):
        while True:
            connection.send(_loaded(connection.recv()))
            lower_priority()


def _loaded(request: ModelFiles) -> ModelParts | str:
    try:
        return request.load()
    except InputError as error:
        return str(error)
    except Exception as error:  # whatever a mesh library raises at a damaged file; its words may quote the file
        return f"{request} cannot be loaded: {type(error).__name__}"


class Swap:
    """The files in force with the `parts` that they became, the `code` that is loaded, and what is wanted next.

    A thread waits for the worker: 100,000 plates that came through the pipe in the node's own would delay a tick by
    30 ms; in this one 50,000 delay it by 3 to 15 ms.
    """

    def __init__(self, worker: ToolWorker, files: ModelFiles, parts: ModelParts, code: frozenset[str]) -> None:
        self.files, self.parts, self.code = files, parts, code
        self.last_failure = ""
        """Why the last swap failed; empty once one has succeeded."""
        self._worker, self._thread = worker, ThreadPoolExecutor(1)
        self._wanted = files, code
        self._loading: Future[ModelParts] | None = None

    def _missing(self) -> tuple[ModelFiles, frozenset[str]]:
        files, code = self._wanted
        new = (None if file == old else file for file, old in zip(files, self.files, strict=True))
        return ModelFiles._make(new), code - self.code

    @property
    def preparing(self) -> str:
        """What is being loaded; empty if nothing is."""
        files, code = self._missing()
        named = [str(files)] * any(files) + [f"machine code of {part}" for part in sorted(code)]
        return " and ".join(named) if self._loading else ""

    def want(self, files: ModelFiles, code: frozenset[str]) -> None:
        """Load what is not in force of these files and this code, in place of what is being loaded."""
        if (files, code) == self._wanted and self._loading:
            return
        if self._loading and not self._loading.cancel():
            self._worker.end()
        self._wanted = files, code
        new_files, new_code = self._missing()
        needed = any(new_files) or new_code
        self._loading = self._thread.submit(self._load, new_files, new_code) if needed else None

    def _load(self, files: ModelFiles, code: frozenset[str]) -> ModelParts:
        with suppress(Exception):  # code that is missing compiles at its first use
            prepare(code, at_low_priority=True)
        return self._worker.load(files) if any(files) else ModelParts()

    def poll(self) -> bool | None:
        """Once it is loaded, whether it came into force; if not, the files that were in force stay. Else None."""
        if self._loading is None or not self._loading.done():
            return None
        new, code = self._missing()
        future, self._loading = self._loading, None
        self.code |= code
        try:
            loaded = future.result()
        except InputError as error:
            self.last_failure, self._wanted = str(error), (self.files, self.code)
            return False
        chosen = (part if file else old for file, part, old in zip(new, loaded, self.parts, strict=True))
        self.files, self.parts, self.last_failure = self._wanted[0], ModelParts._make(chosen), ""
        return True

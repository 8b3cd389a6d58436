"""What parameters need that takes time to load: it comes from beside the node, which answers meanwhile."""

from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection, Pipe
from typing import Any

from rft_ros.child_process import lower_priority, start_child
from rft_ros.errors import InputError
from rft_ros.estimator import Model, Settings
from rft_ros.estimator.warm_up import needed, prepare
from rft_ros.files import checked_file
from rft_ros.parameters import (
    FILES,
    Values,
    files_of,
    load_files,
    model_of,
    read_small_file,
    settings_of,
    small_files_of,
)
from rft_ros.rft import Medium, Table
from rft_ros.tool import locate_mesh


class ToolWorker:
    """A process that loads one model's files at a time, started early for its imports and replaced if it ends."""

    def __init__(self) -> None:
        self._start(low_priority=False)

    def _start(self, *, low_priority: bool) -> None:
        self._connection, theirs = Pipe()
        with theirs:
            self.process = start_child(_serve, theirs.fileno(), low_priority, pass_fds=[theirs.fileno()])

    def load(self, files: Mapping[str, Values]) -> dict[str, Any]:
        """Load parts of `files_of`; InputError if they cannot be used, or are given up."""
        try:
            if self.process.poll() is not None:
                self._connection.close()
                self._start(low_priority=True)
            self._connection.send(files)
            answer: dict[str, Any] | str = self._connection.recv()
        except Exception as error:  # the process ended, or none is to be had, or no descriptor, or a damaged answer
            self.end()
            ended = isinstance(error, EOFError | ConnectionError)
            why = f"the process that loads {_named(files)} ended" if ended else str(error)
            raise InputError(f"{why}; set it again") from None
        if isinstance(answer, str):
            raise InputError(answer)
        return answer

    def end(self) -> None:
        """End the process; what it loads is given up."""
        self.process.kill()
        self.process.wait()


def _serve(descriptor: int, low_priority: int) -> None:
    """In the process: answer requests until the node closes the connection; the node waits for the first one only."""
    connection = Connection(descriptor)
    if low_priority:
        lower_priority()
    import scipy.spatial  # noqa: F401
    import trimesh  # noqa: F401

    with suppress(EOFError, OSError):
        while True:
            connection.send(_loaded(connection.recv()))
            lower_priority()


def _loaded(files: Mapping[str, Values]) -> dict[str, Any] | str:
    try:
        return load_files(files)
    except InputError as error:
        return str(error)
    except Exception as error:  # whatever a mesh library raises at a damaged file; its words may quote the file
        return f"{_named(files)} cannot be loaded: {type(error).__name__}"


def _named(files: Mapping[str, Values]) -> str:
    given = {name: value for part in files.values() for name, value in part.items() if name in FILES and value}
    return " and ".join(f"{name} '{file}'" for name, file in given.items()) or "ground.cell"


class Swap:
    """The files in force, the `parts` that they became, the machine code that is loaded, and what is wanted next.

    The constructor loads what `values` need, or raises InputError. A thread waits for the worker: 100,000 plates that
    came through the pipe in the node's own would delay a tick by 30 ms; in this one 50,000 delay it by 3 to 15 ms.
    """

    def __init__(self, worker: ToolWorker, values: Values, *, on_cold_cache: Callable[[], None]) -> None:
        self._worker, self._thread = worker, ThreadPoolExecutor(1)
        self._files, self._code = self._wanted = files_of(values), needed(values)
        prepare(self._code, on_cold_cache=on_cold_cache)
        self.parts = worker.load(self._files)  # after the code, which the worker would compile too
        self.last_failure = ""
        """Why the last swap failed; empty once one has succeeded."""
        self._loading: Future[dict[str, Any]] | None = None
        self._read: dict[tuple[str, str], Medium | Table] = {}  # by parameter and file: those in force
        self._read = self._checked_read = self._read_for(values)

    @property
    def files(self) -> Values:
        """The parameters that give the files in force."""
        return {name: value for part in self._files.values() for name, value in part.items()}

    def settings(self, values: Values) -> Settings:
        """The settings of these parameters; without learning, and velocities from poses, until their code is loaded."""
        settings = settings_of(values)
        settings = settings if "learning" in self._code else replace(settings, learning_mode="off")
        return settings if "velocity" in self._code else replace(settings, twist_source="topic")

    def model(self, values: Values, *, generation: int = 0) -> Model:
        """The model of these parameters with the tool and the ground in force; `check` them first."""
        read: dict[tuple[str, str], Any] = {**self._read, **self._checked_read}
        medium = read.get(("medium.file", values["medium.file"]))
        table = read.get(("alpha_y.table", values["alpha_y.table"]))
        return model_of({**values, **self.files}, **self.parts, medium=medium, table=table, generation=generation)

    def _read_for(self, values: Values) -> dict[tuple[str, str], Medium | Table]:
        """The small files of these parameters, read again unless they are in force: a file may be gone since."""
        wanted = small_files_of(values).items()
        return {named: self._read.get(named) or read_small_file(*named) for named in wanted}

    def check(self, values: Values) -> None:
        """Raise InputError for parameters that cannot come into force; a mesh is not read yet."""
        self.settings(values)
        self._checked_read = self._read_for(values)
        self.model(values)
        if files_of(values)["tool"] != self._files["tool"]:
            checked_file(locate_mesh(values["mesh.file"]), "mesh.file")

    def _missing(self) -> tuple[dict[str, Values], frozenset[str]]:
        files, code = self._wanted
        return {part: new for part, new in files.items() if new != self._files[part]}, code - self._code

    @property
    def preparing(self) -> str:
        """What is being loaded; empty if nothing is."""
        files, code = self._missing()
        named = [_named(files)] * bool(files) + [f"machine code of {part}" for part in sorted(code)]
        return " and ".join(named) if self._loading else ""

    def want(self, values: Values) -> None:
        """Load what these parameters, checked last, need and is not in force, in place of what is being loaded."""
        self._read = self._checked_read
        wanted = files_of(values), needed(values)
        if self._loading and wanted == self._wanted:
            return
        if self._loading and not self._loading.cancel():
            self._worker.end()
        self._wanted = wanted
        files, code = self._missing()
        self._loading = self._thread.submit(self._load, files, code) if files or code else None

    def _load(self, files: dict[str, Values], code: frozenset[str]) -> dict[str, Any]:
        with suppress(Exception):  # code that is missing compiles at its first use
            prepare(code, at_low_priority=True)
        return self._worker.load(files) if files else {}

    def poll(self) -> bool | None:
        """Once it is loaded, whether it came into force; if not, the files that were in force stay. Else None."""
        if self._loading is None or not self._loading.done():
            return None
        future, self._loading = self._loading, None
        files, code = self._wanted
        self._code |= code
        try:
            self.parts |= future.result()
        except InputError as error:
            self.last_failure, self._wanted = str(error), (self._files, self._code)
            return False
        self._files, self.last_failure = files, ""
        return True

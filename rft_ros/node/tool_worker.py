"""A worker process that reads the files that parameters name, while the node keeps answering poses."""

import os
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from typing import Any, NamedTuple

from rft_ros.child_process import start_child
from rft_ros.errors import InputError
from rft_ros.parameters import FILES, Values, load_parts

__all__ = ["ToolWorker", "named"]

_NICENESS = 10  # such a process gets a tenth of a busy core, and all of an idle one
_SIGN_PERIOD = 1.0  # s between two signs of life from a process that loads
_SILENT = 300.0  # s without a sign of life after which the process is given up
_BLOCKED_AFTER, _BLOCKED_CPU = 60.0, 0.01
"""A process that uses less than `_BLOCKED_CPU` [s] of CPU time in `_BLOCKED_AFTER` [s] waits for a file, as for a pipe.
"""

_STARVED_AFTER, _STARVED_SHARE = 5.0, 0.5
"""A process of low priority that gets less than this share of a core is replaced after this time [s]."""


class _Alive(NamedTuple):
    """A sign of life: CPU time that the process has used for this request [s]."""

    used: float


class ToolWorker:
    """A process that loads one model's files at a time. It is started early for its imports, and replaced if it ends.

    It runs at a low priority, so that it does not delay ticks. On a busy machine it then gets a tenth of a core only,
    and another process loads the same files at the node's priority. A process without privileges cannot raise its own
    priority again.
    """

    def __init__(self) -> None:
        self._start(low_priority=False)
        self.used: float | None = None
        """CPU time that the load in progress has used [s]; None until the process has begun it, and after its end."""

    def _start(self, *, low_priority: bool) -> None:
        self._low_priority = low_priority
        self._connection, theirs = Pipe()
        with theirs:
            self.process = start_child(_serve, theirs.fileno(), low_priority, pass_fds=[theirs.fileno()])

    def _replace(self, *, low_priority: bool) -> None:
        self.end()
        self._connection.close()
        self._start(low_priority=low_priority)

    def load(self, files: Mapping[str, Values], given_up: threading.Event | None = None) -> dict[str, Any]:
        """Load parts of `parts_of`. Raises InputError if they cannot be used, do not end, or if `given_up` is set."""
        given_up = given_up or threading.Event()
        try:
            answer = self._answer(files, given_up)
        except Exception as error:  # of any kind: no process or descriptor is left, or the answer is damaged
            self.end()
            if isinstance(error, InputError):
                raise
            ended = isinstance(error, EOFError | ConnectionError)
            why = f"the process that loads {named(files)} ended" if ended else str(error)
            raise InputError(f"{why}; set it again") from None
        finally:
            self.used = None
        if isinstance(answer, str):
            raise InputError(answer)
        return answer

    def _answer(self, files: Mapping[str, Values], given_up: threading.Event) -> dict[str, Any] | str:
        """The answer of the process. A process that ended before it began this request is replaced."""
        if self.process.poll() is not None:
            self._replace(low_priority=True)
        try:
            self._connection.send(files)
            return self._wait(files, given_up)
        except (EOFError, ConnectionError):
            if self.used is not None or given_up.is_set():
                raise
        self._replace(low_priority=True)
        self._connection.send(files)
        return self._wait(files, given_up)

    def _wait(self, files: Mapping[str, Values], given_up: threading.Event) -> dict[str, Any] | str:
        """Wait for the answer to a request that was sent. A process that gets no CPU time is replaced."""
        begin = moved = heard = time.monotonic()
        used_then = 0.0
        while True:
            if given_up.is_set():
                raise InputError(f"{named(files)} is no longer wanted")
            now = time.monotonic()
            used = self.used or 0.0
            if self._low_priority and now - begin > _STARVED_AFTER and used < _STARVED_SHARE * (now - begin):
                self._replace(low_priority=False)
                self.used = None
                self._connection.send(files)
                moved = heard = now
                used_then = 0.0
            if used - used_then > _BLOCKED_CPU:
                moved, used_then = now, used
            if self.used is not None and now - moved > _BLOCKED_AFTER:
                raise InputError(f"{named(files)} could not be read for {_BLOCKED_AFTER:g} s; give a regular file")
            if now - heard > _SILENT:
                raise InputError(f"the process that loads {named(files)} was silent for {_SILENT:g} s; set it again")
            if not self._connection.poll(_SIGN_PERIOD):
                continue
            message = self._connection.recv()
            if not isinstance(message, _Alive):
                self._low_priority = True  # it lowers its priority once it has answered
                answer: dict[str, Any] | str = message
                return answer
            self.used, heard = message.used, time.monotonic()

    def end(self) -> None:
        """End the process, and with it the load in progress."""
        self.process.kill()
        self.process.wait()


def _serve(descriptor: int, low_priority: int) -> None:
    """In the process: answer requests until the node closes the connection.

    The node waits for the first answer, so the first process keeps its priority until then.
    """
    connection = Connection(descriptor)
    if low_priority:
        _lower_priority()
    import scipy.spatial  # noqa: F401
    import trimesh  # noqa: F401

    with suppress(EOFError, OSError):
        used_before = 0.0
        while True:
            files = connection.recv()
            done = threading.Event()
            signs = threading.Thread(target=_give_signs, args=(connection, done, used_before), daemon=True)
            signs.start()
            answer = _loaded(files)
            done.set()
            signs.join()
            connection.send(answer)
            _lower_priority()
            used_before = time.process_time()


def _lower_priority() -> None:
    """In the process: leave busy cores to the node."""
    os.setpriority(os.PRIO_PROCESS, 0, max(os.getpriority(os.PRIO_PROCESS, 0), _NICENESS))
    # A kernel that schedules by session (autogroup) applies niceness within one session only, so the session gets it
    # too. During 20 changes of the mesh 474 of 15,000 poses were answered late, and 1,824 without this.
    with suppress(OSError):
        Path("/proc/self/autogroup").write_text(str(_NICENESS))


def _give_signs(connection: Connection, done: threading.Event, used_before: float) -> None:
    """Send signs of life until the request is done. The CPU time of this thread is left out."""
    with suppress(OSError):
        while True:
            connection.send(_Alive(time.process_time() - time.thread_time() - used_before))
            if done.wait(_SIGN_PERIOD):
                return


def _loaded(files: Mapping[str, Values]) -> dict[str, Any] | str:
    try:
        return load_parts(files)
    except InputError as error:
        return str(error)
    except Exception as error:  # whatever a mesh library raises at a damaged file; its words may quote the file
        return f"{named(files)} cannot be loaded: {type(error).__name__}"


def named(files: Mapping[str, Values]) -> str:
    """The files that parts of `parts_of` name, with their parameters."""
    given = {name: value for part in files.values() for name, value in part.items() if name in FILES and value}
    return " and ".join(f"{name} '{file}'" for name, file in given.items()) or "ground.cell"

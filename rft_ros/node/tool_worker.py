"""A worker process that reads the files that parameters name, while the node keeps answering poses.

The worker imports what loading needs once, and forks a process for each load. To end a load costs the node nothing:
starting a Python process from the node would hold its GIL until the system runs the new process, 0.4 s on a busy
machine, and its imports take seconds of a core.
"""

import os
import signal
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe, wait
from typing import Any

from rft_ros.child_process import lower_priority, start_child, watch_parent
from rft_ros.errors import InputError
from rft_ros.parameters import FILES, Part, load_parts, parameter_values

_LOOK = 0.2  # s between two looks whether a load is still wanted, and whether it has stalled
_LONGEST_STALL = 60.0  # s
_STALLED_CPU = 0.01
"""A load that uses less CPU time than this [s] in the longest stall waits for a drive that does not answer."""


class ToolWorker:
    """A process that loads one model's files at a time. It is started early for its imports, and replaced if it ends.

    It runs at a low priority, so that it does not delay ticks. On a busy machine a load then takes ten times as long.
    A new request ends the load of the one before. `longest_stall`: a load that waits so long for a drive [s] is ended.
    """

    def __init__(self, *, longest_stall: float = _LONGEST_STALL) -> None:
        self._longest_stall = longest_stall
        self._requests = 0
        self._ended = False
        self._start(low_priority=False)

    def _start(self, *, low_priority: bool) -> None:
        ours, theirs = Pipe()
        self._connection = ours
        with theirs:
            self.process = start_child(
                _serve,
                theirs.fileno(),
                self._longest_stall,
                pass_fds=[theirs.fileno()],
                low_priority=low_priority,
            )

    def load(
        self, files: Mapping[str, Part], is_wanted: Callable[[], bool] = lambda: True
    ) -> dict[str, Any]:
        """Load parts of a `Config`. Raises InputError if they cannot be used, do not end, or are no longer wanted."""
        try:
            answer = self._answer(files, is_wanted)
        except InputError:  # the load is no longer wanted: the next request ends it
            raise
        except Exception as error:
            # of any kind: no process or descriptor is left, or the answer is damaged
            self._kill()
            raise InputError(f"{error}; set it again") from None
        if isinstance(answer, str):
            raise InputError(answer)
        return answer

    def _answer(
        self, files: Mapping[str, Part], is_wanted: Callable[[], bool]
    ) -> dict[str, Any] | str:
        """The answer of the process. One that has ended, perhaps long ago, is replaced once."""
        for _ in range(2):
            if self._ended:
                break
            if self.process.poll() is not None:
                self._start(low_priority=True)
            self._requests += 1
            with suppress(EOFError, ConnectionError):
                self._connection.send((self._requests, files))
                return self._wait(files, is_wanted)
            self._kill()
        raise RuntimeError(_has_ended(files))

    def _wait(
        self, files: Mapping[str, Part], is_wanted: Callable[[], bool]
    ) -> dict[str, Any] | str:
        """Wait for the answer to the last request."""
        while True:
            while not self._connection.poll(_LOOK):
                if not is_wanted():
                    raise InputError(f"{named(files)} is no longer wanted")
            answer: dict[str, Any] | str
            request, answer = self._connection.recv()
            if request == self._requests:  # another is the answer to a request that was given up
                return answer

    def end(self) -> None:
        """End the process, and with it the load in progress, for good."""
        self._ended = True
        self._kill()

    def _kill(self) -> None:
        self.process.kill()
        self.process.wait()


class _Load:
    """In the worker: a process that loads the files of one request, forked from the worker."""

    def __init__(self, node: Connection, request: int, files: Mapping[str, Part]) -> None:
        self.request = request
        self.files = files
        ours, theirs = Pipe(duplex=False)
        self.answer = ours
        """Has the answer, or ends without one."""
        with theirs:
            self._pid = os.fork()
            if self._pid == 0:
                try:
                    watch_parent()
                    # otherwise the node would not see that the worker has ended
                    node.close()
                    theirs.send((request, _loaded(files)))
                finally:
                    os._exit(0)
        self._worked_until = time.monotonic()
        self._used = self._cpu_time()

    def stalled_for(self) -> float:
        """How long it has waited without using the CPU [s]."""
        now = time.monotonic()
        used = self._cpu_time()
        if used - self._used > _STALLED_CPU:
            self._used = used
            self._worked_until = now
        return now - self._worked_until

    def _cpu_time(self) -> float:
        """CPU time that the process has used [s]; 0 where the system does not tell."""
        with suppress(OSError):
            return time.clock_gettime(~self._pid << 3 | 2)  # its clock of CPU time on Linux
        return 0.0

    def pass_answer(self, node: Connection) -> None:
        """Pass its answer to the node, or say that it ended without one."""
        try:
            answer = self.answer.recv_bytes()
        except (EOFError, OSError):
            self.give_up(node, f"{_has_ended(self.files)}; set it again")
        else:
            node.send_bytes(answer)
            self.end()

    def give_up(self, node: Connection, reason: str) -> None:
        """End the process, and answer with the reason."""
        node.send((self.request, reason))
        self.end()

    def end(self) -> None:
        """End the process, without waiting for one that a drive holds."""
        os.kill(self._pid, signal.SIGKILL)
        self.answer.close()
        _reap()


def _serve(descriptor: int, longest_stall: float) -> None:
    """In the worker: answer requests until the node closes the connection.

    The node waits for the first answer, so the first worker keeps its priority until then.
    """
    node = Connection(descriptor)
    import scipy.spatial  # noqa: F401
    import trimesh  # noqa: F401

    load: _Load | None = None
    with suppress(EOFError, OSError):
        while True:
            if load is None:
                wait([node])
            elif load.answer in wait([node, load.answer], _LOOK):
                load.pass_answer(node)
                load = None
                lower_priority()
            elif load.stalled_for() > longest_stall:
                load.give_up(node, _stalled(load.files, longest_stall))
                load = None
            if node.poll():
                if load is not None:
                    load.end()
                load = _Load(node, *node.recv())


def _reap() -> None:
    """Let the system forget the processes that have ended; one that a drive holds is forgotten later."""
    with suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG) != (0, 0):
            pass


def _loaded(files: Mapping[str, Part]) -> dict[str, Any] | str:
    try:
        return load_parts(files)
    except InputError as error:
        return str(error)
    except Exception as error:
        # whatever a mesh library raises at a damaged file; its words may quote the file
        return f"{named(files)} cannot be loaded: {type(error).__name__}"


def _has_ended(files: Mapping[str, Part]) -> str:
    return f"the process that loads {named(files)} ended"


def _stalled(files: Mapping[str, Part], seconds: float) -> str:
    return f"{named(files)} gave nothing to read for {seconds:g} s; look at its drive, and set it again"


def files_in(part: Part) -> dict[str, str]:
    """The files that a part names, by their parameters."""
    values = parameter_values(part)
    return {name: str(values[name]) for name in FILES if values.get(name)}


def named(parts: Mapping[str, Part]) -> str:
    """The files that parts of `Config.parts` name, with their parameters."""
    words = [
        f"{name} '{file}'" for part in parts.values() for name, file in files_in(part).items()
    ]
    return " and ".join(words) or "ground.cell"

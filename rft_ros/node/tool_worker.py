"""A worker process that reads the files that parameters name, while the node keeps answering poses."""

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from typing import Any

from rft_ros.child_process import lower_priority, start_child
from rft_ros.errors import InputError
from rft_ros.parameters import FILES, Part, load_parts, parameter_values

_LOOK = 1.0  # s between two looks at a process that loads
_BLOCKED_AFTER = 60.0
_BLOCKED_CPU = 0.01
"""A process that uses less than `_BLOCKED_CPU` [s] of CPU time in `_BLOCKED_AFTER` [s] waits for a stalled drive."""


class ToolWorker:
    """A process that loads one model's files at a time. It is started early for its imports, and replaced if it ends.

    It runs at a low priority, so that it does not delay ticks. On a busy machine a load then takes ten times as long.
    """

    def __init__(self) -> None:
        self._ended = False
        self._start(low_priority=False)

    def _start(self, *, low_priority: bool) -> None:
        ours, theirs = Pipe()
        self._connection = ours
        with theirs:
            self.process = start_child(
                _serve, theirs.fileno(), pass_fds=[theirs.fileno()], low_priority=low_priority
            )

    def load(
        self, files: Mapping[str, Part], is_wanted: Callable[[], bool] = lambda: True
    ) -> dict[str, Any]:
        """Load parts of a `Config`. Raises InputError if they cannot be used, do not end, or are no longer wanted."""
        try:
            answer = self._answer(files, is_wanted)
        except InputError:
            self._kill()
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
            with suppress(EOFError, ConnectionError):
                self._connection.send(files)
                return self._wait(files, is_wanted)
            self._kill()
        raise RuntimeError(f"the process that loads {named(files)} ended")

    def _wait(
        self, files: Mapping[str, Part], is_wanted: Callable[[], bool]
    ) -> dict[str, Any] | str:
        """Wait for the answer to a request that was sent."""
        moved = time.monotonic()
        used_then = self._cpu_time()
        while not self._connection.poll(_LOOK):
            if not is_wanted():
                raise InputError(f"{named(files)} is no longer wanted")
            now = time.monotonic()
            used = self._cpu_time()
            if used - used_then > _BLOCKED_CPU:
                moved = now
                used_then = used
            elif now - moved > _BLOCKED_AFTER:
                raise InputError(
                    f"{named(files)} gave nothing to read for {_BLOCKED_AFTER:g} s; look at its drive, and set it again"
                )
        answer: dict[str, Any] | str = self._connection.recv()
        return answer

    def _cpu_time(self) -> float:
        """CPU time that the process has used [s]; 0 where the system does not tell."""
        with suppress(OSError):
            return time.clock_gettime(~self.process.pid << 3 | 2)  # its clock of CPU time on Linux
        return 0.0

    def end(self) -> None:
        """End the process, and with it the load in progress, for good."""
        self._ended = True
        self._kill()

    def _kill(self) -> None:
        self.process.kill()
        self.process.wait()


def _serve(descriptor: int) -> None:
    """In the process: answer requests until the node closes the connection.

    The node waits for the first answer, so the first process keeps its priority until then.
    """
    connection = Connection(descriptor)
    import scipy.spatial  # noqa: F401
    import trimesh  # noqa: F401

    with suppress(EOFError, OSError):
        while True:
            connection.send(_loaded(connection.recv()))
            lower_priority()


def _loaded(files: Mapping[str, Part]) -> dict[str, Any] | str:
    try:
        return load_parts(files)
    except InputError as error:
        return str(error)
    except Exception as error:
        # whatever a mesh library raises at a damaged file; its words may quote the file
        return f"{named(files)} cannot be loaded: {type(error).__name__}"


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

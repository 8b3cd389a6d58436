"""Python processes that end when the process that started them ends."""

import importlib
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

__all__ = ["lower_priority", "run", "start_child"]

_NICENESS = 10  # a tenth of a busy core, and all of an idle one


def start_child(
    function: Callable[..., None], *arguments: str | float, pass_fds: Sequence[int] = ()
) -> "subprocess.Popen[bytes]":
    """Call a function of a module in a new Python process.

    The child ends at once when this process ends, however that happens. Ctrl-C in the terminal does not reach it.
    """
    call = (function.__module__, function.__name__, *arguments)
    code = f"import sys; sys.path[:] = {sys.path!r}; from rft_ros.child_process import run; run(*{call!r})"
    return subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, pass_fds=pass_fds, start_new_session=True
    )


def run(module: str, function: str, *arguments: str | float) -> None:
    """In the child: call the function, and watch for the end of the parent."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    getattr(importlib.import_module(module), function)(*arguments)


def _end_with_parent() -> None:
    os.read(0, 1)  # nothing is ever written: it returns when the other end of the pipe closes
    os._exit(1)


def lower_priority() -> None:
    """In the child: leave busy cores to the parent."""
    os.setpriority(os.PRIO_PROCESS, 0, max(os.getpriority(os.PRIO_PROCESS, 0), _NICENESS))
    # A kernel that groups sessions applies niceness within a session only: beside 20 swaps of meshes 1,824 of 15,000
    # poses were answered late without this, 474 with it.
    with suppress(OSError):
        Path("/proc/self/autogroup").write_text(str(_NICENESS))

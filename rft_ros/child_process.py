"""Python processes that end when the process that started them ends."""

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

_NICENESS = 10  # such a process gets a tenth of a busy core, and all of an idle one


def start_child(
    function: Callable[..., None],
    *arguments: str | float,
    pass_fds: Sequence[int] = (),
    low_priority: bool = False,
) -> "subprocess.Popen[bytes]":
    """Call a module's function in a new Python process, which ends when this one does and gets no Ctrl-C.

    `low_priority`: from its start. Its imports take a second of a core, and on a busy machine poses would wait for it.
    """
    name = function.__name__
    begin = "lower_priority(); watch_parent()" if low_priority else "watch_parent()"
    code = f"import sys; sys.path[:] = {sys.path!r}; "
    code += f"from rft_ros.child_process import lower_priority, watch_parent; {begin}; "
    code += f"from {function.__module__} import {name}; {name}(*{arguments!r})"
    return subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        pass_fds=pass_fds,
        start_new_session=True,
    )


def watch_parent() -> None:
    """In the child: end when the parent ends."""

    def end() -> None:
        # the parent never writes: the call returns when the parent's end of the pipe closes
        os.read(0, 1)
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()


def lower_priority() -> None:
    """In the child: leave busy cores to the parent."""
    os.setpriority(os.PRIO_PROCESS, 0, max(os.getpriority(os.PRIO_PROCESS, 0), _NICENESS))
    # A kernel that schedules by session (autogroup) applies niceness within one session only, so the session gets it
    # too. During 20 changes of the mesh 474 of 15,000 poses were answered late, and 1,824 without this.
    with suppress(OSError):
        Path("/proc/self/autogroup").write_text(str(_NICENESS))

"""Python processes that end when the process that started them ends."""

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence

__all__ = ["start_child", "watch_parent"]


def start_child(
    function: Callable[..., None], *arguments: str | float, pass_fds: Sequence[int] = ()
) -> "subprocess.Popen[bytes]":
    """Call a module's function in a new Python process, which ends when this one does and gets no Ctrl-C."""
    module, name = function.__module__, function.__name__
    code = f"import sys; sys.path[:] = {sys.path!r}; from rft_ros.child_process import watch_parent; watch_parent(); "
    code += f"from {module} import {name}; {name}(*{arguments!r})"
    return subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, pass_fds=pass_fds, start_new_session=True
    )


def watch_parent() -> None:
    """In the child: end when the parent ends."""

    def end() -> None:
        os.read(0, 1)  # the parent never writes: the call returns when the parent's end of the pipe closes
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()

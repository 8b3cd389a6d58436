"""A new tool is prepared in a process of its own: a busy thread here would cost one tick in six (DESIGN 6)."""

import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from rft_ros.estimator.parameters import Value
from rft_ros.prepare_tool import read_tool
from rft_ros.tool import Tool

__all__ = ["MeshPreparation"]


class MeshPreparation:
    """A process that loads and checks a mesh and leaves the tool in a file; `poll` until it answers."""

    def __init__(self, values: Mapping[str, Value]) -> None:
        self.values = values
        self._folder = tempfile.TemporaryDirectory(prefix="rft_ros_")
        scale, origin = values["mesh.scale"], values["mesh.origin"]
        assert isinstance(origin, tuple)
        request = [str(values["mesh.file"]), repr(scale), *(repr(x) for x in origin), self._folder.name]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "rft_ros.prepare_tool", *request],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        with contextlib.suppress(OSError):  # on processor time that nobody else wants: the ticks come first
            os.sched_setscheduler(self._process.pid, os.SCHED_IDLE, os.sched_param(0))

    def poll(self) -> Tool | str | None:
        """The tool, or a sentence that says why there is none, or None while the process runs."""
        status = self._process.poll()
        if status is None:
            return None
        assert self._process.stderr is not None
        said = self._process.stderr.read().decode(errors="replace").strip()
        self._process.stderr.close()
        try:
            if status == 0:
                return read_tool(Path(self._folder.name))
            return said.splitlines()[-1] if said else f"preparing the mesh ended with status {status}"
        finally:
            self._folder.cleanup()

    def cancel(self) -> None:
        """End the process, if it still runs, and remove its file."""
        self._process.kill()
        self._process.wait()
        if self._process.stderr is not None:
            self._process.stderr.close()
        self._folder.cleanup()

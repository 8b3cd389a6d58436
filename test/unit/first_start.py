"""A node that is started once, until it says that it is ready, and then told to stop."""

import signal
import subprocess
import threading
from collections.abc import Sequence
from pathlib import Path

WAIT = 180.0  # a first start compiles: 20 s, on a busy machine more than a minute


def first_start(command: Sequence[str], *, folder: Path, environment: dict[str, str]) -> tuple[int, str]:
    """Exit status after SIGINT, and what the node said."""
    said = []
    with subprocess.Popen(
        command, cwd=folder, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    ) as node:
        assert node.stdout
        overdue = threading.Timer(WAIT, node.kill)
        overdue.start()
        try:
            for line in node.stdout:
                said.append(line)
                if "ready: " in line:
                    node.send_signal(signal.SIGINT)
            status = node.wait()
        finally:
            overdue.cancel()
            node.kill()
    return status, "".join(said)

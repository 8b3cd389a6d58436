"""Progress is shown on a terminal; a pipe or a file gets none of it."""

import os
import pty
import re
import subprocess
import sys

SCRIPT = """
import sys, time
from rft_ros.progress import bar, busy
with bar("long work", 3.0) as update:
    update(1.5, "long work")
    time.sleep(0.3)
with busy("choosing"):
    time.sleep(0.3)
print("done")
"""


def at_a_terminal(**environment):
    """What the script prints, and what it shows on a terminal that is its stderr."""
    ours, its = pty.openpty()
    environment = {**os.environ, "COLUMNS": "60", "TERM": "xterm", **environment}
    command = [sys.executable, "-c", SCRIPT]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=its, env=environment, text=True, timeout=600)
    os.close(its)
    shown = b""
    try:
        while part := os.read(ours, 65536):
            shown += part
    except OSError:  # Linux's way to say that the other end is closed
        pass
    os.close(ours)
    assert done.returncode == 0
    return done.stdout, shown.decode()


def test_a_terminal_shows_the_work_in_progress_apart_from_the_output():
    printed, shown = at_a_terminal()
    assert printed == "done\n"
    for words in ("long work", "50%", "choosing ..."):
        assert words in shown


def test_no_color_turns_colours_off():
    assert not re.search(r"\x1b\[[0-9;]*3[0-9]m", at_a_terminal(NO_COLOR="1")[1])


def test_a_pipe_gets_no_progress_bar():
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, timeout=600)
    assert (done.stdout, done.stderr) == ("done\n", "")

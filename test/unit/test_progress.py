"""Progress is for people at a terminal: nothing of it gets into a pipe or a file."""

import os
import pty
import re
import subprocess
import sys

SCRIPT = """
import sys, time
from rft_ros.progress import busy, each
for item in each(["first", "second"], str):
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
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=its, env=environment, text=True, timeout=60)
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


def test_at_a_terminal_it_names_what_is_under_way_and_leaves_the_output_alone():
    printed, shown = at_a_terminal()
    assert printed == "done\n"
    for words in ("first", "second", "0/2", "1/2", "choosing ..."):
        assert words in shown


def test_without_colours_there_are_none():
    assert not re.search(r"\x1b\[[0-9;]*3[0-9]m", at_a_terminal(NO_COLOR="1")[1])


def test_in_a_pipe_there_is_nothing_of_it():
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.stderr) == ("done\n", "")

"""Progress is shown on a terminal; a pipe or a file gets none of it."""

import io
import os
import pty
import time
from contextlib import redirect_stderr

from rft_ros.progress import bar, busy


def work():
    with bar("long work", 3.0) as update:
        update(1.5, "long work")
        time.sleep(0.2)
    with busy("choosing"):
        time.sleep(0.2)
    print("done")


def test_a_terminal_shows_the_work_in_progress_apart_from_the_output(monkeypatch, capsys):
    for name, value in {"COLUMNS": "60", "TERM": "xterm"}.items():
        monkeypatch.setenv(name, value)
    ours, its = pty.openpty()
    with os.fdopen(its, "w") as terminal, redirect_stderr(terminal):
        work()
        shown = os.read(ours, 65536).decode()
    os.close(ours)
    assert capsys.readouterr().out == "done\n"
    for words in ("long work", "50%", "choosing ..."):
        assert words in shown


def test_a_pipe_gets_no_progress_bar(capsys):
    with redirect_stderr(io.StringIO()) as pipe:
        work()
    assert (capsys.readouterr().out, pipe.getvalue()) == ("done\n", "")

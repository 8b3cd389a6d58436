"""A long wait is never silent: where stderr is no terminal, a line says what takes long."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rft_ros import progress
from rft_ros.commands import machine_code
from rft_ros.commands.machine_code import load_code
from rft_ros.progress import bar, busy

ROOT = Path(__file__).parents[2]
STATE = "t,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz\n0,0,0,-0.01,0,0,0,1,0,0,-0.01,0,0,0\n"


@pytest.mark.parametrize("wait", [busy, lambda what: bar(what, 1.0)], ids=["busy", "bar"])
def test_a_long_wait_says_a_line_where_stderr_is_no_terminal(capsys, monkeypatch, wait):
    monkeypatch.setattr(progress, "MAX_SILENCE_S", 0.0)
    said = ""
    with wait("fitting"):
        while not said:
            time.sleep(0.01)
            said = capsys.readouterr().err
    assert "fitting ..." in said


@pytest.mark.parametrize("wait", [busy, lambda what: bar(what, 1.0)], ids=["busy", "bar"])
def test_a_wait_that_goes_on_says_for_how_long(capsys, monkeypatch, wait):
    monkeypatch.setattr(progress, "MAX_SILENCE_S", 0.0)
    monkeypatch.setattr(progress, "LINE_PERIOD", 0.02)
    said = ""
    end = time.monotonic() + 5.0
    with wait("fitting"):
        while said.count("fitting, for ") < 2:
            assert time.monotonic() < end, said
            time.sleep(0.01)
            said += capsys.readouterr().err


def test_a_long_compilation_says_for_how_long(capsys, monkeypatch):
    monkeypatch.setattr(progress, "MAX_SILENCE_S", 0.0)
    monkeypatch.setattr(progress, "LINE_PERIOD", 0.02)
    monkeypatch.setattr(machine_code, "prepare", lambda *_, **__: time.sleep(0.5))
    load_code()
    assert "loading or compiling code, for 0 s so far ..." in capsys.readouterr().err


def test_a_short_wait_says_nothing(capsys, monkeypatch):
    monkeypatch.setattr(progress, "MAX_SILENCE_S", 1000.0)
    with busy("fitting"):
        pass
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    "command",
    ["predict {states} --mesh plate -o {out}", "view {states} --mesh plate -o {out}", "warm-up"],
)
def test_a_first_run_says_that_it_compiles_before_it_does(tmp_path, command):
    states = tmp_path / "states.csv"
    states.write_text(STATE)
    words = command.format(states=states, out=tmp_path / "out.html").split()
    run = subprocess.Popen(
        [sys.executable, "-m", "rft_ros.cli", *words],
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )
    try:
        said = run.stderr.readline()
        while said and "compiling" not in said:  # one on reading the tool may come before it
            said = run.stderr.readline()
        assert "compiling, ten seconds or more, at the first run only" in said
    finally:
        run.kill()
        run.communicate()

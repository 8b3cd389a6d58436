"""Help and hints of `rft`, and its progress, which a terminal shows; a pipe or a file gets none of it."""

import io
import os
import pty
import re
import shlex
import sys
import time
from contextlib import redirect_stderr
from pathlib import Path

import pytest
from test_cli import STATE, refused, rft

from rft_ros.cli import parser
from rft_ros.commands.options import recording
from rft_ros.installation import program
from rft_ros.progress import bar, busy

ROOT = Path(__file__).resolve().parents[2]
COMMANDS = next(a for a in parser()._actions if a.dest == "command").choices
PREDICT = "predict states.csv --mesh plate -o o"


def test_without_arguments_it_shows_its_help_and_fails(tmp_path):
    done = rft(cwd=tmp_path)
    assert done.returncode == 2
    assert all(re.search(rf"^    {name}\s+\w", done.stderr, re.MULTILINE) for name in COMMANDS), (
        done.stderr
    )


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("repaly bag", "rft: argument COMMAND: invalid choice: 'repaly' (choose from 'predict'"),
        ("replay bag -o o --parms x", "rft: unrecognized arguments: --parms x"),
        (
            "predict states.csv --mesh plate",
            "rft predict: the following arguments are required: -o/--output",
        ),
        (f"{PREDICT} --zeta abc", "rft predict: argument --zeta: invalid number value: 'abc'"),
        (
            f"{PREDICT} --alpha-y linaer",
            "rft predict: alpha_y.model is 'linaer'; it must be one of constant, linear",
        ),
        (
            f"{PREDICT}/o.csv --alpha-y=",
            "rft predict: alpha_y.model is ''; it must be one of constant, linear",
        ),
        ("doctor x.yaml --seconds 0", "rft doctor: --seconds is 0; it must be over 0"),
        ("replay /dev/null -o o", "rft replay: '/dev/null' is not a bag: give a rosbag2 folder"),
    ],
)
def test_wrong_usage_is_a_sentence(tmp_path, line, sentence):
    (tmp_path / "states.csv").write_text(STATE)
    refused(rft(*line.split(), cwd=tmp_path), sentence)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_a_description_and_an_example_that_parses(name):
    command = COMMANDS[name]
    assert command.description
    examples = [line for line in command.epilog.splitlines() if line.startswith("  rft ")]
    assert examples
    for line in examples:
        assert shlex.split(line)[1] == name
        parser().parse_args(shlex.split(line)[1:])
        for file in re.findall(r"config/[\w.]+", line):
            assert (ROOT / file).is_file()


@pytest.mark.parametrize("width", [60, 80, 120])
def test_help_fits_the_terminal(width, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(width))
    for command in COMMANDS.values():
        too_long = [line for line in command.format_help().splitlines() if len(line) > width]
        assert not [line for line in too_long if "rft " not in line]  # examples are for copying


def test_a_demo_too_short_to_reach_the_grains_is_refused_before_anything_starts(tmp_path):
    pytest.importorskip("rclpy")
    refused(
        rft("demo", "--seconds", "3", "-o", "out", cwd=tmp_path),
        "--seconds is 3; it must be over 3",
    )
    assert not (tmp_path / "out").exists()


@pytest.fixture
def empty_path(tmp_path, monkeypatch):
    """A PATH without any program, and no ROS workspace sourced."""
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    (tmp_path / "bin").mkdir()
    return tmp_path / "bin"


def executable(file):
    file.parent.mkdir(parents=True, exist_ok=True)
    file.touch(mode=0o755)


def test_hints_help_and_errors_show_a_command_that_works_here(empty_path, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "executable", str(tmp_path / "my venv" / "bin" / "python"))
    monkeypatch.chdir(tmp_path)
    typed = program()
    assert typed == f"'{sys.executable}' -m rft_ros.cli"
    assert f"see {typed} predict --help" in rft("predict", cwd=tmp_path).stderr
    assert f"  {typed} check-mesh my_tool.stl" in rft("check-mesh", "--help", cwd=tmp_path).stdout
    script = tmp_path / "my venv" / "bin" / "rft"
    executable(script)
    assert shlex.split(program()) == [str(script)]
    executable(tmp_path / "workspace" / "lib" / "rft_ros" / "rft")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "workspace"))
    assert shlex.split(program()) == [str(script)]  # there is no ros2
    executable(empty_path / "ros2")
    assert program() == "ros2 run rft_ros rft"
    executable(empty_path / "rft")
    assert program() == "rft"


@pytest.mark.parametrize(
    ("options", "seconds"), [((), 2.0), (("--tare", "0"), 0.0), (("--tare", "1"), 1.0)]
)
def test_a_tare_of_zero_on_the_command_line_undoes_the_parameter_files(options, seconds, tmp_path):
    file = tmp_path / "cell.yaml"
    file.write_text(
        "rft_replay:\n  ros__parameters:\n    tare: 2.0\nrft:\n  ros__parameters:\n    mesh.file: plate\n"
    )
    words = ["replay", "bag", "--params", str(file), "-o", "out", *options]
    assert recording(parser().parse_args(words))[1].tare == seconds


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

"""What `rft` says of itself, to whoever asks and whoever mistypes."""

import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from test_cli import HEADER, ROW, refused, rft

from rft_ros.cli import parser

ROOT = Path(__file__).resolve().parents[2]
COMMANDS = next(a for a in parser()._actions if a.dest == "command").choices
OPTIONS = [(name, a) for name, command in COMMANDS.items() for a in command._actions if a.dest != "help"]


def test_without_arguments_it_shows_its_help_and_says_that_this_was_no_use(tmp_path):
    done = rft(cwd=tmp_path)
    assert done.returncode == 2
    assert all(re.search(rf"^    {name} +\w", done.stderr, re.MULTILINE) for name in COMMANDS), done.stderr


def test_a_mistyped_command_is_answered_with_the_one_that_was_meant(tmp_path):
    done = rft("repaly", "bag", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (2, "rft: there is no command 'repaly'; did you mean 'replay'?\n")
    done = rft("xyz", cwd=tmp_path)
    assert done.stderr.startswith("rft: there is no command 'xyz'; there are predict, check-mesh, ")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--mesj", "x", "--mesh", "plate", "-o", "o"), "'--mesj' is not one of its arguments; did you mean '--mesh'?"),
        (("--mesh", "plate"), "the following arguments are required: -o/--output"),
        (("--mesh", "plate", "--zeta", "abc", "-o", "o"), "argument --zeta: 'abc' is not a number"),
        (("--mesh", "plate", "--zeta", "inf", "-o", "o"), "argument --zeta: 'inf' is not a finite number"),
        (
            ("--mesh", "plate", "--alpha-y", "linaer", "-o", "o"),
            "--alpha-y 'linaer' is neither constant nor linear, nor the CSV",
        ),
    ],
)
def test_wrong_usage_is_a_sentence(tmp_path, words, sentence):
    (tmp_path / "states.csv").write_text(f"{HEADER}\n{ROW}\n")
    refused(rft("predict", "states.csv", *words, cwd=tmp_path), f"rft predict: {sentence}")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_a_line_that_says_what_for_and_an_example_that_its_parser_takes(name):
    command = COMMANDS[name]
    assert re.fullmatch(r"[A-Z].{10,85}\.", command.description)
    examples = [line for line in command.epilog.splitlines() if line.startswith("  rft ")]
    assert examples
    for line in examples:
        assert shlex.split(line)[1] == name
        parser().parse_args(shlex.split(line)[1:])
        for file in re.findall(r"config/[\w.]+", line):
            assert (ROOT / file).is_file()


@pytest.mark.parametrize(("name", "option"), OPTIONS, ids=[f"{name}-{a.dest}" for name, a in OPTIONS])
def test_every_option_says_what_it_is_and_numbers_and_choices_what_they_are_when_not_given(name, option):
    assert option.help
    if option.option_strings and not option.required and (option.choices or option.type not in (None, Path)):
        assert "(default" in option.help, f"{name} {option.option_strings}"


UNITS = r"\[m\]|\[s\]|[Ss] seconds|no unit|metres|units|share|at most this many|processes"


@pytest.mark.parametrize(("name", "option"), OPTIONS, ids=[f"{name}-{a.dest}" for name, a in OPTIONS])
def test_every_number_says_its_unit(name, option):
    assert option.type in (None, Path) or re.search(UNITS, option.help), f"{name} {option.option_strings}"


@pytest.mark.parametrize("width", [60, 80, 120])
@pytest.mark.parametrize("name", COMMANDS)
def test_help_fits_the_terminal(name, width, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(width))
    too_long = [line for line in COMMANDS[name].format_help().splitlines() if len(line) > width]
    assert not [line for line in too_long if "rft " not in line]  # examples are for copying


def test_a_demo_too_short_to_reach_the_grains_is_refused_before_anything_starts(tmp_path):
    pytest.importorskip("rclpy")
    refused(rft("demo", "--seconds", "3", "-o", "out", cwd=tmp_path), "--seconds is 3; it must be over 3")
    assert not (tmp_path / "out").exists()


def test_an_interrupted_command_says_so_and_ends_as_the_shell_expects(tmp_path):
    (tmp_path / "study.yaml").write_text(
        "tools: [{mesh: root_tip}]\n"
        "motions: [{family: circumnutation, pitch: {from: 0.02, to: 0.2, count: 100000}}]\n"
        "media: [{zeta: 0.33}]\n"
    )
    command = [sys.executable, "-m", "rft_ros.cli", "sweep", str(tmp_path / "study.yaml"), "-o", str(tmp_path / "out")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
        while not list(tmp_path.glob("out/chunks/*.csv")):
            assert run.poll() is None
            time.sleep(0.01)
        run.send_signal(signal.SIGINT)
        _, said = run.communicate(timeout=60)
    assert said.splitlines()[-1] == "rft sweep: interrupted"
    assert "Traceback" not in said
    assert run.returncode == 130

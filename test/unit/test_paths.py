"""Whatever path a command or a parameter is given, the answer is one sentence, soon; arguments come from the parser."""

import signal
from pathlib import Path

import pytest
from path_arguments import (
    GOOD,
    command_lines,
    hostile_paths,
    parameters_with,
    path_arguments,
    write_good,
)

from rft_ros.cli import main

OUTPUTS = {"output", "figure"}
LONGEST = 240
"""Seconds that a command may take, also on a busy machine."""

LETTERS = 1000
"""Characters that a sentence may have beside the path."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_good(tmp_path)
    return tmp_path


@pytest.fixture
def said(capsys):
    """What a command says on stderr, without warnings and what it works on; it ends with status 2, or 1, and soon."""

    def too_long(*_):
        raise TimeoutError(f"took more than {LONGEST} s")

    def of(arguments):
        before = signal.signal(signal.SIGALRM, too_long)
        signal.alarm(LONGEST)
        try:
            status = main(arguments)
        finally:
            signal.alarm(0)
            signal.signal(signal.SIGALRM, before)
        errors = capsys.readouterr().err
        lines = errors.splitlines()
        beside = [line for line in lines if line.startswith("warning: ") or line.endswith(" ...")]
        return status, [line for line in lines if line not in beside]

    return of


def test_every_path_argument_has_a_good_value_in_the_table():
    known = {(name, dest) for name, sets in GOOD.items() for good in sets for dest in good}
    assert {(name, action.dest) for name, action in path_arguments()} == known


def named(sentence, kind, path):
    """Whether a sentence names the path, or says that it has too many characters, and is not too long."""
    says = "hostile" in sentence or (kind == "deep" and "characters" in sentence)
    return says and len(sentence) < len(str(path)) + LETTERS


INPUTS = [(name, action) for name, action in path_arguments() if action.dest not in OUTPUTS]


@pytest.mark.parametrize(
    ("command", "action"), INPUTS, ids=[f"{name}-{action.dest}" for name, action in INPUTS]
)
def test_a_path_that_is_no_file_of_use_is_refused_with_one_sentence(folder, said, command, action):
    if action.dest in ("medium", "alpha_y"):
        suffix = ".csv"
    else:
        suffix = Path(
            next(good[action.dest] for good in GOOD[command] if action.dest in good)
        ).suffix
    for kind, path in hostile_paths(folder / "hostile", suffix).items():
        for words in command_lines(str(path), command=command, action=action):
            status, lines = said(words)
            assert status == 2, (kind, words, lines)
            assert len(lines) == 1, (kind, words, lines)
            assert named(lines[0], kind, path), (kind, words, lines)


def test_a_parameter_that_names_no_file_of_use_is_refused_with_one_sentence(folder, said):
    for suffix in (".stl", ".npz", ".yaml", ".csv"):
        for kind, path in hostile_paths(folder / f"hostile{suffix}", suffix).items():
            if kind == "of bytes":
                continue  # YAML is text
            for name, text in parameters_with(str(path)):
                (folder / "cell.yaml").write_text(text, encoding="utf-8")
                status, lines = said(["replay", "bag", "--params", "cell.yaml", "-o", "out"])
                assert (status, len(lines)) == (2, 1), (kind, name, suffix, lines)
                assert named(lines[0], kind, path), (kind, name, suffix, lines)


RESULTS = [
    (name, action)
    for name, action in path_arguments()
    if action.dest in OUTPUTS and name != "demo"
]


@pytest.mark.parametrize(
    ("command", "action"), RESULTS, ids=[f"{name}-{action.dest}" for name, action in RESULTS]
)
def test_a_path_that_cannot_be_written_is_refused_with_one_sentence(folder, said, command, action):
    suffix = Path(next(good[action.dest] for good in GOOD[command] if action.dest in good)).suffix
    paths = hostile_paths(folder / "hostile", suffix)
    paths["full"] = folder / "hostile" / f"full{suffix}"
    paths["full"].symlink_to("/dev/full")
    for kind in ("loop", "in a loop", "in a file", "in a pipe", "long", "deep", "full", "folder"):
        for words in command_lines(str(paths[kind]), command=command, action=action):
            status, lines = said(words)
            folder_of_results = kind == "folder" and not suffix
            assert status in ((0, 1) if folder_of_results else (1, 2)), (kind, words, lines)
            assert len(lines) == (status == 2), (kind, words, lines)

"""`make` sets up its environment in lines that can be read, and says what is wrong with the Python that it is given.

A script stands in for Python: it notes what it is asked to do, and downloads nothing.
"""

import os
import shutil
import subprocess
from pathlib import Path

import pytest
from distribution import ROOT

pytestmark = pytest.mark.repository

STAND_IN = """#!/bin/sh
case "$*" in
  *version_info*) echo {version};;
  *"-m venv"*) for folder; do :; done; case "$*" in *--clear*) rm -rf "$folder";; esac
    mkdir -p "$folder/bin"; cp -n "$0" "$folder/bin/python"; echo {version} >> begun;;
  *"-m pip"*) echo "$@" >> installed;;
esac
"""


def python(file: Path, version: str) -> Path:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(STAND_IN.format(version=version), encoding="utf-8")
    file.chmod(0o755)
    return file


@pytest.fixture
def project(tmp_path):
    for name in ("Makefile", "setup.py", "package.xml"):
        shutil.copy(ROOT / name, tmp_path)
    shutil.copytree(ROOT / "constraints", tmp_path / "constraints")
    return tmp_path


def make(project: Path, version: str, *arguments: str) -> "subprocess.CompletedProcess[str]":
    stand_in = python(project.parent / f"python_{version}" / "python", version)
    command = ["make", f"PYTHON={stand_in}", *(arguments or [".venv/.demo"])]
    # not as a part of the make that runs the tests, which would announce folders
    alone = {
        name: value
        for name, value in os.environ.items()
        if name not in ("MAKELEVEL", "MAKEFLAGS", "MFLAGS")
    }
    return subprocess.run(command, cwd=project, capture_output=True, text=True, env=alone)


@pytest.mark.parametrize("version", ["3.9", "3.14"])
def test_make_refuses_an_unsupported_python_before_it_begins_an_environment(project, version):
    done = make(project, version)
    assert done.returncode == 2
    said = done.stderr.splitlines()[0]
    for words in (f"is {version}", "3.10 to 3.13", "make PYTHON="):
        assert words in said
    assert not (project / ".venv").exists()


@pytest.mark.parametrize("before", ["another Python", "no pip"])
def test_make_begins_an_environment_anew_that_cannot_be_used(project, before):
    scripts = project / ".venv" / "bin"
    scripts.mkdir(parents=True)
    if before == "another Python":
        python(scripts / "python", "3.9")
    assert make(project, "3.12").returncode == 0
    assert "3.12" in (scripts / "python").read_text()
    assert (project / "begun").read_text().split() == ["3.12"]


@pytest.mark.parametrize(
    ("leg", "variable"), [("test-target", "PYTHON312"), ("test-minimum", "PYTHON_MINIMUM")]
)
def test_a_leg_without_its_python_says_which_is_missing(project, leg, variable):
    done = make(project, "3.13", f"{variable}=", leg)
    assert done.returncode == 2
    for words in (f"make {leg} needs Python 3.1", f"{variable}="):
        assert words in done.stderr.splitlines()[0]


@pytest.mark.parametrize(
    ("leg", "variable", "constraints"),
    [
        ("test-target", "PYTHON312", "constraints/ubuntu-24.04.txt"),
        ("test-minimum", "PYTHON_MINIMUM", "constraints/minimum.txt"),
    ],
)
def test_a_leg_installs_its_versions_in_an_environment_of_its_own(
    project, leg, variable, constraints
):
    stand_in = python(project.parent / "python_3.10" / "python", "3.10")
    make(project, "3.13", f"{variable}={stand_in}", leg)  # ends at rft, which nothing installed
    environment = leg.replace("test-", ".venv-")
    installed = (project / "installed").read_text(encoding="utf-8").splitlines()
    of_package = [line for line in installed if "--editable" in line]
    assert (project / environment / "bin" / "python").is_file()
    assert not (project / ".venv").exists()
    assert len(of_package) == 2
    assert all(f"--constraint {constraints}" in line for line in of_package)

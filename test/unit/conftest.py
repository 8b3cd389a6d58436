"""The release that several files test: built and installed once a run, by the first process that asks for it."""

import subprocess
import sys
import venv
from pathlib import Path

import pytest
from distribution import clean_copy, metadata, place, required, share_machine_code, without_ros


@pytest.fixture(scope="session")
def dist(once) -> Path:
    """The folder that ``make dist`` fills: an sdist, and a wheel built from nothing but the sdist."""
    pytest.importorskip(
        "build", reason="building a release needs build: pip install 'rft_ros[test]'"
    )

    def make(folder: Path) -> None:
        source = clean_copy(folder / "source")
        command = [sys.executable, "-m", "build", "--outdir", str(folder), str(source)]
        done = subprocess.run(command, capture_output=True, text=True, env=without_ros())
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]

    return once("dist", make)


@pytest.fixture(scope="session")
def wheel(dist: Path) -> Path:
    (wheel,) = dist.glob("rft_ros-*.whl")
    return wheel


@pytest.fixture(scope="session")
def installed(once, wheel: Path) -> Path:
    """An empty environment, without even setuptools, with the wheel and the packages that it asks for, and no others.

    pip installs the wheel; the others, of the versions that the wheel allows, come from this process's environment.
    """

    def make(folder: Path) -> None:
        venv.create(folder, with_pip=False)
        pip = [
            sys.executable,
            "-m",
            "pip",
            "--quiet",
            "--python",
            str(folder / "bin" / "python"),
            "install",
        ]
        subprocess.run(
            [*pip, "--no-deps", "--no-index", str(wheel)],
            check=True,
            cwd=folder,
            env=without_ros(),
        )
        (package,) = folder.glob("lib/python*/site-packages/rft_ros")
        for distribution in required(metadata(wheel)["Requires-Dist"], extra="ros"):
            place(distribution, package.parent)
        share_machine_code(package)

    return once("installed", make)

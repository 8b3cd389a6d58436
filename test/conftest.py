"""What all tests share: the reference data, repeatable hypothesis runs, children that hear SIGINT and start fast."""

import fcntl
import os
import shutil
import signal
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from studies.choice import Choice

CalibrationOf = Callable[[str, "Choice"], Path]

# The first example compiles the kernel: no deadline. The same examples every time: a failure is a change, not luck.
settings.register_profile("rft", deadline=None, derandomize=True)
settings.load_profile("rft")

# Jobs that a shell started in the background ignore SIGINT, and so do their children. A handler ends that: a child
# begins with the default action instead.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Hundreds of child processes import the package: with its bytecode on disk each starts a second sooner.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of reference data that lies beside the project, never in it."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"the reference data is not at {SHARED_DATA}")
    return SHARED_DATA


@pytest.fixture(scope="session")
def once(
    tmp_path_factory: pytest.TempPathFactory,
) -> Callable[[str, Callable[[Path], object]], Path]:
    """A folder by name, which the first process of this run that asks for it fills by a function."""
    base = tmp_path_factory.getbasetemp()
    base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def folder_of(name: str, make: Callable[[Path], object]) -> Path:
        folder, done = base / name, base / f"{name}.done"
        with (base / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not done.exists():
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir()
                make(folder)
                done.touch()
        return folder

    return folder_of


@pytest.fixture(scope="session")
def calibration_of(
    once: Callable[[str, Callable[[Path], object]], Path],
) -> Iterator[CalibrationOf]:
    """Calibrations of recordings for the studies: each takes ten seconds, so one process makes it for all.

    Beside the parameter file lies `said.txt`, what the command wrote on stderr.
    """
    from studies import learning

    def make(group: str, choice: "Choice", folder: Path) -> None:
        with (folder / "said.txt").open("w") as said, redirect_stderr(said):
            learning.calibrate(group, choice, folder)

    def calibrated(group: str, choice: "Choice") -> Path:
        model = f"{choice.law} {choice.integration} {choice.alpha_y} {choice.mobilization_length}"
        folder = once(f"calibrated {group} {model}", partial(make, group, choice))
        return folder / "calibrated.yaml"

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(learning, "calibrated", calibrated)
        yield calibrated


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests of the repository itself are slow and seldom fail: they run last."""
    items.sort(key=lambda item: item.get_closest_marker("repository") is not None)


_CPU = Counter[str]()
_spent = 0.0


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport() -> Iterator[None]:
    """Note with each report the CPU time since the last one [s], of this process and the children that ended."""
    global _spent
    report = (yield).get_result()
    before, _spent = _spent, sum(os.times()[:4])
    report.cpu = _spent - before if before else 0.0


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    _CPU[report.location[0].rpartition("/")[0]] += report.cpu


# in quotes: pytest 7, which Ubuntu 24.04 has, gives that class no public name
def pytest_terminal_summary(terminalreporter: "pytest.TerminalReporter") -> None:
    groups = ", ".join(f"{folder} {seconds:.0f}" for folder, seconds in _CPU.most_common())
    terminalreporter.write_line(f"CPU time [s]: {groups}; together {_CPU.total():.0f}")

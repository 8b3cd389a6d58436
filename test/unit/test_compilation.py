"""The cache of machine code: never stale, never in the way, and kept where nobody else can write."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba.core import config
from numba.core.compiler import CompileResult

from rft_ros.rft.frames import rotation
from rft_ros.rft.kernel.compilation import compiled

PACKAGE = Path(__file__).resolve().parents[2] / "rft_ros"
QUATERNION = np.array([0.1, 0.2, 0.3, 0.9])

# What `turned` below is, in a package above the core: for new processes.
MODULE = """
import numpy as np
from rft_ros.rft.kernel.compilation import compiled
from rft_ros.rft.frames import rotation
from rft_ros.tool.numbers import QUARTER

@compiled
def turned(quaternion):
    return rotation(quaternion[0], quaternion[1], quaternion[2], quaternion[3])[1] + QUARTER

print(turned(np.array([0.1, 0.2, 0.3, 0.9])), sum(turned.stats.cache_misses.values()))
"""


def turned(quaternion):
    return rotation(quaternion[0], quaternion[1], quaternion[2], quaternion[3])[1] + 0.25


def answer():
    """A number by a function made anew, which has only the cache to know its code from; how many were compiled."""
    function = compiled(turned)
    return function(QUATERNION), sum(function.stats.cache_misses.values())


def kept(folder: Path) -> list[Path]:
    """The files of the cache."""
    return sorted(file for file in folder.rglob("*") if file.is_file())


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty folder for machine code, used by the functions that this process makes from now on."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    config.reload_config()
    yield tmp_path / "cache"
    monkeypatch.undo()
    config.reload_config()


def test_a_damaged_file_of_the_cache_counts_as_absent_and_is_replaced(cache):
    number, count = answer()
    assert (number, count) == (turned(QUATERNION), 1)
    assert answer() == (number, 0)
    (file,) = kept(cache)
    content = file.read_bytes()
    changed = bytearray(content)
    changed[len(content) // 2] ^= 1
    for damaged in (content[:500], b"x" * 5000, b"", bytes(changed)):
        file.write_bytes(damaged)
        assert answer() == (number, 1)
    assert answer() == (number, 0)


@pytest.mark.parametrize("part", ["file", "folder", "link"])
def test_machine_code_that_others_could_have_written_is_not_loaded(cache, tmp_path, part):
    number, _ = answer()
    (file,) = kept(cache)
    if part == "link":
        file.rename(tmp_path / "elsewhere")
        file.symlink_to(tmp_path / "elsewhere")
    else:
        (file if part == "file" else file.parent).chmod(0o777)
    assert answer() == (number, 1)


def test_a_cache_that_cannot_be_written_does_not_fail_a_call(cache):
    number, _ = answer()
    (file,) = kept(cache)
    file.unlink()
    file.mkdir()  # root may write into any folder
    assert answer() == (number, 1)


@pytest.mark.parametrize(("verb", "method"), [("save", "_reduce"), ("load", "_rebuild")])
@pytest.mark.usefixtures("cache")
def test_a_numba_that_cannot_save_or_load_its_code_fails_no_call_and_warns_once(
    monkeypatch, verb, method
):
    if verb == "load":
        answer()
    monkeypatch.delattr(CompileResult, method)
    with pytest.warns(RuntimeWarning, match=f"cannot {verb} machine code") as warned:
        assert answer() == (turned(QUATERNION), 1)
        assert answer() == (turned(QUATERNION), 1)
    assert len(warned) == 1


def test_numba_disable_jit_leaves_forces_as_they_are():
    script = "from rft_ros.rft import *; p = Plates.from_arrays([[0, 0, -1]], [[0, 0, -1]], [1])\n"
    script += (
        "print(wrenches(p, Agarwal2023(), [0, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0])[0, 2] > 0)"
    )
    found = subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
    )
    assert found.stdout == "True\n", found.stderr


class Elsewhere:
    """`turned` in new processes, in a copy of the core with a package beside it."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.package = folder, folder / "rft_ros"
        shutil.copytree(
            PACKAGE / "rft", self.package / "rft", ignore=shutil.ignore_patterns("__pycache__")
        )
        (self.package / "tool").mkdir()
        (self.package / "tool" / "turned.py").write_text(MODULE, encoding="utf-8")
        (self.package / "tool" / "numbers.py").write_text("QUARTER = 0.25", encoding="utf-8")

    def answer(self, **environment: str) -> tuple[float, int]:
        """The number, and how many functions were compiled for it."""
        inherited = {
            name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"
        }
        # bytecode goes by the source's size and time only
        own = {"PYTHONPATH": str(self.folder), "PYTHONDONTWRITEBYTECODE": "1"}
        command = [sys.executable, "-c", "import rft_ros.tool.turned"]
        done = subprocess.run(
            command,
            env={**inherited, **own, **environment},
            cwd=self.folder,
            capture_output=True,
            text=True,
        )
        assert (done.returncode, done.stderr) == (0, "")
        number, count = done.stdout.split()
        return float(number), int(count)


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory):
    """`turned`, compiled in another process."""
    there = Elsewhere(tmp_path_factory.mktemp("elsewhere"))
    assert there.answer() == (turned(QUATERNION), 1)
    assert there.answer() == (turned(QUATERNION), 0)
    return there


def test_code_that_has_changed_is_compiled_again_despite_a_file_of_the_same_size_and_time(
    elsewhere,
):
    numbers = []
    for name, old, new in (
        ("rft/frames.py", "xy - wz,", "xy + wz,"),
        ("tool/numbers.py", "QUARTER = 0.2", "QUARTER = 0.7"),
    ):
        file = elsewhere.package / name
        was, text = file.stat(), file.read_text(encoding="utf-8")
        assert old in text
        file.write_text(text.replace(old, new), encoding="utf-8")
        os.utime(file, ns=(was.st_atime_ns, was.st_mtime_ns))
        number, count = elsewhere.answer()
        numbers.append(number)
        assert count == 1
        assert len(kept(elsewhere.folder / "__pycache__")) == 1, (
            "code of the former source was left behind"
        )
        file.write_text(text, encoding="utf-8")
    assert len({turned(QUATERNION), *numbers}) == 3
    assert elsewhere.answer() == (turned(QUATERNION), 1)


def test_what_runs_leaves_nothing_in_the_folder_of_an_installed_package(elsewhere):
    """pip leaves what it did not install; Python takes a folder that is left for a package, and no command runs."""
    assert {file.suffix for file in kept(elsewhere.package)} == {".py"}
    assert len(list((elsewhere.folder / "__pycache__").glob("rft_ros.*.nbc"))) == 1


def test_who_may_not_write_beside_the_package_keeps_machine_code_in_the_cache_of_the_user(
    elsewhere,
):
    beside = elsewhere.folder / "__pycache__"
    shutil.rmtree(beside)
    beside.write_text("no folder")  # root may write into any folder
    cache = elsewhere.folder / "of_the_user"
    assert [elsewhere.answer(XDG_CACHE_HOME=str(cache))[1] for _ in range(2)] == [1, 0]
    assert len(kept(cache / "rft_ros")) == 1


def test_processes_that_compile_at_once_do_not_disturb_each_other(elsewhere):
    cache = elsewhere.folder / "at_once"
    command = [sys.executable, "-c", "import rft_ros.tool.turned"]
    environment = {
        **os.environ,
        "PYTHONPATH": str(elsewhere.folder),
        "NUMBA_CACHE_DIR": str(cache),
    }
    start = {"env": environment, "cwd": elsewhere.folder, "stdout": subprocess.PIPE, "text": True}
    running = [subprocess.Popen(command, **start) for _ in range(2)]
    assert {float(process.communicate()[0].split()[0]) for process in running} == {
        turned(QUATERNION)
    }
    assert elsewhere.answer(NUMBA_CACHE_DIR=str(cache)) == (turned(QUATERNION), 0)
    assert len(kept(cache)) == 1

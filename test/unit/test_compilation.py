"""The cache of machine code: never stale, never in the way, and made again only where the code has changed."""

import os
import shutil
import subprocess
import sys
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba.core import config
from numba.core.compiler import CompileResult

from rft_ros.rft.frames import rotation
from rft_ros.rft.kernel.compilation import compiled, inlined
from rft_ros.whole_file import replacing

PACKAGE = Path(__file__).resolve().parents[2] / "rft_ros"
QUATERNION = np.array([0.1, 0.2, 0.3, 0.9])

# What `turned` below is, in a package above the core: for new processes.
MODULE = """
import numpy as np
from rft_ros.rft.kernel.compilation import compiled
from rft_ros.rft.frames import rotation
from rft_ros.tool import numbers
from rft_ros.tool.numbers import ZERO, nothing

@compiled
def turned(quaternion):
    moved = 0.25 + ZERO + numbers.NO_MORE + nothing()
    return rotation(quaternion[0], quaternion[1], quaternion[2], quaternion[3])[1] + moved

if __name__ != "__main__":
    print(turned(np.array([0.1, 0.2, 0.3, 0.9])), sum(turned.stats.cache_misses.values()))
"""


NUMBERS = """
from numba import types
from numba.extending import intrinsic

ZERO = 0.0
NO_MORE = 0.0
OTHER = 3.0

@intrinsic
def nothing(_):
    return types.float64(), lambda context, *_: context.get_constant(types.float64, 0.0)
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
    file.unlink()
    assert answer() == (number, 1)


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


def test_a_planted_link_in_place_of_a_part_file_is_not_followed(tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("mine")
    (tmp_path / f".code.{os.getpid()}.part.nbc").symlink_to(victim)
    with replacing(tmp_path / "code.nbc") as part:
        part.write_text("new")
    assert (victim.read_text(), (tmp_path / "code.nbc").read_text()) == ("mine", "new")


def test_numba_disable_jit_leaves_forces_as_they_are():
    script = "from rft_ros.rft import *; p = Plates.from_arrays([[0, 0, -1]], [[0, 0, -1]], [1])\n"
    script += "print(wrenches(p, agarwal2023(), [0, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0])[0, 2] > 0)"
    found = subprocess.run(
        [sys.executable, "-c", script], env={**os.environ, "NUMBA_DISABLE_JIT": "1"}, capture_output=True, text=True
    )
    assert found.stdout == "True\n", found.stderr


def test_a_cache_that_cannot_be_written_does_not_fail_a_call(cache):
    number, _ = answer()
    (file,) = kept(cache)
    file.unlink()
    file.mkdir()  # root may write into any folder
    assert answer() == (number, 1)
    assert kept(cache) == []


@pytest.mark.parametrize(("verb", "method"), [("save", "_reduce"), ("load", "_rebuild")])
@pytest.mark.usefixtures("cache")
def test_a_numba_that_cannot_save_or_load_its_code_fails_no_call_and_warns_once(monkeypatch, verb, method):
    if verb == "load":
        answer()
    monkeypatch.delattr(CompileResult, method)
    with pytest.warns(RuntimeWarning, match=f"cannot {verb} machine code") as warned:
        assert answer() == (turned(QUATERNION), 1)
        assert answer() == (turned(QUATERNION), 1)
    assert len(warned) == 1


class Elsewhere:
    """`turned` in new processes, in a copy of the core with a package beside it."""

    def __init__(self, folder: Path) -> None:
        for file in (PACKAGE / "whole_file.py", *(PACKAGE / "rft").rglob("*.py")):
            copy = folder / "rft_ros" / file.relative_to(PACKAGE)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, copy)
        self.folder, self.cache = folder, folder / "cache"
        (folder / "rft_ros" / "tool").mkdir()
        self.file("tool/turned.py").write_text(MODULE, encoding="utf-8")
        self.file("tool/numbers.py").write_text(NUMBERS, encoding="utf-8")

    def file(self, name: str) -> Path:
        return self.folder / "rft_ros" / name

    def answer(self) -> tuple[float, int]:
        """The number, and how many functions were compiled for it."""
        environment = {**os.environ, "PYTHONPATH": str(self.folder), "NUMBA_CACHE_DIR": str(self.cache)}
        environment["PYTHONDONTWRITEBYTECODE"] = "1"  # bytecode goes by the source's size and time only
        command = [sys.executable, "-c", "import rft_ros.tool.turned"]
        done = subprocess.run(command, env=environment, cwd=self.folder, capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, "")
        number, count = done.stdout.split()
        return float(number), int(count)


@pytest.fixture(scope="module")
def compiled_elsewhere(tmp_path_factory):
    """`turned`, compiled in another process."""
    there = Elsewhere(tmp_path_factory.mktemp("elsewhere"))
    assert there.answer() == (turned(QUATERNION), 1)
    assert there.answer() == (turned(QUATERNION), 0)
    return there


@pytest.fixture
def elsewhere(compiled_elsewhere):
    """The same, as it was before the test."""
    files = {file: file.read_bytes() for file in compiled_elsewhere.folder.rglob("*") if file.is_file()}
    yield compiled_elsewhere
    for file in compiled_elsewhere.folder.rglob("*"):
        if file.is_file() and file not in files:
            file.unlink()
    for file, content in files.items():
        file.write_bytes(content)


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("rft/frames.py", "xy - wz, xz + wy", "xy + wz, xz + wy"),  # a function that became part of it
        ("tool/turned.py", "0.25", "0.75"),
        ("tool/numbers.py", "ZERO = 0.0", "ZERO = 0.5"),
        ("tool/numbers.py", "NO_MORE = 0.0", "NO_MORE = 0.5"),  # read as an attribute of its module
        ("tool/numbers.py", "types.float64, 0.0)", "types.float64, 0.5)"),  # in an intrinsic's code
    ],
)
def test_code_that_has_changed_is_compiled_again_despite_a_file_of_the_same_size_and_time(elsewhere, name, old, new):
    file = elsewhere.file(name)
    was, text = file.stat(), file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")
    os.utime(file, ns=(was.st_atime_ns, was.st_mtime_ns))
    number, count = elsewhere.answer()
    assert number != turned(QUATERNION)
    assert count == 1
    assert len(kept(elsewhere.cache)) == 1, "code of the former source was left behind"


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("rft/media.py", "\n\n", "\n\n# a comment\n\n"),
        ("rft/frames.py", "\n\n", "\n\n# a comment\n\n"),  # in a file that the loop comes from, before its functions
        ("rft/frames.py", "import", "def beside(x):\n    return x + 1\n\n\nimport"),
        ("tool/numbers.py", "OTHER = 3.0", "OTHER = 4.0"),
        ("tool/turned.py", "    moved = ", "    # a comment\n\n    moved = "),
    ],
)
def test_what_a_loop_is_not_made_of_may_change_without_compiling_it_again(elsewhere, name, old, new):
    file = elsewhere.file(name)
    docstring, mark, text = file.read_text(encoding="utf-8").partition('"""\n')
    head, text = (docstring + mark, text) if mark else ("", docstring)
    assert old in text
    file.write_text(head + text.replace(old, new, 1), encoding="utf-8")
    assert elsewhere.answer() == (turned(QUATERNION), 0)


def test_what_runs_leaves_nothing_in_the_folder_of_an_installed_package(elsewhere):
    """pip leaves what it did not install; Python takes a folder that is left for a package, and no command runs."""
    command = [sys.executable, "-c", "import rft_ros.tool.turned"]
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"} | {
        "PYTHONPATH": str(elsewhere.folder)
    }
    subprocess.run(command, env=environment, cwd=elsewhere.folder, capture_output=True, check=True)
    left = {file.suffix for file in (elsewhere.folder / "rft_ros").rglob("*") if file.is_file()}
    assert left <= {".py", ".pyc"}
    assert len(list((elsewhere.folder / "__pycache__").glob("rft_ros.*.nbc"))) == 1


def test_who_may_not_write_beside_the_package_keeps_machine_code_in_the_cache_of_the_user(elsewhere):
    beside = elsewhere.folder / "__pycache__"
    beside.mkdir(exist_ok=True)
    beside.rmdir()
    beside.write_text("no folder")  # root may write into any folder
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"} | {
        "PYTHONPATH": str(elsewhere.folder)
    }
    environment |= {"XDG_CACHE_HOME": str(elsewhere.folder / "of_the_user"), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", "import rft_ros.tool.turned"]
    said = [subprocess.check_output(command, env=environment, cwd=elsewhere.folder, text=True) for _ in range(2)]
    assert [line.split()[1] for line in said] == ["1", "0"]
    assert len(kept(elsewhere.folder / "of_the_user" / "rft_ros")) == 1


# How a number gets into a compiled function.
WAYS = {
    "literal": "def f(x):\n    return x + {0}",
    "global": "N = {0}\ndef f(x):\n    return x + N",
    "default": "def f(x, n={0}):\n    return x + n",
    "array": "N = np.array([1.0, {0}])\ndef f(x):\n    return x + N[1]",
    "table": "N = (1.0, (2.0, {0}))\ndef f(x):\n    return x + N[1][1]",
    "closure": "def made(n):\n    def f(x):\n        return x + n\n    return f\nf = made({0})",
    "inlined": "@inlined\ndef n():\n    return {0}\ndef f(x):\n    return x + n()",
    "twice": "@inlined\ndef m():\n    return {0}\n@inlined\ndef n():\n    return m()\ndef f(x):\n    return x + n()",
    "compiled": "@compiled\ndef n():\n    return {0}\ndef f(x):\n    return x + n()",
    "enum": "class N(IntEnum):\n    A = {0}\ndef f(x):\n    return x + N.A.value",
    "named_tuple": "class N(NamedTuple):\n    a: float\nn = N({0})\ndef f(x):\n    return x + n.a",
}


@pytest.mark.parametrize("way", WAYS)
@settings(max_examples=3)
@given(values=st.lists(st.integers(0, 50), min_size=2, max_size=3))
def test_a_number_that_becomes_part_of_the_code_is_never_an_old_one(tmp_path_factory, way, values):
    config.CACHE_DIR = str(tmp_path_factory.mktemp("cache"))
    before = None
    try:
        for value in values:
            function = compiled(_function(way, value))
            assert function(1.0) == 1.0 + value
            assert sum(function.stats.cache_misses.values()) == (0 if value == before else 1)
            before = value
    finally:
        config.reload_config()


def _function(way: str, value: int):
    namespace = {"__name__": __name__, "np": np, "inlined": inlined, "compiled": compiled}
    namespace |= {"IntEnum": IntEnum, "NamedTuple": NamedTuple}
    exec(compile(WAYS[way].format(value), __file__, "exec"), namespace)
    return namespace["f"]


class There(NamedTuple):
    a: float
    b: float


def difference(point):
    return point.a - point.b


@pytest.mark.usefixtures("cache")
def test_fields_of_an_argument_that_change_places_make_the_code_anew():
    """Of types of one name: numba's type of a named tuple does not tell the order of its fields."""
    here, back = There, NamedTuple("There", [("b", float), ("a", float)])
    for kind in (here, back, here):
        assert compiled(difference)(kind(a=3.0, b=1.0)) == 2.0

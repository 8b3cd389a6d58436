"""The cache of machine code: never stale, never in the way."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba.core import config

from rft_ros.rft.compilation import compiled
from rft_ros.rft.frames import rotation

PACKAGE = Path(__file__).resolve().parents[2] / "rft_ros"
QUATERNION = np.array([0.1, 0.2, 0.3, 0.9])

# What `turned` below is, in a package above the core: for new processes.
MODULE = """
import numpy as np
from rft_ros.rft.compilation import compiled
from rft_ros.rft.frames import rotation

@compiled
def turned(quaternion):
    return rotation(quaternion[0], quaternion[1], quaternion[2], quaternion[3])[1] + 0.25

if __name__ != "__main__":
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
    file.unlink()
    assert answer() == (number, 1)


def test_a_cache_that_cannot_be_written_does_not_fail_a_call(cache):
    number, _ = answer()
    (file,) = kept(cache)
    file.unlink()
    file.mkdir()  # root may write into any folder
    assert answer() == (number, 1)
    assert kept(cache) == []


def test_another_process_finds_the_code_and_edited_sources_are_compiled_again_despite_an_old_time_stamp(tmp_path):
    """The function's own file, and that of a function that became part of it; of the same size and time as before."""
    for file in (PACKAGE / "rft").glob("*.py"):
        copy = tmp_path / "rft_ros" / "rft" / file.name
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, copy)
    module = tmp_path / "rft_ros" / "tool" / "turned.py"
    module.parent.mkdir()
    module.write_text(MODULE, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    environment["PYTHONDONTWRITEBYTECODE"] = "1"  # bytecode goes by the source's size and time only

    def answer_elsewhere():
        command = [sys.executable, "-c", "import rft_ros.tool.turned"]
        done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, "")
        number, count = done.stdout.split()
        return float(number), int(count)

    number = turned(QUATERNION)
    assert answer_elsewhere() == (number, 1)
    assert answer_elsewhere() == (number, 0)
    frames = tmp_path / "rft_ros" / "rft" / "frames.py"
    for file, old, new in ((frames, "xy - wz, xz + wy", "xy + wz, xz + wy"), (module, "+ 0.25", "+ 0.75")):
        was, text = file.stat(), file.read_text(encoding="utf-8")
        assert old in text
        file.write_text(text.replace(old, new), encoding="utf-8")
        os.utime(file, ns=(was.st_atime_ns, was.st_mtime_ns))
        before, (number, count) = number, answer_elsewhere()
        assert number != before
        assert count == 1
        assert len(kept(tmp_path / "cache")) == 1, "code of the former source was left behind"

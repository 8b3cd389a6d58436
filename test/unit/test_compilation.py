"""The cache of machine code: never stale, never in the way, and the same for every compiled function."""

import importlib
import os
import pkgutil
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba.core import config
from numba.core.registry import CPUDispatcher

import rft_ros
from rft_ros.estimator.load_cell import _into_sensor
from rft_ros.rft import compilation

ROOT = Path(rft_ros.__file__).parent

# The load cell's function is compiled in a second, and takes the rotation from the core.
CODE = """
import numpy as np
from rft_ros.estimator.load_cell import _into_sensor as function

out = np.zeros(18)
function(np.arange(11.0), np.array([0.1, 0.2, 0.3, 0.9]), np.arange(12.0), out)
print(out.tolist())
print("compiled", sum(function.stats.cache_misses.values()))
"""


def answer(folder: Path) -> tuple[str, str]:
    """Numbers, and how many functions were compiled for them, in a process of its own."""
    environment = {**os.environ, "PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "cache")}
    environment["PYTHONDONTWRITEBYTECODE"] = "1"  # bytecode goes by the source's size and time only
    done = subprocess.run(
        [sys.executable, "-c", CODE], env=environment, cwd=folder, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    numbers, compiled = done.stdout.splitlines()
    return numbers, compiled


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    """An empty folder for machine code, used by the functions that this process makes from now on."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    config.reload_config()
    yield tmp_path
    monkeypatch.undo()
    config.reload_config()


def answer_here() -> tuple[list[float], str]:
    """As `answer`, by a function made anew in this process, which has only the cache to know its code from."""
    function, out = compilation.compiled(_into_sensor.py_func), np.zeros(18)
    function(np.arange(11.0), np.array([0.1, 0.2, 0.3, 0.9]), np.arange(12.0), out)
    return out.tolist(), f"compiled {sum(function.stats.cache_misses.values())}"


def kept(folder: Path) -> list[Path]:
    """The files of the cache."""
    return sorted(file for file in (folder / "cache").rglob("*") if file.is_file())


def test_a_damaged_cache_file_counts_as_absent_and_is_replaced(own_cache):
    numbers, compiled = answer_here()
    assert compiled == "compiled 1"
    (file,) = kept(own_cache)
    content = file.read_bytes()
    changed = bytearray(content)
    changed[len(content) // 2] ^= 1
    assert answer_here() == (numbers, "compiled 0")
    for damaged in (content[:500], b"x" * 5000, b"", bytes(changed)):
        file.write_bytes(damaged)
        assert answer_here() == (numbers, "compiled 1")
    assert answer_here() == (numbers, "compiled 0")


def test_a_cache_that_cannot_be_written_does_not_fail_a_call(own_cache):
    numbers, _ = answer_here()
    (file,) = kept(own_cache)
    file.unlink()
    file.mkdir()
    assert answer_here() == (numbers, "compiled 1")
    assert kept(own_cache) == []


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """A copy of the package with its cache filled, and the numbers of its function."""
    folder = tmp_path_factory.mktemp("copy")
    shutil.copytree(ROOT, folder / "rft_ros", ignore=shutil.ignore_patterns("__pycache__"))
    numbers, compiled = answer(folder)
    assert compiled == "compiled 1"
    assert answer(folder) == (numbers, "compiled 0")
    return folder, numbers


@pytest.mark.parametrize("source", ["rft/frames.py", "estimator/load_cell.py"])
def test_an_edited_source_is_recompiled_even_with_an_old_time_stamp(copy, source):
    """Both the function's own file and that of a function that became part of it; same size, same time."""
    folder, before = copy
    file = folder / "rft_ros" / source
    was, text = file.stat(), file.read_text(encoding="utf-8")
    old, new = ("xy - wz, xz + wy", "xy + wz, xz + wy") if "frames" in source else ("-mount[7])", "-mount[8])")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")
    os.utime(file, ns=(was.st_atime_ns, was.st_mtime_ns))
    numbers, compiled = answer(folder)
    file.write_text(text, encoding="utf-8")
    os.utime(file, ns=(was.st_atime_ns, was.st_mtime_ns))
    assert numbers != before
    assert compiled == "compiled 1"
    assert len(kept(folder)) == 1, "code of the former source was left behind"


def test_every_compiled_function_of_the_package_has_this_cache():
    found = {}
    for module in pkgutil.walk_packages(rft_ros.__path__, "rft_ros."):
        if module.name.startswith(("rft_ros.node", "rft_ros.studies")):  # need ROS; studies are not installed
            continue
        for name, value in vars(importlib.import_module(module.name)).items():
            for each in value.values() if isinstance(value, dict) else (value,):
                if isinstance(each, CPUDispatcher):
                    found[f"{module.name}.{name}"] = type(each._cache)
    assert len(found) >= 6
    assert {name: cache for name, cache in found.items() if cache is not compilation._Cache} == {}

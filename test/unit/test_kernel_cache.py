"""numba's cache on disk may hold what can no longer be read: then the kernels are compiled anew, without a word."""

import os
import pickle
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core.caching import FunctionCache

from rft_ros.rft import mobilization
from rft_ros.rft.kernel import EDGE_AREAS, KERNELS

# Two loops, since numba looks for the one's machine code itself; the second compiles in a second.
CODE = """
import sys
from rft_ros.rft import MEDIA, Plates, alpha_y_model, checked_states, edge_shares, treers2021, wrenches
from rft_ros.rft.kernel import EDGE_AREAS, KERNELS

plates = Plates.from_arrays([[0, 0, 0]], [[0.6, 0, -0.8]], [4e-4])
medium = MEDIA["generic"]
law = treers2021(medium, alpha_y_model("constant", medium))
states = checked_states([0, 0, -0.02, 0, 0, 0, 1, 0.006, 0.008, -0.001, 0, 0, 0])
print(edge_shares(plates, states[0]), *(wrenches(plates, law, states).tolist() if "wrenches" in sys.argv else ()))
print("compiled", sum(sum(loop.stats.cache_misses.values()) for loop in (EDGE_AREAS, KERNELS["centroid"][0])))
"""


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """With a cache of its own, to be filled."""
    return {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path_factory.mktemp("cache"))}


def answer(environment: dict[str, str], *what: str) -> tuple[str, str]:
    """Numbers, and how many loops were compiled for them."""
    command = [sys.executable, "-c", CODE, *what]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    numbers, compiled = done.stdout.splitlines()
    return numbers, compiled


def with_a_class_that_is_gone(index: Path) -> bytes:
    """What numba leaves where an α_y model `Rib` was tried, and then removed from `alpha_y`."""
    with index.open("rb") as file:
        version = pickle.load(file)
    return pickle.dumps(version) + b"crft_ros.rft.alpha_y\nRib\n."


def test_an_index_that_names_an_alpha_y_model_that_is_gone_is_written_anew(environment):
    numbers, compiled = answer(environment, "wrenches")
    assert compiled == "compiled 2"
    assert answer(environment, "wrenches") == (numbers, "compiled 0")
    indices = list(Path(environment["NUMBA_CACHE_DIR"]).rglob("*.nbi"))
    assert len(indices) == 2
    for index in indices:
        index.write_bytes(with_a_class_that_is_gone(index))
    assert answer(environment, "wrenches") == (numbers, "compiled 2")
    assert answer(environment, "wrenches") == (numbers, "compiled 0")


@pytest.mark.parametrize(("kind", "length"), [("nbi", 60), ("nbc", 500)])
def test_a_file_of_the_cache_that_was_cut_short_is_written_anew(environment, kind, length):
    numbers, _ = answer(environment)
    files = [*Path(environment["NUMBA_CACHE_DIR"]).rglob(f"*edge_areas*.{kind}")]
    assert len(files) == 1
    assert files[0].stat().st_size > length
    os.truncate(files[0], length)
    assert answer(environment) == (numbers, "compiled 1")


def test_every_loop_of_the_core_has_such_a_cache():
    loops = [EDGE_AREAS, *(loop for rule in KERNELS.values() for loop in rule), *mobilization._KERNELS.values()]
    assert [loop for loop in loops if type(loop._cache).load_overload is FunctionCache.load_overload] == []

"""Reduced tools are kept on disk by their content, and a cache that cannot be used changes no result."""

import os
import shutil
import subprocess
import sys

import numpy as np
import pytest

from rft_ros.tool import load_tool, locate_mesh, reduce, reduction_cache


@pytest.fixture(autouse=True)
def reductions(tmp_path, monkeypatch):
    """A cache of the test's own, and how often a tool was really reduced."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    made, reduced = [], reduce.reduced_for_any_motion
    monkeypatch.setattr(
        reduce,
        "reduced_for_any_motion",
        lambda *arguments: made.append(arguments) or reduced(*arguments),
    )
    return made


def tool(file="root_tip", **options):
    return load_tool(file, **{"tolerance": 0.05, **options})


def same(a, b):
    arrays = [
        (getattr(a.plates, name), getattr(b.plates, name))
        for name in ("rows", "blocks", "order", "bounds")
    ]
    return (
        a.reduction == b.reduction
        and all(np.array_equal(x, y) for x, y in arrays)
        and a.plates.reach == b.plates.reach
    )


def kept():
    return sorted(reduction_cache.cache_folder().glob("*"))


def test_a_tool_is_reduced_once_and_comes_back_bit_by_bit(reductions):
    first = tool()
    assert same(first, tool())
    assert len(reductions) == 1
    assert len(first.plates) < len(first.facets)


def test_a_tool_that_no_fewer_plates_can_stand_for_is_not_tried_again(reductions):
    for _ in range(2):
        whole = tool("plate", tolerance=1e-6)
        assert whole.plates is whole.facets
    assert len(reductions) == 1


def test_the_content_decides_and_not_the_files_name(reductions, tmp_path):
    copy = tmp_path / "copy.stl"
    shutil.copy(locate_mesh("root_tip"), copy)
    assert same(tool(), tool(copy))
    assert len(reductions) == 1
    turned = [0.5, 0.5, 0.5, 0.5]
    others = [{"scale": 0.002}, {"origin": (0, 0, 1)}, {"quaternion": turned}, {"tolerance": 0.06}]
    for count, changed in enumerate([*others, {"integration": "centroid"}], start=2):
        tool(**changed)
        assert len(reductions) == count, changed


@pytest.mark.parametrize(
    "damage", ["truncated", "changed", "empty", "fifo", "folder", "of another kind"]
)
def test_a_damaged_file_is_not_used_and_is_replaced(reductions, damage):
    first, (file,) = tool(), kept()
    data = file.read_bytes()
    file.unlink()
    if damage == "fifo":
        os.mkfifo(file)
    elif damage == "folder":
        file.mkdir()
    else:
        middle = len(data) // 2
        contents = {
            "truncated": data[:-5],
            "changed": data[:middle] + b"!" + data[middle + 1 :],
            "empty": b"",
        }
        file.write_bytes(contents.get(damage, b"\0" * 100))
    assert same(first, tool())
    assert len(reductions) == 2
    assert same(first, tool())
    assert len(reductions) == (3 if damage == "folder" else 2)  # a folder stays


def test_where_nothing_can_be_written_a_tool_is_reduced_each_time(reductions, tmp_path):
    (tmp_path / "cache").write_text("a file in place of the folder")
    assert same(tool(), tool())
    assert len(reductions) == 2


def test_the_cache_stays_small_and_keeps_what_was_used_last(reductions, monkeypatch):
    monkeypatch.setattr(reduction_cache, "_MAX_FILE_COUNT", 3)
    tool()
    (first,) = kept()
    for k in range(5):
        os.utime(first, ns=(0, 0))
        tool()
        tool(scale=0.002 + 0.001 * k)
        assert first in kept()
        assert len(kept()) <= 3
    assert len(reductions) == 6


def test_processes_that_reduce_the_same_tool_at_once_do_not_disturb_each_other():
    code = (
        "import hashlib; from rft_ros.tool import load_tool;"
        "print(hashlib.sha256(load_tool('root_tip', tolerance=0.05).plates.rows.tobytes()).hexdigest())"
    )
    running = [
        subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
        for _ in range(3)
    ]
    said = {process.communicate(timeout=600)[0] for process in running}
    assert len(said) == 1
    assert len(kept()) == 1

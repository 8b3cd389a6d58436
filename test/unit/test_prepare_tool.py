"""What the helper process leaves behind is the tool, ready for the kernel."""

import shutil
import subprocess
import sys

import numpy as np

from rft_ros.prepare_tool import read_tool, write_tool
from rft_ros.tool import load_tool


def test_a_tool_comes_back_as_it_was_even_when_its_folder_is_gone(tmp_path):
    tool = load_tool("ellipsoid")
    folder = tmp_path / "handover"
    folder.mkdir()
    write_tool(folder, tool)
    back = read_tool(folder)
    shutil.rmtree(folder)
    np.testing.assert_array_equal(back.plates.packed, tool.plates.packed)
    np.testing.assert_array_equal(back.vertices, tool.vertices)
    np.testing.assert_array_equal(back.faces, tool.faces)
    assert back.lowest_point(np.eye(3)) == tool.lowest_point(np.eye(3))
    assert (back.name, back.findings, back.plates.reach) == (tool.name, tool.findings, tool.plates.reach)
    assert not back.plates.packed.flags.writeable
    assert back.plates.packed.flags.aligned


def test_the_process_ends_with_2_and_a_sentence_for_a_mesh_it_cannot_use(tmp_path):
    command = [sys.executable, "-m", "rft_ros.prepare_tool", "gone.stl", "0.001", "0", "0", "0", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 2
    assert "gone.stl" in done.stderr
    assert "Traceback" not in done.stderr

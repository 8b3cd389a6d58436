"""The preparer process leaves the tool, ready for the kernel, or a sentence; and it ends with its node."""

import os
import shutil
import signal
import time

import numpy as np
import pytest

from rft_ros.prepare_tool import read_tool, start_preparer, write_tool
from rft_ros.tool import Tool, ToolRequest, load_tool


@pytest.fixture
def preparer():
    started = start_preparer()
    yield started
    started.close()


def answer(preparation):
    until = time.monotonic() + 60.0
    while (found := preparation.poll()) is None:
        assert time.monotonic() < until
        time.sleep(0.01)
    return found


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
    assert (back.name, back.issues, back.plates.reach) == (tool.name, tool.issues, tool.plates.reach)
    assert not back.plates.packed.flags.writeable
    assert back.plates.packed.flags.aligned


def test_tools_are_prepared_one_after_the_other_and_a_bad_one_in_between_is_a_sentence(preparer):
    for name in ("plate", "sphere"):
        tool = answer(preparer.prepare(ToolRequest(name)))
        assert isinstance(tool, Tool)
        assert len(tool.plates) == len(load_tool(name).plates)
        said = answer(preparer.prepare(ToolRequest("gone.stl")))
        assert isinstance(said, str)
        assert "gone.stl" in said


def test_a_later_request_takes_the_place_of_one_that_is_still_on_its_way(preparer):
    first = preparer.prepare(ToolRequest("wheel"))
    first.cancel()
    tool = answer(preparer.prepare(ToolRequest("plate")))
    assert isinstance(tool, Tool)
    assert tool.name == "plate"


def test_a_request_that_cannot_be_handled_at_all_is_a_sentence_too(preparer):
    said = answer(preparer.prepare(ToolRequest("plate", origin="nowhere")))
    assert isinstance(said, str)
    assert "plate" in said
    assert isinstance(answer(preparer.prepare(ToolRequest("plate"))), Tool)


def test_if_the_process_was_killed_the_answer_says_what_to_do():
    preparer = start_preparer()
    os.kill(preparer.pid, signal.SIGKILL)
    said = answer(preparer.prepare(ToolRequest("plate")))
    assert isinstance(said, str)
    assert "start the node again" in said
    preparer.close()

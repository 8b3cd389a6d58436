"""The union of bodies that touch or overlap: the same surface and force as one body of that shape."""

import sys

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import assert_says, refusal
from test_tool_check import boxes, turned

from rft_ros.tool import load_tool, tool_of_mesh, write_union
from rft_ros.tool.union import union_of

pytest.importorskip("manifold3d")
EXTENTS = np.array((0.04, 0.02, 0.06))


@settings(deadline=None, max_examples=20)
@given(
    axis=st.integers(0, 2),
    distance=st.one_of(st.just(1.0), st.floats(0.05, 1.5)),
    place=st.tuples(*[st.floats(-0.1, 0.1)] * 3),
)
def test_the_union_of_two_boxes_has_the_volume_of_both_once_and_no_covered_surface(
    axis, distance, place
):
    tool = tool_of_mesh(boxes(place, place + distance * np.eye(3)[axis] * EXTENTS), name="two")
    union = union_of(tool)
    assert union.volume == pytest.approx(EXTENTS.prod() * (1.0 + min(distance, 1.0)), rel=1e-4)
    assert "overlap" not in tool_of_mesh(union, name="union").issues


def test_a_cavity_stays():
    inner = trimesh.creation.box((0.01,) * 3)
    inner.invert()
    tool = tool_of_mesh(
        trimesh.util.concatenate([trimesh.creation.box((0.03,) * 3), inner]), name="hollow"
    )
    assert union_of(tool).volume == pytest.approx(0.03**3 - 0.01**3, rel=1e-4)


def test_it_is_written_in_the_units_and_coordinates_of_the_mesh(tmp_path):
    boxes((0.0, 0.0, 0.0), (20.0, 0.0, 0.0), extents=(40.0, 20.0, 60.0)).export(
        tmp_path / "two.stl"
    )
    placed = {"scale": 0.001, "origin": (1.0, 2.0, 30.0), "quaternion": (0.0, 0.6, 0.0, 0.8)}
    tool = load_tool(tmp_path / "two.stl", **placed)
    write_union(tmp_path / "one.stl", tool)
    one = load_tool(tmp_path / "one.stl", **placed)
    for bound in (np.min, np.max):
        np.testing.assert_allclose(
            bound(one.vertices, axis=0), bound(tool.vertices, axis=0), atol=1e-7
        )
    assert not {"overlap", "not_closed"} & one.issues.keys()


def test_what_has_no_union_is_named_and_so_is_the_package(monkeypatch):
    box = trimesh.creation.box(EXTENTS)
    for mesh, word in (
        (trimesh.Trimesh(box.vertices, box.faces[1:]), "not closed"),
        (trimesh.Trimesh(box.vertices, turned(box.faces, 3), process=False), "not closed"),
        (trimesh.Trimesh(box.vertices, box.faces[:, ::-1]), "inside out"),
    ):
        assert_says(refusal(union_of, tool_of_mesh(mesh, name="m", file="m.stl")), "m.stl", word)
    monkeypatch.setitem(sys.modules, "manifold3d", None)
    monkeypatch.delitem(sys.modules, "trimesh.boolean")
    assert_says(refusal(union_of, tool_of_mesh(box, name="m")), "pip install manifold3d")

"""Poses or meshes in millimetres are flagged, and what an arm or an excavator does is not."""

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from one_plate import SECOND, estimator, plate_model, pose, push, twist

from rft_ros.cli import main
from rft_ros.estimator import Estimate, QualityFlag, Trust, sentences, trust
from rft_ros.tool import tool_of_mesh

HEADER = "t,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz"


def box(size, shape, *, flange=0.0, unit=1.0):
    """A box of this largest extent [m]; `shape`: shares of it; `flange`: the tool frame [m] above its lower face."""
    mesh = trimesh.creation.box(extents=np.array(shape) / max(shape) * size)
    mesh.apply_translation([0.0, 0.0, -mesh.bounds[0, 2] - flange])
    mesh.apply_scale(unit)
    return tool_of_mesh(mesh, name="box")


def estimated(tool, depth, *, unit=1.0, surface_height=0.0, zeta=0.33):
    """The estimate of a tool pushed down at 10 mm/s, its lowest point this deep; `unit`: of the pose, 1,000 for mm."""
    e = estimator(model=plate_model(tool=tool, zeta=zeta), surface_height=surface_height)
    z = unit * (surface_height - depth - tool.lowest_point(np.eye(3)))
    push(e, twist(SECOND, (0.0, 0.0, -0.01)))
    answer = push(e, pose(SECOND, (0.0, 0.0, z)))
    assert isinstance(answer, Estimate)
    return answer


SHAPES = st.tuples(*3 * [st.floats(0.02, 1.0)])
SIZES = st.floats(np.log(2e-3), np.log(2.5)).map(np.exp)


@settings(max_examples=30, deadline=None)
@given(
    SIZES,
    SHAPES,
    st.floats(0.0, 0.3),
    st.floats(-0.5, 1.0),
    st.floats(0.1, 3.0),
    st.floats(-1.0, 1.0),
)
def test_what_an_arm_or_an_excavator_can_do_is_not_flagged(
    size, shape, flange, share, zeta, height
):
    depth = share * (size + 0.2)
    answer = estimated(box(size, shape, flange=flange), depth, zeta=zeta, surface_height=height)
    assume(np.linalg.norm(answer.predicted[:3]) < 1e5)
    assert not answer.quality_flags & QualityFlag.IMPOSSIBLE


@settings(max_examples=30, deadline=None)
@given(SIZES, SHAPES, st.floats(0.0, 0.3), st.floats(0.05, 1.0), st.floats(0.0, 2.0))
def test_poses_in_millimetres_are_not_trusted(size, shape, flange, share, above):
    tool = box(size, shape, flange=flange)
    depth = 0.002 + share * (size + 0.1)
    # the frame's origin is below the surface too
    assume(depth + tool.lowest_point(np.eye(3)) > 0.01 * size + 0.001)
    deep = estimated(tool, depth, unit=1e3)
    aloft = estimated(tool, -0.06 - above, unit=1e3)
    for answer in (deep, aloft):
        assert answer.quality_flags & QualityFlag.IMPOSSIBLE
        assert trust(answer.quality_flags) is Trust.NO
        assert "millimetres" in sentences(answer.quality_flags)


@settings(max_examples=20, deadline=None)
@given(st.floats(np.log(0.011), np.log(2.5)).map(np.exp), SHAPES, st.floats(0.01, 1.0))
def test_meshes_in_millimetres_are_not_trusted(size, shape, share):
    answer = estimated(box(size, shape, unit=1e3), share * size)
    assert trust(answer.quality_flags) is Trust.NO


@pytest.mark.parametrize(
    ("z", "options", "words"),
    [
        (-20.0, (), ("20.", "deep", "metres", "millimetres")),
        (900.0, (), ("above the grains", "millimetres")),
        (-0.02, ("--scale", "1.0"), ("51 m", "mesh.scale", "--scale", "millimetres")),
        (-0.02, ("--zeta", "1e6"), ("N, more than any arm's", "millimetres")),
        (-0.12, (), ("121.6 mm deep", "lowest point", "--surface-height")),
    ],
)
@pytest.mark.parametrize("command", ["predict", "view"])
def test_predict_and_view_say_what_cannot_be_and_a_first_state_in_the_grains(
    tmp_path, capsys, command, z, options, words
):
    states, out = (
        tmp_path / "states.csv",
        tmp_path / ("out.csv" if command == "predict" else "out.html"),
    )
    rows = np.zeros((3, 14))
    rows[:, 0], rows[:, 7], rows[:, 10] = (0.0, 0.1, 0.2), 1.0, -0.01
    rows[:, 3] = z - 0.01 * rows[:, 0]
    np.savetxt(states, rows, delimiter=",", header=HEADER, comments="")
    assert main([command, str(states), "--mesh", "plate", *options, "-o", str(out)]) == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("warning: ")]
    assert any(all(word in line for word in words) for line in lines), lines


def test_the_motion_of_the_readme_begins_at_the_surface_for_a_tool_below_its_flange(
    tmp_path, monkeypatch, capsys
):
    page = (Path(__file__).parents[2] / "README.md").read_text()
    (script,) = (
        code
        for code in re.findall(r"```python\n(.*?)```", page, re.DOTALL)
        if "states.csv" in code
    )
    tool = trimesh.creation.box(extents=(40.0, 30.0, 120.0))
    tool.apply_translation([0.0, 0.0, -60.0])  # the flange is at the origin
    tool.export(tmp_path / "my_tool.stl")
    monkeypatch.chdir(tmp_path)
    exec(script, {})
    assert main(["predict", "states.csv", "--mesh", "my_tool.stl", "-o", "out.csv"]) == 0
    assert "warning" not in capsys.readouterr().err
    force = np.linalg.norm(np.loadtxt("out.csv", delimiter=",", skiprows=1)[:, 1:4], axis=1)
    assert force[0] < 1e-6 < 1.0 < force[-1]

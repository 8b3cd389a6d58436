"""A link of a URDF as a tool: its meshes where the robot has them, and the sentence for a URDF that cannot be used."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import assert_says, refusal
from scipy.spatial.transform import Rotation

from rft_ros.tool import load_tool, locate_mesh

NO_WIDTH = '<box size="1 0 1"/>'
BOX = trimesh.creation.box((0.1, 0.2, 0.3)).apply_translation((0.01, 0.02, 0.03))


def element(kind, mesh, *, scale="1 1 1", xyz="0 0 0", rpy="0 0 0"):
    place, geometry = (
        f'<origin xyz="{xyz}" rpy="{rpy}"/>',
        f'<mesh filename="{mesh}" scale="{scale}"/>',
    )
    return f"<{kind}>{place}<geometry>{geometry}</geometry></{kind}>"


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """A package that no workspace knows, with a mesh in metres."""
    folder = tmp_path_factory.mktemp("workspace") / "clone"
    for name in ("urdf", "meshes"):
        (folder / name).mkdir(parents=True)
    (folder / "package.xml").write_text("<package><name>digger</name></package>")
    BOX.export(folder / "meshes" / "bucket.stl")
    BOX.export(folder / "meshes" / "bucket.dae")
    return folder


def robot(package, *elements, name="robot.urdf"):
    file = package / "urdf" / name
    file.write_text(
        f'<robot name="r"><link name="base"/><link name="arm/bucket">{"".join(elements)}</link></robot>'
    )
    return f"{file}#arm/bucket"


triple = st.tuples(*[st.floats(-3.0, 3.0).map(lambda x: round(x, 3))] * 3)


@settings(deadline=None, max_examples=20)
@given(
    scale=st.tuples(*[st.sampled_from((-2.0, -0.5, 0.5, 1.0, 3.0))] * 3), xyz=triple, rpy=triple
)
def test_a_link_has_its_mesh_where_the_robot_has_it_with_facets_outward(package, scale, xyz, rpy):
    words = {
        name: " ".join(map(str, value))
        for name, value in (("scale", scale), ("xyz", xyz), ("rpy", rpy))
    }
    tool = load_tool(robot(package, element("collision", "../meshes/bucket.stl", **words)))
    placed = BOX.vertices * scale @ Rotation.from_euler("xyz", rpy).as_matrix().T + xyz
    np.testing.assert_allclose(tool.vertices.min(axis=0), placed.min(axis=0), atol=1e-5)
    np.testing.assert_allclose(tool.vertices.max(axis=0), placed.max(axis=0), atol=1e-5)
    assert "inside_out" not in tool.issues
    assert (tool.name, tool.frame.scale) == ("bucket", 1.0)


@pytest.mark.parametrize("place", ["../meshes/bucket.stl", "package://digger/meshes/bucket.stl"])
@pytest.mark.parametrize("kind", ["collision", "visual"])
def test_collision_meshes_are_joined_and_visual_ones_taken_where_there_are_none(
    package, kind, place
):
    drawn = (
        element("visual", "gone.stl")
        if kind == "collision"
        else "<collision><geometry/></collision>"
    )
    tool = load_tool(
        robot(package, drawn, element(kind, place), element(kind, place, xyz="1 0 0"))
    )
    assert len(tool.faces) == 2 * len(BOX.faces)


def solid(text, *, kind="collision", xyz="0 0 0", rpy="0 0 0"):
    return f'<{kind}><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{text}</geometry></{kind}>'


@pytest.mark.parametrize(
    ("text", "extents"),
    [
        ('<box size="0.1 0.2 0.3"/>', (0.1, 0.2, 0.3)),
        ('<sphere radius="0.1"/>', (0.2, 0.2, 0.2)),
        ('<cylinder radius="0.1" length="0.5"/>', (0.2, 0.2, 0.5)),
        ('<capsule radius="0.1" length="0.5"/>', (0.2, 0.2, 0.7)),
    ],
)
def test_solids_of_a_link_count_alone_and_beside_a_mesh_where_the_robot_has_them(
    package, text, extents
):
    half_turn = f"{np.pi / 2} 0 0"
    alone = load_tool(
        robot(package, solid(text, xyz="1 2 3", rpy=half_turn), element("visual", "gone.stl"))
    )
    x, y, z = extents
    np.testing.assert_allclose(np.ptp(alone.vertices, axis=0), (x, z, y), atol=1e-9)
    np.testing.assert_allclose(alone.vertices.mean(axis=0), (1.0, 2.0, 3.0), atol=1e-3)
    assert not {"not_closed", "inside_out", "inconsistent_winding"} & alone.issues.keys()
    both = load_tool(
        robot(package, element("collision", "../meshes/bucket.stl"), solid(text, xyz="1 2 3"))
    )
    assert len(both.faces) == len(alone.faces) + len(BOX.faces)


@pytest.mark.parametrize("name", ["package://gone/x.stl", "$(find gone)/x.stl"])
def test_a_mesh_of_another_link_is_not_looked_for(package, name):
    file = package / "urdf" / "arm.urdf"
    camera = f'<link name="camera">{element("collision", name)}</link>'
    file.write_text(
        f'<robot name="r">{camera}<link name="b">{element("collision", "../meshes/bucket.stl")}</link></robot>'
    )
    assert len(load_tool(f"{file}#b").faces) == len(BOX.faces)
    assert_says(refusal(load_tool, f"{file}#camera"), "package 'gone'")


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("http://digger/meshes/bucket.stl", "does not exist"),
        ("http://host/{mesh}", "does not exist"),
        ("file://host/{mesh}", "on another machine, 'host'"),
        ("file://digger/meshes/bucket.stl", "on another machine, 'digger'"),
        ("package://digger/{mesh}", "package 'digger'"),
        ("package:///meshes/bucket.stl", "package ''"),
        ("package://digger/../clone/meshes/bucket.stl", "package 'digger'"),
        ("package://digger/%2e%2e/clone/meshes/bucket.stl", "package 'digger'"),
    ],
)
def test_only_a_path_inside_a_package_is_looked_for_above_the_urdf(package, name, word):
    mesh = package / "meshes" / "bucket.stl"
    file = robot(package, element("collision", name.format(mesh=mesh)))
    assert_says(refusal(load_tool, file), word)


def test_a_xacro_file_is_expanded_where_xacro_is_installed_and_else_is_told_what_expands_it(
    package, tmp_path, monkeypatch
):
    file = robot(
        package, element("collision", "$(find digger)/meshes/bucket.stl"), name="robot.urdf.xacro"
    )
    monkeypatch.setenv("PATH", str(tmp_path))
    assert_says(refusal(load_tool, file), "robot.urdf.xacro", "expand it with xacro")
    program = tmp_path / "xacro"
    program.write_text('#!/bin/sh\n/bin/cat "$1"\n')
    program.chmod(0o755)
    assert len(load_tool(file).faces) == len(BOX.faces)
    program.write_text("#!/bin/sh\necho undefined property 1>&2\nexit 1\n")
    assert_says(refusal(load_tool, file), "robot.urdf.xacro", "'undefined property'")
    monkeypatch.setattr("rft_ros.tool.urdf._XACRO_TIMEOUT_S", 0.2)
    program.write_text("#!/bin/sh\necho still at work 1>&2\nexec /bin/sleep 5\n")
    assert_says(refusal(load_tool, file), "robot.urdf.xacro", "timed out after 0.2 seconds")


def test_a_declared_unit_scales_the_mesh_and_mesh_origin_moves_it_in_the_link(package):
    dae = package / "meshes" / "inch.dae"
    text = (package / "meshes" / "bucket.dae").read_text()
    dae.write_text(text.replace("<up_axis>", '<unit name="inch" meter="0.0254"/><up_axis>'))
    tool = load_tool(
        robot(package, element("visual", "../meshes/inch.dae")), origin=(0.0, 0.0, 1.0)
    )
    np.testing.assert_allclose(np.ptp(tool.vertices, axis=0), 0.0254 * BOX.extents)
    np.testing.assert_allclose(
        tool.vertices.mean(axis=0), 0.0254 * BOX.vertices.mean(axis=0) - [0.0, 0.0, 1.0]
    )


def test_the_file_of_a_link_is_the_urdf_and_a_hash_elsewhere_is_part_of_a_name():
    assert locate_mesh("a/robot.urdf#tip").name == "robot.urdf"
    assert locate_mesh("a/tool#1.stl").name == "tool#1.stl"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<robot", ("is not XML", "xacro")),
        ('<robot><link name="a"/></robot>', ("has no link 'tip'", "robot.urdf#LINK", "none")),
        ('<robot><link name="tip"/></robot>', ("has no link 'tip' with a shape",)),
        (
            f'<robot><link name="b">{element("visual", "x.stl")}</link></robot>',
            ("has no link 'tip'", "have one: b"),
        ),
        *(
            (
                f'<robot><link name="tip">{element("visual", "x.stl", **wrong)}</link></robot>',
                words,
            )
            for wrong, words in (
                ({"scale": "1 2"}, ("scale", "'1 2'", "three numbers")),
                ({"rpy": "a b c"}, ("rpy", "'a b c'", "three numbers")),
                ({"xyz": "nan 0 0"}, ("xyz", "three numbers")),
            )
        ),
        (
            f'<robot><link name="tip">{element("visual", "x.stl")}</link></robot>',
            ("x.stl' does not exist",),
        ),
        (
            f'<robot><link name="tip">{solid("<box/>")}</link></robot>',
            ("'tip'", "size", "three numbers"),
        ),
        (
            f'<robot><link name="tip">{solid(NO_WIDTH)}</link></robot>',
            ("size", "[1.0, 0.0, 1.0]", "positive"),
        ),
        (
            f'<robot><link name="tip">{element("visual", "package://gone/x.stl")}</link></robot>',
            ("package 'gone'",),
        ),
    ],
)
def test_a_urdf_that_cannot_be_used_is_named_with_what_to_write(tmp_path, text, words):
    file = tmp_path / "robot.urdf"
    file.write_text(text)
    assert_says(refusal(load_tool, f"{file}#tip"), *words)


def test_a_urdf_without_a_link_lists_the_links_that_have_meshes(package):
    file = robot(package, element("visual", "../meshes/bucket.stl")).partition("#")[0]
    assert_says(refusal(load_tool, file), "has no link ''", "arm/bucket")

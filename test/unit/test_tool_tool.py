"""Tools: plates from a mesh file, the lowest point, copies, and the description."""

import pickle
from copy import deepcopy

import numba
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from rft_ros.rft import INTEGRATIONS
from rft_ros.tool import describe_tool, load_tool

TRIANGLE = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0]]
X_DOWN = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])


@pytest.fixture
def flat(tmp_path):
    trimesh.Trimesh(TRIANGLE, [[0, 1, 2]]).export(tmp_path / "flat.stl")
    return load_tool(tmp_path / "flat.stl")


def test_plates_are_the_facets(tmp_path):
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=20.0)
    mesh.apply_translation([5.0, 0.0, 0.0])
    mesh.export(tmp_path / "ball.stl")
    ball = load_tool(str(tmp_path / "ball.stl"), integration="centroid")
    x, y, z, nx, ny, nz, area = ball.plates.rows
    assert (ball.name, ball.file) == ("ball", str(tmp_path / "ball.stl"))
    assert len(ball.plates) == len(ball.faces) == 1280
    normals = np.stack([nx, ny, nz], axis=1)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-12)
    assert ((np.stack([x - 0.005, y, z], axis=1) * normals).sum(axis=1) > 0.019).all()
    assert area.sum() == pytest.approx(4.0 * np.pi * 0.02**2, rel=0.01)
    np.testing.assert_allclose(area @ normals, 0.0, atol=1e-12)
    np.testing.assert_allclose(
        ball.vertices[ball.faces].mean(axis=1), np.stack([x, y, z], axis=1), atol=1e-15
    )


def test_normals_come_from_the_winding_not_from_the_file(tmp_path):
    mesh = trimesh.creation.box(extents=(10.0, 10.0, 10.0))
    data = bytearray(mesh.export(file_type="stl"))
    for facet in range(12):
        start = 84 + 50 * facet
        data[start : start + 12] = np.array([0.6, 0.0, 0.8], dtype="<f4").tobytes()
    (tmp_path / "box.stl").write_bytes(data)
    np.testing.assert_allclose(
        load_tool(str(tmp_path / "box.stl")).plates.normals.T, mesh.face_normals, atol=1e-6
    )


def test_facets_without_area_are_dropped(tmp_path):
    line = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [20.0, 0.0, 0.0]]
    corners = np.array([line, TRIANGLE, line]).reshape(-1, 3)
    trimesh.Trimesh(corners, np.arange(9).reshape(3, 3), process=False).export(tmp_path / "m.ply")
    tool = load_tool(str(tmp_path / "m.ply"))
    assert len(tool.plates) == len(tool.faces) == 1
    assert tool.plates.area == pytest.approx(50e-6)
    assert "degenerate_facets" in tool.issues
    assert tool.lowest_point(X_DOWN) == pytest.approx(-0.01)


@pytest.mark.parametrize("name", ["ellipsoid", "root_tip", "abb_plate"])
def test_lowest_point_is_that_of_all_vertices(name):
    tool = load_tool(name)
    for rotation in Rotation.random(50, random_state=1).as_matrix():
        assert tool.lowest_point(rotation) == pytest.approx(
            (tool.vertices @ rotation.T)[:, 2].min(), abs=1e-12
        )


def test_lowest_point_of_a_flat_tool_and_without_vertices_that_no_facet_has(flat, tmp_path):
    assert (flat.lowest_point(np.eye(3)), flat.lowest_point(X_DOWN)) == (0.0, pytest.approx(-0.01))
    lines = "v 0 0 -99\nv 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\nf 2 4 3\nf 2 3 5\nf 2 5 4\nf 3 4 5\n"
    (tmp_path / "m.obj").write_text(lines)
    assert load_tool(str(tmp_path / "m.obj")).lowest_point(np.eye(3)) == 0.0


@pytest.mark.parametrize("integration", INTEGRATIONS)
def test_copied_plates_are_the_same_type_to_the_compiler(integration):
    """Writable arrays are another type: passed to code compiled for read-only ones, nothing would check them."""
    plates = load_tool("plate", integration=integration).plates
    for copy in (pickle.loads(pickle.dumps(plates)), deepcopy(plates)):
        assert (copy.reach, copy.integration) == (plates.reach, plates.integration)
        assert np.array_equal(copy.rows, plates.rows)
        assert numba.typeof(copy.packed) == numba.typeof(plates.packed)


def test_description_of_a_good_tool():
    assert describe_tool(load_tool("plate"))[1:] == [
        "facets: 672",
        "x: -25.500 to 25.500 mm (extent 51.000 mm)",
        "y: -25.500 to 25.500 mm (extent 51.000 mm)",
        "z: -1.600 to 1.600 mm (extent 3.200 mm)",
        "lowest point: 1.600 mm below the tool frame's origin (mesh.origin, --origin)",
        "mesh unit: 0.001 m (mesh.scale, --scale)",
        "area: 5854.8 mm²",
        "volume: 8323.2 mm³",
    ]


def test_description_of_an_open_tool_warns_and_gives_no_volume(flat):
    assert describe_tool(flat)[-2:] == [
        "area: 50.0 mm²",
        "warning: the surface is not closed (open edges: 3)",
    ]

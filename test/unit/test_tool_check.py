"""Each finding on a mesh made to have it, and none on a good one."""

import numpy as np
import pytest
import trimesh

from rft_ros.tool import check_mesh, load_tool


def ball(radius=0.02):
    return trimesh.creation.icosphere(subdivisions=2, radius=radius)


def of(vertices, faces):
    return trimesh.Trimesh(vertices, faces, process=False)


def soup(mesh):
    return of(mesh.triangles.reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3))


def found(mesh):
    return {f.kind: f.message for f in check_mesh(mesh)}


def test_good_mesh_has_no_findings():
    assert check_mesh(ball()) == ()


def test_soup_whose_facets_meet_is_closed():
    assert check_mesh(soup(ball())) == ()


@pytest.mark.parametrize("radius", [6e-4, 2.4])
def test_corners_meet_whatever_the_size(radius):
    assert check_mesh(soup(ball(radius))) == ()


def test_check_leaves_the_mesh_alone():
    mesh = soup(ball())
    before = mesh.triangles.copy()
    check_mesh(mesh)
    assert np.array_equal(mesh.triangles, before)


def test_a_hole_is_not_closed():
    mesh = ball()
    holed = of(mesh.vertices, mesh.faces[1:])
    assert found(holed) == {"not_closed": "the surface is not closed (open edges: 3)"}


def test_an_edge_of_three_facets_is_not_closed():
    mesh = ball()
    vertices = np.vstack([mesh.vertices, [0.0, 0.0, 0.03]])
    a, b = mesh.faces[0, :2]
    message = found(of(vertices, np.vstack([mesh.faces, [a, b, len(vertices) - 1]])))["not_closed"]
    assert message == "the surface is not closed (open edges: 2; edges of three or more facets: 1)"


def test_closed_parts_that_share_an_edge_are_not_called_open():
    block = trimesh.creation.box(extents=(0.02, 0.02, 0.02))
    beside = block.vertices + np.array([0.02, 0.02, 0.0])
    both = of(np.vstack([block.vertices, beside]), np.vstack([block.faces, block.faces + 8]))
    assert found(both)["crowded"] == "parts of the surface touch (edges of three or more facets: 1)"
    assert "not_closed" not in found(both)


def test_hollows_point_to_the_advice_on_hulls():
    bowl = trimesh.creation.annulus(r_min=0.018, r_max=0.02, height=0.02)
    assert "use the convex hull (docs/where-it-fails.md)" in found(bowl)["concave"]


def test_a_turned_facet_has_inconsistent_winding():
    mesh = ball()
    faces = mesh.faces.copy()
    faces[7] = faces[7, ::-1]
    message = "the winding is inconsistent (edges between an outward and an inward facet: 3)"
    assert found(of(mesh.vertices, faces)) == {"inconsistent_winding": message}


@pytest.mark.parametrize("make", [lambda mesh: mesh, soup], ids=["joined", "soup"])
def test_an_inside_out_mesh_is_reported(make):
    mesh = ball()
    shrunk = of(mesh.vertices, mesh.faces[:, ::-1])
    volume = mesh.volume * 1e6
    assert found(make(shrunk)) == {
        "inside_out": f"the surface is inside out (volume -{volume:.3g} cm³), so trailing facets count as leading"
    }


def test_inside_out_is_seen_in_a_soup_with_gaps():
    mesh = ball()
    centres = mesh.triangles.mean(axis=1, keepdims=True)
    apart = 0.9 * (mesh.triangles[:, ::-1] - centres) + centres
    assert found(of(apart.reshape(-1, 3), np.arange(3 * len(apart)).reshape(-1, 3))).keys() == {
        "not_closed",
        "inside_out",
    }


def test_open_sheet_is_not_called_inside_out():
    sheet = of([[0, 0, -0.01], [0.02, 0, -0.01], [0, 0.02, -0.01]], [[0, 1, 2]])
    assert found(sheet).keys() == {"not_closed"}


def test_facets_without_area_are_counted_and_open_no_edges():
    mesh = ball()
    a, b, _ = mesh.faces[0]
    with_slivers = of(mesh.vertices, np.vstack([mesh.faces, [[a, a, b], [b, b, b]]]))
    assert found(with_slivers) == {"degenerate_facets": "2 of 322 facets have no area and are dropped"}


def test_facets_on_a_line_have_no_area():
    vertices = np.array([[0.1, 0.1, 0.1], [0.2, 0.3, 0.4], [0.4, 0.7, 1.0], [0.0, 0.0, 1.0]])
    message = found(of(vertices, [[0, 1, 2], [0, 1, 3]]))["degenerate_facets"]
    assert message == "1 of 2 facets have no area and are dropped"


def test_repeated_facet_but_not_the_back_of_a_sheet():
    corners = [[0.0, 0.0, 0.0], [0.02, 0.0, 0.0], [0.0, 0.02, 0.0]]
    assert "duplicate_facets" not in found(of(corners, [[0, 1, 2], [2, 1, 0]]))
    message = "facets that repeat another, so that its force counts again: 1"
    assert found(of(corners, [[0, 1, 2], [1, 2, 0]]))["duplicate_facets"] == message


@pytest.mark.parametrize(
    ("extent", "message"),
    [
        (51.0, "the largest extent is 51 m; if 0.051 m is meant, multiply mesh.scale by 0.001"),
        (51000.0, "the largest extent is 5.1e+04 m; if 0.051 m is meant, multiply mesh.scale by 1e-06"),
        (5.1e-5, "the largest extent is 5.1e-05 m; if 0.051 m is meant, multiply mesh.scale by 1000"),
    ],
)
def test_size_of_a_wrong_unit(extent, message):
    assert found(trimesh.creation.box(extents=(extent, extent / 2, extent / 16))) == {"size": message}


@pytest.mark.parametrize("extent", [0.0011, 4.9])
def test_the_size_of_a_tool_has_no_issue(extent):
    assert check_mesh(trimesh.creation.box(extents=(extent,) * 3)) == ()


def test_facets_too_long_for_the_published_rule_are_named_and_the_refined_rule_takes_them(tmp_path):
    blade = trimesh.creation.box(extents=(60.0, 4.0, 80.0))
    blade.export(tmp_path / "blade.stl")
    (finding,) = load_tool(str(tmp_path / "blade.stl"), integration="centroid").issues
    assert finding.kind == "coarse"
    assert finding.message.startswith("100 % of the surface is in facets longer than a quarter of the tool")
    assert load_tool(str(tmp_path / "blade.stl")).issues == ()
    blade.subdivide().subdivide().subdivide().export(tmp_path / "fine.stl")
    assert load_tool(str(tmp_path / "fine.stl"), integration="centroid").issues == ()

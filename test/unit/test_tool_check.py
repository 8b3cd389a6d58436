"""Each finding on a mesh made to have it, and none on a good one."""

import numpy as np
import pytest
import trimesh
from refusals import assert_says, refusal

from rft_ros.tool.check import check_mesh

BALL = trimesh.creation.icosphere(subdivisions=2, radius=0.02)
SHEET = [[0.0, 0.0, 0.0], [0.02, 0.0, 0.0], [0.0, 0.02, 0.0]]


def of(vertices, faces):
    return trimesh.Trimesh(vertices, faces, process=False)


def soup(triangles):
    return of(np.reshape(triangles, (-1, 3)), np.arange(3 * len(triangles)).reshape(-1, 3))


@pytest.mark.parametrize(
    "mesh",
    [
        BALL,
        soup(BALL.triangles),
        *(soup(trimesh.creation.icosphere(2, radius).triangles) for radius in (2.6e-3, 2.4)),
        *(trimesh.creation.box((extent,) * 3) for extent in (0.0051, 4.9)),
    ],
)
def test_a_good_mesh_or_soup_of_any_usual_size_has_no_issue_and_stays_as_it_is(mesh):
    before = mesh.triangles.copy()
    assert check_mesh(mesh) == {}
    assert np.array_equal(mesh.triangles, before)


def turned(faces, facet):
    faces = faces.copy()
    faces[facet] = faces[facet, ::-1]
    return faces


WINDING = "the winding is inconsistent"
INSIDE_OUT = f"inside out (volume -{BALL.volume * 1e6:.3g} cm³)"
CENTRES = BALL.triangles.mean(axis=1, keepdims=True)


@pytest.mark.parametrize(
    ("mesh", "issues"),
    [
        (
            of(BALL.vertices, BALL.faces[1:]),
            {"not_closed": "the surface is not closed (open edges: 3)"},
        ),
        (
            trimesh.creation.annulus(r_min=0.018, r_max=0.02, height=0.02),
            {"concave": "rft check-mesh says whether the convex hull (mesh.hull"},
        ),
        (of(BALL.vertices, turned(BALL.faces, 7)), {"inconsistent_winding": WINDING}),
        (of(BALL.vertices, BALL.faces[:, ::-1]), {"inside_out": INSIDE_OUT}),
        (soup(BALL.triangles[:, ::-1]), {"inside_out": INSIDE_OUT}),
        (
            soup(0.9 * (BALL.triangles[:, ::-1] - CENTRES) + CENTRES),
            {"not_closed": "", "inside_out": ""},
        ),
        (soup([SHEET]), {"not_closed": ""}),
        (
            of(BALL.vertices, np.vstack([BALL.faces, [[0, 0, 1], [1, 1, 1]]])),
            {"degenerate_facets": "2 of 322 facets have no area: dropped"},
        ),
        (
            of(
                [[0.1, 0.1, 0.1], [0.2, 0.3, 0.4], [0.4, 0.7, 1.0], [0.0, 0.0, 1.0]],
                [[0, 1, 2], [0, 1, 3]],
            ),
            {
                "degenerate_facets": "1 of 2 facets have no area: dropped",
                "not_closed": "",
                "inconsistent_winding": "",
            },
        ),
        (of(SHEET, [[0, 1, 2], [2, 1, 0]]), {}),
        (
            of(SHEET, [[0, 1, 2], [1, 2, 0]]),
            {
                "duplicate_facets": "repeated facets",
                "inconsistent_winding": "",
            },
        ),
        *(
            (
                trimesh.creation.box((e, e / 2, e / 16)),
                {
                    "size": f"is {said} m at mesh.scale 1; if {meant} m is meant, set mesh.scale (--scale) to {by}"
                },
            )
            for e, said, meant, by in (
                (51.0, "51", "0.051", "0.001"),
                (51000.0, "5.1e+04", "0.051", "1e-06"),
                (5.1e-5, "5.1e-05", "0.051", "1000"),
                (0.002, "0.002", "0.0508", "25.4"),
            )
        ),
    ],
)
def test_each_issue_is_named_with_numbers_and_no_other(mesh, issues):
    said = check_mesh(mesh)
    assert said.keys() == issues.keys()
    for kind, text in issues.items():
        assert text in said[kind]


def boxes(*places, extents=(0.04, 0.02, 0.06)):
    return trimesh.util.concatenate(
        [trimesh.creation.box(extents).apply_translation(place) for place in places]
    )


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(("distance", "meets"), [(1.0, True), (0.6, True), (1.1, False)])
def test_bodies_that_touch_or_overlap_are_named_and_bodies_apart_are_not(axis, distance, meets):
    at, side = np.array((0.03, -0.07, 0.01)), np.eye(3)[axis] * (0.04, 0.02, 0.06)
    assert ("overlap" in check_mesh(boxes(at, at + distance * side))) is meets


def test_a_cavity_is_no_body_inside_another():
    inner = trimesh.creation.box((0.01,) * 3)
    inner.invert()
    assert "overlap" not in check_mesh(
        trimesh.util.concatenate([trimesh.creation.box((0.03,) * 3), inner])
    )


def test_a_mesh_smaller_than_the_rounding_of_its_coordinates_is_refused():
    tiny = BALL.copy().apply_scale(1e-8).apply_translation((1e9, 0.0, 0.0))
    assert_says(refusal(check_mesh, tiny), "no facet with an area", "rounding", "unit", "origin")


def test_a_mesh_far_from_the_tool_frame_is_named_with_its_distance():
    far = BALL.copy().apply_translation((3000.0, 4000.0, 0.0))
    assert "5e+03 m" in check_mesh(far)["far"]

"""A tool no finer than its motions need: fewer plates, the same wrench within the tolerance, the same every time."""

import numpy as np
import pytest
import trimesh

from rft_ros.errors import InputError
from rft_ros.rft import MEDIA, Plates, alpha_y_model, checked_states, treers2021, wrenches
from rft_ros.sweeps.motions import OscillatingInsertion, sample
from rft_ros.tool import load_tool
from rft_ros.tool.reduce import merged_plates, random_motions, reduced_for_scene

LAW = treers2021(MEDIA["generic"], alpha_y_model("constant", MEDIA["generic"]))
RULES = ["centroid", "refined"]
INSERTION = checked_states(sample(OscillatingInsertion(), 240)[1])


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("name", ["plate", "root_tip"])
def test_a_reduced_tool_keeps_the_tolerance_in_motions_that_it_was_not_chosen_by(name, rule):
    tool = load_tool(name, integration=rule, tolerance=0.05)
    assert len(tool.plates) < 0.4 * len(tool.facets) == 0.4 * len(tool.faces)
    states = random_motions(tool.corners, 2000, seed=12)
    full, few = (wrenches(plates, LAW, states)[:, :3] for plates in (tool.facets, tool.plates))
    size, off = np.linalg.norm(full, axis=1), np.linalg.norm(few - full, axis=1)
    assert np.percentile(off[size > 0.0] / size[size > 0.0], 95.0) < 0.055
    assert tool.reduction.error <= 0.05
    said = f"{len(tool.facets):,} facets -> {len(tool.plates):,} plates, {100.0 * tool.reduction.error:.1f} %"
    assert str(tool.reduction) == f"{said} at the 95th percentile"


def test_a_smaller_tolerance_takes_more_plates_and_zero_all_of_them():
    counts = [len(load_tool("plate", tolerance=t).plates) for t in (0.1, 0.05, 0.0)]
    assert counts == sorted(set(counts))
    tool = load_tool("plate", tolerance=0.0)
    assert tool.plates is tool.facets
    assert tool.reduction is None


def test_the_same_tool_always_gives_the_same_plates():
    one, two = (load_tool("plate", tolerance=0.05) for _ in range(2))
    np.testing.assert_array_equal(one.plates.rows, two.plates.rows)
    assert one.reduction == two.reduction


def test_a_tool_that_needs_all_its_facets_keeps_them_and_says_so(tmp_path):
    trimesh.creation.box((20.0, 30.0, 40.0)).export(tmp_path / "box.stl")
    tool = load_tool(str(tmp_path / "box.stl"), tolerance=0.01)
    assert tool.plates is tool.facets
    assert str(tool.reduction) == "12 facets, all of them needed for 1 %"


@pytest.mark.parametrize("tolerance", [-0.1, 1.5, float("nan")])
def test_a_tolerance_outside_0_to_1_is_refused_with_a_sentence(tolerance):
    with pytest.raises(InputError, match=r"tolerance is .*; it must lie between 0 \(the full tool\) and 1"):
        load_tool("plate", tolerance=tolerance)


@pytest.mark.parametrize("rule", RULES)
def test_merging_keeps_area_and_first_moment(rule):
    full = load_tool("ellipsoid", integration=rule).facets
    few = merged_plates(full, 100)
    assert 80 <= len(few) <= 100
    assert few.integration == rule
    assert few.area == pytest.approx(full.area, rel=1e-12)
    np.testing.assert_allclose(*(p.packed[:3] @ p.packed[6] for p in (few, full)), atol=1e-12 * full.area)


def test_a_flat_square_merged_to_one_triangle_feels_the_same_wrench_while_it_is_submerged():
    """The triangle has the square's second moments, and so its centre of pressure."""
    square = trimesh.Trimesh([[0, 0, 0], [0, 0.03, 0], [0, 0.03, 0.03], [0, 0, 0.03]], [[0, 2, 1], [0, 3, 2]])
    triangles = square.subdivide().subdivide().triangles - [0.0, 0.015, 0.015]
    full = Plates.from_triangles(triangles, np.full(len(triangles), 0.02))
    one = merged_plates(full, 1)
    assert len(one) == 1
    for q in ([0, 0, 0, 1], [0.3, 0.2, 0.1, 0.9273618495]):
        state = checked_states([0.01, 0.02, -0.06, *q, -0.01, 0.002, -0.003, 0, 0, 0])
        assert np.linalg.norm(wrenches(full, LAW, state)[0, :3]) > 1.0
        np.testing.assert_allclose(wrenches(one, LAW, state), wrenches(full, LAW, state), rtol=1e-9, atol=1e-12)


def test_a_scene_needs_few_plates_and_they_are_facets_with_other_areas():
    tool = load_tool("ellipsoid")
    scene, said = reduced_for_scene(tool.facets, INSERTION, 0.025)
    assert len(scene) < 0.02 * len(tool.facets)
    assert said.error <= 0.025
    assert said.motions == "a scene of 240 states"
    assert (scene.packed[6] > 0.0).all()
    assert {tuple(place) for place in scene.packed[:3].T} <= {tuple(place) for place in tool.facets.packed[:3].T}


@pytest.mark.parametrize(
    ("count", "height", "message"),
    [(19, -0.05, "the scene has 19 states; it needs at least 20"), (40, 1.0, "has no force")],
)
def test_a_scene_without_force_is_refused_with_a_sentence(count, height, message):
    states = np.zeros((count, 13))
    states[:, 2], states[:, 6], states[:, 9] = height, 1.0, -0.01
    with pytest.raises(InputError, match=message):
        reduced_for_scene(load_tool("plate").facets, states, 0.025)


@pytest.mark.parametrize("rule", RULES)
def test_a_single_facet_and_a_thin_plate_can_be_asked_to_be_reduced(tmp_path, rule):
    """Normals that cancel have no mean."""
    trimesh.Trimesh([[0, 0, 0], [10, 0, 0], [0, 10, 0]], [[0, 1, 2]]).export(tmp_path / "one.stl")
    assert len(load_tool(str(tmp_path / "one.stl"), integration=rule, tolerance=0.025).plates) == 1
    assert np.isfinite(load_tool("plate", integration=rule, tolerance=1.0).plates.rows).all()

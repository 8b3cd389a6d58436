"""A tool no finer than its motions need: the same wrench within the tolerance."""

import re

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from test_cli import HEADER

from rft_ros.cli import main
from rft_ros.rft import (
    MEDIA,
    Memory,
    Plates,
    alpha_y_model,
    checked_states,
    treers2021,
    wrenches,
    wrenches_in_time,
)
from rft_ros.sweeps.motions import circumnutation, oscillating_insertion, sample
from rft_ros.tool import load_tool, random_motions
from rft_ros.tool.reduce import merged_plates

LAW = treers2021(MEDIA["generic"], alpha_y_model("constant", MEDIA["generic"]))
RULES = ["centroid", "refined"]
INSERTION = checked_states(sample(oscillating_insertion(), 240)[1])


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("name", ["plate", "root_tip"])
def test_a_reduced_tool_keeps_the_tolerance_in_motions_that_it_was_not_chosen_by(name, rule):
    tool = load_tool(name, integration=rule, tolerance=0.05)
    assert len(tool.plates) < 0.4 * len(tool.facets) == 0.4 * len(tool.faces)
    states = random_motions(tool.corners, 2000, seed=12)
    full, few = (wrenches(plates, LAW, states)[:, :3] for plates in (tool.facets, tool.plates))
    size, off = np.linalg.norm(full, axis=1), np.linalg.norm(few - full, axis=1)
    assert np.percentile(off[size > 0.0] / size[size > 0.0], 95.0) < 0.055
    said = f"{len(tool.facets):,} facets -> {len(tool.plates):,} plates, "
    assert re.fullmatch(
        rf"{said}(4\.\d|5\.0) % at the 95th percentile of any motion", tool.reduction
    )


def reversing_path(tool, random):
    """States from the surface to 0.8 of a depth, back to 0.6, and on to all of it; and that the tool goes down."""
    about = Rotation.from_quat(random.normal(size=4))
    heights = (about.as_matrix() @ tool.corners.T)[2]
    fall, azimuth = random.uniform(np.pi / 6.0, np.pi / 2.0), random.uniform(0.0, 2.0 * np.pi)
    along = np.array(
        [np.cos(fall) * np.cos(azimuth), np.cos(fall) * np.sin(azimuth), -np.sin(fall)]
    )
    way = np.concatenate(
        [np.linspace(0.0, 0.8, 80), np.linspace(0.8, 0.6, 30), np.linspace(0.6, 1.0, 40)]
    )
    states = np.zeros((len(way), 13))
    states[:, :3] = [0.0, 0.0, -heights.min()] + (np.ptp(heights) / np.sin(fall) * way)[
        :, None
    ] * along
    states[:, 3:7] = about.as_quat()
    states[:, 7:10] = np.where(np.diff(way, prepend=0.0) < 0.0, -0.01, 0.01)[:, None] * along
    return states


@pytest.mark.parametrize("name", ["sphere", "plate", "ellipsoid", "root_tip", "scoop"])
def test_with_memory_a_reduced_tool_keeps_the_tolerance_over_the_peak_of_paths_that_reverse(name):
    full, few = (load_tool(name, tolerance=tolerance).plates for tolerance in (0.0, 0.025))
    law = treers2021(
        MEDIA["generic"], alpha_y_model("linear", MEDIA["generic"]), mobilization_length=0.003
    )
    random, errors = np.random.default_rng(2), []
    for _ in range(12):
        states = reversing_path(load_tool(name), random)
        exact, reduced = (wrenches_in_time(p, law, states, Memory(p))[:, :3] for p in (full, few))
        errors.append(
            np.linalg.norm(reduced - exact, axis=1) / np.linalg.norm(exact, axis=1).max()
        )
    assert np.percentile(errors, 95.0) < 0.03


def test_a_smaller_tolerance_takes_more_plates_and_zero_all_of_them():
    counts = [len(load_tool("plate", tolerance=t).plates) for t in (0.1, 0.05, 0.0)]
    assert counts == sorted(set(counts))
    tool = load_tool("plate", tolerance=0.0)
    assert tool.plates is tool.facets
    assert tool.reduction == ""


def test_a_tool_that_needs_all_its_facets_keeps_them_and_says_so(tmp_path):
    trimesh.creation.box((20.0, 30.0, 40.0)).export(tmp_path / "box.stl")
    tool = load_tool(str(tmp_path / "box.stl"), tolerance=0.01)
    assert tool.plates is tool.facets
    assert tool.reduction.startswith("12 facets -> 12 plates, 0.0 %")


@pytest.mark.parametrize("tolerance", [-0.1, 1.5, float("nan")])
def test_a_tolerance_outside_0_to_1_is_refused_with_a_sentence(tolerance):
    with pytest.raises(
        ValueError, match=r"tolerance is .*; it must (lie between 0 .* and 1|be a finite)"
    ):
        load_tool("plate", tolerance=tolerance)


@pytest.mark.parametrize("rule", RULES)
def test_merging_keeps_area_and_first_moment(rule):
    full = load_tool("ellipsoid", integration=rule).facets
    few = merged_plates(full, 100)
    assert 80 <= len(few) <= 100
    assert few.integration == rule
    assert few.area == pytest.approx(full.area, rel=1e-12)
    np.testing.assert_allclose(
        *(p.centroids @ p.areas for p in (few, full)), atol=1e-12 * full.area
    )


def test_a_flat_square_merged_to_one_triangle_feels_the_same_wrench_while_it_is_submerged():
    """The triangle has the square's second moments, and so its centre of pressure."""
    square = trimesh.Trimesh(
        [[0, 0, 0], [0, 0.03, 0], [0, 0.03, 0.03], [0, 0, 0.03]], [[0, 2, 1], [0, 3, 2]]
    )
    triangles = square.subdivide().subdivide().triangles - [0.0, 0.015, 0.015]
    full = Plates.from_triangles(triangles, np.full(len(triangles), 0.02))
    one = merged_plates(full, 1)
    assert len(one) == 1
    for q in ([0, 0, 0, 1], [0.3, 0.2, 0.1, 0.9273618495]):
        state = checked_states([0.01, 0.02, -0.06, *q, -0.01, 0.002, -0.003, 0, 0, 0])
        assert np.linalg.norm(wrenches(full, LAW, state)[0, :3]) > 1.0
        np.testing.assert_allclose(
            wrenches(one, LAW, state), wrenches(full, LAW, state), rtol=1e-9, atol=1e-12
        )


@pytest.mark.parametrize("rule", RULES)
def test_a_single_facet_and_a_thin_plate_can_be_asked_to_be_reduced(tmp_path, rule):
    """Normals that cancel have no mean."""
    trimesh.Trimesh([[0, 0, 0], [10, 0, 0], [0, 10, 0]], [[0, 1, 2]]).export(tmp_path / "one.stl")
    assert len(load_tool(str(tmp_path / "one.stl"), integration=rule, tolerance=0.025).plates) == 1
    assert np.isfinite(load_tool("plate", integration=rule, tolerance=1.0).plates.rows).all()


def write_states(file, height=0.0):
    times = 0.25 * np.arange(85)
    states = circumnutation().at(times)
    states[:, 2] += height
    np.savetxt(file, np.column_stack([times, states]), delimiter=",", header=HEADER, comments="")
    return str(file)


def test_predict_reduces_when_it_is_asked_to(tmp_path, capsys):
    given = [
        "predict",
        write_states(tmp_path / "states.csv"),
        "--mesh",
        "plate",
        "-o",
        str(tmp_path / "out.csv"),
    ]
    assert main([*given, "--tolerance", "0.1"]) == 0
    assert "plate: 672 facets -> " in capsys.readouterr().out

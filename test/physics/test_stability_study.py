"""The study of failures: its measures where the answer is known, and the figures it writes."""

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

from studies.concave_tools import blocked, bowl, concavity, fork, resistance
from studies.stability import share_in_wake, study


def test_a_convex_tool_shadows_no_facet_and_a_hemisphere_half_of_them():
    assert concavity(trimesh.creation.box((1.0, 2.0, 3.0)).triangles) == 0.0
    ball = trimesh.creation.icosphere(3).triangles[:, ::-1]  # seen from inside
    assert concavity(ball[ball.mean(axis=1)[:, 2] > 0.0]) == pytest.approx(0.5, abs=0.02)


def test_a_plate_behind_another_is_blocked_in_the_direction_of_motion_and_not_to_the_side():
    pair = fork(0.005)
    on = blocked(pair.triangles, np.tile([1.0, 0.0, 0.0], (len(pair.faces), 1)))
    front = pair.triangles_center[:, 0] > 0.0026
    assert not on[front].any()
    assert on[pair.triangles_center[:, 0] < -0.0056].all()
    assert not blocked(pair.triangles, pair.face_normals)[np.abs(pair.face_normals[:, 1]) > 0.9].any()


def test_two_plates_close_together_count_twice_where_shadowing_would_count_one():
    counted, lit = resistance(fork(0.0025), np.array([1.0, 0.0, 0.0]))
    assert counted == pytest.approx(2.0 * lit, rel=0.06)


def test_a_bowl_pushed_mouth_first_counts_for_less_than_the_disc_that_its_plug_would_be():
    down = np.array([0.0, 0.0, -1.0])
    (disc, _), (deep, lit) = resistance(bowl(0.0), down), resistance(bowl(0.025), down)
    assert 0.55 * disc < deep < 0.7 * disc
    assert lit == pytest.approx(deep, rel=0.01)


def test_a_helix_of_less_pitch_has_more_of_its_force_from_its_own_wake():
    tight, wide = share_in_wake(0.02), share_in_wake(0.08)
    assert 0.25 < tight < 0.45
    assert wide < 0.05


def test_every_figure_of_the_study_is_on_the_page():
    page = (Path(__file__).parents[2] / "docs/where-it-fails.md").read_text(encoding="utf-8")
    drawn = {f"{result.name}.png" for result in study() if result.figure}
    assert drawn == set(re.findall(r"\(images/(fails_\w+\.png)\)", page))

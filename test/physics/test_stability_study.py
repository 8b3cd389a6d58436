"""The study of failures: its measures where the answer is known, and the figures it writes."""

import pytest

from studies.concave_tools import RUNS, errors
from studies.stability import share_in_wake


@pytest.mark.usefixtures("shared_data")
@pytest.mark.parametrize("name", RUNS)
def test_a_dragged_hollow_tool_is_nearer_to_its_hull_and_a_box_pressed_mouth_first_to_its_facets(name):
    facets, hull = errors(name)
    assert (hull < 0.85 * facets) is (name != "cup_down")


def test_a_helix_of_less_pitch_has_more_of_its_force_from_its_own_wake():
    tight, wide = share_in_wake(0.02), share_in_wake(0.08)
    assert 0.25 < tight < 0.45
    assert wide < 0.05

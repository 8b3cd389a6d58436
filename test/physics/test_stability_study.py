"""The study of failures: its measures where the answer is known, and the figures it writes."""

import pytest

from studies.concave_tools import RUNS, errors
from studies.stability import share_in_wake


@pytest.mark.usefixtures("shared_data")
def test_the_hull_that_check_mesh_recommends_predicts_dragged_hollow_tools_and_facets_the_beginning_of_a_press():
    error = {name: errors(name) for name in RUNS}
    assert [
        error[name][1] <= most
        for name, most in (("rake", 0.15), ("cup_fwd", 0.25), ("pair9", 0.26))
    ] == [True] * 3
    facets, hull = error["cup_down"]
    assert facets < hull


def test_a_helix_of_less_pitch_has_more_of_its_force_from_its_own_wake():
    tight, wide = share_in_wake(0.02), share_in_wake(0.08)
    assert 0.25 < tight < 0.45
    assert wide < 0.05

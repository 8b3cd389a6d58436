"""The study of failures: its measures where the answer is known, and the figures it writes."""

import numpy as np
import pytest

from studies.concave_tools import bowl, fork, resistance
from studies.stability import share_in_wake


def test_two_plates_close_together_count_nearly_twice_and_a_bowl_for_less_than_the_disc_of_its_plug():
    forward, down = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0])
    close, hull = fork(0.0025), fork(0.0025).convex_hull.subdivide()
    assert resistance(close, forward) == pytest.approx(1.86 * resistance(hull, forward), rel=0.02)
    assert 0.55 < resistance(bowl(0.025), down) / resistance(bowl(0.0), down) < 0.7


def test_a_helix_of_less_pitch_has_more_of_its_force_from_its_own_wake():
    tight, wide = share_in_wake(0.02), share_in_wake(0.08)
    assert 0.25 < tight < 0.45
    assert wide < 0.05

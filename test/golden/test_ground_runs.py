"""What a map of the ground is worth on four passes through one trench; the limits are the docs' table, rounded up."""

import numpy as np
import pytest

from studies.ground import four_passes
from studies.learning import learned, pass_errors


@pytest.fixture(scope="module")
def runs():
    return four_passes()


def test_a_map_before_each_pass_explains_the_passes_after_the_first(runs):
    on_level, on_map = (pass_errors(series, series.rows[:, :3]) for series in runs)
    assert on_map[0] == on_level[0]
    assert np.mean(on_level) > 0.34
    assert np.mean(on_map) < 0.26
    assert max(on_map) < 0.30


def test_the_map_helps_learning_that_lags(runs):
    level, ground = (
        np.mean(pass_errors(series, learned(series, lag=0.005).out)) for series in runs
    )
    assert ground < 0.85 * level

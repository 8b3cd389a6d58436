"""The wrench below an inclined surface: depth is vertical, and the level plane is the special case."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scenes import LINEAR as LAW

from rft_ros.rft import wrenches
from rft_ros.tool import load_tool

TOOLS = {rule: load_tool("ellipsoid", integration=rule) for rule in ("centroid", "refined")}
PLATE = load_tool("plate", integration="refined")
SLOPES = st.tuples(*(st.floats(-0.3, 0.3) for _ in range(2)))


def states(n=8, seed=3):
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(n, 4))
    return np.hstack(
        [
            0.02 * rng.normal(size=(n, 3)),
            q / np.linalg.norm(q, axis=1)[:, None],
            0.05 * rng.normal(size=(n, 6)),
        ]
    )


@pytest.mark.parametrize("slope", [None, 0.1, (0.1,), "ab", (np.nan, 0.0), (0.0, np.inf)])
def test_a_slope_that_is_not_two_numbers_is_refused(slope):
    with pytest.raises(ValueError, match="slope"):
        wrenches(PLATE.plates, LAW, states(), slope=slope)


@pytest.mark.parametrize("rule", TOOLS)
def test_a_slope_of_zero_gives_the_bits_of_the_level_plane(rule):
    plates = TOOLS[rule].plates
    level = wrenches(plates, LAW, states(), surface_height=0.003, sensitivities=True)
    assert_array_equal(
        wrenches(
            plates, LAW, states(), surface_height=0.003, slope=(-0.0, 0.0), sensitivities=True
        ),
        level,
    )


@pytest.mark.parametrize("rule", TOOLS)
@given(slope=SLOPES, x=st.floats(-1.0, 1.0), y=st.floats(-1.0, 1.0))
def test_a_shift_along_the_slope_changes_nothing(rule, slope, x, y):
    plates, here = TOOLS[rule].plates, states()
    there = here.copy()
    there[:, :3] += (x, y, slope[0] * x + slope[1] * y)
    assert_allclose(
        wrenches(plates, LAW, there, slope=slope),
        wrenches(plates, LAW, here, slope=slope),
        rtol=1e-6,
        atol=1e-9,
    )


@given(slope=SLOPES, depth=st.floats(0.02, 0.05))
def test_a_submerged_horizontal_plate_feels_the_depth_of_its_middle(slope, depth):
    state = [0.0, 0.0, -depth, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -0.01, 0.0, 0.0, 0.0]
    below = wrenches(PLATE.plates, LAW, state, slope=slope)[0]
    level = wrenches(PLATE.plates, LAW, state)[0]
    assert_allclose(below[2], level[2], rtol=1e-9)
    assert below[6] == pytest.approx(level[6])


def test_inertia_of_a_submerged_plate_is_the_same_on_a_slope():
    fast = replace(LAW, density=2000.0, inertia=1.0)
    state = [0.0, 0.0, -0.05, 0.0, 0.0, 0.0, 1.0, 0.3, 0.0, -0.4, 0.0, 0.0, 0.0]
    level, inclined = (
        wrenches(PLATE.plates, fast, state, slope=slope)
        - wrenches(PLATE.plates, LAW, state, slope=slope)
        for slope in ((0.0, 0.0), (0.2, -0.1))
    )
    assert level[0, 2] > 0.1
    assert_allclose(inclined[:, :3], level[:, :3], rtol=1e-9, atol=1e-9)
    # it acts at the centre of load, which the slope moves by some micrometres
    assert_allclose(inclined[:, 3:6], level[:, 3:6], atol=1e-5 * level[0, 2])

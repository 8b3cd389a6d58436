"""Grains resist: the power of the force on a leading plate, and the one fit that breaks this."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import RULES, directions

from rft_ros.rft import MEDIA, alpha_y_model, treers2021, wrenches
from studies.force_jumps import greatest_power, plate_facing

ZERO_OF_LINEAR = 0.2035 / 0.0015
"""β at which the paper's linear α_y passes through zero [deg]; at 180° it is -0.0665 N/cm³."""


def power(law, rule, beta, v):
    """Of one plate, over area, depth and speed [N/cm³]."""
    plate = plate_facing(np.radians(beta), rule)
    state = np.array([[0, 0, -1.0, 0, 0, 0, 1, *v, 0, 0, 0]])
    return float(wrenches(plate, law, state)[0, :3] @ v / (1e6 * plate.area))


@RULES
@pytest.mark.parametrize("model", ["constant", "linear"])
@given(medium=st.sampled_from(sorted(MEDIA)), beta=st.floats(0.0, 180.0), v=directions())
def test_no_leading_plate_is_pushed_on_but_with_alpha_y_linear_those_that_look_up(model, rule, medium, beta, v):
    """In any direction, γ < 0 too: a fortiori in intrusion. The linear fit's push is bounded."""
    law = treers2021(MEDIA[medium], alpha_y_model(model, MEDIA[medium]))
    breaks = model == "linear" and beta > ZERO_OF_LINEAR
    assert power(law, rule, beta, v) <= (0.0015 * beta - 0.2035 if breaks else 0.0) + 1e-12


@RULES
def test_the_break_of_the_linear_fit_is_reached(rule):
    """About 0.06 N/cm³, a fifteenth of α_z(0, 90°), for a face that looks up and moves along itself."""
    assert 0.05 < greatest_power(np.radians(174.0), rule, "linear", intruding=False) < 0.0665
    assert 0.03 < greatest_power(np.radians(165.0), rule, "linear", intruding=True) < 0.0665
    assert greatest_power(np.radians(130.0), rule, "linear", intruding=False) < 0.0
    assert greatest_power(np.radians(180.0), rule, "linear", intruding=True) == -np.inf

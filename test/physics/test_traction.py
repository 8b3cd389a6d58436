"""One plate: the law against the published rule written with atan2, tanh and atanh, and against closed forms."""

import math

import published_rule as rule
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from scenes import CONSTANT, FLAT, GENERIC, directions
from single_plate import traction_per_depth

from rft_ros.rft import (
    ALPHA_Y_MODELS,
    MEDIA,
    Plates,
    Table,
    alpha_y_model,
    checked_states,
    treers2021,
    wrenches,
)


def force(law, n, v):
    """The compiled force on a plate of 1 m² with normal n, 1 m deep."""
    plate = Plates.from_arrays([[0, 0, 0]], [n], [1.0])
    return wrenches(plate, law, checked_states([0, 0, -1.0, 0, 0, 0, 1, *v, 0, 0, 0]))[
        0, :3
    ].tolist()


steep = st.one_of(directions(), directions(-1.0, -0.99), directions(0.99, 1.0))


@pytest.mark.parametrize("model", ALPHA_Y_MODELS)
@example(
    n=(0.0044721247746346, 0.0, -0.99999),
    v=(-0.36039373215435, 0.78747467122686, -0.5),
    zeta=1.0,
    name="generic",
)
@given(n=steep, v=steep, zeta=st.floats(0.01, 100.0), name=st.sampled_from(sorted(rule.MEDIA)))
def test_the_traction_of_any_plate_in_any_medium_and_its_force_are_the_published_rules(
    model, n, v, zeta, name
):
    # On the two edges of the rule, leading or not and horizontal or not, rounding decides.
    assume(abs(rule.dot(n, v)) > 1e-12 and abs(abs(n[2]) - FLAT) > 1e-12)
    assert model in rule.ALPHA_Y, "write the model's formula by hand in published_rule.py"
    alpha_y = alpha_y_model(model, MEDIA[name], Table.sampled(*rule.TABLE))
    law = treers2021(MEDIA[name], alpha_y, zeta=zeta)
    expected = rule.plate_force(n, v, 1.0, 1.0, name, zeta, rule.ALPHA_Y[model](name))
    assert force(law, n, v) == pytest.approx(expected, abs=1e-10 * zeta * 1e6)
    if rule.dot(n, v) > 0.0:
        assert traction_per_depth(law, *n, *v) == pytest.approx(expected, abs=1e-10 * zeta * 1e6)


@given(azimuth=st.floats(0.0, 360.0), v=directions(-0.999, -0.1))
def test_just_under_the_horizontal_threshold_e2_is_the_normals_and_just_above_it_the_velocitys(
    azimuth, v
):
    """The rule jumps there, as published; on either side it is continuous, so that a hair changes a hair."""
    a = math.radians(azimuth)
    for nz, e2 in ((FLAT - 1e-9, (math.cos(a), math.sin(a))), (FLAT + 1e-9, (v[0] + 1e-5, v[1]))):
        h = math.sqrt(1.0 - nz * nz)
        n = (h * math.cos(a), h * math.sin(a), -nz)
        tx, ty, tz = traction_per_depth(CONSTANT, *n, *v)
        e2x, e2y = e2[0] / math.hypot(*e2), e2[1] / math.hypot(*e2)
        beta = math.atan2(n[2], n[0] * e2x + n[1] * e2y) + math.pi / 2
        v2 = v[0] * e2x + v[1] * e2y
        gamma = -math.atan2(v[2], v2)
        weight = rule.f23(math.hypot(v2, v[2]))
        assert tz == pytest.approx(1e6 * weight * rule.alpha_z("generic", beta, gamma), abs=1e-3)
        assert tx * e2x + ty * e2y == pytest.approx(
            -1e6 * weight * rule.alpha_x("generic", beta, gamma), abs=1e-3
        )
        near = traction_per_depth(CONSTANT, *n, v[0] + 1e-9, v[1], v[2])
        assert near == pytest.approx((tx, ty, tz), abs=1e6 * 1e-5)


@pytest.mark.parametrize("zeta", [0.0, -1.0, math.nan, math.inf])
def test_zeta_must_be_a_positive_number(zeta):
    with pytest.raises(ValueError, match=r"medium\.zeta is .*; it must be a positive number"):
        treers2021(GENERIC, alpha_y_model("constant", GENERIC), zeta=zeta)

"""One plate: the law against the published rule written with atan2, tanh and atanh, and against closed forms."""

import math

import published_rule as rule
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scenes import CONSTANT, FLAT, GENERIC, LINEAR, directions

from rft_ros.rft import MEDIA, Plates, alpha_y_model, checked_states, traction_per_depth, treers2021, wrenches

LAWS = pytest.mark.parametrize(
    ("law", "alpha_y"), [(CONSTANT, rule.constant("generic")), (LINEAR, rule.linear)], ids=["constant", "linear"]
)
zetas = st.floats(0.01, 100.0)


def force(law, n, v, depth=0.02, area=3e-4):
    """The compiled force on one plate with normal n whose centroid is the tool frame's origin, at the given depth."""
    plate = Plates.from_arrays([[0, 0, 0]], [n], [area])
    return wrenches(plate, law, checked_states([0, 0, -depth, 0, 0, 0, 1, *v, 0, 0, 0]))[0, :3].tolist()


def law_of_angles(medium, beta, gamma):
    """Traction per depth at (β, γ) [deg] of a plate whose e2 is x and which does not move along e1."""
    b, g = math.radians(beta), math.radians(gamma)
    law = treers2021(MEDIA[medium], alpha_y_model("constant", MEDIA[medium]))
    return traction_per_depth(law, math.sin(b), 0.0, -math.cos(b), math.cos(g), 0.0, -math.sin(g))


steep = st.one_of(directions(), directions(-1.0, -0.99), directions(0.99, 1.0))


@LAWS
@given(n=steep, v=steep)
def test_the_force_on_any_plate_is_the_published_rule(law, alpha_y, n, v):
    # On the two edges of the rule, leading or not and horizontal or not, rounding decides.
    assume(abs(rule.dot(n, v)) > 1e-12 and abs(abs(n[2]) - FLAT) > 1e-12)
    expected = rule.plate_force(n, v, 0.02, 3e-4, "generic", 1.0, alpha_y)
    assert force(law, n, v) == pytest.approx(expected, abs=1e-10 * 0.02 * 3e-4 * 1e6)


@given(n=directions(), v=directions(), zeta=zetas, name=st.sampled_from(sorted(rule.MEDIA)))
def test_the_law_in_plain_python_is_the_published_rule_for_every_medium(n, v, zeta, name):
    assume(abs(rule.dot(n, v)) > 1e-12 and abs(abs(n[2]) - FLAT) > 1e-12)
    if rule.dot(n, v) < 0.0:
        v = tuple(-c for c in v)
    law = treers2021(MEDIA[name], alpha_y_model("constant", MEDIA[name]), zeta=zeta)
    expected = rule.plate_force(n, v, 1.0, 1.0, name, zeta, rule.constant(name))
    assert traction_per_depth(law, *n, *v) == pytest.approx(expected, abs=1e-10 * zeta * 1e6)


def test_a_horizontal_plate_pushed_straight_down_feels_alpha_z_at_zero_and_90_degrees():
    """A00 + A10 + B11 sin 90° + B01 sin 90° + B-11 sin 90° = 1 N/cm³ for the generic medium; 3 cm² at 2 cm: 6 N up."""
    fx, fy, fz = force(CONSTANT, (0, 0, -1), (0, 0, -0.01))
    assert fz == pytest.approx((0.206 + 0.169 + 0.212 + 0.358 + 0.055) * 2.0 * 3.0, rel=1e-9)
    assert math.hypot(fx, fy) < 1e-3 * fz


def test_a_vertical_plate_pushed_broadside_feels_alpha_x_at_90_and_zero_degrees_against_its_motion():
    """α_x(90°, 0) = -C11 + C01 - C-11, and α_z(90°, 0) = A00 - A10 + B11 sin 180° + B-11 sin(-180°)."""
    fx, fy, fz = force(CONSTANT, (1, 0, 0), (0.01, 0, 0))
    assert fx == pytest.approx(-(0.124 + 0.253 - 0.007) * 2.0 * 3.0, rel=1e-9)
    assert fy == pytest.approx(0.0, abs=1e-12)
    assert fz == pytest.approx((0.206 - 0.169) * 2.0 * 3.0, rel=1e-9)


def test_beta_is_zero_for_a_plate_that_faces_down_and_90_degrees_for_a_vertical_one():
    """Read back from the linear α_y of a plate that moves almost along e1, where nothing else is left."""
    for beta in (3.0, 45.0, 90.0, 120.0):
        n = (math.sin(math.radians(beta)), 0.0, -math.cos(math.radians(beta)))
        v = (1e-9 * n[0], -1.0, 1e-9 * n[2])
        _, along_e1, _ = traction_per_depth(LINEAR, *n, *v)
        assert (0.2035 - along_e1 / 1e6) / 0.0015 == pytest.approx(beta, abs=1e-6)


def test_gamma_is_positive_for_a_plate_that_moves_down():
    """A plate at β = 45° meets more stress going down (γ = 30°) than going up (γ = -30°); e1 plays no part."""
    down, up = law_of_angles("generic", 45.0, 30.0), law_of_angles("generic", 45.0, -30.0)
    assert down[2] == pytest.approx(1e6 * rule.alpha_z("generic", math.pi / 4, math.pi / 6), rel=1e-9)
    assert up[2] == pytest.approx(1e6 * rule.alpha_z("generic", math.pi / 4, -math.pi / 6), rel=1e-9)
    assert down[2] > up[2]


@pytest.mark.parametrize("medium", rule.MEDIA)
@given(beta=st.floats(2.6, 177.4), gamma=st.floats(-180.0, 180.0))
def test_across_e1_the_law_is_the_nine_term_fit_of_li_2013(medium, beta, gamma):
    """With no velocity along e1, f23 = 1 and the traction is (-α_x, α_z) in the e2-E3 plane."""
    tx, ty, tz = law_of_angles(medium, beta, gamma)
    b, g = math.radians(beta), math.radians(gamma)
    assert tx == pytest.approx(-1e6 * rule.alpha_x(medium, b, g), abs=1e-4)
    assert ty == pytest.approx(0.0, abs=1e-4)
    assert tz == pytest.approx(1e6 * rule.alpha_z(medium, b, g), abs=1e-4)


@given(n=directions(-0.7, 0.7), v=directions())
def test_along_e1_the_force_opposes_the_motion(n, v):
    """Up to β = 135.7°, beyond which the published line is negative: abs(n·E3) <= 0.7 keeps β under 134.4°."""
    e1, _ = rule.directions(n, v)
    v1 = rule.dot(v, e1)
    assume(abs(v1) > 1e-6)
    for law in (CONSTANT, LINEAR):
        assert rule.dot(traction_per_depth(law, *n, *v), e1) * v1 < 0.0


@given(n=directions(), v=directions(), factor=st.floats(0.1, 10.0))
def test_the_force_on_a_plate_grows_with_depth_area_and_zeta_alone(n, v, factor):
    once = force(CONSTANT, n, v)
    tolerance = 1e-12 * factor * 6.0
    scaled = [factor * component for component in once]
    assert force(CONSTANT, n, v, depth=0.02 * factor) == pytest.approx(scaled, abs=tolerance)
    assert force(CONSTANT, n, v, area=3e-4 * factor) == pytest.approx(scaled, abs=tolerance)
    stronger = treers2021(GENERIC, alpha_y_model("constant", GENERIC), zeta=factor)
    assert force(stronger, n, v) == pytest.approx(scaled, abs=tolerance)


@given(azimuth=st.floats(0.0, 360.0), v=directions(-0.999, -0.1))
def test_just_under_the_horizontal_threshold_e2_is_the_normals_and_just_above_it_the_velocitys(azimuth, v):
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
        assert tx * e2x + ty * e2y == pytest.approx(-1e6 * weight * rule.alpha_x("generic", beta, gamma), abs=1e-3)
        near = traction_per_depth(CONSTANT, *n, v[0] + 1e-9, v[1], v[2])
        assert near == pytest.approx((tx, ty, tz), abs=1e6 * 1e-5)


@given(beta=st.floats(10.0, 80.0), azimuth=st.floats(0.0, 360.0), psi=st.floats(-80.0, 80.0))
def test_turning_a_plate_and_its_motion_about_the_vertical_turns_its_traction(beta, azimuth, psi):
    b, a, p = (math.radians(angle) for angle in (beta, azimuth, psi))

    def at(turn):
        n = (math.sin(b) * math.cos(turn), math.sin(b) * math.sin(turn), -math.cos(b))
        v = (0.8 * math.cos(turn + p), 0.8 * math.sin(turn + p), -0.6)
        return traction_per_depth(LINEAR, *n, *v)

    x, y, z = at(0.0)
    turned = (x * math.cos(a) - y * math.sin(a), x * math.sin(a) + y * math.cos(a), z)
    assert at(a) == pytest.approx(turned, abs=1e-6)


@pytest.mark.parametrize("zeta", [0.0, -1.0, math.nan, math.inf])
def test_zeta_must_be_a_positive_number(zeta):
    with pytest.raises(ValueError, match=r"medium\.zeta is .*; it must be a positive number"):
        treers2021(GENERIC, alpha_y_model("constant", GENERIC), zeta=zeta)

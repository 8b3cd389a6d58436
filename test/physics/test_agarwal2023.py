"""The law of Agarwal, Goldman and Kamrin (2023): its polynomials, its limits and its symmetries."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import AGARWAL, GENERIC, RULES, directions, facing
from single_plate import traction_per_depth

from rft_ros.rft import LAWS, Agarwal2023, alpha_y_model, law_named, wrenches
from rft_ros.rft.agarwal2023 import C1, C2, C3, FLAT_PRESS

ROUGH = Agarwal2023(surface_friction=1e6)
"""A surface so rough that it limits nothing."""

UPRIGHT = math.sin(math.radians(5.0))


def published(normal, velocity):
    """α in units of ξ, from the paper's angles β, γ, ψ in the frame of r, θ, z; written from the paper's text."""
    n, v = np.asarray(normal), np.asarray(velocity) / np.linalg.norm(velocity)
    n = n if n[2] <= 0.0 else -n  # the polynomials know normals that do not look up
    r = np.array([v[0], v[1], 0.0])
    r = r / np.linalg.norm(r) if np.linalg.norm(r) > 1e-12 else np.array([1.0, 0.0, 0.0])
    theta = np.cross([0.0, 0.0, 1.0], r)
    gamma = math.asin(-v[2])
    side = 1.0 if n @ r >= 0.0 else -1.0
    beta = side * math.acos(min(-n[2], 1.0))
    psi = math.atan2(side * (n @ theta), side * (n @ r))
    x1, x2 = math.sin(gamma), math.cos(beta)
    x3 = math.cos(psi) * math.cos(gamma) * math.sin(beta) + math.sin(gamma) * math.cos(beta)
    terms = np.array(
        [
            *(1, x1, x2, x3, x1**2, x2**2, x3**2, x1 * x2, x2 * x3, x3 * x1, x1**3, x2**3, x3**3),
            *(
                x1 * x2**2,
                x2 * x1**2,
                x2 * x3**2,
                x3 * x2**2,
                x3 * x1**2,
                x1 * x3**2,
                x1 * x2 * x3,
            ),
        ]
    )
    f1, f2, f3 = terms @ C1, terms @ C2, terms @ C3
    along_r = f1 * math.sin(beta) * math.cos(psi) + f2 * math.cos(gamma)
    along_theta = f1 * math.sin(beta) * math.sin(psi)
    up = -f1 * math.cos(beta) - f2 * math.sin(gamma) - f3
    return along_r * r + along_theta * theta + np.array([0.0, 0.0, up])


def traction(law, normal, velocity):
    return np.array(traction_per_depth(law, *normal, *velocity)) / law.stiffness


@given(normal=directions(), velocity=directions())
def test_it_is_the_published_polynomial_wherever_grains_press_and_the_plate_is_not_upright(
    normal, velocity
):
    expected = published(normal, velocity)
    if abs(normal[2]) < UPRIGHT or np.dot(normal, velocity) <= 0.0 or expected @ normal > 0.0:
        return
    # of acos near 1
    np.testing.assert_allclose(traction(ROUGH, normal, velocity), expected, rtol=0, atol=1e-7)


def test_a_flat_plate_pressed_straight_down_feels_the_same_as_by_treers():
    """α_z(β = 0, γ = 90°) is 0.876 ξ; ξ is chosen so that this is ζ N/cm³, as with Li's generic coefficients."""
    assert pytest.approx(0.87574) == FLAT_PRESS
    for name in LAWS:
        law = law_named(name, GENERIC, alpha_y_model("constant", GENERIC), zeta=0.3)
        assert traction_per_depth(law, 0.0, 0.0, -1.0, 0.0, 0.0, -1.0) == pytest.approx(
            (0.0, 0.0, 0.3e6), abs=3.0
        )


def test_an_upright_plate_moved_against_the_grains_is_pushed_back_and_slightly_up():
    """The mean of the published values with the normal just below and just above the horizontal."""
    along, _, up = traction(ROUGH, (1.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    just_below, just_above = (published((1.0, 0.0, z), (1.0, 0.0, 0.0)) for z in (-1e-12, 1e-12))
    assert along == pytest.approx(0.5 * (just_below[0] + just_above[0]), abs=1e-9)
    assert up == pytest.approx(0.5 * (just_below[2] + just_above[2]), abs=1e-9)
    assert along < 0.0 < up


def test_the_published_force_on_an_upright_plate_jumps_by_a_fifth_and_this_one_does_not():
    """The fit meets the two signs of an upright normal only roughly; the sign changes over 5° here."""
    below, above = (published((1.0, 0.0, z), (1.0, 0.0, 0.0))[0] for z in (-1e-9, 1e-9))
    assert abs(below - above) > 0.15 * abs(below)
    tilts = np.linspace(-0.2, 0.2, 4001)
    force = np.array(
        [traction(AGARWAL, (math.cos(t), 0.0, math.sin(t)), (1.0, 0.0, -0.2)) for t in tilts]
    )
    assert (
        np.linalg.norm(np.diff(force, axis=0), axis=1).max()
        < 1e-3 * np.linalg.norm(force, axis=1).max()
    )


@given(normal=directions(), velocity=directions(), friction=st.floats(0.0, 2.0))
def test_grains_never_pull_and_friction_limits_what_acts_along_the_plate(
    normal, velocity, friction
):
    found = traction(Agarwal2023(surface_friction=friction), normal, velocity)
    pressure = -float(found @ normal)
    assert pressure >= -1e-12
    assert np.linalg.norm(found + pressure * np.asarray(normal)) <= friction * pressure + 1e-9


def test_the_coefficient_taken_for_x2_x3_squared_is_the_one_by_which_grains_seldom_pull():
    """-0.20770, in other codes, pulls at three times as many directions of a leading plate."""
    beta, gamma = np.meshgrid(
        np.radians(np.linspace(0, 180, 61)), np.radians(np.linspace(-90, 270, 91))
    )
    lead = np.sin(beta) * np.cos(gamma) + np.cos(beta) * np.sin(gamma) > 0.02
    n = np.stack([np.sin(beta), 0 * beta, -np.cos(beta)], axis=-1)[lead]
    v = np.stack([np.cos(gamma), 0 * gamma, -np.sin(gamma)], axis=-1)[lead]
    normal_part = np.array([published(a, b) @ a for a, b in zip(n, v, strict=True)])
    x2, x3 = np.abs(n[:, 2]), (n * v).sum(axis=1) * np.where(n[:, 2] > 0.0, -1.0, 1.0)
    other = normal_part - (-0.20770 + 0.02730) * x2 * x3**2 * n[:, 2]
    assert (normal_part > 0.0).mean() < 0.04
    assert (other > 0.0).mean() > 0.1


@RULES
@given(beta=st.floats(0.0, math.pi), velocity=directions())
def test_both_rules_integrate_it(rule, beta, velocity):
    normal = math.sin(beta), 0.0, -math.cos(beta)
    plate = facing(rule, [[0.0, 0.0, 0.0]], [normal])
    if np.dot(normal, velocity) < 0.05:  # a refined plate leads in part up to 1°
        return
    state = np.array([[0, 0, -1.0, 0, 0, 0, 1, *velocity, 0, 0, 0]])
    expected = np.array(traction_per_depth(AGARWAL, *normal, *velocity)) * plate.area
    np.testing.assert_allclose(
        wrenches(plate, AGARWAL, state)[0, :3], expected, atol=1e-3 * np.abs(expected).max()
    )

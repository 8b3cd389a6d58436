"""The inertia of the grains: λ ρ v_n² against a leading plate's normal, whatever its depth."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import (
    AGARWAL,
    CONSTANT,
    GENERIC,
    INERTIAL,
    RULES,
    directions,
    facing,
    random_plates,
    random_scene,
    seeds,
)

from rft_ros.rft import (
    BY_HEIGHT,
    MOMENTS,
    TORQUE,
    Memory,
    Plates,
    alpha_y_model,
    described,
    treers2021,
    wrenches,
    wrenches_in_time,
)
from rft_ros.rft.grains import CONFINEMENT_FACTOR, INERTIA

DENSITY = 1500.0  # of `INERTIAL`


def plate(normal, rule):
    """At the tool frame's origin."""
    return facing(rule, [[0.0, 0.0, 0.0]], [normal])


def at(velocity, depth=0.1):
    return np.array([[0.0, 0.0, -depth, 0.0, 0.0, 0.0, 1.0, *velocity, 0.0, 0.0, 0.0]])


def added(plates, states):
    """Force by the grains' inertia [N]: with the density less without."""
    return (wrenches(plates, INERTIAL, states) - wrenches(plates, CONSTANT, states))[0, :3]


@RULES
@given(
    normal=directions(),
    velocity=directions(),
    speed=st.floats(0.01, 3.0),
    depth=st.floats(0.05, 0.7),
)
def test_a_plate_that_leads_feels_the_published_stress_against_its_normal(
    rule, normal, velocity, speed, depth
):
    lead = float(np.dot(normal, velocity))
    if lead < 0.05:  # a refined plate leads in part up to 1°
        return
    body = plate(normal, rule)
    stress = (
        INERTIA
        * (1.0 + CONFINEMENT_FACTOR * min(normal[2], 0.0) ** 2)
        * DENSITY
        * (speed * lead) ** 2
    )
    expected = -stress * body.area * np.asarray(normal)
    found = added(body, at(speed * np.asarray(velocity), depth))
    force = np.abs(
        wrenches(body, CONSTANT, at(velocity, depth))[0, :3]
    ).max()  # both are subtracted from each other
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-11 * force)


@RULES
def test_a_plate_that_trails_or_is_dry_feels_none(rule):
    body = plate((1.0, 0.0, 0.0), rule)
    assert not added(body, at((-1.0, 0.0, 0.0))).any()
    assert not added(body, at((1.0, 0.0, 0.0), depth=-0.1)).any()


def test_a_refined_plate_feels_it_on_its_submerged_part_alone():
    side = 0.02
    corners = np.array(
        [[[0, 0, 0], [0, side, -side], [0, 0, -side]], [[0, 0, 0], [0, side, 0], [0, side, -side]]]
    )
    square = Plates.from_triangles(corners, np.full(2, 0.01))
    whole, half = (added(square, at((-1.0, 0.0, 0.0), depth))[0] for depth in (0.1, -0.5 * side))
    assert half == pytest.approx(0.5 * whole, rel=1e-9)


@RULES
def test_with_memory_it_acts_at_once_and_ends_at_rest(rule):
    body = plate((1.0, 0.0, 0.0), rule)
    states = np.concatenate([at((1.0, 0.0, 0.0)), at((0.0, 0.0, 0.0))])
    with_density, without = (
        wrenches_in_time(body, replace(law, mobilization_length=0.003), states, Memory(body))[:, 0]
        for law in (INERTIAL, CONSTANT)
    )
    assert without[0] == pytest.approx(0.0, abs=1e-12)
    assert with_density[0] == pytest.approx(-INERTIA * DENSITY * body.area, rel=1e-9)
    assert with_density[1] == pytest.approx(without[1], rel=1e-9)


@RULES
@given(seed=seeds)
def test_the_derivative_by_the_surface_height_has_none_of_it_and_the_torque_all(rule, seed):
    rng = np.random.default_rng(seed)
    body, state = random_plates(rng, 60, rule), random_scene(rng, 1)
    wide, plain = (
        wrenches(body, law, state, sensitivities=True)[0] for law in (INERTIAL, CONSTANT)
    )
    np.testing.assert_array_equal(wide[BY_HEIGHT], plain[BY_HEIGHT])
    moments = wide[MOMENTS].reshape(3, 3)  # r_j f_l
    torque = [
        moments[1, 2] - moments[2, 1],
        moments[2, 0] - moments[0, 2],
        moments[0, 1] - moments[1, 0],
    ]
    np.testing.assert_allclose(torque, wide[TORQUE], rtol=1e-9, atol=1e-12)


def test_density_0_is_no_inertia_and_a_negative_one_is_refused():
    model = alpha_y_model("constant", GENERIC)
    assert not treers2021(GENERIC, model, density=0.0).has_inertia and not AGARWAL.has_inertia
    for name, numbers in (
        ("medium.density", {"density": -1.0}),
        ("medium.inertia", {"density": 1.0, "inertia": -1.0}),
    ):
        with pytest.raises(ValueError, match=name):
            treers2021(GENERIC, model, **numbers)


def test_a_law_is_described_with_inertia_if_density_and_factor_are_over_0():
    model = alpha_y_model("constant", GENERIC)
    assert "density 1500" in described(treers2021(GENERIC, model, density=DENSITY))
    for numbers in ({}, {"density": DENSITY, "inertia": 0.0}):
        law = treers2021(GENERIC, model, **numbers)
        assert not law.has_inertia and "density" not in described(law)

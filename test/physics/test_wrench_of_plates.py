"""The wrench of many plates: against the slow reference, which plates count, and one state as a row of many."""

import numpy as np
import published_rule as rule
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import (
    CONSTANT,
    GENERIC,
    LINEAR,
    listed,
    random_plates,
    random_scene,
    seeds,
    without_flat,
)

from rft_ros.rft import QUATERNION, Plates, alpha_y_model, checked_states, treers2021, wrenches


@pytest.mark.parametrize(
    ("name", "alpha_y"),
    [("constant", rule.constant("generic")), ("linear", rule.linear)],
    ids=["constant", "linear"],
)
@given(seed=seeds, zeta=st.floats(0.1, 10.0), surface=st.floats(-0.02, 0.02))
def test_force_and_torque_of_a_tumbling_body_are_the_published_rules(
    name, alpha_y, seed, zeta, surface
):
    rng = np.random.default_rng(seed)
    state = random_scene(rng, 1)
    # the cap is compared plate by plate in test_traction
    body = without_flat(random_plates(rng, 60), state[0])
    expected = rule.wrench(listed(body), state[0].tolist(), "generic", zeta, alpha_y, surface)
    law = treers2021(GENERIC, alpha_y_model(name, GENERIC), zeta=zeta)
    actual = wrenches(body, law, state, surface_height=surface)[0, :6]
    scale = max(abs(component) for component in expected[:3])
    assert actual == pytest.approx(expected, abs=1e-10 * scale)


def test_a_plate_that_slides_along_itself_is_not_leading():
    plate = Plates.from_arrays([[0, 0, 0]], [[1, 0, 0]], [1e-4])
    assert not wrenches(
        plate, CONSTANT, checked_states([0, 0, -0.1, 0, 0, 0, 1, 0, 0.3, -0.7, 0, 0, 0])
    )[0, :6].any()


@given(seed=seeds)
def test_the_submerged_area_is_that_of_the_plates_below_the_surface_whatever_their_motion(seed):
    rng = np.random.default_rng(seed)
    body, state = random_plates(rng, 60), random_scene(rng, 1)
    expected = sum(
        area
        for centroid, _, area in listed(body)
        if state[0, 2] + rule.turned(state[0, QUATERNION].tolist(), centroid)[2] < 0.0
    )
    assert wrenches(body, CONSTANT, state)[0, 6] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("law", [CONSTANT, LINEAR], ids=["constant", "linear"])
@pytest.mark.parametrize("plates", [1, 2, 7, 16, 33, 250])
def test_one_state_is_its_row_of_a_batch_bit_for_bit(law, plates, random_states):
    body = random_plates(np.random.default_rng(plates), plates)
    batch = wrenches(body, law, random_states)
    for k in range(len(random_states)):
        np.testing.assert_array_equal(
            wrenches(body, law, random_states[k : k + 1]), batch[k : k + 1]
        )


@pytest.mark.parametrize("threads", [2, 3, 8, None])
def test_the_number_of_threads_changes_not_a_bit(threads):
    rng = np.random.default_rng(5)
    body, states = (
        random_plates(rng, 997),
        random_scene(rng, 2000),
    )  # enough work for eight threads
    alone = wrenches(body, LINEAR, states, threads=1)
    np.testing.assert_array_equal(wrenches(body, LINEAR, states, threads=threads), alone)
    assert np.unique(alone[:, 0]).size == len(states)


def test_no_states_give_no_rows(random_body):
    assert wrenches(random_body, CONSTANT, np.empty((0, 13))).shape == (0, 7)

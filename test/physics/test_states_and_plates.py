"""What may enter the kernel: states, quaternions and plates are checked once, with a sentence for what is wrong."""

import math

import numpy as np
import published_rule as rule
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from rft_ros.rft import (
    QUATERNION,
    STATE,
    Plates,
    checked_states,
    quaternion_products,
    rotate_vectors,
    rotation_matrices,
    rotation_matrix,
    unit_quaternion,
)

numbers = st.floats(-1.0, 1.0)
STILL = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]


def state(**columns):
    row = list(STILL)
    for name, value in columns.items():
        row[STATE.index(name)] = value
    return row


def test_the_callers_states_are_not_written_to():
    given_states = np.array([state(qw=1.005)])
    assert checked_states(given_states)[0, 6] == 1.0
    assert given_states[0, 6] == 1.005


@pytest.mark.parametrize(
    ("states", "message"),
    [
        *(
            (np.zeros((2, n)), rf"states has shape \[2, {n}\]; it must be \[n, 13\]")
            for n in (12, 14)
        ),
        *(
            ([[v] * 13], "states has values of type .*; they must be real numbers")
            for v in (1j, "1", None)
        ),
    ],
)
def test_what_is_no_table_of_states_is_refused(states, message):
    with pytest.raises(ValueError, match=message):
        checked_states(states)


@pytest.mark.parametrize("column", STATE)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_not_finite_is_refused_by_row_and_column(column, value):
    with pytest.raises(
        ValueError, match=f"row 1: {column} is {value}; it must be a finite number"
    ):
        checked_states([STILL, state(**{column: value}), STILL])


@pytest.mark.parametrize(
    ("qw", "norm"), [(0.0, "0"), (0.98, "0.98"), (1.02, "1.02"), (1e-200, "0")]
)
def test_a_quaternion_that_is_not_a_rotation_is_refused_by_row(qw, norm):
    with pytest.raises(
        ValueError, match=f"row 2: the quaternion qx, qy, qz, qw has norm {norm}; it must be 1"
    ):
        checked_states([STILL, STILL, state(qw=qw)])


@given(q=st.tuples(numbers, numbers, numbers, numbers), error=st.floats(-0.009, 0.009))
def test_a_quaternion_within_a_hundredth_of_unit_length_is_normalised(q, error):
    assume(math.hypot(*q) > 0.1)
    unit = [c / math.hypot(*q) for c in q]
    made = unit_quaternion(*[c * (1.0 + error) for c in unit])
    assert made == pytest.approx(unit, abs=1e-15)
    assert math.hypot(*made) == pytest.approx(1.0, abs=1e-15)
    row = state(
        **dict(zip(("qx", "qy", "qz", "qw"), (c * (1.0 + error) for c in unit), strict=True))
    )
    assert checked_states(row)[0, QUATERNION] == pytest.approx(unit, abs=1e-15)


@pytest.mark.parametrize(
    "q", [(0, 0, 0, 0), (0, 0, 0, 1.011), (0, 0, 0, 0.989), (math.nan, 0, 0, 1), (1e200, 0, 0, 0)]
)
def test_a_quaternion_that_is_not_a_rotation_has_no_unit_quaternion(q):
    assert unit_quaternion(*q) is None


@given(q=st.tuples(numbers, numbers, numbers, numbers), r=st.tuples(numbers, numbers, numbers))
def test_the_rotation_matrix_turns_vectors_as_the_quaternion_does(q, r):
    assume(math.hypot(*q) > 0.1)
    unit = [c / math.hypot(*q) for c in q]
    assert rotation_matrix(unit) @ r == pytest.approx(rule.turned(unit, r), abs=1e-14)


@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_any_number_of_rotations_turns_vectors_as_each_alone_does(count):
    random = np.random.default_rng(1)
    quaternions = random.normal(size=(count, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1)[:, None]
    vectors = random.normal(size=(count, 3))
    rotations = rotation_matrices(quaternions)
    turned = rotate_vectors(rotations, vectors)
    assert rotations.shape == (count, 3, 3)
    assert turned.shape == (count, 3)
    for q, r, vector in zip(quaternions, vectors, turned, strict=True):
        assert vector == pytest.approx(rotation_matrix(q) @ r, abs=1e-14)


@pytest.mark.parametrize("count", [0, 1, 5])
def test_a_product_of_quaternions_turns_first_by_the_inner_one(count):
    random = np.random.default_rng(2)
    one, *stack = random.normal(size=(count + 1, 4))
    one /= np.linalg.norm(one)
    stack = np.reshape(stack, (count, 4))
    stack /= np.linalg.norm(stack, axis=1)[:, None]
    outer_is_one = quaternion_products(one, stack)
    inner_is_one = quaternion_products(stack, one)
    first, each = rotation_matrix(one), rotation_matrices(stack)
    assert outer_is_one.shape == inner_is_one.shape == (count, 4)
    assert rotation_matrices(outer_is_one) == pytest.approx(first @ each, abs=1e-14)
    assert rotation_matrices(inner_is_one) == pytest.approx(each @ first, abs=1e-14)


def test_plates_know_their_number_area_and_reach():
    plates = Plates.from_arrays(
        [[0.03, 0, 0.04], [0, 0, 0.01]], [[0, 0, 2], [3, 0, 4]], [1e-4, 2e-4]
    )
    assert len(plates) == 2
    assert plates.area == pytest.approx(3e-4)
    assert plates.reach == pytest.approx(0.05)
    assert plates.normals.T.tolist() == [[0, 0, 1], [0.6, 0, 0.8]]


def test_plates_cannot_be_written_to():
    plates = Plates.from_arrays([[0, 0, 0]], [[0, 0, 1]], [1e-4])
    with pytest.raises(ValueError, match="read-only"):
        plates.rows[0, 0] = 1.0


ONE = ([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]], [1e-4])


@pytest.mark.parametrize(
    ("centroids", "normals", "areas", "complaint"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), "at least one plate element; got none"),
        (np.zeros((2, 3)), np.ones((1, 3)), np.ones(2), r"got \(2, 3\), \(1, 3\), \(2,\)"),
        (np.zeros((1, 2)), np.ones((1, 2)), np.ones(1), r"centroids \[n, 3\].*got \(1, 2\)"),
        (ONE[0], ONE[1], [1e-4, 1e-4], r"areas \[n\]; got .*\(2,\)"),
        ([[np.nan, 0, 0]], ONE[1], ONE[2], "must be finite"),
        (ONE[0], [[np.inf, 0, 0]], ONE[2], "must be finite"),
        (ONE[0], ONE[1], [np.nan], "must be finite"),
        (ONE[0], ONE[1], [-1e-9], "areas must not be negative"),
        (ONE[0], [[0, 0, 0]], ONE[2], "normals not zero"),
    ],
)
def test_arrays_that_are_not_plates_are_refused_with_a_sentence(
    centroids, normals, areas, complaint
):
    with pytest.raises(ValueError, match=complaint):
        Plates.from_arrays(centroids, normals, areas)

"""Inputs where the rule divides zero by zero: finite numbers, and the ones that physics asks for."""

import numpy as np
import pytest
from scenes import AGARWAL, CONSTANT, GENERIC, INERTIAL, LINEAR, facing, unit

from rft_ros.rft import INTEGRATIONS, Plates, Table, checked_states, treers2021, wrenches

TABLE = treers2021(GENERIC, Table.sampled(np.array([0.0, 1.5]), np.zeros(1), np.full((2, 1), 0.1)))
LAWS = pytest.mark.parametrize(
    "law", [CONSTANT, LINEAR, TABLE], ids=["constant", "linear", "table"]
)

ALL = pytest.mark.parametrize(
    "law",
    [CONSTANT, LINEAR, TABLE, AGARWAL, INERTIAL],
    ids=["constant", "linear", "table", "agarwal2023", "inertia"],
)

AXES = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
BOX = Plates.from_arrays(0.01 * np.array(AXES), AXES, np.full(6, 4e-4))
"""The six faces of a 2 cm cube, exactly along the axes."""


def wrench(plates, law, velocity, angular=(0, 0, 0), pz=-0.05):
    return wrenches(plates, law, checked_states([0, 0, pz, 0, 0, 0, 1, *velocity, *angular]))[
        0, :6
    ]


@LAWS
@pytest.mark.parametrize("nz", [-1.0, 1.0])
@pytest.mark.parametrize("vz", [-1.0, 1.0])
def test_an_exactly_flat_plate_in_exactly_vertical_motion_is_pushed_vertically_or_not_at_all(
    law, nz, vz
):
    """Against the motion: α_z(0, 90°) = 1 N/cm³ and α_z(180°, -90°) = 0.206 + 0.169 - 0.212 - 0.358 - 0.055 = -0.25."""
    force = wrench(Plates.from_arrays([[0, 0, 0]], [[0, 0, nz]], [1e-4]), law, (0, 0, vz))
    stress = (1.0 if nz < 0.0 else -0.25) if nz * vz > 0.0 else 0.0
    assert force[2] == pytest.approx(stress * 5.0, abs=1e-9)
    assert force[:2] == pytest.approx([0, 0], abs=1e-4)  # the nudge tilts the velocity by 1e-5


@LAWS
def test_flat_plates_whose_horizontal_velocity_is_exactly_minus_the_nudge_are_finite(law):
    """There the nudged velocity is exactly vertical and e2 has no direction at all."""
    v = (-1e-5, 0.0, -np.sqrt(1 - 1e-10))
    force = wrench(Plates.from_arrays([[0, 0, 0]], [[0, 0, -1]], [1e-4]), law, v)
    assert force[2] == pytest.approx(5.0, rel=1e-3)
    assert np.isfinite(force).all()


@ALL
def test_at_rest_above_the_grains_and_without_a_leading_plate_there_is_no_wrench(law):
    bottom = Plates.from_arrays(
        [[0, 0, 0], [0.01, 0, 0]], [[0, 0, -1], [0.1, 0, -1]], [1e-4, 1e-4]
    )
    found = [wrench(BOX, law, (0, speed, -speed)) for speed in (0, 5e-324, 1e-310)]
    found += [
        wrench(BOX, law, (0.1, 0.2, -0.3), (1, 2, 3), pz=height)
        for height in (0.01, 0.01 + 1e-12, 1.0)
    ]
    found.append(wrench(bottom, law, (0, 0, 1)))
    assert not np.any(found)


@LAWS
@pytest.mark.parametrize("speed", [1e-280, 1e-160, 1e160, 1e200])
def test_speeds_whose_squares_overflow_or_underflow_give_the_same_wrench(law, speed):
    direction = np.array([0.6, -0.48, -0.64])
    np.testing.assert_allclose(
        wrench(BOX, law, speed * direction), wrench(BOX, law, direction), rtol=1e-9, atol=1e-9
    )


@ALL
@pytest.mark.parametrize("rule", INTEGRATIONS)
def test_ten_thousand_states_of_special_numbers_give_no_nan(rule, law):
    rng = np.random.default_rng(11)
    n = 10_000
    special = np.array(
        [0.0, -0.0, 1.0, -1.0, 0.5, 1e-5, -1e-5, 5e-324, 1e-310, 1e-160, 1e-16, 1e160, -1e200]
    )
    where = np.array([0.0, -0.0, -0.01, 0.01, -1e-300, 0.05, -0.05, -1e6, 1e6])

    def mixed(columns, values):
        """Half random numbers, half special ones."""
        drawn = rng.normal(size=(n, columns))
        return np.where(rng.random((n, columns)) < 0.5, rng.choice(values, (n, columns)), drawn)

    turns = unit(rng.normal(size=(n, 4)))
    halves = unit(
        np.array(
            [[0, 0, 0, 1], [1, 0, 0, 0], [0, 1, 0, 0], [1, 0, 0, 1], [0, 1, 0, -1], [1, 1, 1, 1.0]]
        )
    )
    q = np.where(rng.random((n, 1)) < 0.5, halves[rng.integers(0, len(halves), n)], turns)
    states = checked_states(np.hstack([mixed(3, where), q, mixed(6, special)]))
    r = np.vstack([0.01 * np.array(AXES), np.zeros((6, 3)), rng.normal(0, 0.02, (20, 3))])
    normals = np.vstack([AXES, AXES, rng.normal(size=(20, 3))])
    body = facing(rule, r, normals)
    at_origin = facing(rule, np.zeros((6, 3)), np.array(AXES))
    for plates in (body, at_origin):
        result = wrenches(plates, law, states)
        assert np.isfinite(result).all(), (
            f"state {states[~np.isfinite(result).all(axis=1)][0].tolist()}"
        )
        assert (result[:, :6] != 0.0).any(axis=1).sum() > n // 10

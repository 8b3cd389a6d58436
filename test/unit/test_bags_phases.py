"""Phases follow their definitions and do not flicker under noise."""

from itertools import groupby

import numpy as np
import pytest

from rft_ros.bags.estimates import PHASES, phases_of

REST = 0.001
STEP = 10_000_000
DOWN, UP, LEVEL, STILL = (0.0, -0.02), (0.0, 0.02), (0.02, 0.0), (0.0, 0.0)
PLUNGE = ((200, DOWN), (50, STILL), (100, LEVEL), (300, UP))


def run(*legs, depth=-0.0101, noise=0.0):
    """Stamps, depth, downward velocity and speed at 100 Hz of (count, (vx, vz)) legs; `noise` on both velocities."""
    exact = np.repeat([velocity for _, velocity in legs], [count for count, _ in legs], axis=0)
    depth = depth - 0.01 * np.cumsum(exact[:, 1])
    velocity = exact + noise * np.random.default_rng(3).standard_normal(exact.shape)
    return (
        10**9 + STEP * np.arange(len(depth)),
        depth,
        -velocity[:, 1],
        np.linalg.norm(velocity, axis=1),
    )


def segments(moments):
    return [(PHASES[code], len(list(those))) for code, those in groupby(phases_of(*moments, REST))]


def test_a_plunge_has_every_phase_where_it_begins():
    assert segments(run(*PLUNGE)) == [
        ("approach", 50),
        ("penetration", 150),
        ("dwell", 50),
        ("ploughing", 100),
        ("withdrawal", 300),
    ]


@pytest.mark.parametrize("noise", [0.0003, 0.0005])
def test_phases_do_not_flicker_under_noise(noise):
    """Noise up to half of `rest_speed`."""
    exact, found = segments(run(*PLUNGE)), segments(run(*PLUNGE, noise=noise))
    assert [phase for phase, _ in found] == [phase for phase, _ in exact]
    assert [count for _, count in found] == pytest.approx([count for _, count in exact], abs=3)


def test_motion_shorter_than_a_tenth_of_a_second_does_not_change_the_phase():
    assert segments(run((150, DOWN), (5, UP), (100, DOWN))) == [
        ("approach", 50),
        ("penetration", 205),
    ]
    assert segments(run((150, DOWN), (12, UP), (100, DOWN)))[2] == ("withdrawal", 12)


@pytest.mark.parametrize(
    ("degrees", "phase"),
    [(90.0, "penetration"), (20.0, "penetration"), (3.0, "ploughing"), (0.0, "ploughing"),
     (-3.0, "ploughing"), (-20.0, "withdrawal"), (-90.0, "withdrawal")],
)  # fmt: skip
def test_the_slope_separates_ploughing_from_going_down_or_up(degrees, phase):
    angle = np.deg2rad(degrees)
    assert segments(run((60, (0.02 * np.cos(angle), -0.02 * np.sin(angle))), depth=0.02)) == [
        (phase, 60)
    ]


def test_rising_out_of_the_grains_is_withdrawal_and_turning_in_place_is_no_dwell():
    found = segments(run((100, UP), (30, STILL), (50, LEVEL), (50, DOWN), depth=0.005))
    assert found == [("withdrawal", 100), ("approach", 130)]
    every = np.ones(30)
    assert segments((STEP * np.arange(30), 0.02 * every, 0.0 * every, 0.01 * every)) == [
        ("ploughing", 30)
    ]


def test_a_time_jump_begins_another_run():
    first, second = run((55, DOWN)), run(*PLUNGE)
    both = phases_of(*(np.append(a, b) for a, b in zip(first, second, strict=True)), REST)
    np.testing.assert_array_equal(
        both, np.append(phases_of(*first, REST), phases_of(*second, REST))
    )

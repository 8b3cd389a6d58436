"""Phases follow their definitions and do not flicker under noise."""

from itertools import groupby

import numpy as np
import pytest

from rft_ros.bags.phases import Phase, phases_of

REST = 0.001
STEP = 10_000_000
DOWN, UP, LEVEL, STILL = (0.0, -0.02), (0.0, 0.02), (0.02, 0.0), (0.0, 0.0)
PLUNGE = ((200, DOWN), (50, STILL), (100, LEVEL), (300, UP))


def run(*legs, depth=-0.01, noise=0.0):
    """Moments at 100 Hz of (count, (vx, vz)) legs; `noise` on both."""
    random = np.random.default_rng(3)
    moments = []
    for count, (vx, vz) in legs:
        for _ in range(count):
            depth -= vz * 0.01
            x, z = np.array([vx, vz]) + noise * random.standard_normal(2)
            speed = float(np.hypot(x, z))
            moments.append((10**9 + len(moments) * STEP, depth, -float(z), speed, speed))
    return moments


def segments(moments):
    return [(phase, len(list(those))) for phase, those in groupby(phases_of(moments, REST))]


def test_a_plunge_has_every_phase_where_it_begins():
    assert segments(run(*PLUNGE)) == [
        (Phase.APPROACH, 50),
        (Phase.PENETRATION, 150),
        (Phase.DWELL, 50),
        (Phase.PLOUGHING, 100),
        (Phase.WITHDRAWAL, 300),
    ]


@pytest.mark.parametrize("noise", [0.0003, 0.0005])
def test_phases_do_not_flicker_under_noise(noise):
    """Noise up to half of `rest_speed`."""
    exact, found = segments(run(*PLUNGE)), segments(run(*PLUNGE, noise=noise))
    assert [phase for phase, _ in found] == [phase for phase, _ in exact]
    assert [count for _, count in found] == pytest.approx([count for _, count in exact], abs=12)


@pytest.mark.parametrize("noise", [0.001, 0.003, 0.01])
def test_under_noise_above_the_rest_speed_every_phase_still_lasts_a_tenth_of_a_second(noise):
    assert min(count for _, count in segments(run(*PLUNGE, noise=noise))) >= 10


def test_motion_shorter_than_a_tenth_of_a_second_does_not_change_the_phase():
    assert segments(run((150, DOWN), (5, UP), (100, DOWN))) == [(Phase.APPROACH, 50), (Phase.PENETRATION, 205)]
    assert segments(run((150, DOWN), (12, UP), (100, DOWN)))[2] == (Phase.WITHDRAWAL, 12)


@pytest.mark.parametrize(
    ("degrees", "phase"),
    [(90.0, Phase.PENETRATION), (20.0, Phase.PENETRATION), (3.0, Phase.PLOUGHING), (0.0, Phase.PLOUGHING),
     (-3.0, Phase.PLOUGHING), (-20.0, Phase.WITHDRAWAL), (-90.0, Phase.WITHDRAWAL)],
)  # fmt: skip
def test_the_slope_separates_ploughing_from_going_down_or_up(degrees, phase):
    angle = np.deg2rad(degrees)
    assert segments(run((60, (0.02 * np.cos(angle), -0.02 * np.sin(angle))), depth=0.02)) == [(phase, 60)]


def test_out_of_the_grains_it_withdraws_until_it_moves_otherwise():
    found = segments(run((100, UP), (30, STILL), (50, LEVEL), (50, DOWN), depth=0.005))
    assert [phase for phase, _ in found] == [Phase.WITHDRAWAL, Phase.APPROACH]


def test_turning_in_place_below_the_surface_is_not_dwell():
    assert segments([(10**9 + k * STEP, 0.02, 0.0, 0.0005, 0.01) for k in range(30)]) == [(Phase.PLOUGHING, 30)]


@pytest.mark.parametrize("last", [650, 153, 603])  # 153: in a phase that has not yet lasted
def test_a_time_jump_begins_another_run(last):
    first, second = run(*PLUNGE)[:last], run(*PLUNGE)
    assert phases_of(first + second, REST) == phases_of(first, REST) + phases_of(second, REST)

"""Phases follow their definitions, do not flicker under noise, and every moment is returned in order."""

import numpy as np
import pytest

from rft_ros.bags.phases import Moment, Phase, Phases

REST = 0.001
STEP = 10_000_000
DOWN, UP, LEVEL, STILL = (0.0, -0.02), (0.0, 0.02), (0.02, 0.0), (0.0, 0.0)


def run(legs, *, depth=-0.01, noise=0.0):
    """Moments at 100 Hz of (count, (vx, vz)) legs; `noise` on both."""
    random = np.random.default_rng(3)
    stamp, moments = 10**9, []
    for count, (vx, vz) in legs:
        for _ in range(count):
            depth -= vz * 0.01
            x, z = np.array([vx, vz]) + noise * random.standard_normal(2)
            speed = float(np.hypot(x, z))
            moments.append(Moment(stamp, depth, -float(z), speed, speed))
            stamp += STEP
    return moments


def phases_of(moments):
    phases = Phases(REST)
    settled = [item for k, moment in enumerate(moments) for item in phases.push(k, moment)] + phases.finish()
    assert [k for k, _ in settled] == list(range(len(moments)))
    return [phase for _, phase in settled]


def segments(phases):
    found = []
    for phase in phases:
        if found and found[-1][0] is phase:
            found[-1][1] += 1
        else:
            found.append([phase, 1])
    return [(phase, count) for phase, count in found]


PLUNGE = ((200, DOWN), (50, STILL), (100, LEVEL), (300, UP))


def test_a_plunge_has_every_phase_where_it_begins():
    assert segments(phases_of(run(PLUNGE))) == [
        (Phase.APPROACH, 50),
        (Phase.PENETRATION, 150),
        (Phase.DWELL, 50),
        (Phase.PLOUGHING, 100),
        (Phase.WITHDRAWAL, 300),
    ]


@pytest.mark.parametrize("noise", [0.0003, 0.0005])
def test_phases_do_not_flicker_under_noise(noise):
    """Noise up to half of `rest_speed`."""
    found = segments(phases_of(run(PLUNGE, noise=noise)))
    assert [phase for phase, _ in found] == [
        *(Phase.APPROACH, Phase.PENETRATION, Phase.DWELL, Phase.PLOUGHING, Phase.WITHDRAWAL)
    ]
    exact = [count for _, count in segments(phases_of(run(PLUNGE)))]
    assert [count for _, count in found] == pytest.approx(exact, abs=12)


@pytest.mark.parametrize("noise", [0.001, 0.003, 0.01])
def test_under_noise_above_the_rest_speed_every_phase_still_lasts_a_tenth_of_a_second(noise):
    assert min(count for _, count in segments(phases_of(run(PLUNGE, noise=noise)))) >= 10


def test_motion_shorter_than_a_tenth_of_a_second_does_not_change_the_phase():
    blip = ((150, DOWN), (5, UP), (100, DOWN))
    assert [phase for phase, _ in segments(phases_of(run(blip)))] == [Phase.APPROACH, Phase.PENETRATION]
    longer = ((150, DOWN), (12, UP), (100, DOWN))
    assert segments(phases_of(run(longer)))[2] == (Phase.WITHDRAWAL, 12)


@pytest.mark.parametrize(
    ("degrees", "phase"),
    [(90.0, Phase.PENETRATION), (20.0, Phase.PENETRATION), (3.0, Phase.PLOUGHING), (0.0, Phase.PLOUGHING),
     (-3.0, Phase.PLOUGHING), (-20.0, Phase.WITHDRAWAL), (-90.0, Phase.WITHDRAWAL)],
)  # fmt: skip
def test_the_slope_separates_ploughing_from_going_down_or_up(degrees, phase):
    angle = np.deg2rad(degrees)
    leg = ((60, (0.02 * float(np.cos(angle)), -0.02 * float(np.sin(angle)))),)
    assert set(phases_of(run(leg, depth=0.02))) == {phase}


def test_out_of_the_grains_it_withdraws_until_it_moves_otherwise():
    legs = ((100, UP), (30, STILL), (50, LEVEL), (50, DOWN))
    found = [phase for phase, _ in segments(phases_of(run(legs, depth=0.005)))]
    assert found == [Phase.WITHDRAWAL, Phase.APPROACH]


def test_turning_in_place_below_the_surface_is_not_dwell():
    turning = [Moment(10**9 + k * STEP, 0.02, 0.0, 0.0005, 0.01) for k in range(30)]
    assert set(phases_of(turning)) == {Phase.PLOUGHING}


def test_moments_of_unknown_motion_have_no_phase_and_do_not_end_one():
    moments = run(((100, DOWN),), depth=0.0)
    for k in (0, 20, 21, 60):
        moments[k] = None
    found = phases_of(moments)
    assert [k for k, phase in enumerate(found) if phase is None] == [0, 20, 21, 60]
    assert set(found) == {None, Phase.PENETRATION}


def test_a_time_jump_begins_another_run():
    found = phases_of([*run(PLUNGE), *run(PLUNGE)])
    assert found[650:] == found[:650]


def test_few_moments_wait_when_stamps_do_not_advance():
    phases = Phases(REST)
    still = Moment(10**9, 0.01, 0.0, 0.0, 0.0)
    phases.push(0, Moment(10**9, 0.01, 0.02, 0.02, 0.02))
    longest = waiting = 0
    for k in range(1, 20_000):
        waiting += 1 - len(phases.push(k, still))
        longest = max(longest, waiting)
    assert longest <= 4096

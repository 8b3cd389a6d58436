"""Tare: the bias that makes a still tool in the air weigh nothing, refused whenever it would be wrong."""

import re
from dataclasses import replace

import numpy as np
import pytest
from one_plate import (
    LEVEL,
    MS,
    SECOND,
    START,
    about,
    estimator,
    measurement,
    pose,
    push,
    twist,
    use,
    wrench,
)
from refusals import refusal

from rft_ros.estimator import Estimate
from rft_ros.estimator.tare import drift
from rft_ros.parameters import LoadCell

AIR, GRAINS = (0.0, 0.0, 0.05), (0.0, 0.0, -0.01)
STILL, MOVING = (0.0, 0.0, 0.0), (0.0, 0.0, -0.02)
READING = (0.5, -0.25, 1.8, 0.01, 0.02, -0.03)


def run(e, seconds, *, start=START, position=AIR, linear=STILL, reading=READING, quaternion=LEVEL):
    """100 Hz of twist, wrench and pose; returns the next stamp."""
    for stamp in range(start, start + round(seconds * SECOND), 10 * MS):
        place = tuple(np.array(position) + np.array(linear) * (stamp - start) * 1e-9)
        push(
            e,
            *([wrench(stamp, reading)] if reading else ()),
            twist(stamp, linear),
            pose(stamp, place, quaternion),
        )
    return stamp + 10 * MS


def refused(e, window=0.5):
    return (
        refusal(e.tare, window)
        .removeprefix("tare refused: ")
        .removeprefix("within the last 0.5 s ")
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_after_a_tare_is_used_the_compensated_wrench_is_zero_weight_and_all(sign):
    """Taken in a tilted attitude with 0.6 kg on a rotated sensor."""
    cell = LoadCell(
        quaternion=about((1, 0, 0), 40.0), sign=sign, mass=0.6, center_of_mass=(0.01, 0.0, 0.05)
    )
    e = estimator(sensor=cell)
    after = run(e, 1.0, quaternion=about((0, 1, 0), 25.0))
    bias, before = e.tare(0.5), measurement(e).compensated
    use(e, sensor=replace(cell, bias=bias))
    run(e, 0.01, start=after, quaternion=about((0, 1, 0), 25.0))
    assert measurement(e).compensated == pytest.approx([0.0] * 6, abs=1e-9)
    assert before != pytest.approx([0.0] * 6, abs=1e-2)


@pytest.mark.parametrize("window", [0.2, 0.5])
def test_a_tare_is_the_mean_of_the_windows_readings(window):
    e = estimator()
    after = run(e, 1.0, reading=(0.0,) * 6)
    run(e, 0.1, start=after, reading=(1.0,) * 6)
    assert e.tare(window) == pytest.approx((0.1 / window,) * 6)


def test_tare_is_refused_while_the_tool_moves_and_for_a_window_after_it():
    e = estimator()
    after = run(e, 1.0, linear=MOVING)
    assert refused(e) == "the tool moved at 0.0200 m/s, and rest_speed is 0.0002; hold it still"
    after = run(e, 0.4, start=after)
    assert "the tool moved at 0.0" in refused(e)
    run(e, 0.2, start=after)
    assert e.tare(0.5) == pytest.approx(READING)


@pytest.mark.parametrize("rate", [125, 500])
@pytest.mark.parametrize("sigma", [0.5e-6, 3e-6, 10e-6])
@pytest.mark.parametrize("window", [0.25, 1.0])
def test_the_noise_of_poses_is_no_motion_to_a_tare(sigma, rate, window):
    """From the first pose on, whose noise is not known yet; 3 mm/s of true motion is motion under the same noise."""
    rng = np.random.default_rng(1)
    for speed in (0.0, 0.003):
        e = estimator(twist_source="pose_difference")
        for k in range(2, round(window * rate) + 3):
            stamp = START + k * SECOND // rate
            turned = rng.normal(0.0, 5.0 * sigma, 3)
            place = np.array([speed * k / rate, 0.0, 0.05]) + rng.normal(0.0, sigma, 3)
            quaternion = np.append(turned, 1.0) / np.sqrt(1.0 + turned @ turned) * (-1) ** k
            push(
                e,
                pose(stamp, tuple(place.tolist()), tuple(quaternion.tolist())),
                wrench(stamp, READING),
            )
        last = (k - 3.5) / rate  # from the third pose on: the first two have no velocity
        if speed:
            assert re.search(r"the tool moved at 0.00(2[89]|3[012])", refused(e, last))
        else:
            assert e.tare(last) == pytest.approx(READING)


def test_a_tool_that_moves_and_comes_back_within_the_window_moves():
    time = np.arange(0.0, 4.0, 0.008)
    places = np.tile([0.0, 0.0, 0.05, *LEVEL], (len(time), 1))
    assert drift(time, places, 0.1) == 0.0
    places[:, 0] = 1e-3 * np.sin(np.pi * time / 2.0)
    assert drift(time, places, 0.1) > 1e-3
    places[:, 0], places[:, 5] = 0.0, 1e-3 * np.sin(np.pi * time / 2.0)
    assert drift(time, places, 0.1) > 2e-4


def test_tare_is_refused_in_the_grains_at_rest_or_not_and_while_the_velocity_is_not_known():
    for linear in (STILL, MOVING):
        e = estimator()
        run(e, 1.0, position=GRAINS, linear=linear)
        assert "in the grains" in refused(e)
    e = estimator()
    after = run(e, 1.0)
    for stamp in range(after, after + 200 * MS, 10 * MS):
        push(e, wrench(stamp, READING), pose(stamp, AIR))
    assert "velocity" in refused(e)
    assert "twist_stale" in refused(e)


def test_tare_is_refused_with_fewer_than_ten_samples():
    e = estimator()
    run(e, 1.0, reading=())
    push(e, *(wrench(START + SECOND - k * MS, READING) for k in range(9, 0, -1)))
    assert refused(e) == "9 load-cell samples came; it needs 10: start its driver"
    push(e, wrench(START + SECOND, READING))
    assert e.tare(0.5) == pytest.approx(READING)


@pytest.mark.parametrize("jump", [False, True])
def test_tare_is_refused_before_any_pose_and_when_poses_stop_and_the_load_cell_continues(jump):
    """The tool was last seen in the grains, two seconds ago: nothing says that it left them; rest before a jump back in
    time does not count."""
    e = estimator()
    push(e, *(wrench(START - SECOND + k * 10 * MS) for k in range(100)))
    assert refused(e).startswith("no pose with a known velocity has come yet")
    if jump:
        run(e, 1.0, start=START + 50 * SECOND)
    after = run(e, 1.0, position=GRAINS)
    push(e, *(wrench(after + k * 10 * MS, READING) for k in range(200)))
    assert (
        refused(e)
        == "no poses come, the last one is 2.0 s old; start their driver, and tare again"
    )


def test_readings_that_ended_before_the_last_poses_are_no_tare():
    e = estimator()
    after = run(e, 1.0)
    run(e, 20.0, start=after, reading=())
    assert refused(e).startswith("no load-cell samples come, the last one is 20.0 s old")


def test_after_a_jump_back_in_time_a_still_tool_can_be_tared_again():
    e = estimator()
    run(e, 1.0, position=GRAINS)
    run(e, 1.0, start=START - 50 * SECOND)
    assert e.tare(0.5) == pytest.approx(READING)
    assert isinstance(push(e, pose(START - 49 * SECOND, AIR)), Estimate)

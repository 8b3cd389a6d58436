"""Tare: the bias that makes a still tool in the air weigh nothing, refused whenever it would be wrong."""

import re
from dataclasses import replace

import numpy as np
import pytest
from one_plate import LEVEL, SECOND, START, about, estimator, measurement, pose, twist, wrench

from rft_ros.errors import InputError
from rft_ros.estimator import Estimate, LoadCell
from rft_ros.estimator.load_cell import drift

MS = SECOND // 1000
AIR, GRAINS = (0.0, 0.0, 0.05), (0.0, 0.0, -0.01)
STILL, MOVING = (0.0, 0.0, 0.0), (0.0, 0.0, -0.02)
READING = (0.5, -0.25, 1.8, 0.01, 0.02, -0.03)


def run(e, seconds, *, start=START, position=AIR, linear=STILL, reading=READING, quaternion=(0.0, 0.0, 0.0, 1.0)):
    """100 Hz of twist, wrench and pose; returns the next stamp."""
    stamp = start
    while stamp < start + seconds * SECOND:
        e.push_twist(twist(stamp, linear))
        if reading is not None:
            e.push_wrench(wrench(stamp, reading))
        e.push_pose(pose(stamp, tuple(np.array(position) + np.array(linear) * (stamp - start) * 1e-9), quaternion))
        stamp += 10 * MS
    return stamp


def tared(e, window=0.5):
    return replace(e.settings, load_cell=replace(e.settings.load_cell, bias=e.tare(window)))


def test_a_still_tool_in_the_air_is_tared_to_its_mean_reading():
    e = estimator()
    after = run(e, 0.6, reading=(9.0,) * 6)
    run(e, 1.0, start=after)
    assert e.tare(0.5) == pytest.approx(READING, abs=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_after_a_tare_the_compensated_wrench_is_zero_weight_and_all(sign):
    """Taken in a tilted attitude with 0.6 kg on a rotated sensor; afterwards zero, there and turned another way."""
    cell = LoadCell(quaternion=about((1, 0, 0), 40.0), sign=sign, mass=0.6, center_of_mass=(0.01, 0.0, 0.05))
    tilted = about((0, 1, 0), 25.0)
    e = estimator(load_cell=cell)
    after = run(e, 1.0, quaternion=tilted)
    e.use(settings=tared(e))
    e.push_twist(twist(after, STILL))
    e.push_wrench(wrench(after, READING))
    e.push_pose(pose(after, AIR, tilted))
    assert measurement(e).compensated == pytest.approx([0.0] * 6, abs=1e-9)


def test_a_tare_changes_nothing_until_it_is_used():
    e = estimator()
    after = run(e, 1.0)
    e.tare(0.5)
    e.push_twist(twist(after, STILL))
    e.push_wrench(wrench(after, READING))
    e.push_pose(pose(after, AIR))
    assert measurement(e).compensated == pytest.approx(READING)


@pytest.mark.parametrize("window", [0.2, 0.5])
def test_only_samples_of_the_window_are_averaged(window):
    e = estimator()
    after = run(e, 1.0, reading=(0.0,) * 6)
    run(e, 0.1, start=after, reading=(1.0,) * 6)
    assert e.tare(window) == pytest.approx((0.1 / window,) * 6)


def refused(e, window=0.5):
    with pytest.raises(InputError) as refusal:
        e.tare(window)
    return str(refusal.value)


def test_tare_is_refused_before_any_pose():
    e = estimator()
    for k in range(100):
        e.push_wrench(wrench(START + k * 10 * MS))
    assert refused(e) == "tare refused: no pose with a known velocity has come yet"


def test_tare_is_refused_while_the_tool_moves_and_for_a_window_after_it():
    e = estimator()
    after = run(e, 1.0, linear=MOVING)
    assert refused(e) == "tare refused: within the last 0.5 s the tool moved at 0.0200 m/s"
    after = run(e, 0.4, start=after)
    assert "within the last 0.5 s the tool moved at 0.0" in refused(e)
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
            e.push_pose(pose(stamp, tuple(place.tolist()), tuple(quaternion.tolist())))
            e.push_wrench(wrench(stamp, READING))
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


@pytest.mark.parametrize("linear", [STILL, MOVING])
def test_tare_is_refused_in_the_grains_at_rest_or_not(linear):
    e = estimator()
    run(e, 1.0, position=GRAINS, linear=linear)
    assert refused(e) == "tare refused: within the last 0.5 s the tool was in the grains"


def test_tare_is_refused_while_the_velocity_is_not_known():
    e = estimator()
    after = run(e, 1.0)
    for k in range(20):
        e.push_wrench(wrench(after + k * 10 * MS, READING))
        e.push_pose(pose(after + k * 10 * MS, AIR))
    assert refused(e) == "tare refused: within the last 0.5 s the tool's velocity was unknown (twist_stale)"


def test_tare_is_refused_with_fewer_than_ten_samples():
    e = estimator()
    run(e, 1.0, reading=None)
    for k in range(9):
        e.push_wrench(wrench(START + SECOND - (9 - k) * MS, READING))
    assert refused(e) == "tare refused: 9 load-cell samples in the last 0.5 s; it needs 10"
    e.push_wrench(wrench(START + SECOND, READING))
    assert e.tare(0.5) == pytest.approx(READING)


def test_tare_is_refused_when_poses_stop_and_the_load_cell_continues():
    """The tool was last seen in the grains, two seconds ago: nothing says that it left them."""
    e = estimator()
    after = run(e, 1.0, position=GRAINS)
    for k in range(200):
        e.push_wrench(wrench(after + k * 10 * MS, READING))
    assert refused(e) == "tare refused: within the last 0.5 s no pose has shown the tool at rest"


def test_after_a_jump_back_in_time_a_still_tool_can_be_tared_again():
    e = estimator()
    run(e, 1.0, position=GRAINS)
    run(e, 1.0, start=START - 50 * SECOND)
    assert e.tare(0.5) == pytest.approx(READING)
    assert isinstance(e.push_pose(pose(START - 49 * SECOND, AIR)), Estimate)


def test_rest_before_a_jump_back_in_time_does_not_count_after_it():
    """After the jump the tool was last seen in the grains, two seconds ago."""
    e = estimator()
    run(e, 1.0)
    after = run(e, 1.0, start=START - 50 * SECOND, position=GRAINS)
    for k in range(200):
        e.push_wrench(wrench(after + k * 10 * MS, READING))
    assert refused(e) == "tare refused: within the last 0.5 s no pose has shown the tool at rest"

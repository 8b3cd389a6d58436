"""Inputs that no motion and no load cell gives: poses that jump, two publishers on a topic, axes without numbers."""

import math
from dataclasses import replace

import numpy as np
import pytest
from cells import loads, motion, wrong
from one_plate import MS, START, estimator, measurement, pose, push, twist, use, wrench
from recordings import plunge, write_ros2

from rft_ros.cli import main
from rft_ros.estimator import Reason
from rft_ros.estimator.pose_jumps import A_JUMP, IN_MILLIMETRES, TWO_PUBLISHERS
from rft_ros.estimator.pose_noise import NOISY_SENTENCE

STEP = 8 * MS
NAN = math.nan


def issues_after(places, *, step=STEP, start=START):
    """The issues after poses at these places [m]."""
    e = estimator(twist_source="pose_difference")
    for k, place in enumerate(places):
        push(e, pose(start + k * step, place))
    return e.issues()


def sinking(count, speed=0.02):
    return [(0.0, 0.0, 0.3 - 0.008 * speed * k) for k in range(count)]


def test_a_pose_that_jumps_60_mm_in_8_ms_is_named_as_a_jump_and_not_for_ever():
    before = sinking(50)
    after = [(x + 0.06, y, z) for x, y, z in sinking(400)[50:]]
    assert issues_after(before) == []
    assert A_JUMP in issues_after(before + after[:10])
    assert A_JUMP not in issues_after(before + after)


def test_stamps_that_begin_near_0_are_no_jump():
    """As of a table, a simulation, or a bag of them."""
    assert issues_after(sinking(50), start=1_000_000_000) == []


@pytest.mark.parametrize("speed", [0.02, 1.0, 4.0])
def test_a_fast_tool_does_not_jump(speed):
    assert not {A_JUMP, TWO_PUBLISHERS, IN_MILLIMETRES} & set(issues_after(sinking(50, speed)))


def test_two_publishers_of_poses_are_named_and_are_no_noise():
    """One gives the flange, the other the tool's tip."""
    places = [(x + 0.1 * (k % 2), y, z) for k, (x, y, z) in enumerate(sinking(200))]
    found = issues_after(places)
    assert TWO_PUBLISHERS in found
    assert NOISY_SENTENCE not in found


def test_poses_in_millimetres_are_named_and_are_no_noise():
    random = np.random.default_rng(1)
    places = 1e3 * (np.array(sinking(200)) + 1e-5 * random.standard_normal((200, 3)))
    found = issues_after(map(tuple, places.tolist()))
    assert IN_MILLIMETRES in found
    assert NOISY_SENTENCE not in found


def test_a_load_cell_without_torques_gives_forces_and_its_axes_are_named():
    e = estimator()
    push(e, twist(), wrench(numbers=(1.0, 2.0, 3.0, NAN, 0.5, math.inf)), pose())
    found = measurement(e)
    assert found.compensated[:3] == (1.0, 2.0, 3.0)
    assert np.isnan(found.compensated)[[3, 5]].all()
    assert np.isfinite(found.residual[:3]).all()
    assert any("gives no number on tx, tz" in issue for issue in e.issues())
    push(e, wrench(START + STEP))
    assert e.issues() == []


def test_a_load_cell_without_one_force_is_not_used_and_the_axis_is_named():
    e = estimator()
    assert push(e, wrench(numbers=(1.0, NAN, 3.0, 0.0, 0.0, 0.0))) is Reason.WRENCH_NOT_FINITE
    assert any("gives no number on fy" in issue for issue in e.issues())


def test_a_tare_without_torques_keeps_their_bias():
    e = estimator()
    use(e, sensor=replace(e.load_cell, bias=(0, 0, 0, 0.1, 0.2, 0.3)))
    for k in range(100):
        stamp = START + k * STEP
        reading = wrench(stamp, (1.0, 2.0, 3.0, NAN, NAN, NAN))
        push(e, reading, twist(stamp, (0.0, 0.0, 0.0)), pose(stamp, (0.0, 0.0, 0.1)))
    assert e.tare(0.5) == pytest.approx((1.0, 2.0, 3.0, 0.1, 0.2, 0.3))


STATES = motion(100.0)
LOADS = loads(STATES)
ODD = (np.arange(len(STATES)) % 2)[:, None]


def test_the_doctor_names_two_publishers_by_their_messages():
    of_poses = wrong(STATES, LOADS, poses=STATES[:, :3] + 0.1 * ODD * (0, 0, 1))
    assert [finding.name for finding in of_poses] == ["pose"]
    assert "jump to and fro by 0.1 m, as of two publishers" in of_poses[0].text
    of_readings = wrong(STATES, LOADS + ODD * (0, 3, 4, 0, 0, 0))
    assert any("/rft/wrench_measured jump to and fro by 5 N" in f.text for f in of_readings)
    seldom = (np.arange(len(STATES)) % 4 == 3)[:, None]
    of_rates = wrong(STATES, LOADS, poses=STATES[:, :3] + 0.1 * seldom * (0, 0, 1))
    assert [finding.name for finding in of_rates] == ["pose"]


def test_the_doctor_names_a_jump_with_its_length_and_time():
    places = STATES[:, :3].copy()
    places[500:] += (0.06, 0.0, 0.0)
    found = {finding.name: finding.text for finding in wrong(STATES, LOADS, poses=places)}
    assert "a pose jumps by 60 mm in 10 ms, 5.0 s after the first one" in found["jump"]


def test_the_doctor_names_axes_without_numbers_and_judges_by_the_forces():
    readings = LOADS.copy()
    readings[:, 3:] = NAN
    (found,) = wrong(STATES, readings)
    assert "no number on tx, ty, tz of /rft/wrench_measured" in found.text
    turned = {finding.name for finding in wrong(STATES, readings, sensor__sign=-1.0)}
    assert "sign" in turned


def test_a_recording_without_torques_is_replayed_and_a_calibration_names_the_axes(
    tmp_path, capsys
):
    rows = [
        (role, time, stamp, (*numbers[:3], NAN, NAN, NAN) if role == "wrench" else numbers)
        for role, time, stamp, numbers in plunge()
    ]
    bag = write_ros2(tmp_path / "bag", rows)
    file = tmp_path / "cell.yaml"
    file.write_text("/**: {ros__parameters: {mesh.file: plate}}")
    arguments = [str(bag), "--params", str(file), "-o"]
    assert main(["replay", *arguments, str(tmp_path / "out")]) == 0
    assert "gives no number on tx, ty, tz" in capsys.readouterr().out
    assert main(["calibrate", *arguments, str(tmp_path / "calibrated.yaml")]) == 2
    assert "gives no number on tx, ty, tz" in capsys.readouterr().err


def test_a_replay_of_two_publishers_says_so_and_calls_them_no_noise(tmp_path, capsys):
    offset = np.array((0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0))
    rows = [
        (role, time, stamp, tuple(np.array(numbers) + offset * (k // 3 % 2)))
        if role == "pose"
        else (role, time, stamp, numbers)
        for k, (role, time, stamp, numbers) in enumerate(plunge())
    ]
    bag = write_ros2(tmp_path / "bag", rows)
    assert main(["replay", str(bag), "-o", str(tmp_path / "out"), "--no-report"]) == 0
    said = capsys.readouterr().out
    assert TWO_PUBLISHERS in said
    assert "noise" not in said
    assert "millimetres" not in said.replace("in millimetres or a wrong mesh.scale", "")

"""Velocity from poses alone: the slope of a line through the last ones."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from one_plate import LEVEL, SECOND, START, estimator, pose, twist
from scipy.spatial.transform import Rotation

from rft_ros.estimator import Estimate, Reason
from rft_ros.estimator.velocity import PoseDifference

MS = SECOND // 1000
speeds = st.floats(-0.5, 0.5)
rates = st.floats(-3.0, 3.0)


def differenced(poses, *, window=0.05, max_age=0.1):
    """The twist after the last of these poses."""
    difference = PoseDifference()
    difference.span(window=window, max_age=max_age)
    ready = [difference.push(p) for p in poses]
    return difference.twist, ready


def screw(v, w, *, times, lever=(0.0, 0.0, 0.0), start=(0.1, -0.2, 0.3), turned=(0.1, 0.2, -0.3)):
    """Poses of a body that turns at w [rad/s] on an axis that moves at v [m/s]; its origin lies at `lever` from it."""
    poses = []
    for t in times:
        spin = Rotation.from_rotvec(np.array(w) * t)
        position = np.array(start) + np.array(v) * t + spin.apply(lever)
        quaternion = (spin * Rotation.from_rotvec(turned)).as_quat()
        poses.append(pose(START + round(t * SECOND), tuple(position.tolist()), tuple(quaternion.tolist())))
    return poses


@given(v=st.tuples(speeds, speeds, speeds), w=st.tuples(rates, rates, rates), flips=st.integers(0, 255))
def test_a_constant_twist_is_found_exactly(v, w, flips):
    """Also where a driver flips the sign of its quaternions, which are the same rotations."""
    poses = screw(v, w, times=np.arange(0, 0.064, 0.008))
    poses = [
        p._replace(quaternion=tuple(-c for c in p.quaternion)) if flips >> k & 1 else p for k, p in enumerate(poses)
    ]
    found, ready = differenced(poses)
    assert ready == [False, False, *[True] * 6]
    assert found == pytest.approx([*v, *w], abs=1e-9)


@given(steps=st.lists(st.integers(2, 12), min_size=4, max_size=8), v=st.tuples(speeds, speeds, speeds))
def test_uneven_stamps_do_not_matter(steps, v):
    found, _ = differenced(screw(v, (0.1, 0.2, 0.3), times=np.cumsum(steps) * 1e-3))
    assert found == pytest.approx([*v, 0.1, 0.2, 0.3], abs=1e-9)


@pytest.mark.parametrize(("window", "rate"), [(0.03, 500), (0.05, 1000), (0.07, 100), (0.1, 125), (0.3, 1000)])
def test_the_pose_at_the_windows_very_edge_counts_and_the_one_before_does_not(window, rate):
    """0.03 s hold 16 poses at 500 Hz, though 15 times 2 ms is more than 0.03 in floating point."""
    edge, step = round(window * rate), SECOND // rate
    for back, counts in ((edge, True), (edge + 1, False)):
        poses = [pose(START + k * step, (1e-3 if k == 2 else 0.0, 0.0, 0.0)) for k in range(back + 3)]
        found, _ = differenced(poses, window=window)
        assert (found[0] != 0.0) == counts


def test_a_point_off_the_axis_gets_the_velocity_of_the_windows_middle_less_a_tenth_of_its_half_turn_squared():
    """The slope of sin over [-a, a] is 3 (sin a - a cos a) / a³, that is 1 - a²/10; a = ω T/2."""
    w, lever, window = 2.0, 0.1, 0.2
    times = np.linspace(0.0, window, 101)
    found, _ = differenced(
        screw((0, 0, 0), (0, 0, w), times=times, lever=(lever, 0, 0)), window=window + 1e-6, max_age=1
    )
    a = w * window / 2
    shrink = 3 * (math.sin(a) - a * math.cos(a)) / a**3
    assert shrink == pytest.approx(1 - a**2 / 10, abs=1e-4)
    middle = np.cross((0, 0, w), Rotation.from_rotvec([0, 0, a]).apply([lever, 0, 0]))
    assert found[:3] == pytest.approx(shrink * middle, abs=1e-4 * w * lever)  # 101 samples for an integral
    assert found[3:] == pytest.approx([0, 0, w], abs=1e-9)


@pytest.mark.parametrize("window", [0.022, 0.052, 0.102])
def test_noise_in_the_poses_shrinks_as_least_squares_predicts(window):
    """n samples dt apart with noise σ: the slope's deviation is σ / dt * sqrt(12 / (n (n² - 1)))."""
    rng = np.random.default_rng(4)
    sigma, dt, n = 1e-5, 0.005, int(window / 0.005) + 1
    difference = PoseDifference()
    difference.span(window=window, max_age=1.0)
    found = []
    for k in range(400 * n):
        noise = rng.normal(0.0, sigma, 6)
        q = Rotation.from_rotvec(noise[3:]).as_quat()
        difference.push(pose(START + k * 5 * MS, tuple(noise[:3].tolist()), tuple(q.tolist())))
        if k % n == n - 1:  # windows that share no pose
            found.append(difference.twist.copy())
    predicted = sigma / dt * math.sqrt(12 / (n * (n * n - 1)))
    assert np.std(found, axis=0) == pytest.approx([predicted] * 6, rel=0.15)
    two_poses = sigma / dt * math.sqrt(2)
    assert predicted < 0.35 * two_poses


def test_poses_older_than_the_window_do_not_count():
    slow = screw((0.01, 0, 0), (0, 0, 0), times=np.arange(0, 0.2, 0.005))
    last = slow[-1]
    fast = [
        pose(last.stamp + k * 5 * MS, (last.position[0] + 5e-4 * k, *last.position[1:]), last.quaternion)
        for k in range(1, 12)
    ]
    found, _ = differenced([*slow, *fast], window=0.049)
    assert found[0] == pytest.approx(0.1, abs=1e-9)


def test_sparse_poses_are_used_three_at_a_time_as_long_as_they_are_fresh():
    """30 Hz against a window of 50 ms: three poses span 67 ms. At 15 Hz the third is older than max_age."""
    found, ready = differenced(screw((0.1, 0, 0), (0, 0, 0.5), times=np.arange(5) / 30))
    assert ready == [False, False, True, True, True]
    assert found == pytest.approx([0.1, 0, 0, 0, 0, 0.5], abs=1e-8)
    _, ready = differenced(screw((0.1, 0, 0), (0, 0, 0.5), times=np.arange(5) / 15))
    assert ready == [False] * 5


def test_after_a_gap_the_history_restarts():
    before = screw((0.1, 0, 0), (0, 0, 0), times=np.arange(0, 0.05, 0.008))
    after = screw((0.0, 0.2, 0), (0, 0, 0), times=np.arange(1.0, 1.05, 0.008))
    found, ready = differenced([*before, *after])
    assert ready == [False, False, *[True] * 5, False, False, *[True] * 5]
    assert found == pytest.approx([0, 0.2, 0, 0, 0, 0], abs=1e-9)


def test_hours_into_a_recording_the_twist_is_as_exact():
    late = [
        p._replace(stamp=p.stamp + 10**6 * SECOND)
        for p in screw((0.1, 0, 0), (0, 0, 1), times=np.arange(0, 0.064, 0.008))
    ]
    found, _ = differenced([pose(START), *late])
    assert found == pytest.approx([0.1, 0, 0, 0, 0, 1], abs=1e-6)


def test_the_estimator_predicts_from_poses_what_it_predicts_from_the_twist_topic():
    v, w = (0.002, 0.0, -0.02), (0.0, 0.0, 0.0)
    poses = screw(v, w, times=np.arange(0, 0.1, 0.005), start=(0, 0, -0.01), turned=(0, 0, 0))
    by_poses, by_topic = estimator(twist_source="pose_difference"), estimator()
    answers = [by_poses.push_pose(p) for p in poses]
    assert [a.reason for a in answers[:2]] == [Reason.POSE_HISTORY_SHORT] * 2
    for p, answer in list(zip(poses, answers, strict=True))[2:]:
        by_topic.push_twist(twist(p.stamp, v, w))
        assert isinstance(answer, Estimate)
        assert answer.predicted == pytest.approx(by_topic.push_pose(p).predicted, rel=1e-6, abs=1e-9)


def test_rate_limited_poses_still_count_as_history():
    e = estimator(twist_source="pose_difference", max_rate=50.0)
    answers = [
        e.push_pose(p) for p in screw((0, 0, -0.02), (0, 0, 0), times=np.arange(0, 0.05, 0.005), start=(0, 0, -0.01))
    ]
    assert sum(isinstance(a, Estimate) for a in answers) == 2
    assert e.counts[Reason.POSE_RATE_LIMITED.value] == 6


@pytest.mark.parametrize(("window", "at_rest"), [(0.1, True), (0.01, False)])
def test_encoder_noise_of_a_tool_at_rest_in_the_grains_is_tamed_by_the_window(window, at_rest):
    """5 µm at 200 Hz: the slope deviates by 0.036 mm/s over 21 poses, by 0.7 mm/s over 3; rest is below 0.2 mm/s."""
    rng = np.random.default_rng(8)
    e = estimator(twist_source="pose_difference", twist_window=window + 1e-4)
    for k in range(400):
        position = np.array([0, 0, -0.01]) + rng.normal(0, 5e-6, 3)
        e.push_pose(pose(START + k * 5 * MS, tuple(position.tolist()), LEVEL))
    share = e.counts[Reason.AT_REST.value] / 400
    assert share > 0.9 if at_rest else share < 0.1

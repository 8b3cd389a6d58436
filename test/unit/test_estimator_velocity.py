"""Velocity from poses alone: the slope of the last ones at the newest."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from one_plate import LEVEL, MS, SECOND, START, estimator, pose, push, twist
from scipy.spatial.transform import Rotation

from rft_ros.estimator import Estimate, PoseDifference, PoseNoise, Reason

speeds = st.floats(-0.5, 0.5)
rates = st.floats(-3.0, 3.0)


def twists(poses, *, window=0.2):
    """The twist after each pose, shape [n, 6]; NaN where there are not enough."""
    difference = PoseDifference()
    found = np.full((len(poses), 6), np.nan)
    for row, p in zip(found, poses, strict=True):
        if difference.push(p, window=window, gap=10**8):
            row[:] = difference.twist
    return found


def ready(found):
    """Whether there was a twist, as a string of - and +."""
    return "".join("-" if np.isnan(row[0]) else "+" for row in found)


def screw(v, w, *, times, lever=(0.0, 0.0, 0.0), start=(0.1, -0.2, 0.3), turned=(0.1, 0.2, -0.3)):
    """Poses of a body that turns at w [rad/s] on an axis that moves at v [m/s]; its origin lies at `lever` from it."""
    poses = []
    for t in times:
        spin = Rotation.from_rotvec(np.array(w) * t)
        position = np.array(start) + np.array(v) * t + spin.apply(lever)
        quaternion = (spin * Rotation.from_rotvec(turned)).as_quat()
        poses.append(
            pose(START + round(t * SECOND), tuple(position.tolist()), tuple(quaternion.tolist()))
        )
    return poses


@given(
    v=st.tuples(speeds, speeds, speeds),
    w=st.tuples(rates, rates, rates),
    flips=st.integers(0, 255),
    gaps=st.lists(st.integers(2, 12), min_size=8, max_size=8),
)
def test_a_constant_twist_is_found_exactly(v, w, flips, gaps):
    """Also with uneven stamps [ms], long after other poses, and of a driver that flips the sign of its quaternions."""
    poses = screw(v, w, times=1e6 + np.cumsum(gaps) * 1e-3)
    flipped = [p._replace(quaternion=tuple(-c for c in p.quaternion)) for p in poses]
    found = twists([pose(START), *(flipped[k] if flips >> k & 1 else poses[k] for k in range(8))])[
        1:
    ]
    assert ready(found[2:]) == "++++++"
    assert found[-1] == pytest.approx([*v, *w], abs=1e-6)


@given(
    v=st.tuples(speeds, speeds, speeds),
    a=st.tuples(speeds, speeds, speeds),
    rate=st.sampled_from([30, 125, 200, 1000]),
    more=st.integers(1, 20),
)
def test_under_constant_acceleration_there_is_no_lag(v, a, rate, more):
    times = np.arange(round(0.2 * rate) + more) / rate
    places = np.outer(times, v) + np.outer(times**2 / 2.0, a)
    poses = [
        pose(START + round(t * SECOND), tuple(p.tolist()), LEVEL)
        for t, p in zip(times, places, strict=True)
    ]
    assert twists(poses)[-1, :3] == pytest.approx(np.array(v) + np.array(a) * times[-1], abs=1e-6)


@pytest.mark.parametrize("rate", [125, 500, 1000])
def test_a_turning_body_has_the_velocity_of_now(rate):
    """A parabola over T errs by at most (ω T)²/10; a line would lag by ω T/2, a fifth."""
    w, lever, window = 2.0, 0.1, 0.2
    times = np.arange(0.0, 1.0, 1.0 / rate)
    found = twists(screw((0, 0, 0), (0, 0, w), times=times, lever=(lever, 0, 0)), window=window)[
        -1
    ]
    true = np.cross((0, 0, w), Rotation.from_rotvec([0, 0, w * times[-1]]).apply([lever, 0, 0]))
    assert np.linalg.norm(found[:3] - true) < (w * window) ** 2 / 10.0 * w * lever
    assert found[3:] == pytest.approx([0, 0, w], abs=1e-6)


def shaken(poses, sigma):
    """The poses with noise: sigma [m] in position, ten times as much [rad] in attitude."""
    rng = np.random.default_rng(4)
    out = []
    for p in poses:
        turned = Rotation.from_rotvec(rng.normal(0.0, 10.0 * sigma, 3)) * Rotation.from_quat(
            p.quaternion
        )
        position = np.array(p.position) + rng.normal(0.0, sigma, 3)
        out.append(pose(p.stamp, tuple(position.tolist()), tuple(turned.as_quat().tolist())))
    return out


def straight(v, sigma, *, seconds, rate):
    return shaken(screw(v, (0, 0, 0), times=np.arange(0, seconds, 1.0 / rate)), sigma)


@given(
    v=st.tuples(speeds, speeds, speeds),
    w=st.tuples(rates, rates, rates),
    sigma=st.sampled_from([1e-6, 1e-5, 1e-4]),
    jitter=st.sampled_from([0.0, 0.0005, 0.002]),
)
@settings(max_examples=20, deadline=None)
def test_the_noise_at_the_tip_is_that_of_the_poses_and_not_of_their_stamps(v, w, sigma, jitter):
    """Stamps at 125 Hz that differ from the time of the pose [s] move a pose along its path only."""
    times = np.arange(1000) / 125
    late = np.random.default_rng(1).normal(0.0, jitter, len(times))
    poses = shaken(screw(v, np.multiply(w, 0.1), times=times + late), sigma)
    noise = PoseNoise()
    for p, t in zip(poses, times, strict=True):
        noise.add(p._replace(stamp=START + round(t * SECOND)), gap=SECOND)
    assert noise.at_tip(0.1) == pytest.approx(np.hypot(sigma, 0.1 * 10.0 * sigma), rel=0.25)


@given(sigma=st.floats(1e-6, 1e-4))
@settings(max_examples=10, deadline=None)
def test_noise_at_rest_is_found_where_a_stage_has_it_along_its_one_axis(sigma):
    noise, height = PoseNoise(), np.random.default_rng(2).normal(0.0, sigma, 1000)
    for k, z in enumerate(height.tolist()):
        noise.add(pose(START + 8 * k * MS, (0.0, 0.0, z), LEVEL), gap=SECOND)
    assert 0.35 * sigma < noise.at_tip(0.1) < 1.2 * sigma


@given(st.integers(0, 99), st.sampled_from([0.0, 0.002]))
@settings(max_examples=10, deadline=None)
def test_corners_of_the_motion_are_no_noise(seed, jitter):
    """A corner in every 0.3 s at 100 Hz, in any direction."""
    random, noise = np.random.default_rng(seed), PoseNoise()
    directions = np.repeat(random.standard_normal((20, 3)), 30, axis=0)
    steps = 8e-4 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    late = np.abs(random.normal(0.0, jitter, len(steps)))[:, None]
    for k, place in enumerate((np.cumsum(steps, axis=0) + 100.0 * late * steps).tolist()):
        noise.add(pose(START + 10 * k * MS, tuple(place), LEVEL), gap=SECOND)
    assert noise.at_tip(0.1) < 5e-6


@pytest.mark.parametrize(("window", "rate"), [(0.1, 200), (0.2, 125), (0.2, 200)])
def test_noise_of_a_straight_motion_shrinks_as_least_squares_of_a_line_predicts(window, rate):
    """But for the few windows whose noise looks like a bend."""
    sigma, v = 1e-5, (0.01, 0.0, -0.02)
    found = twists(straight(v, sigma, seconds=6000 / rate, rate=rate), window=window)[100:]
    t = -np.arange(round(window * rate) + 1) / rate
    slope = np.sqrt(np.linalg.inv(np.vander(t, 2).T @ np.vander(t, 2))[0, 0])
    spread = 0.5 * np.subtract(*np.quantile(found, (0.84, 0.16), axis=0))
    assert spread == pytest.approx(sigma * slope * np.array([1, 1, 1, 10, 10, 10]), rel=0.2)
    assert np.mean(found, axis=0) == pytest.approx([*v, 0, 0, 0], abs=0.2 * sigma * slope)


@pytest.mark.parametrize("rate", [125, 500, 1000])
@pytest.mark.parametrize("sigma", [1e-6, 1e-5])
def test_noise_of_a_tool_at_rest_is_no_motion_but_a_speed_over_the_noise_is(sigma, rate):
    found = twists(straight((0, 0, 0), sigma, seconds=4000 / rate, rate=rate))[100:]
    assert np.mean(np.any(found != 0.0, axis=1)) < 0.01
    found = twists(straight((0.002, 0, 0), sigma, seconds=20, rate=125))[100:]
    assert np.mean(found[:, 0] > 0.001) > 0.99


@pytest.mark.parametrize("sigma", [0.0, 1e-6, 3e-6])
def test_a_turn_at_right_angles_is_followed_within_a_few_poses_and_does_not_overshoot(sigma):
    """From 10 mm/s along x to 10 mm/s along y, at 125 Hz."""
    before = screw((0.01, 0, 0), (0, 0, 0), times=np.arange(-1.0, 0.001, 0.008), start=(0, 0, 0))
    after = screw((0, 0.01, 0), (0, 0, 0), times=np.arange(0.008, 0.4, 0.008), start=(0, 0, 0))
    found = twists(shaken([*before, *after], sigma))[len(before) :, :2]
    if not sigma:
        assert found[0] == pytest.approx([0, 0.01], abs=1e-6)
    assert np.abs(found[3:] - [0, 0.01]).max() < 0.002


def test_after_a_jump_of_the_position_the_velocity_is_right_again_at_the_second_pose():
    poses = screw((0.01, 0, 0), (0, 0, 0), times=np.arange(0, 1, 0.008))
    poses[90:] = [
        p._replace(position=(p.position[0], p.position[1] + 0.005, p.position[2]))
        for p in poses[90:]
    ]
    found = twists(poses)
    assert abs(found[90, 1]) > 0.1
    assert found[91:, :3] == pytest.approx(np.tile([0.01, 0, 0], (len(poses) - 91, 1)), abs=1e-6)


def test_sparse_poses_count_as_long_as_none_is_missing_for_max_age():
    """At 15 Hz three poses are taken though they span more than the window; at 8 Hz each is 125 ms after the last."""
    found = twists(screw((0.1, 0, 0), (0, 0, 0.5), times=np.arange(5) / 15), window=0.05)
    assert ready(found) == "--+++"
    assert found[-1] == pytest.approx([0.1, 0, 0, 0, 0, 0.5], abs=1e-8)
    assert ready(twists(screw((0.1, 0, 0), (0, 0, 0.5), times=np.arange(5) / 8))) == "-----"


def test_after_a_gap_the_history_restarts():
    before = screw((0.1, 0, 0), (0, 0, 0), times=np.arange(0, 0.05, 0.008))
    found = twists([*before, *screw((0.0, 0.2, 0), (0, 0, 0), times=np.arange(1.0, 1.05, 0.008))])
    assert ready(found) == "--+++++--+++++"
    assert found[-1] == pytest.approx([0, 0.2, 0, 0, 0, 0], abs=1e-9)


def descent(v=(0.0, 0.0, -0.02), *, count=20):
    return screw(v, (0, 0, 0), times=np.arange(count) / 200, start=(0, 0, -0.01), turned=(0, 0, 0))


def test_the_estimator_predicts_from_poses_what_it_predicts_from_the_twist_topic():
    v = (0.002, 0.0, -0.02)
    by_poses, by_topic = estimator(twist_source="pose_difference"), estimator()
    for k, p in enumerate(descent(v)):
        answer = push(by_poses, twist(p.stamp, frame="unused"), p)
        if k < 2:
            assert answer.reason is Reason.POSE_HISTORY_SHORT
        else:
            assert answer.predicted == pytest.approx(
                push(by_topic, twist(p.stamp, v), p).predicted, rel=1e-6, abs=1e-9
            )
    assert by_poses.counts.keys() == {Reason.POSE_HISTORY_SHORT}


def test_rate_limited_poses_still_count_as_history():
    e = estimator(twist_source="pose_difference", max_rate=50.0)
    assert sum(isinstance(push(e, p), Estimate) for p in descent(count=10)) == 2
    assert e.counts[Reason.POSE_RATE_LIMITED] == 6


@pytest.mark.parametrize("window", [0.05, 0.2])
def test_a_tool_at_rest_in_the_grains_rests_for_the_estimator_however_its_encoders_shake(window):
    """20 µm at 200 Hz: two poses differ by 6 mm/s; `rest_speed` is 0.2 mm/s."""
    e = estimator(twist_source="pose_difference", twist_window=window)
    push(e, *shaken(descent((0, 0, 0), count=400), 2e-5))
    assert e.counts[Reason.AT_REST] / 400 > 0.9


@pytest.mark.parametrize("seed", range(3))
def test_steps_of_coarse_encoders_are_no_motion_either(seed):
    """Positions in steps of 1.4 µm that change a few times a second, as an ABB arm at rest reports them at 200 Hz."""
    rng = np.random.default_rng(seed)
    drift = np.cumsum(rng.normal(0.0, 5e-8, 2000)) + rng.normal(0.0, 2e-7, 2000)
    steps = 1.4e-6 * np.round(drift / 1.4e-6)
    assert np.ptp(steps) > 1e-6
    poses = [pose(START + k * 5 * MS, (0.0, 0.0, z), LEVEL) for k, z in enumerate(steps.tolist())]
    assert np.abs(twists(poses)[2:, 2]).max() < 2e-4


@given(
    slow=st.sampled_from([30, 60, 90, 120]),
    fast=st.sampled_from([250, 500, 1000]),
    v=st.tuples(speeds, speeds, speeds),
    sigma=st.sampled_from([0.0, 5e-6]),
)
@settings(max_examples=20, deadline=None)
def test_a_driver_that_repeats_poses_gives_the_velocities_of_the_poses_without_the_repeats(
    slow, fast, v, sigma
):
    """It publishes at a fast rate what is measured at a slow one: at first its repeats may be a tool at rest.

    When the tool stops, the velocity is soon zero.
    """
    poses = shaken(screw(v, (0, 0, 0), times=np.arange(0.0, 1.0, 1.0 / slow)), sigma)
    due = [poses[k * slow // fast]._replace(stamp=START + k * SECOND // fast) for k in range(fast)]
    new = [k == 0 or due[k][2:] != due[k - 1][2:] for k in range(fast)]
    every, once = twists(due), twists([p for p, is_new in zip(due, new, strict=True) if is_new])
    np.testing.assert_array_equal(every[new][slow // 2 :], once[slow // 2 :])
    still = [due[-1]._replace(stamp=due[-1].stamp + k * SECOND // fast) for k in range(1, fast)]
    assert np.abs(twists([*due, *still])[-1]).max() < 1e-9

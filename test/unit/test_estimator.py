"""The estimator as a whole: what an estimate holds, swaps while it runs, and the same samples twice."""

import math
from dataclasses import replace

import numpy as np
import pytest
from one_plate import AREA, SECOND, START, about, estimator, measurement, plate_model, pose, twist, wrench

from rft_ros.estimator import Estimate, Estimator, LoadCell, Reason, Settings
from rft_ros.rft import Plates
from rft_ros.tool import Tool

MS = SECOND // 1000


def answer(e, stamp=START, **where) -> Estimate:
    e.push_twist(twist(stamp))
    e.push_wrench(wrench(stamp))
    return e.push_pose(pose(stamp, **where))


def test_the_force_on_a_flat_plate_is_1_newton_a_cm_of_depth_a_cm2_times_zeta():
    """α_z(0, 90°) of the generic medium is 1 N/cm³: 1 cm deep, 4 cm², ζ = 0.33."""
    estimate = answer(estimator(model=plate_model(zeta=0.33)))
    assert estimate.predicted[2] == pytest.approx(0.33 * 1.0 * 1.0 * 4.0, rel=1e-6)
    assert estimate.submerged_area == pytest.approx(AREA)
    assert estimate.stamp == START


def test_depth_counts_from_the_surface_height():
    estimate = answer(estimator(surface_height=0.25), position=(0.0, 0.0, 0.23))
    assert estimate.predicted[2] == pytest.approx(8.0, rel=1e-6)


def test_in_the_air_the_prediction_is_zero_and_the_residual_is_the_compensated_wrench():
    e = estimator()
    e.push_twist(twist())
    e.push_wrench(wrench(numbers=(1, 2, 3, 4, 5, 6)))
    estimate = e.push_pose(pose(position=(0, 0, 1)))
    assert estimate.predicted == (0.0,) * 6
    measured = measurement(e)
    assert measured.residual == measured.compensated == (1, 2, 3, 4, 5, 6)
    assert estimate.submerged_area == 0.0


def far_plate(distance) -> Tool:
    corners = np.zeros((3, 3))
    plates = Plates.from_arrays([[0, distance, 0]], [[0, 0, -1]], [AREA])
    return Tool(
        name="far",
        file="",
        plates=plates,
        facets=plates,
        vertices=corners,
        faces=np.array([[0, 1, 2]]),
        issues=(),
        corners=corners,
    )


def test_the_speed_is_an_upper_bound_of_the_fastest_plates_speed():
    """20 cm from the origin, turning at 0.5 rad/s about x and sinking at 1 cm/s: at most 1 + 10 cm/s."""
    e = estimator(model=plate_model(tool=far_plate(0.2)))
    e.push_twist(twist(angular=(0.5, 0.0, 0.0)))
    assert e.push_pose(pose()).speed == pytest.approx(0.01 + 0.5 * 0.2)


def test_a_tool_that_only_turns_is_moving_if_its_plates_are():
    """1 mrad/s at 20 cm is 0.2 mm/s at the plate: at the origin nothing moves at all."""
    for rate, reason in ((0.9e-3, Reason.AT_REST), (1.1e-3, None)):
        e = estimator(model=plate_model(tool=far_plate(0.2)))
        e.push_twist(twist(linear=(0.0, 0.0, 0.0), angular=(-rate, 0.0, 0.0)))
        answer = e.push_pose(pose())
        assert (answer.reason is reason) if reason else answer.predicted[2] == pytest.approx(4.0, rel=1e-4)


def test_the_last_twist_at_or_before_the_pose_is_used():
    e = estimator()
    for k in range(3):
        e.push_twist(twist(START + k * MS, (0.0, 0.0, -0.01 * (k + 1))))
    assert e.push_pose(pose(START + MS)).speed == pytest.approx(0.02)
    assert e.push_pose(pose(START + 5 * MS)).speed == pytest.approx(0.03)


def test_a_twist_that_comes_after_its_pose_is_not_used_for_it():
    e = estimator()
    e.push_twist(twist(START, (0.0, 0.0, -0.01)))
    assert e.push_pose(pose(START + MS)).speed == pytest.approx(0.01)
    e.push_twist(twist(START + MS, (0.0, 0.0, -0.02)))
    assert e.push_pose(pose(START + 2 * MS)).speed == pytest.approx(0.02)


def test_a_new_model_answers_the_next_pose_under_its_own_generation():
    e = estimator(model=plate_model(generation=3))
    before = answer(e)
    e.use(model=plate_model(zeta=2.0, generation=4))
    after = answer(e, START + MS)
    assert (before.generation, after.generation) == (3, 4)
    assert after.predicted[2] == pytest.approx(2.0 * before.predicted[2])


def test_new_settings_and_models_keep_the_inputs_and_the_pose_history():
    e = estimator(twist_source="pose_difference")
    for k in range(5):
        e.push_wrench(wrench(START + k * MS))
        e.push_pose(pose(START + k * MS, (0.0, 0.0, -0.01 - 1e-5 * k)))
    e.use(settings=replace(e.settings, surface_height=0.01), model=plate_model(zeta=0.5, generation=1))
    estimate = e.push_pose(pose(START + 5 * MS, (0.0, 0.0, -0.01005)))
    assert estimate.predicted[2] == pytest.approx(0.5 * 4.0 * 2.005, rel=1e-6)
    assert measurement(e).residual is not None
    assert e.counts["estimates"] == 4


def test_a_new_load_cell_applies_to_the_next_pose():
    e = estimator()
    answer(e)
    e.use(settings=replace(e.settings, load_cell=LoadCell(bias=(1.0,) * 6)))
    answer(e, START + MS)
    assert [m.compensated for m in e.measurements()] == [(0.0,) * 6, (-1.0,) * 6]


def test_a_pose_without_an_answer_leaves_the_state_of_the_last_one():
    e = estimator(max_rate=10.0)
    answer(e)
    assert answer(e, START + MS, position=(0.0, 0.0, -0.02)).reason is Reason.POSE_RATE_LIMITED
    assert e.state[2] == -0.01
    assert e.push_pose(pose(START + SECOND, (0.0, 0.0, -0.03))).reason is Reason.TWIST_STALE
    assert e.state[2] == -0.01
    assert e.depth() == pytest.approx(0.03)


def test_settings_and_model_can_be_read_back():
    settings, model = Settings(surface_height=0.1), plate_model()
    e = Estimator(settings, model)
    assert (e.settings, e.model) == (settings, model)


def recording(seed):
    """Two seconds of a jittery cell: three streams, a tumbling tool, and the odd bad sample."""
    rng = np.random.default_rng(seed)
    samples = []
    for k in range(400):
        stamp = START + k * 5 * MS + int(rng.integers(0, MS))
        samples.append(("push_twist", twist(stamp, tuple(rng.normal(0, 0.02, 3).tolist()), (0.1, 0.0, 0.2), "tool")))
        samples.append(("push_wrench", wrench(stamp - 2 * MS, rng.normal(0, 5, 6).tolist())))
        depth = 0.02 * math.sin(k / 40)
        bad = k % 97 == 96
        position = (0.0, math.nan if bad else 0.0, -depth)
        samples.append(("push_pose", pose(stamp, position, about((0.6, 0.0, 0.8), 0.3 * k))))
    return samples


@pytest.mark.parametrize("twist_source", ["topic", "pose_difference"])
def test_the_same_samples_give_the_same_answers_bit_for_bit(twist_source):
    def answers():
        cell = LoadCell(position=(0.01, 0.02, 0.03), quaternion=about((0, 1, 0), 30.0), mass=0.5, bias=(0.1,) * 6)
        e = estimator(load_cell=cell, twist_source=twist_source)
        answers = [(getattr(e, push)(sample), e.measurements()) for push, sample in recording(6)]
        e.finish()
        return answers, e.measurements(), e.counts

    first, second = answers(), answers()
    assert repr(first) == repr(second)
    assert first[-1]["estimates"] > 300


def test_every_sample_is_accounted_for():
    """Poses in = estimates + poses reasons; what is counted besides are inputs turned away and missing residuals."""
    e = estimator(max_rate=150.0)
    reasons = 0
    for push, sample in recording(7):
        result = getattr(e, push)(sample)
        reasons += push == "push_pose" and not isinstance(result, Estimate)
    assert e.counts["estimates"] + reasons == 400
    poses = ("pose_not_finite", "pose_rate_limited")
    assert sum(e.counts[name] for name in poses) == reasons
    assert e.counts["pose_not_finite"] == 4

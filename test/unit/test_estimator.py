"""The estimator as a whole: what an estimate holds, swaps while it runs, and the same samples twice."""

import math
from dataclasses import replace

import numpy as np
import pytest
from one_plate import AREA, SECOND, START, about, estimator, plate_model, plate_tool, pose, push, twist
from one_plate import wrench as load

from rft_ros.estimator import Estimate, LoadCell, Reason

MS = SECOND // 1000


def answer(e, stamp=START, **where) -> Estimate:
    return push(e, twist(stamp), load(stamp), pose(stamp, **where))


def test_the_force_on_a_flat_plate_is_1_newton_a_cm_of_depth_a_cm2_times_zeta():
    """α_z(0, 90°) of the generic medium is 1 N/cm³: 1 cm below the surface, 4 cm², ζ = 0.33."""
    for surface in (0.0, 0.25):
        e = estimator(model=plate_model(zeta=0.33), surface_height=surface)
        estimate = push(e, twist(START - 20 * MS), load(START - 50 * MS), pose(position=(0.0, 0.0, surface - 0.01)))
        assert estimate.predicted[2] == pytest.approx(0.33 * 1.0 * 1.0 * 4.0, rel=1e-6)
        assert estimate.submerged_area == pytest.approx(AREA)
        assert estimate.stamp == START


def test_the_speed_is_an_upper_bound_of_the_fastest_plates_speed_and_decides_on_rest():
    """20 cm from the origin: at 0.5 rad/s and 1 cm/s at most 11 cm/s; 1 mrad/s alone is 0.2 mm/s at the plate."""
    model = plate_model(tool=plate_tool(distance=0.2))
    assert push(estimator(model=model), twist(angular=(0.5, 0.0, 0.0)), pose()).speed == pytest.approx(0.11)
    for rate, rests in ((0.9e-3, True), (1.1e-3, False)):
        found = push(estimator(model=model), twist(linear=(0.0, 0.0, 0.0), angular=(-rate, 0.0, 0.0)), pose())
        assert (found.reason is Reason.AT_REST) if rests else found.predicted[2] == pytest.approx(4.0, rel=1e-4)


def test_the_last_twist_at_or_before_the_pose_that_has_come_is_used():
    e = estimator()
    push(e, *(twist(START + k * MS, (0.0, 0.0, -0.01 * (k + 1))) for k in range(3)))
    assert push(e, pose(START + MS)).speed == pytest.approx(0.02)
    assert push(e, pose(START + 5 * MS)).speed == pytest.approx(0.03)
    assert push(e, twist(START + 5 * MS, (0.0, 0.0, -0.05)), pose(START + 6 * MS)).speed == pytest.approx(0.05)


def test_new_settings_and_models_apply_to_the_next_pose_and_keep_inputs_and_history():
    e = estimator(twist_source="pose_difference", model=plate_model(generation=3))
    for k in range(5):
        last = push(e, load(START + k * MS), pose(START + k * MS, (0.0, 0.0, -0.01 - 1e-5 * k)))
    assert last.generation == 3
    settings = replace(e.settings, surface_height=0.01, load_cell=LoadCell(bias=(1.0,) * 6))
    model = plate_model(zeta=0.5, generation=4)
    e.use(settings=settings, model=model)
    assert (e.settings, e.model) == (settings, model)
    estimate = push(e, pose(START + 5 * MS, (0.0, 0.0, -0.01005)))
    assert estimate.generation == 4
    assert estimate.predicted[2] == pytest.approx(0.5 * 4.0 * 2.005, rel=1e-6)
    e.finish()
    assert [m.compensated[0] for m in e.measurements()[-2:]] == [0.0, -1.0]
    assert e.counts["estimates"] == 4


def test_a_pose_without_an_answer_leaves_the_state_of_the_last_one():
    e = estimator(max_rate=10.0)
    answer(e)
    assert answer(e, START + MS, position=(0.0, 0.0, -0.02)).reason is Reason.POSE_RATE_LIMITED
    assert push(e, pose(START + SECOND, (0.0, 0.0, -0.03))).reason is Reason.TWIST_STALE
    assert e.state[2] == -0.01
    assert e.depth() == pytest.approx(0.03)


def recording(seed):
    """Two seconds of a jittery cell: three streams, a tumbling tool, and the odd bad sample."""
    rng = np.random.default_rng(seed)
    for k in range(400):
        stamp = START + k * 5 * MS + int(rng.integers(0, MS))
        yield twist(stamp, tuple(rng.normal(0, 0.02, 3).tolist()), (0.1, 0.0, 0.2), "tool")
        yield load(stamp - 2 * MS, rng.normal(0, 5, 6).tolist())
        position = (0.0, math.nan if k % 97 == 96 else 0.0, -0.02 * math.sin(k / 40))
        yield pose(stamp, position, about((0.6, 0.0, 0.8), 0.3 * k))


@pytest.mark.parametrize("twist_source", ["topic", "pose_difference"])
def test_the_same_samples_give_the_same_answers_bit_for_bit(twist_source):
    def answers():
        cell = LoadCell(position=(0.01, 0.02, 0.03), quaternion=about((0, 1, 0), 30.0), mass=0.5, bias=(0.1,) * 6)
        e = estimator(load_cell=cell, twist_source=twist_source)
        answers = [(push(e, sample), e.measurements()) for sample in recording(6)]
        e.finish()
        return answers, e.measurements(), e.counts

    first, second = answers(), answers()
    assert repr(first) == repr(second)
    assert first[-1]["estimates"] > 300

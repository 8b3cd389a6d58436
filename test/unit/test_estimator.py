"""The estimator as a whole: what an estimate holds, swaps while it runs, and every reason for giving none."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from one_plate import (
    SECOND,
    START,
    about,
    config,
    estimator,
    measurement,
    plate_model,
    plate_tool,
    pose,
    push,
    twist,
    use,
    wrench,
)
from scipy.spatial.transform import Rotation

from rft_ros.estimator import Estimate, PoseSample, Reason
from rft_ros.parameters import LoadCell
from rft_ros.tool import load_tool

MS = SECOND // 1000
AGE = 100 * MS  # the default max_input_age


def test_the_force_on_a_flat_plate_is_1_newton_a_cm_of_depth_a_cm2_times_zeta():
    """α_z(0, 90°) of the generic medium is 1 N/cm³: 1 cm below the surface, 4 cm², ζ = 0.33."""
    for surface in (0.0, 0.25):
        e = estimator(model=plate_model(zeta=0.33), surface_height=surface)
        estimate = push(
            e,
            twist(START - 20 * MS),
            wrench(START - 50 * MS),
            pose(position=(0.0, 0.0, surface - 0.01)),
        )
        assert estimate.predicted[2] == pytest.approx(0.33 * 1.0 * 1.0 * 4.0, rel=1e-6)
        assert estimate.submerged_area == pytest.approx(4e-4)
        assert estimate.stamp == START


def test_the_speed_is_an_upper_bound_of_the_fastest_plates_speed_and_decides_on_rest():
    """20 cm from the origin: at 0.5 rad/s and 1 cm/s at most 11 cm/s; 1 mrad/s alone is 0.2 mm/s at the plate."""
    model = plate_model(tool=plate_tool(distance=0.2))
    assert push(
        estimator(model=model), twist(angular=(0.5, 0.0, 0.0)), pose()
    ).speed_bound == pytest.approx(0.11)
    for rate, rests in ((0.9e-3, True), (1.1e-3, False)):
        found = push(
            estimator(model=model),
            twist(linear=(0.0, 0.0, 0.0), angular=(-rate, 0.0, 0.0)),
            pose(),
        )
        assert (
            (found.reason is Reason.AT_REST)
            if rests
            else found.predicted[2] == pytest.approx(4.0, rel=1e-4)
        )


def test_the_last_twist_at_or_before_the_pose_that_has_come_is_used():
    e = estimator()
    push(e, *(twist(START + k * MS, (0.0, 0.0, -0.01 * (k + 1))) for k in range(3)))
    assert push(e, pose(START + MS)).speed_bound == pytest.approx(0.02)
    assert push(e, pose(START + 5 * MS)).speed_bound == pytest.approx(0.03)
    assert push(
        e, twist(START + 5 * MS, (0.0, 0.0, -0.05)), pose(START + 6 * MS)
    ).speed_bound == pytest.approx(0.05)


def test_a_new_config_and_model_apply_to_the_next_pose_and_keep_inputs_and_history():
    e = estimator(twist_source="pose_difference", model=plate_model(generation=3))
    for k in range(5):
        last = push(e, wrench(START + k * MS), pose(START + k * MS, (0.0, 0.0, -0.01 - 1e-5 * k)))
    assert last.generation == 3
    new = config(e.config, surface_height=0.01, sensor=LoadCell(bias=(1.0,) * 6))
    model = plate_model(zeta=0.5, generation=4)
    e.use(config=new, model=model)
    assert (e.config, e.model) == (new, model)
    estimate = push(e, pose(START + 5 * MS, (0.0, 0.0, -0.01005)))
    assert estimate.generation == 4
    assert estimate.predicted[2] == pytest.approx(0.5 * 4.0 * 2.005, rel=1e-6)
    e.finish()
    assert [m.compensated[0] for m in e.measurements()[-2:]] == [0.0, -1.0]
    assert e.estimates == 4


def test_a_pose_without_an_answer_leaves_the_state_of_the_last_one():
    e, _ = pushed(twist(), pose(), max_rate=10.0)
    assert push(e, pose(START + MS, (0.0, 0.0, -0.02))).reason is Reason.POSE_RATE_LIMITED
    assert push(e, pose(START + SECOND, (0.0, 0.0, -0.03))).reason is Reason.TWIST_STALE
    assert e.state[2] == -0.01
    assert e.depth() == pytest.approx(0.03)


def recording(seed):
    """Two seconds of a jittery cell: three streams, a tumbling tool, and the odd bad sample."""
    rng = np.random.default_rng(seed)
    for k in range(400):
        stamp = START + k * 5 * MS + int(rng.integers(0, MS))
        yield twist(stamp, tuple(rng.normal(0, 0.02, 3).tolist()), (0.1, 0.0, 0.2), "tool")
        yield wrench(stamp - 2 * MS, rng.normal(0, 5, 6).tolist())
        position = (0.0, math.nan if k % 97 == 96 else 0.0, -0.02 * math.sin(k / 40))
        yield pose(stamp, position, about((0.6, 0.0, 0.8), 0.3 * k))


@pytest.mark.parametrize("twist_source", ["topic", "pose_difference"])
def test_the_same_samples_give_the_same_answers_bit_for_bit_also_as_arrays(twist_source):
    def answers(of=tuple):
        cell = LoadCell(
            position=(0.01, 0.02, 0.03),
            quaternion=about((0, 1, 0), 30.0),
            mass=0.5,
            bias=(0.1,) * 6,
        )
        e = estimator(sensor=cell, twist_source=twist_source)
        samples = (
            type(s)(*(of(v) if isinstance(v, tuple) else v for v in s)) for s in recording(6)
        )
        answers = [(push(e, sample), e.measurements()) for sample in samples]
        e.finish()
        return answers, e.measurements(), e.counts, e.estimates

    first, second = answers(), answers()
    assert repr(first) == repr(second)
    assert answers(np.array) == first
    assert first[-1] > 300


def pushed(*samples, **values):
    """An estimator that was given these samples in this order, and what it said to the last one."""
    e = estimator(**values)
    return e, push(e, *samples)


SCENES = {
    Reason.POSE_NOT_FINITE: (twist(), pose(position=(0.0, math.nan, 0.0))),
    Reason.POSE_QUATERNION_NOT_UNIT: (twist(), pose(quaternion=(0.0, 0.0, 0.0, 0.0))),
    Reason.POSE_FRAME_UNKNOWN: (twist(), pose(frame="camera")),
    Reason.POSE_STAMP_ZERO: (twist(), pose(stamp=0)),
    Reason.POSE_REPEATED: (twist(), pose(), pose()),
    Reason.POSE_OUT_OF_ORDER: (twist(), pose(), pose(START - 1)),
    Reason.POSE_RATE_LIMITED: (twist(), pose(), pose(START + MS)),
    Reason.POSE_HISTORY_SHORT: (pose(), pose(START + MS)),
    Reason.TWIST_MISSING: (pose(),),
    Reason.TWIST_STALE: (twist(), pose(START + AGE + 1)),
    Reason.TWIST_NOT_FINITE: (twist(linear=(math.nan, 0.0, 0.0)),),
    Reason.TWIST_FRAME_UNKNOWN: (twist(frame="flange"),),
    Reason.TWIST_STAMP_ZERO: (twist(stamp=0),),
    Reason.TWIST_OUT_OF_ORDER: (twist(), twist(START - 1)),
    Reason.AT_REST: (twist(linear=(0.0, 0.0, 0.0)), pose()),
    Reason.ESTIMATE_NOT_FINITE: (twist(), pose(position=(0.0, 0.0, -9e99))),
    Reason.WRENCH_NOT_FINITE: (wrench(numbers=(0, 0, math.inf, 0, 0, 0)),),
    Reason.WRENCH_FRAME_UNKNOWN: (wrench(frame="tool"),),
    Reason.WRENCH_STAMP_ZERO: (wrench(stamp=0),),
    Reason.WRENCH_OUT_OF_ORDER: (wrench(), wrench(START - 1)),
}
SETTINGS = {
    Reason.POSE_RATE_LIMITED: {"max_rate": 100.0},
    Reason.POSE_HISTORY_SHORT: {"twist_source": "pose_difference"},
}
ELSEWHERE = (
    "wrench_missing",
    "wrench_stale",
    "surface_",
    "tf_",
    "sensor_frame_unknown",
    "time_jump",
    "message_",
)
"""In test_estimator_load_cell.py, test_estimator_ground.py, test_transforms.py, below, and in test/ros/test_node.py."""


def test_every_reason_has_a_scene_here():
    assert {*SCENES} == {reason for reason in Reason if not reason.value.startswith(ELSEWHERE)}


@pytest.mark.parametrize("reason", SCENES, ids=str)
def test_a_refused_sample_is_counted_under_its_reason_and_the_next_are_answered(reason):
    e, answer = pushed(*SCENES[reason], **SETTINGS.get(reason, {}))
    sample = SCENES[reason][-1]
    assert answer == ((sample.stamp, reason) if type(sample).__name__ == "PoseSample" else reason)
    assert e.counts[reason] >= 1
    for k in range(4):
        stamp = START + 2 * SECOND + 20 * k * MS
        answer = push(e, twist(stamp), wrench(stamp), pose(stamp, (0.0, 0.0, -0.01 - 2e-4 * k)))
    assert answer.predicted[2] == pytest.approx(400.0 * (0.01 + 6e-4), rel=1e-6)
    assert measurement(e).residual is not None


def test_the_last_unknown_frame_is_named_with_the_expected_one_until_the_config_changes():
    e, _ = pushed(
        pose(frame="camera"), pose(frame="base_link"), twist(frame="flange"), wrench(frame="tool")
    )
    named = {
        "pose_frame_unknown": "pose frame_id 'base_link' is not world_frame 'world'",
        "twist_frame_unknown": "twist frame_id 'flange' is neither world_frame 'world' nor tool_frame 'tool'",
        "wrench_frame_unknown": "wrench frame_id 'tool' is not sensor_frame 'ft_sensor', nor fixed to it or"
        " world_frame 'world'",
    }
    remedy = "; set the parameter to an existing frame, or publish the transform between the two on /tf_static"
    named = {reason: said + remedy for reason, said in named.items()}
    assert e.unknown_frames() == named
    assert e.counted() == [
        f"{name}: {1 + (name[0] == 'p')} ({said})" for name, said in named.items()
    ]
    use(e, world_frame="base_link")
    assert e.unknown_frames() == {}
    assert e.counted()[0] == "pose_frame_unknown: 2"


def test_inputs_as_old_as_max_input_age_are_used_and_those_after_the_pose_are_missing():
    for age in (0, AGE):
        e, answer = pushed(twist(START - age), wrench(START - age), pose())
        assert isinstance(answer, Estimate)
        assert measurement(e).residual is not None
    e, answer = pushed(twist(START + 1), pose())
    assert answer.reason is Reason.TWIST_MISSING


@pytest.mark.parametrize(
    "bad",
    [
        *(pose(quaternion=(0, 0, 0, size)) for size in (0.0, 0.98, 1.02)),
        pose(START + 1, frame="camera"),
        pose(START + 1, position=(math.inf, 0.0, 0.0)),
    ],
)
def test_a_refused_pose_does_not_count_as_the_last_one(bad):
    e, answer = pushed(twist(), bad)
    assert answer.reason.value.startswith("pose_")
    assert isinstance(push(e, pose()), Estimate)


def test_a_jump_back_by_a_second_or_more_is_a_new_beginning_and_by_less_a_late_pose():
    """A bag that loops: the first pose after the jump is answered, the history before it is forgotten."""
    e, answer = pushed(twist(), pose(), twist(START - SECOND), pose(START - SECOND))
    assert isinstance(answer, Estimate)
    measurement(e)
    assert (e.estimates, e.counts) == (2, {"time_jump": 1, "wrench_missing": 2})
    poses = [pose(START + k * MS) for k in range(5)]
    _, answer = pushed(*poses, pose(START - 2 * SECOND), twist_source="pose_difference")
    assert answer.reason is Reason.POSE_HISTORY_SHORT
    _, answer = pushed(twist(), wrench(), pose(), pose(START - 2 * SECOND))
    assert answer.reason is Reason.TWIST_MISSING
    e, answer = pushed(twist(), pose(), pose(START - SECOND + 1))
    assert answer.reason is Reason.POSE_OUT_OF_ORDER
    assert Reason.TIME_JUMP not in e.counts


@given(
    rate=st.sampled_from([125.0, 60.0, 25.0, 1.0]),
    period=st.sampled_from([8 * MS, MS]),
    seed=st.integers(0, 99),
)
@settings(max_examples=10, deadline=None)
@example(rate=125.0, period=8 * MS, seed=0)
def test_max_rate_bounds_the_estimates_and_a_limit_at_the_streams_own_rate_drops_no_pose(
    rate, period, seed
):
    """In four seconds of stamps that jitter by a tenth of the period. A new limit counts from the next pose on."""
    e, poses = estimator(max_rate=1e-300), 4 * SECOND // period
    push(e, twist(), pose())
    assert push(e, pose(START + MS)).reason is Reason.POSE_RATE_LIMITED
    use(e, max_rate=rate)
    jitter = np.random.default_rng(seed).integers(0, period // 10, poses)
    for stamp in (START + SECOND + period * np.arange(poses) + jitter).tolist():
        push(e, twist(stamp), pose(stamp))
    least = poses if rate == SECOND / period else 0.85 * rate * 4
    assert least <= e.estimates - 1 <= rate * 4 + 1
    assert e.estimates - 1 + e.counts[Reason.POSE_RATE_LIMITED] == poses + 1


@pytest.mark.parametrize("angular", [(0.0, 0.0, 0.0), (0.0, 0.0, 1e-9), (10.0, 0.0, 0.0)])
def test_rest_is_a_reason_in_the_grains_only(angular):
    """In the grains the force of a tool that stopped is not what RFT gives; in the air it is zero. The plate is at the
    origin, where a turn does not move it."""
    still = twist(linear=(0.0, 0.0, -1e-4), angular=angular)
    _, inside = pushed(still, pose())
    assert inside.reason is Reason.AT_REST
    _, outside = pushed(still, pose(position=(0.0, 0.0, 0.01)))
    assert outside.predicted == (0.0,) * 6
    _, answer = pushed(still, pose(), rest_speed=5e-5)
    assert isinstance(answer, Estimate)
    _, answer = pushed(twist(linear=(0.0, 0.0, 0.0)), pose(), rest_speed=0.0)
    assert answer.reason is Reason.AT_REST


def test_a_reduced_tool_is_in_the_grains_when_its_mesh_is():
    tool = load_tool("plate", tolerance=0.025)
    turns = Rotation.random(50, random_state=0)
    lowest = (turns.as_matrix() @ tool.corners.T)[:, 2].min(axis=1)
    for quaternion, low in zip(turns.as_quat().tolist(), lowest.tolist(), strict=True):
        for above in (1e-5, 1e-3, -1e-3):
            rests, place = twist(linear=(0.0, 0.0, -1e-4)), (0.0, 0.0, above - low)
            sample = PoseSample(START, "world", place, tuple(quaternion))
            answer = push(estimator(model=replace(plate_model(), tool=tool)), rests, sample)
            if above > 0.0:
                assert answer.predicted == (0.0,) * 6
            else:
                assert answer.reason is Reason.AT_REST

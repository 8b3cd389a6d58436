"""The estimator with a mobilization length: rest is answered, and what ends a memory."""

import numpy as np
import pytest
from one_plate import LEVEL, plate_model, pose, push, twist

from rft_ros.estimator import Estimate, Estimator, Reason, Settings, TransformSample
from rft_ros.rft import Memory, checked_states, wrenches_in_time
from rft_ros.tool import load_tool

PLATE = load_tool("plate")
PERIOD = 8_000_000  # 125 Hz


def model(length, *, tool=PLATE, zeta=0.3):
    return plate_model(zeta=zeta, tool=tool, mobilization_length=length)


class Arm:
    """Poses at 125 Hz, whose velocities the estimator takes from the poses themselves."""

    def __init__(self, length, **settings):
        self.estimator = Estimator(Settings(twist_source="pose_difference", **settings), model(length))
        self.stamp, self.height = 1_000_000_000, 0.005

    def move(self, speed, seconds):
        answers = []
        for _ in range(round(seconds * 1e9 / PERIOD)):
            self.stamp += PERIOD
            self.height += speed * PERIOD * 1e-9
            answers.append(push(self.estimator, pose(self.stamp, (0.0, 0.0, self.height))))
        return answers


def vertical(answer):
    assert isinstance(answer, Estimate)
    return answer.predicted[2]


def test_without_memory_rest_is_a_reason_and_with_memory_it_is_an_estimate_that_holds():
    forgetful, remembering = Arm(0.0), Arm(0.003)
    forgetful.move(-0.01, 4.1)
    assert forgetful.move(0.0, 1.0)[-1].reason is Reason.AT_REST
    pressed = vertical(remembering.move(-0.01, 4.1)[-1])
    held = [vertical(a) for a in remembering.move(0.0, 4.0)]
    assert held[-1] == pytest.approx(pressed, rel=0.02)
    assert np.ptp(held[50:]) < 1e-9 * pressed  # flat
    assert Reason.AT_REST not in remembering.estimator.counts


def test_encoder_noise_at_rest_does_not_wear_the_force_down():
    arm, rng = Arm(0.003), np.random.default_rng(5)

    def rest(seconds):
        """Of encoders with a noise of 2 µm."""
        for noise in rng.normal(scale=2e-6, size=round(seconds * 1e9 / PERIOD)):
            arm.height = true + noise
            answer = arm.move(0.0, PERIOD * 1e-9)[-1]
        return vertical(answer)

    arm.move(-0.01, 4.0)
    true = arm.height
    before = rest(0.5)
    assert rest(20.0) == pytest.approx(before, rel=0.02)


@pytest.mark.parametrize(
    "noise", [(2e-6, 0.0), (5e-6, 0.0), (5e-6, 3e-5), (3e-6, 1e-4)], ids=["2 um", "5 um", "30 urad", "100 urad"]
)
def test_noise_of_poses_and_of_a_long_lever_at_rest_takes_no_force_off(noise):
    """Of positions [m] and rotations [rad]; the tool's tip is 120 mm below its flange. In a minute at rest."""
    tool, rng = load_tool("plate", origin=(0.0, 0.0, 120.0)), np.random.default_rng(3)
    estimator = Estimator(Settings(twist_source="pose_difference", rest_speed=1e-3), model(0.003, tool=tool))
    flange = 0.12 + 0.005
    stamp, forces = 1_000_000_000, []
    for step in [-0.01 * PERIOD * 1e-9] * 500 + [0.0] * 7_500:
        stamp, flange = stamp + PERIOD, flange + step
        x, y, z = rng.normal(scale=noise[0], size=3)
        turn = rng.normal(scale=noise[1], size=3) / 2.0
        quaternion = np.append(turn, 1.0) / np.linalg.norm(np.append(turn, 1.0))
        answer = push(estimator, pose(stamp, (x, y, flange + z), tuple(quaternion.tolist())))
        forces.append(answer.predicted[2] if isinstance(answer, Estimate) else np.nan)
    begin, end = np.nanmean(forces[550:650]), np.nanmean(forces[-100:])
    assert begin > 1.0
    assert end == pytest.approx(begin, rel=0.01)


def test_on_withdrawal_the_force_falls_within_millimetres():
    arm = Arm(0.003)
    pressed = vertical(arm.move(-0.01, 4.1)[-1])
    arm.move(0.0, 1.0)
    left = vertical(arm.move(0.01, 0.3)[-1])
    assert abs(left) < 0.15 * pressed  # the upper face has begun to lead


def test_zeta_is_swapped_without_forgetting_and_a_mesh_is_not():
    arm = Arm(0.003)
    arm.move(-0.01, 4.0)
    before = vertical(arm.move(0.0, 1.0)[-1])
    arm.estimator.use(model=model(0.003, zeta=0.6))
    assert vertical(arm.move(0.0, 0.1)[-1]) == pytest.approx(before)
    assert vertical(arm.move(-0.01, 1.0)[-1]) > 1.5 * before
    arm.estimator.use(model=model(0.003, tool=load_tool("plate", integration="refined")))
    assert vertical(arm.move(0.0, 0.5)[-1]) == pytest.approx(0.0, abs=0.05 * before)


def test_a_silent_gap_at_rest_changes_nothing_and_a_path_over_it_is_what_the_poses_say():
    """A driver that publishes only in motion: rest for a second, then 0.1 mm up."""
    steps = np.concatenate([np.full(500, -8e-5), np.zeros(125), np.full(5, 2e-5)])

    def raised(silent):
        e, height = Estimator(Settings(), model(0.003)), 0.005
        for k, step in enumerate(steps.tolist(), 1):
            height += step
            if step or not silent:
                motion = twist(k * PERIOD, (0.0, 0.0, step / PERIOD * 1e9))
                answer = push(e, motion, pose(k * PERIOD, (0.0, 0.0, height)))
        return vertical(answer)

    assert raised(silent=True) == pytest.approx(raised(silent=False), rel=0.03)


def test_the_estimator_and_the_core_agree_on_a_path():
    arm = Arm(0.004)
    memory, law, expected = Memory(PLATE.plates), arm.estimator.model.law, 0.0
    for _ in range(300):
        answer = arm.move(-0.012, PERIOD * 1e-9)[0]
        if not isinstance(answer, Estimate):
            continue
        state = checked_states(arm.estimator.state)
        expected = wrenches_in_time(PLATE.plates, law, state, memory)[0, 2]
        assert vertical(answer) == pytest.approx(expected, rel=1e-12, abs=1e-15)
    assert expected > 1.0


def test_an_absurd_pose_is_refused_and_the_memory_lives():
    arm = Arm(0.003)
    before = vertical(arm.move(-0.01, 4.0)[-1])
    far = TransformSample(0, "world", "far", (0.0, 0.0, -9e99), LEVEL, True)
    assert push(arm.estimator, far._replace(position=(0.0, 0.0, -1e308))) is Reason.TF_INVALID
    assert push(arm.estimator, far) is None
    for frame, z in (("world", -1e308), ("far", -9e99)):
        arm.stamp += PERIOD
        assert push(arm.estimator, pose(arm.stamp, (0.0, 0.0, z), frame=frame)).reason is Reason.POSE_NOT_FINITE
    assert vertical(arm.move(-0.01, 0.1)[-1]) > before


def test_a_move_in_a_silent_gap_between_two_rests_is_path_for_learning():
    """A driver is silent for a second, while the tool moves 30 mm and stops: the grains may be others there."""
    e = Estimator(Settings(learning_mode="apply"), model(0.003))
    for k, (x, speed) in enumerate([(0.0, 0.01), (0.01 * PERIOD * 1e-9, 0.0), (0.0, 0.0)], 1):
        push(e, twist(k * PERIOD, (speed, 0.0, 0.0)), pose(k * PERIOD, (x, 0.0, -0.02)))
    before = e.learning.belief().path
    later = 4 * PERIOD + 10**9
    push(e, twist(later, (0.0, 0.0, 0.0)), pose(later, (0.03, 0.0, -0.02)))
    moved = e.learning.belief().path
    assert moved - before == pytest.approx(0.03, rel=1e-3)  # less the dead band
    for k in range(1, 6):  # noise of poses at rest, 5 um, is no path
        again = later + k * 10**9
        push(e, twist(again, (0.0, 0.0, 0.0)), pose(again, (0.03 + 5e-6 * (k % 2), 0.0, -0.02)))
    assert moved <= e.learning.belief().path <= moved + 1e-5

"""The estimator with a mobilization length: rest is answered, and what ends a memory."""

import numpy as np
import pytest
from one_plate import LEVEL, SECOND, estimator, plate_model, pose, push, twist

from rft_ros.estimator import Estimate, QualityFlag, Reason, TransformSample
from rft_ros.rft import Memory, checked_states, wrenches_in_time
from rft_ros.tool import load_tool

PLATE = load_tool("plate")
PERIOD = 8_000_000  # 125 Hz


def model(length, *, tool=PLATE, zeta=0.3):
    return plate_model(zeta=zeta, tool=tool, mobilization_length=length)


class Arm:
    """Poses at 125 Hz, whose velocities the estimator takes from the poses themselves."""

    def __init__(self, length):
        self.estimator = estimator(twist_source="pose_difference", model=model(length))
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


LEVER = 0.1  # m, from the tool frame to the tool
SPHERE = load_tool(
    "sphere", origin=(0.0, 0.0, 1e3 * LEVER), tolerance=0.025, integration="refined"
)
ALONG_ITSELF = load_tool("plate", tolerance=0.025, integration="refined")
PARTS = {
    "press": (-0.005, 2.2),
    "rest": (0.0, 2.0),
    "drag begins": (0.002, 1.0),
    "drag": (0.002, 3.0),
    "after": (0.0, 1.0),
}
"""The velocity [m/s], along z or in a drag along x, and the duration [s] of each part of a motion."""


def forces_of(parts, *, rate, source, noise=(0.0, 0.0), seed=0, tool=SPHERE):
    """The predicted forces on a tool [N] and the flags, by part; `noise` of positions [m] and rotations [rad]."""
    rng, e = (
        np.random.default_rng(seed),
        estimator(twist_source=source, model=model(0.003, tool=tool)),
    )
    place, stamp, found = (
        np.array([0.0, 0.0, 0.001 - tool.lowest_point(np.eye(3))]),
        1_000_000_000,
        {},
    )
    for name, (speed, seconds) in parts.items():
        velocity = np.array([speed, 0.0, 0.0] if "drag" in name else [0.0, 0.0, speed])
        answers = []
        for _ in range(round(seconds * rate)):
            stamp, place = stamp + SECOND // rate, place + velocity / rate
            turn = np.append(rng.normal(0.0, 0.5 * noise[1], 3), 1.0)
            at, turned = place + rng.normal(0.0, noise[0], 3), turn / np.linalg.norm(turn)
            motion = twist(stamp, tuple(velocity.tolist()))
            answers.append(
                push(e, motion, pose(stamp, tuple(at.tolist()), tuple(turned.tolist())))
            )
        answers = [answer for answer in answers if isinstance(answer, Estimate)]
        found[name] = (
            np.array([a.predicted[:3] for a in answers]),
            np.array([a.quality_flags for a in answers]),
        )
    return found


@pytest.mark.parametrize("source", ["topic", "pose_difference"])
@pytest.mark.parametrize("noise", [(3e-6, 3e-5), (4e-6, 0.0)], ids=["3 um, 30 urad", "4 um"])
@pytest.mark.parametrize("tool", [SPHERE, ALONG_ITSELF], ids=["sphere", "plate along itself"])
def test_noise_of_poses_changes_the_force_little_and_does_not_look_like_a_withdrawal(
    source, noise, tool
):
    """At most 5 % of the peak while pressed and at rest, 8 % in the drag and after it, 15 % where the drag begins."""
    true, noisy = (
        forces_of(PARTS, rate=250, source=source, noise=n, tool=tool) for n in ((0.0, 0.0), noise)
    )
    peak = max(np.linalg.norm(forces, axis=1).max() for forces, _ in true.values())
    limits = {"press": 0.05, "rest": 0.05, "drag begins": 0.15, "drag": 0.08, "after": 0.08}
    for name, limit in limits.items():
        error = np.linalg.norm(noisy[name][0] - true[name][0], axis=1).max() / peak
        assert error < limit, name
        assert not (noisy[name][1] & QualityFlag.WITHDRAWAL).any(), name


@pytest.mark.parametrize("source", ["topic", "pose_difference"])
@pytest.mark.parametrize("noise", [(2e-5, 0.0), (3e-6, 1e-4)], ids=["20 um", "100 urad"])
def test_noise_of_poses_at_rest_takes_no_force_off(source, noise):
    """In half a minute, of which the last second is compared with the first."""
    parts = {
        "press": (-0.005, 2.2),
        "settle": (0.0, 1.0),
        "begin": (0.0, 1.0),
        "rest": (0.0, 28.0),
        "end": (0.0, 1.0),
    }
    found = forces_of(parts, rate=125, source=source, noise=noise)
    begin, end = (found[name][0][:, 2].mean() for name in ("begin", "end"))
    assert begin > 0.5
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
        e, height = estimator(model=model(0.003)), 0.005
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
        assert (
            push(arm.estimator, pose(arm.stamp, (0.0, 0.0, z), frame=frame)).reason
            is Reason.POSE_NOT_FINITE
        )
    assert vertical(arm.move(-0.01, 0.1)[-1]) > before


def test_a_move_in_a_silent_gap_between_two_rests_is_path_for_learning():
    """A driver is silent for a second, while the tool moves 30 mm and stops: the grains may be others there."""
    e = estimator(learning_mode="apply", model=model(0.003))
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

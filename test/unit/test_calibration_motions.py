"""`rft calibrate` says which kinds of motion a recording had, and the ζ of each; node and replay say which are new."""

import numpy as np
import pytest
from one_plate import START, estimator, plate_model
from scipy.spatial.transform import Rotation
from synthetic_track import TOOL, Path, grain_wrenches, known, law, recorded

from rft_ros.calibration.calibrate import PARTS, calibrate
from rft_ros.estimator import PoseSample
from rft_ros.rft.motion_kinds import MOTIONS, kind_of_motion

TURNED = Rotation.from_euler("z", 90.0, degrees=True)


def every_kind():
    """Down, a rest, a drag, a turn about the vertical, and up."""
    path = Path((0.0, 0.0, 0.03)).wait(1.0).move((0.0, 0.0, -0.06), 0.01).wait(1.0)
    return (
        path.move((0.04, 0.0, 0.0), 0.01).turn_to(TURNED, seconds=4.0).move((0.0, 0.0, 0.06), 0.01)
    )


def weaker_in_drags(share):
    """Grains with memory whose force is this share of the model's wherever the tool is dragged."""

    def wrenches(states):
        force = grain_wrenches(None, states, law(0.8), surface=0.0, length=0.003)
        dragged = np.hypot(states[:, 7], states[:, 8]) > 1e-3
        return np.where(dragged[:, None], share, 1.0) * force

    return wrenches


def of_motions(path, parts=PARTS, **of_recording):
    values = known(medium__mobilization_length=0.003)
    result = calibrate([recorded(path, length=0.003, **of_recording)], values, parts=parts)
    return {motion.kind: motion for motion in result.motions}, result.warnings


def test_each_kind_of_motion_has_the_zeta_of_the_grains_where_the_model_is_true():
    found, warnings = of_motions(every_kind())
    assert set(found) == {*MOTIONS, "rest"}
    for motion in found.values():
        assert abs(motion.zeta - 0.8) <= 3.0 * motion.error
        assert motion.rms < 0.02 * found["press"].peak
    assert found["drag"].error < 0.05
    assert not warnings


def test_a_drag_that_needs_another_zeta_than_the_press_is_said_with_its_zeta():
    found, warnings = of_motions(
        every_kind(), parts=("surface", "zeta"), force=weaker_in_drags(0.4)
    )
    assert found["press"].zeta == pytest.approx(0.8, rel=0.02)
    assert found["drag"].zeta == pytest.approx(0.32, rel=0.05)
    (sentence,) = warnings
    assert {"drag", "press", "medium.zeta"} <= set(
        sentence.replace(";", " ").replace(":", " ").split()
    )
    assert "0.32" in sentence


def test_a_kind_of_motion_follows_from_the_displacement_alone():
    moves = {
        "press": ((0.0, 0.0, -1.0), 0.0),
        "drag": ((1.0, 0.0, -0.9), 0.2),
        "turn": ((1.0, 0.0, 0.0), 1.0),  # rolls
        "withdrawal": ((0.1, 0.1, 1.0), 0.3),
    }
    for kind, (velocity, turned) in moves.items():
        assert kind_of_motion(*velocity, turned) == kind
        assert kind_of_motion(*(1e-3 * np.array(velocity)), 1e-3 * turned) == kind


def test_only_kinds_with_a_path_of_some_millimetres_count():
    path = (
        Path((0.0, 0.0, 0.03))
        .wait(1.0)
        .move((0.0, 0.0, -0.06), 0.01)
        .move((0.003, 0.0, 0.0), 0.01)
        .wait(1.0)
    )
    found, _ = of_motions(path)
    assert set(found) == {"press", "rest"}


def issues_of(path, *, noise=0.0):
    """What an estimator that was calibrated on presses says of its motion along a path, at 100 Hz."""
    e = estimator(
        model=plate_model(tool=TOOL, mobilization_length=0.003),
        twist_source="pose_difference",
        medium_calibrated_motions="press, withdrawal",
    )
    time, states = path.states()
    places = states[:, :3] + np.random.default_rng(3).normal(0.0, noise, (len(time), 3))
    for t, place, state in zip(time, places.tolist(), states, strict=True):
        e.push_pose(
            PoseSample(START + round(1e9 * t), "world", tuple(place), tuple(state[3:7].tolist()))
        )
    return [sentence for sentence in e.issues() if "calibrated_motions" in sentence]


@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_a_motion_of_a_kind_that_was_not_calibrated_is_said_after_some_millimetres(noise):
    pressed = Path((0.0, 0.0, 0.01)).wait(0.5).move((0.0, 0.0, -0.04), 0.01).wait(20.0)
    assert issues_of(pressed, noise=noise) == []
    in_the_air = Path((0.0, 0.0, 0.02)).wait(0.5).move((0.05, 0.0, 0.0), 0.02)
    assert issues_of(in_the_air, noise=noise) == []
    (sentence,) = issues_of(
        pressed.move((0.02, 0.0, 0.0), 0.01).wait(1.0).move((0.0, 0.0, 0.04), 0.01), noise=noise
    )
    assert "drag" in sentence
    assert "press, withdrawal" in sentence
    turned = Path((0.0, 0.0, -0.02)).wait(0.5).turn_to(TURNED, seconds=5.0).wait(0.5)
    (sentence,) = issues_of(turned, noise=noise)
    assert "turn" in sentence

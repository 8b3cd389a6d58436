"""The estimator with a learned medium: what is learned, what keeps it, and the deviation of a prediction."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from one_plate import SECOND, START, about, estimator, pose, push, twist, use, wrench

from rft_ros.estimator import OFFSET_SENTENCE, QualityFlag, TransformSample, Trust, trust
from rft_ros.parameters import LoadCell

STEP = 10_000_000  # at 1 cm/s: 0.1 mm of path


class Press:
    """One plate pushed straight down at 1 cm/s into grains whose force is `factor` times the model's 4 N a cm of depth.

    The grains begin `surface` over the model's; the load cell reads `offset` [N] beside their force, or `reading`.
    """

    def __init__(self, mode="apply", *, surface=0.0, **values):
        self.estimator = estimator(learning_mode=mode, **values)
        self.stamp, self.depth, self.surface, self.answers, self.forces = (
            START,
            0.0,
            surface,
            [],
            [],
        )

    def push(self, count, factor=1.0, *, offset=0.0, reading=None):
        for _ in range(count):
            self.stamp += STEP
            self.depth += 1e-4
            self.forces.append(factor * 400.0 * max(self.depth + self.surface, 0.0))
            felt = wrench(
                self.stamp, reading or (0.0, 0.0, self.forces[-1] + offset, 0.0, 0.0, 0.0)
            )
            motion = twist(self.stamp), pose(self.stamp, (0.0, 0.0, -self.depth))
            self.answers.append(push(self.estimator, felt, *motion))
        return self

    @property
    def learning(self):
        return self.estimator.learning

    def use(self, **values):
        use(self.estimator, **values)


def test_observe_learns_the_same_and_predicts_as_the_model():
    seen, used, plain = (Press(mode).push(300, 1.6) for mode in ("observe", "apply", "off"))
    for observed, applied, unlearned in zip(
        seen.answers, used.answers, plain.answers, strict=True
    ):
        assert observed.predicted == pytest.approx(unlearned.predicted, rel=1e-12)
        # it is an error of what is observed
        correction = applied.predicted[2] - unlearned.predicted[2]
        assert observed.sigma[2] == pytest.approx(
            math.hypot(applied.sigma[2], correction), rel=1e-9
        )
    assert seen.learning.belief() == used.learning.belief()
    assert seen.learning.belief().vertical_strength > 1.4
    assert plain.learning is None


def test_readings_at_rest_update_nothing_but_late_ones_of_the_motion_before_do():
    press, felt = Press().push(100, 1.6), []

    def move(count, speed):
        for _ in range(count):
            press.stamp, press.depth = press.stamp + STEP, press.depth + speed * STEP * 1e-9
            felt.append(wrench(press.stamp, (0.0, 0.0, 1.6 * 400.0 * press.depth, 0.0, 0.0, 0.0)))
            motion = (
                twist(press.stamp, (0.0, 0.0, -speed)),
                pose(press.stamp, (0.0, 0.0, -press.depth)),
            )
            push(press.estimator, *motion)

    move(1, 0.0)  # half of the way since the pose before was in motion
    learned = press.learning.belief()
    move(20, 0.0)
    for sample in felt:
        press.estimator.push(sample._replace(wrench=(0.0, 0.0, 50.0, 0.0, 0.0, 0.0)))
    move(5, 0.0)
    assert press.learning.belief() == learned
    felt.clear()
    move(50, 0.01)
    move(5, 0.0)
    rested = press.learning.belief()
    for sample in felt:
        press.estimator.push(sample)
    move(1, 0.0)
    assert press.learning.belief() != rested


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_load_cell_dead_from_the_start_leaves_the_model_as_it_is(noise):
    """Zeros, and zeros with noise, in grains 1.6 times as strong as the model's."""
    rng = np.random.default_rng(1)
    press, fixed = Press(), Press("off").push(500, 1.6)
    for _ in range(500):
        press.push(1, reading=rng.normal(0.0, noise, 6).tolist())
    learned, told = (np.array([a.predicted[2] for a in p.answers]) for p in (press, fixed))
    true = np.array(fixed.forces)
    assert press.learning.excludes_readings
    assert np.sqrt(np.mean((learned - true) ** 2)) < 2.0 * np.sqrt(np.mean((told - true) ** 2))
    assert learned[-1] == pytest.approx(told[-1], rel=0.05)


def test_a_coarse_cell_updates_the_filter():
    """Steps of 1 N, no noise: a reading repeats over 1 to 2 mm."""
    press, excluded = Press(), 0
    while press.depth < 0.05:
        true = 1.6 * 400.0 * (press.depth + 1e-4)
        press.push(1, reading=[0.0, 0.0, float(round(true)) or 1e-9, 0.0, 0.0, 0.0])
        excluded += press.learning.excludes_readings
    assert not excluded
    assert press.answers[-1].predicted[2] == pytest.approx(true, rel=0.1)


def test_a_repeated_force_updates_nothing_whether_or_not_the_load_cell_gives_torques():
    """It reads half-way between two poses, so that each pose has an interpolated reading."""
    beliefs = []
    for torque in (0.0, math.nan):
        press = Press().push(100, 1.6)
        for _ in range(50):
            press.stamp += STEP
            press.depth += 1e-4
            felt = wrench(press.stamp + STEP // 2, (0.0, 0.0, 30.0, torque, torque, torque))
            push(
                press.estimator,
                felt,
                twist(press.stamp),
                pose(press.stamp, (0.0, 0.0, -press.depth)),
            )
        beliefs.append(press.learning.belief())
    assert beliefs[0] == beliefs[1]


def test_spikes_in_the_load_cell_are_no_surprise():
    rng, press, turns = np.random.default_rng(4), Press(), 0
    for _ in range(800):
        before = press.learning.change
        press.push(1, 1.0 + 100.0 * rng.normal() * (rng.random() < 0.03))
        turns += press.learning.change is not before
    assert turns <= 2


@pytest.mark.parametrize("source", ["parameters", "tf"])
def test_a_cell_that_was_not_tared_is_told_to_be_and_lowers_the_trust(source):
    """It reads 2.4 N in the air. Other parameters than the load cell's do not change that."""
    press = Press(sensor_frame_source=source)
    push(
        press.estimator,
        TransformSample(0, "tool", "ft_sensor", (0.0, 0.0, 0.1), (0.0, 0.0, 0.0, 1.0), True),
    )
    press.depth = -0.015
    press.push(150, offset=2.4)
    assert press.estimator.issues() == [OFFSET_SENTENCE]
    press.push(200, offset=2.4)
    assert trust(press.answers[-1].quality_flags) is Trust.CAUTION
    assert press.answers[-1].quality_flags & QualityFlag.DISAGREEMENT
    assert press.learning.strength()[0] == pytest.approx(1.0, abs=0.4)
    press.use(max_input_age=0.2, sensor=LoadCell())  # as the parameters say
    press.push(1, offset=2.4)
    assert press.answers[-1].quality_flags & QualityFlag.DISAGREEMENT
    press.use(sensor=LoadCell(bias=(0, 0, 2.4, 0, 0, 0)))
    press.push(1, offset=2.4)
    assert not press.answers[-1].quality_flags & QualityFlag.DISAGREEMENT


@pytest.mark.parametrize("mode", ["off", "observe", "apply"])
@given(
    parts=st.lists(
        st.tuples(
            st.integers(1, 100),
            st.sampled_from([-1.0, 0.0, 0.05, 1.0, 7.0]),
            st.sampled_from([0.0, 0.5, -3.0]),
        ),
        min_size=1,
        max_size=6,
    ),
    start=st.sampled_from([-0.005, 0.0]),
)
@settings(max_examples=20, deadline=None)
@example(parts=[(200, -1.0, 0.0)], start=0.0)
@example(parts=[(200, 1.0, -3.0)], start=-0.01)
def test_the_flag_of_a_disagreement_is_set_while_an_issue_is_named_and_only_then(
    mode, parts, start
):
    """Parts of a push: number of poses, measured force over the model's (-1: a reversed cell), its offset [N]."""
    press = Press(mode)
    press.depth = start
    for count, factor, offset in parts:
        for _ in range(count):
            press.push(1, factor, offset=offset)
            is_flagged = bool(press.answers[-1].quality_flags & QualityFlag.DISAGREEMENT)
            assert is_flagged == bool(press.estimator.issues())


def test_a_force_that_triples_is_flagged_as_a_surprise_until_it_is_learned():
    press = Press().push(300)
    assert not any(a.quality_flags & QualityFlag.SURPRISE for a in press.answers)
    press.push(30, 3.0)
    assert press.answers[-1].quality_flags & QualityFlag.SURPRISE
    assert not press.push(300, 3.0).answers[-1].quality_flags & QualityFlag.SURPRISE


@given(
    st.floats(-180.0, 180.0), st.sampled_from([(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.6, 0.0, 0.8)])
)
def test_the_axes_of_the_sensor_do_not_change_the_size_of_the_deviation(degrees, axis):
    found = []
    for cell in (LoadCell(), LoadCell(quaternion=about(axis, degrees))):
        sigma = push(estimator(sensor=cell), twist(), pose()).sigma
        found.append((math.hypot(*sigma[:3]), math.hypot(*sigma[3:])))
    np.testing.assert_allclose(*found, rtol=1e-9)


def test_the_surface_height_counts_once_when_it_is_set_to_what_was_learned():
    press = Press(surface=0.004).push(100)
    press.use(surface_height=0.004)
    press.push(1)
    assert press.answers[-1].predicted[2] == pytest.approx(press.forces[-1], rel=0.1)


def test_a_surprise_and_a_wrong_model_end_with_a_jump_of_time():
    press = Press().push(300).push(200, -1.0)
    assert press.learning.change
    assert press.learning.excludes_readings
    press.stamp -= 100 * SECOND
    press.depth = -0.01
    press.push(1)
    assert not press.learning.change
    assert not press.learning.excludes_readings

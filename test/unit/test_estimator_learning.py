"""The estimator with a learned medium: what is learned, what keeps it, and the deviation of a prediction."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from one_plate import SECOND, START, about, estimator, plate_model, plate_tool, pose, twist, wrench

from rft_ros.estimator import Estimate, LoadCell
from rft_ros.estimator.learning import BeliefIssue
from rft_ros.estimator.quality import QualityFlag, Trust, trust
from rft_ros.parameters import defaults, read_parameter_file, settings_of, write_parameter_file

STEP = 10_000_000  # at 1 cm/s: 0.1 mm of path


class Press:
    """One plate pushed straight down at 1 cm/s into grains `factor` times as strong as the model's."""

    def __init__(self, mode="apply", *, late=0, **settings):
        self.estimator = estimator(learning_mode=mode, **settings)
        self.model = estimator(load_cell=settings.get("load_cell"))
        self.stamp, self.depth, self.answers, self.readings = START, 0.0, [], []
        self.late = late

    def push(self, count, factor=1.0, *, reading=None, rising=False):
        for _ in range(count):
            self.stamp += STEP
            self.depth += -1e-4 if rising else 1e-4
            speed = 0.01 if rising else -0.01
            sample, motion = pose(self.stamp, (0.0, 0.0, -self.depth)), twist(self.stamp, (0.0, 0.0, speed))
            self.model.push_twist(motion)
            told = self.model.push_pose(sample).predicted
            self.readings.append(wrench(self.stamp, reading or [factor * f for f in told]))
            self.estimator.push_twist(motion)
            if len(self.readings) > self.late:
                self.estimator.push_wrench(self.readings[-1 - self.late])
            self.answers.append(self.estimator.push_pose(sample))
        return self

    @property
    def ratio(self):
        """The last predicted vertical force over the model's own."""
        self.model.push_twist(twist(self.stamp + 1))
        return self.answers[-1].predicted[2] / (self.readings[-1].wrench[2] or math.nan)


def test_observe_learns_the_same_and_predicts_as_the_model():
    seen, used, plain = (Press(mode).push(300, 1.6) for mode in ("observe", "apply", "off"))
    for observed, unlearned in zip(seen.answers, plain.answers, strict=True):
        assert observed.predicted == pytest.approx(unlearned.predicted, rel=1e-12)
    assert seen.estimator.learning.belief() == used.estimator.learning.belief()
    assert seen.estimator.learning.belief().vertical_strength > 1.4
    assert plain.estimator.learning is None


def test_a_prediction_uses_no_reading_taken_within_the_lag_before_it():
    usual, other = Press(learning_lag=0.002).push(200, 1.6), Press(learning_lag=0.002).push(200, 1.6)
    usual.push(19, 1.6)
    other.push(19, 5.0)
    assert [a.predicted for a in usual.answers] == [a.predicted for a in other.answers]
    assert usual.push(5, 1.6).answers[-1].predicted != other.push(5, 1.6).answers[-1].predicted


def test_readings_that_come_late_but_within_the_lag_change_no_prediction_and_no_deviation():
    prompt, late = Press().push(300, 1.6), Press(late=8, max_input_age=0.5).push(300, 1.6)
    assert [(a.predicted, a.sigma) for a in late.answers] == [(a.predicted, a.sigma) for a in prompt.answers]


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_load_cell_dead_from_the_start_is_named_and_leaves_the_model_as_it_is(noise):
    """Zeros, and zeros with noise, in grains 1.6 times as strong as the model's."""
    rng = np.random.default_rng(1)
    press, fixed = Press(), Press("off")
    issues = set()
    for _ in range(500):
        press.push(1, reading=[*rng.normal(0.0, noise, 6).tolist()])
        issues.update(press.estimator.learning.issues())
        fixed.push(1, 1.6)
    true = np.array([r.wrench[2] for r in fixed.readings])
    learned, told = (np.array([a.predicted[2] for a in p.answers]) for p in (press, fixed))
    assert (BeliefIssue.WEAK if noise else BeliefIssue.STUCK) in issues
    assert np.sqrt(np.mean((learned - true) ** 2)) < 2.0 * np.sqrt(np.mean((told - true) ** 2))
    assert learned[-1] == pytest.approx(told[-1], rel=0.05)


def test_a_coarse_cell_is_not_called_stuck_and_teaches():
    """Steps of 1 N, no noise: a reading repeats over 1 to 2 mm."""
    press, issues = Press(), set()
    while press.depth < 0.05:
        true = 1.6 * press.estimator.model.zeta * 400.0 * (press.depth + 1e-4)
        press.push(1, reading=[0.0, 0.0, float(round(true)) or 1e-9, 0.0, 0.0, 0.0])
        issues.update(press.estimator.learning.issues())
    assert not issues
    assert press.answers[-1].predicted[2] == pytest.approx(true, rel=0.1)


def test_spikes_in_the_load_cell_are_no_surprise():
    rng, press, turns = np.random.default_rng(4), Press(), 0
    for _ in range(800):
        before = press.estimator.learning.surprise
        press.push(1, 1.0 + 100.0 * rng.normal() * (rng.random() < 0.03))
        turns += press.estimator.learning.surprise is not before
    assert turns <= 2


def test_a_cell_that_was_not_tared_is_told_to_be_and_lowers_the_trust():
    """It reads 2.4 N in the air."""
    press = Press()
    press.depth = -0.01
    for k in range(300):
        told = max(4.0 * 100.0 * (press.depth + 1e-4), 0.0)
        press.push(1, reading=[0.0, 0.0, told + 2.4, 0.0, 0.0, 0.0])
        if k == 99:
            assert press.estimator.learning.issues() == [BeliefIssue.OFFSET]
    assert "tare" in BeliefIssue.OFFSET
    assert press.estimator.learning.doubts() == [BeliefIssue.OFFSET]
    assert trust(press.answers[-1].quality_flags) is Trust.CAUTION
    assert press.answers[-1].quality_flags & QualityFlag.DISAGREEMENT
    assert press.estimator.learning.strength()[0] == pytest.approx(1.0, abs=0.4)
    press.estimator.use(settings=replace(press.estimator.settings, load_cell=LoadCell(bias=(0, 0, 2.4, 0, 0, 0))))
    press.push(1, reading=[0.0, 0.0, told + 2.4, 0.0, 0.0, 0.0])
    assert not press.answers[-1].quality_flags & QualityFlag.DISAGREEMENT


def test_a_silent_gap_at_rest_does_not_widen_sigma():
    quick, slow = Press().push(300), Press().push(300)
    slow.stamp += 100 * SECOND
    assert slow.push(1).answers[-1].sigma[2] == pytest.approx(quick.push(1).answers[-1].sigma[2], rel=0.02)


def test_withdrawal_does_not_change_the_strength_of_the_bed():
    press = Press().push(300, 1.6)
    before, _ = press.estimator.learning.strength()
    after, _ = press.push(200, reading=[0.0, 0.0, -0.01, 0.0, 0.0, 0.0], rising=True).estimator.learning.strength()
    assert after == pytest.approx(before, rel=0.01)  # the last 2 mm were still to be learned
    assert before == pytest.approx(1.6, abs=0.3)


def test_another_medium_forgets_another_tool_keeps_the_strength_and_so_does_a_jump_of_time():
    press = Press().push(300, 1.6)
    learned, e = press.estimator.learning.strength(), press.estimator
    e.use(model=replace(e.model, tool=plate_tool()))
    assert e.learning.strength() == learned
    e.use(model=plate_model(zeta=2.0))
    assert e.learning.strength() is None
    press = Press().push(300, 1.6)
    press.stamp -= 100 * SECOND
    assert press.estimator.learning.strength() == learned
    press.push(2, 1.6)
    assert press.estimator.learning.strength()[0] == pytest.approx(learned[0], rel=0.2)


def test_a_small_standard_error_of_zeta_makes_the_prior_narrow():
    presses = [Press("observe", zeta_error=error) for error in (0.0, 0.05)]
    for press in presses:
        press.depth = 0.05  # where the surface matters less
    wide, narrow = (press.push(1).answers[0].sigma[2] for press in presses)
    assert wide > 2.0 * narrow > 0.0


def test_a_force_that_triples_is_flagged_as_a_surprise_until_it_is_learned():
    press = Press().push(300)
    assert not any(a.quality_flags & QualityFlag.SURPRISE for a in press.answers)
    press.push(30, 3.0)
    assert press.answers[-1].quality_flags & QualityFlag.SURPRISE
    assert not press.push(300, 3.0).answers[-1].quality_flags & QualityFlag.SURPRISE


def test_settings_that_change_live_keep_what_was_learned_except_where_the_prior_changes():
    press = Press().push(300, 1.6)
    learning = press.estimator.learning
    values = {**defaults(), "learning.mode": "observe", "learning.lag": 0.005}
    press.estimator.use(settings=settings_of(values))
    assert press.estimator.learning is learning
    assert learning.lag == 0.005
    press.estimator.use(settings=settings_of({**values, "medium.zeta_error": 0.1}))
    assert press.estimator.learning.strength() is None
    press.estimator.use(settings=settings_of(defaults()))
    assert press.estimator.learning is None


@given(st.floats(-180.0, 180.0), st.sampled_from([(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.6, 0.0, 0.8)]))
def test_the_axes_of_the_sensor_do_not_change_the_size_of_the_deviation(degrees, axis):
    found = []
    for cell in (LoadCell(), LoadCell(quaternion=about(axis, degrees))):
        e = estimator(load_cell=cell)
        e.push_twist(twist())
        answer = e.push_pose(pose())
        assert isinstance(answer, Estimate)
        found.append((math.hypot(*answer.sigma[:3]), math.hypot(*answer.sigma[3:])))
    np.testing.assert_allclose(*found, rtol=1e-9)


def test_a_parameter_file_that_was_written_reads_back(tmp_path):
    values = {**defaults(), "medium.zeta": 0.312, "medium.zeta_error": 0.08, "sensor.position": (0.0, 0.1, 0.2)}
    write_parameter_file(tmp_path / "new" / "saved.yaml", values, comment="from a test")
    assert read_parameter_file(tmp_path / "new" / "saved.yaml") == values


def test_the_surface_height_counts_once_when_it_is_set_to_what_was_learned():
    press = Press()
    e = press.estimator
    raised = estimator(surface_height=0.004)
    for _ in range(100):
        press.stamp += STEP
        press.depth += 1e-4
        sample, motion = pose(press.stamp, (0.0, 0.0, -press.depth)), twist(press.stamp)
        for each in (raised, e):
            each.push_twist(motion)
        told = raised.push_pose(sample).predicted
        e.push_wrench(wrench(press.stamp, list(told)))
        e.push_pose(sample)
    e.use(settings=replace(e.settings, surface_height=0.004))
    press.stamp += STEP
    press.depth += 1e-4
    for each in (raised, e):
        each.push_twist(twist(press.stamp))
    sample = pose(press.stamp, (0.0, 0.0, -press.depth))
    assert e.push_pose(sample).predicted[2] == pytest.approx(raised.push_pose(sample).predicted[2], rel=0.1)


def test_a_parameter_without_effect_on_the_law_forgets_nothing():
    press = Press().push(300, 1.6)
    learned, e = press.estimator.learning.strength(), press.estimator
    e.use(model=plate_model(generation=1))
    assert e.model.generation == 1
    assert e.learning.strength() == learned


def test_a_surprise_and_a_wrong_model_end_with_a_jump_of_time():
    press = Press().push(300).push(100, 9.0)
    learning = press.estimator.learning
    assert learning.surprise
    assert learning.issues()
    press.stamp -= 100 * SECOND
    press.depth = -0.01
    press.push(1)
    assert not learning.surprise
    assert not learning.issues()

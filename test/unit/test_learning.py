"""The filter that learns the medium: what it must hold for any input, and what it must say."""

import math
import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rft_ros.estimator.learning import Learning

SPEED = 0.01  # m/s
LAG = 0.002  # m
START = 10_000_000_000  # ns
STEP = SPEED / 200.0  # m, at 200 Hz
LEVER = np.array([0.01, 0.002, -0.02])
few = settings(max_examples=10, deadline=None)


@dataclass(frozen=True)
class Series:
    """A tool on its way through grains: stamps [ns], rows of the model, measured forces [N], path of a step [m]."""

    stamps: NDArray
    rows: NDArray
    forces: NDArray
    step: float = STEP

    @property
    def path(self):
        return self.step * np.arange(len(self.stamps))


def row(force, per_height):
    return np.concatenate(
        [force, np.cross(LEVER, force), [1e-3], per_height, np.outer(LEVER, force).ravel()]
    )


def plunge(*, rate=200.0, depth=0.05, strength=1.0, seed=None):
    """Down by `depth` at `SPEED`: a force that grows with depth to about 50 N, measured with 3 % of noise if seeded."""
    n = round(depth / SPEED * rate)
    d = (np.arange(n) + 1.0) * SPEED / rate
    direction = np.array([-300.0, 100.0, 1000.0])
    rows = np.array([row(x * direction, direction) for x in d])
    forces = strength * rows[:, :3]
    if seed is not None:
        # grains give way over 3 mm: noise is the same for samples closer than that
        noise = np.random.default_rng(seed).normal(0.0, 0.03, (math.ceil(depth / 0.003) + 1, 3))
        forces = forces + np.linalg.norm(forces, axis=1)[:, None] * noise[(d / 0.003).astype(int)]
    return Series(START + (np.arange(n) * 1e9 / rate).astype(np.int64), rows, forces, SPEED / rate)


def learner(**options):
    return Learning(lag=LAG, reach=0.02, **options)


def steps(series, learning, *, delay=0, repeats=False):
    """Predict every pose and learn its measurement, `delay` poses later; yields each pose's number and prediction."""
    n, out = len(series.stamps), None
    for k in range(n + delay):
        if k < n:
            out = learning.predict(
                int(series.stamps[k]), series.rows[k], step=series.step if k else 0.0
            )
        if (j := k - delay) >= 0:
            same = repeats and j > 0 and bool((series.forces[j] == series.forces[j - 1]).all())
            learning.learn(int(series.stamps[j]), series.forces[j], is_repeated=same)
        if k < n:
            yield k, out


def run(series, learning, **options):
    """The predictions, shape [n, 12]."""
    return np.array([out for _, out in steps(series, learning, **options)])


def turn_about_z(angle):
    return Rotation.from_euler("z", angle).as_matrix()


@given(strength=st.floats(0.3, 4.0))
@few
@example(strength=0.24)
def test_the_strengths_are_those_of_the_measured_forces_within_2_cm(strength):
    series, learning = plunge(strength=strength), learner(strength_error=1.0)
    predicted = run(series, learning)
    assert learning.theta[:2] == pytest.approx(strength, rel=0.1)
    assert predicted[-1, :3] == pytest.approx(series.forces[-1], rel=0.05)
    assert predicted[-1, 3:6] == pytest.approx(np.cross(LEVER, predicted[-1, :3]), rel=1e-6)
    late = series.path > 0.02
    error = np.linalg.norm(predicted[late, :3] - series.forces[late], axis=1)
    assert np.median(error / np.linalg.norm(series.forces[late], axis=1)) < 0.1


@given(angle=st.floats(-math.pi, math.pi))
@few
def test_a_world_turned_about_the_vertical_gives_turned_predictions_and_the_same_belief(angle):
    series, r = plunge(strength=1.4, seed=3), turn_about_z(angle)
    rows = series.rows.copy()
    for a in (0, 3, 7):
        rows[:, a : a + 3] = rows[:, a : a + 3] @ r.T
    rows[:, 10:] = (r @ rows[:, 10:].reshape(-1, 3, 3) @ r.T).reshape(-1, 9)
    here, there = learner(), learner()
    a, b = run(series, here), run(replace(series, rows=rows, forces=series.forces @ r.T), there)
    assert there.theta == pytest.approx(here.theta, abs=1e-9)
    assert there.covariance == pytest.approx(here.covariance, abs=1e-9)
    assert b[:, :3] == pytest.approx(a[:, :3] @ r.T, abs=1e-8)
    assert b[:, 3:6] == pytest.approx(a[:, 3:6] @ r.T, abs=1e-8)


@given(
    pauses=st.lists(st.integers(1, 10_000_000_000), min_size=1, max_size=50),
    factor=st.floats(-10.0, 10.0),
    length=st.sampled_from([0.0, math.nan, -1.0]),
)
@few
def test_rest_changes_nothing(pauses, factor, length):
    """For any duration [ns] and any force; a path that is not one counts as none."""
    series, learning = plunge(seed=1, depth=0.02), learner()
    run(series, learning)
    before = learning.theta.tobytes(), learning.covariance.tobytes()
    for stamp in (series.stamps[-1] + np.cumsum(pauses)).tolist():
        learning.predict(stamp, series.rows[-1], step=length)
        learning.learn(stamp, factor * series.forces[-1])
    assert (learning.theta.tobytes(), learning.covariance.tobytes()) == before


@given(rate=st.floats(50.0, 1000.0), strength=st.floats(0.5, 2.0))
@few
@example(rate=50.0, strength=1.5)
@example(rate=1000.0, strength=1.5)
def test_the_rate_of_sampling_does_not_matter(rate, strength):
    """The same path at 50 to 1,000 Hz: beliefs within half of their standard error, errors within a tenth."""
    reference, other = learner(), learner()
    run(plunge(strength=strength, seed=5), reference)
    run(plunge(strength=strength, seed=5, rate=rate), other)
    error = np.sqrt(np.diag(reference.covariance))
    assert np.all(np.abs(other.theta - reference.theta) < 0.5 * error)
    assert np.sqrt(np.diag(other.covariance)) == pytest.approx(error, rel=0.1)


@given(moment=st.integers(50, 900), delay=st.integers(0, 30))
@few
def test_a_prediction_uses_no_sample_of_the_lag_before_it_late_or_not(moment, delay):
    """40 poses lie in a lag of 2 mm."""
    series = plunge(seed=2)
    forces = series.forces.copy()
    forces[moment] *= 2.0
    a, b = run(series, learner()), run(replace(series, forces=forces), learner())
    later = series.path > series.path[moment] + LAG - 1e-9
    assert a[~later].tobytes() == b[~later].tobytes()
    assert not later.any() or a[later].tobytes() != b[later].tobytes()
    assert run(series, learner(), delay=delay).tobytes() == a.tobytes()


@given(
    calls=st.lists(
        st.tuples(
            st.integers(-5, 60),  # step of the stamp [ms]
            st.lists(st.floats(-1e6, 1e6), min_size=18, max_size=18),
            st.sampled_from([0.0, 1e-3]),  # submerged area
            st.floats(),  # path
            st.booleans(),
            st.lists(st.floats(), min_size=3, max_size=3),
            st.integers(-1, 3),  # samples learned, or another stamp
        ),
        max_size=40,
    )
)
@settings(max_examples=100, deadline=None)
@example(calls=[(1, [0.0] * 18, 1e-3, 0.1, False, [1e300, 1e300, 1e300], 1)] * 5)
@example(calls=[(10, [0.0] * 18, 1e-3, 1e3, False, [0.0, 0.0, 0.0], 1)] * 30)
@example(
    calls=[
        (k // 2, [0.0] * 18, 1e-3, step, False, [0.0] * 3, 1)
        for k, step in enumerate((1.0, 1e-300, 1.0))
    ]
)
@example(calls=[(10, [0.0] * 18, 1e-3, step, False, [0.0] * 3, 1) for step in (5e-324, 1.0, 1.0)])
def test_for_any_input_the_covariance_is_symmetric_positive_definite_and_all_is_finite(calls):
    learning, stamp = learner(), START
    for milliseconds, numbers, area, step, passing, force, count in calls:
        stamp += milliseconds * 1_000_000
        out = learning.predict(
            stamp, np.array([*numbers[:6], area, *numbers[6:]]), step=step, passing=passing
        )
        assert np.isfinite(out).all()
        assert (out[6:9] > 0.0).all()
        for _ in range(count):
            learning.learn(stamp, np.array(force))
        if count < 0:
            learning.learn(stamp - 1, np.zeros(3))
        p = learning.covariance
        assert np.isfinite(learning.theta).all()
        assert np.array_equal(p, p.T)
        scale = np.sqrt(np.diag(p))
        assert np.linalg.eigvalsh(p / np.outer(scale, scale)).min() > -1e-12
        learning.belief()
        assert learning.excludes_readings in (True, False)


def test_a_sample_teaches_at_most_once():
    series, once, twice = plunge(seed=6), learner(), learner()
    run(series, once)
    for k, _ in steps(series, twice):
        twice.learn(int(series.stamps[k]), 5.0 * series.forces[k])
    assert once.theta.tobytes() == twice.theta.tobytes()


@given(first=st.floats(0.01, 0.045), factor=st.sampled_from([2.0, 3.0, 0.2]))
@few
def test_a_layer_that_changes_the_force_within_2_mm_is_reported_within_3_mm(first, factor):
    series, learning = plunge(seed=7), learner()
    layer = 1.0 + (factor - 1.0) * np.clip((series.path - first) / 0.002, 0.0, 1.0)
    kind, percent = ("harder", "harder.*-") if factor > 1.0 else ("softer", r"softer.*\+")
    found = None
    for k, _ in steps(replace(series, forces=layer[:, None] * series.forces), learning):
        if learning.change and found is None:
            found = series.path[k]
            assert learning.change == kind
            assert abs(learning.belief().excess) > 0.1
        # also while it is held
        assert not re.search(rf"{percent}|[+-]0 %", learning.surprise_sentence())
    assert first <= found <= first + 0.003


FAULTS = {
    "not a number": lambda f: np.full_like(
        f, np.nan
    ),  # `Reason.WRENCH_NOT_FINITE` counts it before
    "zero": np.zeros_like,
    "stuck": lambda f: np.repeat(f[:1], len(f), axis=0),
    "wrong sign": lambda f: -f,
}


@pytest.mark.parametrize("fault", FAULTS)
@given(first=st.floats(0.012, 0.03), strength=st.floats(0.7, 2.0))
@settings(max_examples=5, deadline=None)
def test_a_load_cell_that_fails_for_10_mm_does_no_lasting_harm(fault, first, strength):
    series, learning, healthy = plunge(seed=9, strength=strength), learner(), learner()
    bad = (series.path > first) & (series.path < first + 0.01)
    forces = series.forces.copy()
    forces[bad] = FAULTS[fault](forces[bad])
    is_excluded = np.zeros(len(bad), bool)
    for k, _ in steps(replace(series, forces=forces), learning, repeats=True):
        is_excluded[k] = learning.excludes_readings
    run(series, healthy)
    assert learning.theta[:2] == pytest.approx(healthy.theta[:2], rel=0.1)
    if fault != "zero":  # which soft grains may explain
        assert is_excluded[bad].any() == (fault == "wrong sign")
    assert not is_excluded[-1]


@pytest.mark.parametrize("noise", [0.05, 0.5])
def test_a_thin_tip_that_enters_first_does_not_let_noise_question_the_load_cell(noise):
    series, learning = plunge(), learner()
    shift = 250  # samples, 12.5 mm of path
    rows = np.concatenate([np.repeat(1e-6 * series.rows[:1], shift, axis=0), series.rows[:-shift]])
    forces = rows[:, :3] + np.random.default_rng(3).normal(0.0, noise, (len(rows), 3))
    for k, _ in steps(replace(series, rows=rows, forces=forces), learning):
        assert not learning.excludes_readings, k


@pytest.mark.parametrize(
    "change", [-np.eye(3), 0.05 * np.eye(3), turn_about_z(math.pi / 2.0)], ids=str
)
def test_forces_that_no_strength_of_the_grains_explains_are_excluded(change):
    series, learning = plunge(seed=10), learner()
    run(replace(series, forces=series.forces @ change), learning)
    assert learning.excludes_readings
    assert learning.theta[:2] == pytest.approx([1.0, 1.0])


def test_the_strength_survives_a_withdrawal_in_which_the_grains_let_go():
    """On the way up the law pulls and the grains do nothing; the next push has the strength of the last."""
    down, learning = plunge(strength=1.8, seed=11), learner()
    run(down, learning)
    pushed, stamp = learning.theta[0], int(down.stamps[-1])
    for k in range(len(down.stamps)):
        stamp += 5_000_000
        back = -0.2 * down.rows[-1 - k]
        back[6] = 1e-3
        learning.predict(stamp, back, step=STEP, passing=True)
        learning.learn(stamp, np.array([0.0, 0.0, 0.01 * k]))
    assert learning.theta[0] < 0.5
    for _ in range(200):
        stamp += 5_000_000
        learning.predict(stamp, np.zeros(19), step=STEP)
    out = learning.predict(stamp + 5_000_000, down.rows[200], step=STEP)
    assert out[2] / down.rows[200][2] == pytest.approx(pushed, rel=0.05)
    assert not learning.change


def test_without_measurements_it_answers_for_ever():
    model, learning = plunge().rows[500], learner()
    for k in range(5000):
        out = learning.predict(START + k * 5_000_000, model, step=1.5e-3)
    assert out[:3] == pytest.approx(model[:3])


@pytest.mark.parametrize("lag", [0.002, 0.005])
def test_sigma_covers_a_vertical_force_that_outgrows_the_model(lag):
    """A wheel's force grows faster with depth than the model's: every error over the lag has one sign."""

    def within_sigma(factor):
        series = plunge(depth=0.08)
        forces = (
            series.forces * [1.0, 1.0, 0.0]
            + series.forces * [0.0, 0.0, 1.0] * factor(series.path)[:, None]
        )
        out = run(replace(series, forces=forces), Learning(lag=lag, reach=0.02))
        errors = np.abs(out[800:, 2] - forces[800:, 2])
        return np.mean(errors < out[800:, 8])

    assert within_sigma(lambda path: (path / 0.05) ** 1.5) > 0.9
    assert 0.4 < within_sigma(lambda path: 1.0 + 0.1 * np.sin(path / 0.0004)) < 0.7


def test_sigma_of_each_horizontal_component_follows_the_errors_of_that_component():
    """A tool dragged along x: errors of a tenth across the motion say nothing about the force along it."""
    series = plunge()
    wrong = np.where(np.arange(len(series.stamps)) // 12 % 2, 0.1, -0.1) * np.linalg.norm(
        series.rows[:, :3], axis=1
    )
    forces = series.forces + np.outer(wrong, [0.0, 1.0, 0.0])
    sigma = run(replace(series, forces=forces), learner())[-200:, 6:8]
    assert (sigma[:, 0] < 0.5 * sigma[:, 1]).all()

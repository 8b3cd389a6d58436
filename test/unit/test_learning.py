"""The filter that learns the medium: what it must hold for any input, and what it must say."""

import math
import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rft_ros.estimator.learning import BeliefIssue, Learning, Surprise

Array = NDArray[np.float64]

SPEED = 0.01  # m/s
LAG = 0.002  # m
START = 10_000_000_000  # ns
STEP = SPEED / 200.0  # m, at 200 Hz
LEVER = np.array([0.01, 0.002, -0.02])


@dataclass(frozen=True)
class Series:
    """A tool on its way through grains: stamps [ns], speeds [m/s], rows of the model, measured forces [N]."""

    stamps: Array
    speeds: Array
    rows: Array
    forces: Array

    @property
    def steps(self) -> Array:
        return np.concatenate([[0.0], 0.5 * (self.speeds[1:] + self.speeds[:-1]) * np.diff(self.stamps) * 1e-9])

    @property
    def path(self) -> Array:
        return np.cumsum(self.steps)


def row(force: Array, per_height: Array) -> Array:
    return np.concatenate([force, np.cross(LEVER, force), [1e-3], per_height, np.outer(LEVER, force).ravel()])


def plunge(*, rate: float = 200.0, depth: float = 0.05, strength: float = 1.0, seed: int | None = None) -> Series:
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
    return Series(START + (np.arange(n) * 1e9 / rate).astype(np.int64), np.full(n, SPEED), rows, forces)


def run(series: Series, learning: Learning, *, delay: int = 0, repeated: Array | None = None) -> Array:
    """Every pose predicted and its measurement learned, `delay` poses later; predictions, shape [n, 12]."""
    out = []
    n = len(series.stamps)
    for k in range(n + delay):
        if k < n:
            out.append(learning.predict(int(series.stamps[k]), series.rows[k], step=float(series.steps[k])).copy())
        if k >= delay:
            j = k - delay
            learning.learn(int(series.stamps[j]), series.forces[j], repeated=repeated is not None and bool(repeated[j]))
    return np.array(out)


def learner(lag: float = LAG, **options: float) -> Learning:
    return Learning(lag=lag, **options, reach=0.02)


def turned(series: Series, angle: float) -> Series:
    c, s = math.cos(angle), math.sin(angle)
    r = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    rows = series.rows.copy()
    for a in (0, 3, 7):
        rows[:, a : a + 3] = rows[:, a : a + 3] @ r.T
    moments = rows[:, 10:].reshape(-1, 3, 3)
    rows[:, 10:] = (r @ moments @ r.T).reshape(-1, 9)
    return replace(series, rows=rows, forces=series.forces @ r.T)


def test_before_any_measurement_the_prediction_is_the_models_and_its_error_the_priors() -> None:
    out = learner(strength_error=0.4).predict(START, plunge().rows[-1], step=STEP)
    assert out[:6] == pytest.approx(plunge().rows[-1][:6], rel=1e-12)
    assert out[8] == pytest.approx(math.hypot(0.4, 0.3) * out[2], rel=0.1)


@given(strength=st.floats(0.3, 4.0))
@settings(max_examples=10, deadline=None)
def test_the_strengths_are_those_of_the_measured_forces(strength: float) -> None:
    learning = learner(strength_error=1.0)
    predicted = run(plunge(strength=strength), learning)
    assert learning.theta[:2] == pytest.approx(strength, rel=0.1)
    assert predicted[-1, :3] == pytest.approx(plunge(strength=strength).forces[-1], rel=0.05)
    assert predicted[-1, 3:6] == pytest.approx(np.cross(LEVER, predicted[-1, :3]), rel=1e-6)


@given(angle=st.floats(-math.pi, math.pi))
@settings(max_examples=10, deadline=None)
def test_a_world_turned_about_the_vertical_gives_turned_predictions_and_the_same_belief(angle: float) -> None:
    series = plunge(strength=1.4, seed=3)
    here, there = learner(), learner()
    a, b = run(series, here), run(turned(series, angle), there)
    c, s = math.cos(angle), math.sin(angle)
    r = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    assert there.theta == pytest.approx(here.theta, abs=1e-9)
    assert there.covariance == pytest.approx(here.covariance, abs=1e-9)
    assert b[:, :3] == pytest.approx(a[:, :3] @ r.T, abs=1e-8)
    assert b[:, 3:6] == pytest.approx(a[:, 3:6] @ r.T, abs=1e-8)


@given(
    steps=st.lists(st.integers(1, 10_000_000_000), min_size=1, max_size=50),
    factor=st.floats(-10.0, 10.0),
    length=st.sampled_from([0.0, math.nan, -1.0]),
)
@settings(max_examples=20, deadline=None)
def test_rest_changes_nothing(steps: list[int], factor: float, length: float) -> None:
    """For any duration [ns] and any force; a path that is not one counts as none."""
    series = plunge(seed=1, depth=0.02)
    learning = learner()
    run(series, learning)
    stamp = int(series.stamps[-1]) + 1_000_000
    before = learning.theta.tobytes(), learning.covariance.tobytes()
    for step in steps:
        stamp += step
        learning.predict(stamp, series.rows[-1], step=length)
        learning.learn(stamp, factor * series.forces[-1])
    assert (learning.theta.tobytes(), learning.covariance.tobytes()) == before


@given(rate=st.floats(50.0, 1000.0), strength=st.floats(0.5, 2.0))
@settings(max_examples=10, deadline=None)
@example(rate=50.0, strength=1.5)
@example(rate=1000.0, strength=1.5)
def test_the_rate_of_sampling_does_not_matter(rate: float, strength: float) -> None:
    """The same path at 50 to 1,000 Hz: beliefs within half of their standard error, errors within a tenth."""
    reference, other = learner(), learner()
    run(plunge(strength=strength, seed=5), reference)
    run(plunge(strength=strength, seed=5, rate=rate), other)
    error = np.sqrt(np.diag(reference.covariance))
    assert np.all(np.abs(other.theta - reference.theta) < 0.5 * error)
    assert np.sqrt(np.diag(other.covariance)) == pytest.approx(error, rel=0.1)


@given(moment=st.integers(50, 900))
@settings(max_examples=10, deadline=None)
def test_a_prediction_uses_no_sample_taken_less_than_the_lag_before_it(moment: int) -> None:
    series = plunge(seed=2)
    forces = series.forces.copy()
    forces[moment] *= 2.0
    a, b = run(series, learner()), run(replace(series, forces=forces), learner())
    later = series.path > series.path[moment] + LAG - 1e-9
    assert a[~later].tobytes() == b[~later].tobytes()
    if later.any():
        assert a[later].tobytes() != b[later].tobytes()


@given(delay=st.integers(0, 30))
@settings(max_examples=10, deadline=None)
def test_measurements_that_come_late_by_less_than_the_lag_change_no_byte(delay: int) -> None:
    """40 poses lie in a lag of 2 mm."""
    a, b = learner(), learner()
    assert run(plunge(seed=4), a).tobytes() == run(plunge(seed=4), b, delay=delay).tobytes()
    assert a.theta.tobytes() == b.theta.tobytes()


_NUMBER = st.floats(-1e6, 1e6)
_FORCE = st.one_of(st.none(), st.lists(st.floats(), min_size=3, max_size=3))


@given(
    calls=st.lists(
        st.tuples(
            st.integers(-5, 60),  # step of the stamp [ms]
            st.lists(_NUMBER, min_size=18, max_size=18),
            st.sampled_from([0.0, 1e-3]),  # submerged area
            st.floats(),  # path
            st.booleans(),
            _FORCE,
            st.integers(-1, 3),  # samples learned, or another stamp
        ),
        max_size=40,
    )
)
@settings(max_examples=100, deadline=None)
@example(calls=[(1, [0.0] * 18, 1e-3, 0.1, False, [1e300, 1e300, 1e300], 1)] * 5)
@example(calls=[(10, [0.0] * 18, 1e-3, 1e3, False, [0.0, 0.0, 0.0], 1)] * 30)
def test_for_any_input_the_covariance_is_symmetric_positive_definite_and_all_is_finite(calls: list) -> None:  # type: ignore[type-arg]
    learning = learner()
    stamp = START
    for milliseconds, numbers, area, step, passing, force, count in calls:
        stamp += milliseconds * 1_000_000
        rows = np.array([*numbers[:6], area, *numbers[6:]])
        out = learning.predict(stamp, rows, step=step, passing=passing)
        assert np.isfinite(out).all()
        assert (out[6:9] > 0.0).all()
        for _ in range(count):
            learning.learn(stamp, None if force is None else np.array(force))
        if count < 0:
            learning.learn(stamp - 1, np.zeros(3))
        p = learning.covariance
        assert np.isfinite(learning.theta).all()
        assert np.array_equal(p, p.T)
        scale = np.sqrt(np.diag(p))
        assert np.linalg.eigvalsh(p / np.outer(scale, scale)).min() > -1e-12
        learning.belief()
        learning.issues()


def test_a_sample_teaches_at_most_once() -> None:
    series = plunge(seed=6)
    once, twice = learner(), learner()
    run(series, once)
    for k, stamp in enumerate(series.stamps):
        twice.predict(int(stamp), series.rows[k], step=float(series.steps[k]))
        twice.learn(int(stamp), series.forces[k])
        twice.learn(int(stamp), 5.0 * series.forces[k])
    assert once.theta.tobytes() == twice.theta.tobytes()


@given(first=st.floats(0.01, 0.045), factor=st.sampled_from([2.0, 3.0]))
@settings(max_examples=10, deadline=None)
def test_a_layer_that_doubles_the_force_within_2_mm_is_reported_within_3_mm(first: float, factor: float) -> None:
    series = plunge(seed=7)
    layer = 1.0 + (factor - 1.0) * np.clip((series.path - first) / 0.002, 0.0, 1.0)
    learning = learner()
    for k, stamp in enumerate(series.stamps):
        learning.predict(int(stamp), series.rows[k], step=STEP)
        learning.learn(int(stamp), layer[k] * series.forces[k])
        if series.path[k] < first:
            assert learning.surprise is Surprise.NONE
        if learning.surprise is not Surprise.NONE:
            break
    assert learning.surprise is Surprise.HARDER
    assert series.path[k] - first <= 0.003
    assert learning.belief().excess > 0.1


def test_a_hole_is_softer() -> None:
    series = plunge(seed=7)
    learning = learner()
    found = set()
    for k, stamp in enumerate(series.stamps):
        learning.predict(int(stamp), series.rows[k], step=STEP)
        learning.learn(int(stamp), series.forces[k] * (0.2 if series.path[k] > 0.03 else 1.0))
        found.add(learning.surprise)
        assert not re.search(r"softer.*\+|[+-]0 %", learning.surprise_sentence())  # also while it is held
    assert found == {Surprise.NONE, Surprise.SOFTER}


FAULTS = {
    "not a number": lambda f: np.full_like(f, np.nan),
    "zero": np.zeros_like,
    "stuck": lambda f: np.repeat(f[:1], len(f), axis=0),
    "wrong sign": lambda f: -f,
}


NAMED = {"zero": BeliefIssue.STUCK, "stuck": BeliefIssue.STUCK, "wrong sign": BeliefIssue.OPPOSED}
"""What the user is told; `Reason.WRENCH_NOT_FINITE` counts what is not a number before it gets here."""


@pytest.mark.parametrize("fault", FAULTS)
@given(first=st.floats(0.012, 0.03), strength=st.floats(0.7, 2.0))
@settings(max_examples=5, deadline=None)
def test_a_load_cell_that_fails_for_10_mm_does_no_lasting_harm_and_is_named(
    fault: str, first: float, strength: float
) -> None:
    series = plunge(seed=9, strength=strength)
    bad = (series.path > first) & (series.path < first + 0.01)
    forces = series.forces.copy()
    forces[bad] = FAULTS[fault](forces[bad])
    repeated = np.all(np.diff(forces, axis=0, prepend=np.nan) == 0.0, axis=1)
    learning, healthy = learner(), learner()
    issues = set()
    for k, stamp in enumerate(series.stamps):
        learning.predict(int(stamp), series.rows[k], step=STEP)
        learning.learn(int(stamp), forces[k], repeated=bool(repeated[k]))
        if bad[k]:
            issues.update(learning.issues())
    run(series, healthy)
    assert learning.theta[:2] == pytest.approx(healthy.theta[:2], rel=0.1)
    assert not learning.issues()
    assert issues >= {NAMED[fault]} if fault in NAMED else not issues


@pytest.mark.parametrize("noise", [0.05, 0.5])
def test_a_thin_tip_that_enters_first_does_not_let_noise_question_the_load_cell(noise) -> None:  # type: ignore[no-untyped-def]
    series = plunge()
    shift = 250  # samples, 12.5 mm of path
    rows = np.concatenate([np.repeat(1e-6 * series.rows[:1], shift, axis=0), series.rows[:-shift]])
    forces = rows[:, :3] + np.random.default_rng(3).normal(0.0, noise, (len(rows), 3))
    learning = learner()
    for k, stamp in enumerate(series.stamps):
        learning.predict(int(stamp), rows[k], step=STEP)
        learning.learn(int(stamp), forces[k])
        assert not learning.issues(), k


@pytest.mark.parametrize(
    ("change", "issue"),
    [
        (lambda f: -f, BeliefIssue.OPPOSED),
        (lambda f: 0.1 * f, BeliefIssue.WEAK),
        (lambda f: 8.0 * f, BeliefIssue.STRONG),
        (lambda f: f @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), BeliefIssue.TURNED),
    ],
)
def test_a_model_that_cannot_be_right_is_a_sentence_and_not_a_belief(change, issue) -> None:  # type: ignore[no-untyped-def]
    series = plunge(seed=10)
    learning = learner()
    run(replace(series, forces=change(series.forces)), learning)
    assert learning.issues() == [issue]
    assert "check" in str(issue)
    assert 0.1 <= learning.theta[0] <= 10.0


def test_forget_goes_back_to_the_calibration() -> None:
    learning = learner()
    run(plunge(strength=2.0), learning)
    learning.forget()
    again = run(plunge(strength=1.2, seed=1), learning)
    assert again.tobytes() == run(plunge(strength=1.2, seed=1), learner()).tobytes()


def test_the_strength_survives_a_withdrawal_in_which_the_grains_let_go() -> None:
    """On the way up the law pulls and the grains do nothing; the next push has the strength of the last."""
    down = plunge(strength=1.8, seed=11)
    learning = learner()
    run(down, learning)
    pushed = learning.theta[0]
    stamp = int(down.stamps[-1])
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
    assert learning.surprise is Surprise.NONE


def test_a_jump_back_in_time_keeps_the_strength_and_no_record() -> None:
    series = plunge(strength=1.8, seed=12)
    learning = learner()
    run(series, learning)
    out = learning.predict(int(series.stamps[0]), series.rows[-1], step=STEP)
    assert out[2] / series.rows[-1][2] == pytest.approx(1.8, rel=0.1)
    learning.learn(int(series.stamps[5]), 5.0 * series.forces[5])
    for stamp in series.stamps[1:]:
        learning.predict(int(stamp), series.rows[-1], step=STEP)
    assert learning.theta[0] == pytest.approx(1.8, rel=0.1)


def test_without_measurements_it_answers_for_ever() -> None:
    series = plunge()
    learning = learner()
    for k in range(5000):
        out = learning.predict(START + k * 5_000_000, series.rows[500], step=1.5e-3)
    assert out[:3] == pytest.approx(series.rows[500][:3])


def test_a_narrow_prior_is_left_slowly_and_a_wide_one_within_2_cm() -> None:
    """ζ = 1 in grains of ζ = 0.24: within a tenth after 2 cm of path."""
    series = plunge(strength=0.24, seed=13)
    out = run(series, learner(strength_error=1.0))
    late = series.path > 0.02
    error = np.linalg.norm(out[late, :3] - series.forces[late], axis=1) / np.linalg.norm(series.forces[late], axis=1)
    assert np.median(error) < 0.1


@pytest.mark.parametrize("column", [0, 2, 5, 8, 15])
def test_a_model_force_that_is_not_finite_teaches_nothing(column: int) -> None:
    series = plunge(strength=1.5, seed=15)
    rows = series.rows.copy()
    rows[500, column] = math.nan
    learning, healthy = learner(), learner()
    run(replace(series, rows=rows), learning)
    run(series, healthy)
    assert learning.theta == pytest.approx(healthy.theta, rel=0.05, abs=0.01)
    assert np.isfinite(learning.covariance).all()
    assert not learning.issues()


def test_observing_leaves_the_wrench_and_widens_its_error_by_the_correction() -> None:
    series = plunge(strength=1.5, seed=14)
    observing, applying = learner(), learner()
    for k, stamp in enumerate(series.stamps):
        a = observing.predict(int(stamp), series.rows[k], step=STEP, apply=False)
        b = applying.predict(int(stamp), series.rows[k], step=STEP)
        observing.learn(int(stamp), series.forces[k])
        applying.learn(int(stamp), series.forces[k])
    assert a[:6] == pytest.approx(series.rows[-1][:6], rel=1e-9)
    assert a[8] == pytest.approx(math.hypot(b[8], b[2] - a[2]), rel=1e-9)


@pytest.mark.parametrize("values", [{"lag": 0.0}, {"lag": math.nan}, {"strength_error": -0.1}])
def test_settings_out_of_range_are_refused_by_name(values: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(values))):
        Learning(**values)

"""A short fuzz of the commands' input files and of estimators; ``make fuzz`` runs for five minutes."""

import pytest
from fuzz import fuzz
from fuzz_estimators import run

pytestmark = pytest.mark.repository


def test_damaged_inputs_are_used_or_refused_with_a_sentence():
    outcomes, findings = fuzz(count=50, seed=20)
    assert {name.partition(":")[0] for name in outcomes} >= {"states", "mesh", "bag", "parameters"}
    assert not findings, findings[0]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("seed", range(8))
def test_an_estimator_answers_each_pose_with_finite_numbers_or_a_reason_and_repeats_them(seed):
    assert repr(run(seed)) == repr(run(seed))

"""A short fuzz of the commands' input files; ``make fuzz`` runs for five minutes."""

from fuzz import fuzz


def test_damaged_inputs_are_used_or_refused_with_a_sentence():
    outcomes, findings = fuzz(count=80, seed=20)
    assert {name.partition(":")[0] for name in outcomes} >= {"states", "mesh", "bag"}
    assert not findings, findings[0]

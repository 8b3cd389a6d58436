"""A short fuzz of the commands' input files; ``make fuzz`` runs five minutes."""

from fuzz import fuzz


def test_damaged_inputs_are_used_or_refused_with_a_sentence():
    result = fuzz(seconds=10.0, seed=20)
    assert sum(result.outcomes.values()) > 30
    assert {name.partition(":")[0] for name in result.outcomes} >= {"states", "mesh", "bag"}
    assert not result.findings, result.findings[0]

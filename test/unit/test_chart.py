"""The chart of models: what each choice gains on the simulated runs, and that inertia helps where plates are fast."""

import pytest

from studies import models
from studies.__main__ import main
from studies.choice import CHOICES
from studies.models import GROUPS, Mark, front, judged_choices


def test_no_mark_is_faster_and_more_accurate_than_one_of_the_front():
    times_and_errors = [(2.5, 0.25), (1.5, 0.18), (14.0, 0.10), (15.0, 0.101), (220.0, 0.25)]
    marks = [Mark(name="", seconds=s, error=e, colour="black") for s, e in times_and_errors]
    assert front(marks) == [marks[1], marks[2]]


@pytest.fixture(scope="module")
def errors():
    """Mean error of each choice in each group of runs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(models, "median_seconds", lambda calls: [1e-3] * len(calls))
        judged = judged_choices()
    found = {}
    for choice in CHOICES:
        for group, member in GROUPS.items():
            of_group = [j.error for j in judged if j.choice == choice and member(j.run)]
            found[choice.name, group.partition(" (")[0]] = sum(of_group) / len(of_group)
    return found


def test_what_each_choice_is_for_shows_in_its_group(errors):
    along, ellipsoid, cycles = "plate in its own plane", "ellipsoid", "cycles"
    assert errors["refined", along] < 0.8 * errors["published", along]
    assert errors["refined, memory 3 mm", ellipsoid] < 0.75 * errors["refined", ellipsoid]
    assert errors["default", cycles] < 0.5 * errors["published", cycles]
    assert errors["default, learned", "root tip"] < 0.6 * errors["default", "root tip"]


@pytest.mark.parametrize("law", ["refined, α_y linear, memory", "refined, agarwal2023, memory"])
def test_inertia_takes_most_of_the_error_of_fast_plates(errors, law):
    assert errors[f"{law}, inertia", "fast plates"] < 0.45 * errors["default", "fast plates"]


def test_inertia_changes_slow_runs_by_little(errors):
    for group in ("plates", "ellipsoid", "root tip", "cycles"):
        slow = errors["refined, α_y linear, memory, inertia", group]
        assert slow == pytest.approx(errors["refined, α_y linear, memory 3 mm", group], abs=0.005)


def test_on_these_beads_treers_law_is_the_better_one_for_plates(errors):
    assert errors["refined, α_y linear", "plates"] < errors["refined, agarwal2023", "plates"]


@pytest.mark.usefixtures("calibration_of")
def test_the_command_draws_the_chart_and_writes_the_table(tmp_path, monkeypatch):
    monkeypatch.setattr(models, "median_seconds", lambda calls: [1e-3] * len(calls))
    # all choices over all recordings take minutes; test/golden/test_learning_runs.py has their errors
    monkeypatch.setattr(models, "_RECORDED", ("cmu",))
    monkeypatch.setattr(
        models, "_NAMES", {name: models._NAMES[name] for name in ("published", "default, learned")}
    )
    few = tuple(choice for choice in CHOICES if choice.name in models._NAMES)
    monkeypatch.setattr(models, "CHOICES", few)
    assert main(["models", "-o", str(tmp_path)]) == 0
    assert {file.name for file in tmp_path.iterdir()} == {"models.png", "models.md"}
    assert (tmp_path / "models.md").read_text().count("\n| ") >= len(few)

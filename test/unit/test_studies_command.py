"""The command `rft study`, what it writes, and tables between marks in the docs."""

import csv

import pytest

from rft_ros.cli import main
from rft_ros.errors import InputError
from rft_ros.studies import horizontal, oscillation
from rft_ros.studies.figure import new_figure
from rft_ros.studies.marked import marked, with_marked, write_marked
from rft_ros.studies.outcome import Outcome, published_against_ours, write_outcome
from rft_ros.studies.registry import STUDIES, run_study

TEXT = "a\n<!-- rft study one: begin -->\nold\n<!-- rft study one: end -->\nb\n"


def test_the_command_writes_figures_numbers_and_a_table_and_shows_it(tmp_path, capsys):
    assert main(["study", "horizontal", "-o", str(tmp_path / "new" / "out")]) == 0
    names = {file.name for file in (tmp_path / "new" / "out").iterdir()}
    assert names == {"horizontal.png", "horizontal.svg", "horizontal.md", "horizontal.csv"}
    shown = capsys.readouterr().out
    assert "published" in shown
    assert "5.8 N" in shown
    with (tmp_path / "new" / "out" / "horizontal.csv").open() as lines:
        rows = list(csv.DictReader(lines))
    assert [float(row["psi_deg"]) for row in rows] == [5.0 * k for k in range(19)]


@pytest.mark.parametrize("study", [horizontal.study, oscillation.study], ids=["horizontal", "oscillation"])
def test_the_same_study_gives_the_same_bytes(study, tmp_path):
    first, second = (write_outcome(study(), tmp_path / name) for name in "ab")
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes(), one.name


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["dem"], "the study 'dem' needs the reference data: give --data DIR"),
        (["horizontal", "--data", "nowhere"], "--data 'nowhere' is no folder"),
        (["horizontal", "--docs", "no.md"], "--docs 'no.md' is no file"),
    ],
)
def test_what_cannot_be_used_is_said_in_a_sentence(arguments, sentence, tmp_path, capsys):
    assert main(["study", *arguments, "-o", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert len(said.strip().splitlines()) == 1


def test_a_name_that_is_none_is_refused_with_the_names_that_are(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["study", "vertical", "-o", str(tmp_path)])
    said = capsys.readouterr().err
    assert all(name in said for name in (*STUDIES, "all"))


def test_a_folder_without_runs_names_the_file_that_is_missing(tmp_path):
    with pytest.raises(InputError, match=r"pen_plate_seedA\.csv"):
        run_study("dem", tmp_path)


def test_marks_stay_and_what_is_between_them_is_replaced():
    assert marked(TEXT, "one") == "old\n"
    assert with_marked(TEXT, "one", "new\n") == TEXT.replace("old", "new")
    assert marked(TEXT, "two") is None
    assert with_marked(TEXT, "two", "new\n") == TEXT


def test_a_file_without_marks_is_left_alone(tmp_path):
    file = tmp_path / "page.md"
    file.write_text(TEXT)
    assert write_marked(file, {"one": "new\n", "two": "x\n"}) == ["one"]
    assert file.read_text() == TEXT.replace("old", "new")
    with pytest.raises(InputError, match="has no line '<!-- rft study two: begin -->'"):
        write_marked(file, {"two": "x\n"})
    assert file.read_text() == TEXT.replace("old", "new")


def test_a_table_says_what_was_left_out():
    outcome = Outcome(
        name="one",
        title="One",
        figure=new_figure(1.0, 1.0),
        numbers={},
        table=published_against_ours(("force", "1 N", "2 N")),
        left_out=("the second half",),
    )
    assert outcome.markdown() == (
        "| quantity | published | ours |\n| --- | --- | --- |\n| force | 1 N | 2 N |\n\nLeft out: the second half\n"
    )

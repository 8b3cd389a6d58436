"""The studies' command line, what it writes, and the tables in the docs that it rewrites."""

import pytest

from rft_ros.errors import InputError
from studies import __main__ as studies
from studies import horizontal
from studies.result import StudyResult, new_figure, published_against_ours, table_in, write_tables

PAGE = "a\n<!-- study one: begin -->\nold\n<!-- study one: end -->\nb\n"
TABLE = published_against_ours(("force", "1 N", "2 N"))


def result(name):
    return StudyResult(name=name, title=name, figure=new_figure(1.0, 1.0), table=TABLE)


def test_the_command_writes_the_figure_and_table_of_a_study_and_prints_it(tmp_path, capsys):
    assert studies.main(["horizontal", "-o", str(tmp_path / "new" / "out")]) == 0
    assert {file.name for file in (tmp_path / "new" / "out").iterdir()} == {
        "horizontal.png",
        "horizontal.md",
    }
    assert "| maximum F23 | 5.8 N |" in capsys.readouterr().out
    for file in horizontal.study().write(tmp_path / "again"):  # the same bytes
        assert file.read_bytes() == (tmp_path / "new" / "out" / file.name).read_bytes(), file.name


def test_a_page_that_does_not_exist_is_one_sentence(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(studies, "run_study", lambda name: (result(name),))
    assert (
        studies.main(["horizontal", "-o", str(tmp_path), "--docs", str(tmp_path / "no.md")]) == 2
    )
    (sentence,) = capsys.readouterr().err.splitlines()[1:]
    assert "no.md" in sentence


def test_the_table_between_the_markers_is_replaced_and_a_page_without_markers_is_left_alone(
    tmp_path,
):
    page, table = (
        tmp_path / "page.md",
        "| quantity | published | ours |\n|---|---|---|\n| force | 1 N | 2 N |\n",
    )
    page.write_text(PAGE)
    assert write_tables(page, [result("one"), result("two")]) == ["one"]
    assert page.read_text() == PAGE.replace("old\n", table)
    assert table_in(page.read_text(), "one") == table
    assert table_in(page.read_text(), "two") is None
    page.write_text(PAGE)
    with pytest.raises(InputError, match="no marker '<!-- study NAME: begin -->' for any of two"):
        write_tables(page, [result("two")])
    assert page.read_text() == PAGE

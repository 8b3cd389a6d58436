"""The tables in the docs are those that `make studies` writes."""

from pathlib import Path

import pytest

from studies.__main__ import run_study
from studies.result import table_in

DOCS = Path(__file__).resolve().parents[2] / "docs"
PLACES = {"dem": "accuracy.md", "horizontal": "paper.md", "oscillation": "paper.md", "circumnutation": "paper.md"}


@pytest.mark.parametrize(("name", "page"), PLACES.items())
def test_the_table_in_the_docs_is_the_studys(name, page):
    (result,) = run_study(name)
    assert table_in((DOCS / page).read_text(encoding="utf-8"), name) == result.table.markdown()

"""The tables in the docs are those that `rft study all --data DIR --docs FILE` writes."""

from pathlib import Path

import pytest

from rft_ros.studies.marked import marked
from rft_ros.studies.registry import run_study

DOCS = Path(__file__).resolve().parents[2] / "docs"
PLACES = {
    "dem": "accuracy.md",
    "horizontal": "paper.md",
    "plates": "paper.md",
    "oscillation": "paper.md",
    "circumnutation": "paper.md",
}


@pytest.mark.parametrize(("name", "page"), PLACES.items())
def test_the_table_in_the_docs_is_the_studys(name, page, shared_data):
    (outcome,) = run_study(name, shared_data)
    assert marked((DOCS / page).read_text(encoding="utf-8"), name) == outcome.markdown()


def test_every_picture_is_there_and_small():
    page = (DOCS / "paper.md").read_text(encoding="utf-8")
    for name in (*PLACES, "convergence"):
        picture = DOCS / "images" / f"paper_{name}.png"
        assert picture.stat().st_size < 150_000
        assert f"images/{picture.name}" in page or name == "dem"

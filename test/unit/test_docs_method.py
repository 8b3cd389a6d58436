"""The coefficients in docs/method.md are those that the code computes with."""

import re
from pathlib import Path

import pytest

from rft_ros import rft
from rft_ros.rft import MEDIA
from rft_ros.rft import velocity_weights as weights

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "method.md").read_text(encoding="utf-8")
ROWS = [[cell.strip() for cell in line.strip("|").split("|")] for line in PAGE.splitlines() if line.startswith("|")]


@pytest.mark.parametrize("name", MEDIA)
def test_the_coefficients_of_a_medium_are_those_in_use(name):
    (printed,) = [row[1:] for row in ROWS if row[0] == f"`{name}`"]
    (header,) = [row[1:] for row in ROWS if row[0] == "medium"]
    in_use = [getattr(MEDIA[name], coefficient.replace("-1", "m1", 1)) for coefficient in header]
    assert [float(value) for value in printed] == in_use


def test_the_coefficients_of_the_weights_are_those_in_use():
    printed = {name: float(value) for name, value in re.findall(r"\b([ABN]\d+) = ([\d.]{8,})", PAGE)}
    assert {name: printed[name] for name in weights.__all__[:6]} == {
        name: getattr(weights, name) for name in weights.__all__[:6]
    }
    bracket_1 = weights.math.tanh(weights.A2 - weights.A3) + weights.math.tanh(weights.A3)
    bracket_23 = weights.math.atanh(weights.B2 - weights.B3) + weights.math.atanh(weights.B3)
    assert printed["N1"] == pytest.approx(weights.A1 * bracket_1, rel=1e-14)
    assert printed["N23"] == pytest.approx(weights.B1 * bracket_23, rel=1e-14)


def test_the_equations_have_the_numbers_by_which_the_code_names_them():
    tags = re.findall(r"\\tag\{(\d+)\}", PAGE)
    assert tags == [str(n) for n in range(1, len(tags) + 1)]
    assert re.findall(r" {3}Eq\. \((\d+)\)$", rft.__doc__, flags=re.MULTILINE) == tags
    for file in Path(rft.__file__).parent.glob("*.py"):
        named = re.findall(r"Eqs?\. \((\d+)\)(?: (?:to|and) \((\d+)\))?", file.read_text(encoding="utf-8"))
        assert {number for pair in named for number in pair if number} <= set(tags), file.name

"""A statement sets one thing: `bench.lines.dense_assignments` names those that set several."""

import pytest

from bench.lines import ROOT, dense_assignments


def test_a_statement_sets_one_thing():
    files = sorted((ROOT / "rft_ros").rglob("*.py"))
    found = {str(file): dense_assignments(file.read_text(encoding="utf-8")) for file in files}
    assert {file: dense for file, dense in found.items() if dense} == {}


@pytest.mark.parametrize(
    "dense",
    [
        "low, high = 0.0, 1.0",
        "a, b = b, a",
        "self.x, self.y = p",
        "a[0], a[1] = 1, 2",
        "(x, y), z = p, 0.0",
    ],
)
def test_what_sets_several_things_is_found(dense):
    assert dense_assignments(f"def f(self):\n    {dense}\n") == [dense]


@pytest.mark.parametrize(
    "plain",
    ["x, y, z = p", "low, high = limits()", "tau_x, tau_y = tx - 1.0, ty", "i0, j0 = i, j"],
)
def test_coordinates_and_one_value_that_is_unpacked_are_plain(plain):
    assert dense_assignments(plain) == []

"""A statement sets one thing, a binding has a noun, and a constant a unit; `bench.lines` finds those that do not."""

import pytest

from bench.lines import ROOT, bare_bindings, dense_assignments, loose_constants


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


MAX_LOOSE_CONSTANTS = 83
MAX_BARE_BINDINGS = 274
"""Lower these when a change removes some. The code before the rule had them, and no change may add any."""


@pytest.mark.parametrize(
    ("find", "limit"),
    [(loose_constants, MAX_LOOSE_CONSTANTS), (bare_bindings, MAX_BARE_BINDINGS)],
    ids=["loose constants", "bare bindings"],
)
def test_no_change_adds_a_constant_without_a_unit_or_a_binding_without_a_noun(find, limit):
    files = (ROOT / "rft_ros").rglob("*.py")
    count = sum(len(find(file.read_text(encoding="utf-8"))) for file in files)
    assert count <= limit, (
        "give the new constant a unit, or the new binding a noun (make lines counts both)"
    )


def test_a_constant_is_loose_unless_its_name_says_its_unit():
    source = "_LEAST = 0.2\nMIN_FORCE_N = 0.2\n_A, B = 1, 2.0\nC: int = -3\nNAME = 'x'\nD = 2**20\nE = f()\n"
    assert loose_constants(source) == ["_LEAST", "_A", "B", "C", "D"]
    assert loose_constants("class Limits:\n    least: float = 0.2\n") == []


def test_a_binding_is_bare_if_no_word_of_it_is_a_noun():
    source = (
        "def f(own, speed):\n    told = 1\n    of_role = placed_tool = 2\n    for few in x: pass\n"
    )
    assert sorted(bare_bindings(source)) == ["few", "of_role", "own", "told"]

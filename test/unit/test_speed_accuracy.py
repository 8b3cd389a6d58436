"""The figure of error against time: its Pareto front, and whether its names can be read."""

from dataclasses import replace
from itertools import combinations

import pytest
from matplotlib.text import Annotation

from studies.speed_accuracy import Mark, front, speed_accuracy_figure

DEFAULT = Mark(name="default", seconds=1.5e-6, error=0.18, colour="green", advised=True)
LEARNING = replace(DEFAULT, name="default, learning", seconds=1.4e-5, error=0.10, side="right")
PAPER = replace(DEFAULT, name="paper's model", seconds=2.5e-6, error=0.25, advised=False)
PEERS = [
    replace(PAPER, name=name, seconds=seconds, peer=True, side="right")
    for name, seconds in (("NumPy", 2.2e-4), ("released code", 2.0e-4))
]
ELEMENTS = replace(PAPER, name="discrete elements", seconds=1.0, error=0.12, peer=True, side="above")
MARKS = [
    *(PAPER, DEFAULT, LEARNING, *PEERS, ELEMENTS),
    replace(PAPER, name="refined rule", seconds=3.6e-6, error=0.22),
    replace(PAPER, name="Agarwal 2023", seconds=3.4e-6, error=0.28),
    replace(LEARNING, name="paper, learning", seconds=1.5e-5, error=0.101, advised=False),
]


def alike(marks):
    """The same marks with fixed models of nearly one error, as in real sand, and no discrete elements."""
    same = [replace(m, error=0.075 + 0.02 * (m.error - 0.2) if m.error > 0.15 else 0.4 * m.error) for m in marks]
    return [m for m in same if m.name != ELEMENTS.name]


def test_no_mark_is_faster_and_more_accurate_than_one_of_the_front():
    best = front(MARKS)
    assert best[0] == DEFAULT
    assert LEARNING in best
    for mark in MARKS:
        beaten = any(other.seconds < mark.seconds and other.error < mark.error for other in MARKS)
        assert beaten == (mark not in best)


@pytest.mark.parametrize(
    "real", [alike(MARKS), [replace(m, error=0.2 * m.error) for m in MARKS]], ids=["alike", "apart"]
)
def test_names_stand_apart_and_inside_of_their_panel(real):
    figure = speed_accuracy_figure(MARKS, real)
    figure.draw_without_rendering()
    for axes, marks in zip(figure.axes, (MARKS, real), strict=True):
        names = {text.get_text(): text.get_window_extent() for text in axes.texts if isinstance(text, Annotation)}
        assert len(names) == len(marks)
        for (one, box), (other, second) in combinations(names.items(), 2):
            assert not box.overlaps(second), (one, other)
        panel = axes.get_window_extent()
        for name, box in names.items():
            assert panel.x0 <= box.x0 and box.x1 <= panel.x1 and panel.y0 <= box.y0 and box.y1 <= panel.y1, name

"""The figure that answers what to choose: error against the time of one evaluation, simulated and real grains."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, permutations
from typing import Literal

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.result import BLACK, GREY, label_axes, new_figure

__all__ = ["Mark", "front", "speed_accuracy_figure"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """One choice: `seconds` of an evaluation, and its mean `error`, a share.

    `peer`: not by this package. `advised`: what a reader should choose. `side` of the mark on which its name stands.
    """

    name: str
    seconds: float
    error: float
    colour: str
    peer: bool = False
    advised: bool = False
    side: Literal["left", "right", "above"] = "left"


def front(marks: Sequence[Mark]) -> list[Mark]:
    """The Pareto front: the marks for which no other is both faster and more accurate, ordered by time."""
    best: list[Mark] = []
    for mark in sorted(marks, key=lambda m: (m.seconds, m.error)):
        if not best or mark.error < best[-1].error:
            best.append(mark)
    return best


_TICKS = {1e-6: "1 µs", 1e-5: "10 µs", 1e-4: "0.1 ms", 1e-3: "1 ms", 1e-2: "10 ms", 1e-1: "0.1 s", 1.0: "1 s"}
_PERIOD_OF_THE_NODE = 2e-3  # s: at 500 Hz
_GAP = 0.066  # between two names, over the height of the panel
_BESIDE = 0.39  # of a panel's width: what a name takes
_LINE = 1.6  # factor of time between the outermost mark and the names beside it
_SIZE = 10.5  # of the text: a README shows the figure at three quarters of its size


def speed_accuracy_figure(simulated: Sequence[Mark], real: Sequence[Mark]) -> Figure:
    """Two panels; one without marks says that its recordings are absent."""
    figure = new_figure(11.0, 5.2)
    figure.suptitle("Without a load cell, choose the default. With one, turn on learning.", fontsize=13, weight="bold")
    panels = figure.subplots(1, 2, width_ratios=(1.1, 1.0))
    kinds = (
        ("Simulated grains, 11 runs", "Median error of the force [%]"),
        ("Real sand: plates and a wheel", "RMS error of the force over its peak [%]"),
    )
    for axes, marks, (title, error) in zip(panels, (simulated, real), kinds, strict=True):
        _draw(axes, marks)
        label_axes(axes, x="Time of one evaluation on one core", y=error, title=title)
        axes.title.set_fontsize(12)
        for text in (axes.xaxis.label, axes.yaxis.label):
            text.set_fontsize(11)
    return figure


def _draw(axes: Axes, marks: Sequence[Mark]) -> None:
    axes.set_xscale("log")
    if not marks:
        axes.text(0.5, 0.5, "the recordings are absent", transform=axes.transAxes, ha="center")
        return
    top = 1.3 * max(100.0 * m.error for m in marks)
    axes.set_ylim(0.0, top)
    best = front(marks)
    times, errors = [m.seconds for m in best], [100.0 * m.error for m in best]
    axes.step(times, errors, where="post", color=GREY, lw=7.0, alpha=0.3, solid_capstyle="round", zorder=1)
    for mark in marks:
        shape = "D" if mark.peer else "o"
        fill = "white" if mark.peer else mark.colour
        size = 13.0 if mark.advised else 9.0
        axes.plot(mark.seconds, 100.0 * mark.error, shape, color=mark.colour, mfc=fill, mew=1.8, ms=size, zorder=3)
    for mark in (m for m in marks if m.side == "above"):
        _write(axes, mark, (mark.seconds, 100.0 * mark.error + 0.5 * _GAP * top), top, ha="right")
    for side in ("left", "right"):
        for group in _near([m for m in marks if m.side == side]):
            _name(axes, group, top)
    low, high = min(m.seconds for m in marks), max(m.seconds for m in marks)
    # Beside the outermost marks there is room for names, unless the last one has its name above it.
    right = _BESIDE if max(marks, key=lambda m: m.seconds).side == "right" else 0.04
    decades = math.log10(high / low) / (1.0 - _BESIDE - right)
    axes.set_xlim(low / 10.0 ** (_BESIDE * decades), high * 10.0 ** (right * decades))
    shown = {t: text for t, text in _TICKS.items() if 0.3 * low < t < 2.0 * high}
    axes.set_xticks(list(shown), [text.replace(" ", "\n") for text in shown.values()])
    axes.minorticks_off()
    axes.axvline(_PERIOD_OF_THE_NODE, color=GREY, lw=1.0, ls="--", zorder=0)
    place = axes.get_xaxis_transform()
    axes.text(_PERIOD_OF_THE_NODE, 0.97, " period of 500 Hz", transform=place, fontsize=9, color=GREY, va="top")
    front_line = "Pareto front: no model is\nfaster and more accurate"
    axes.plot(times[:1], [-1.0], color=GREY, lw=7.0, alpha=0.3, label=front_line)
    axes.legend(loc="lower left", fontsize=9, frameon=False)


def _near(marks: Sequence[Mark]) -> list[list[Mark]]:
    """Marks in groups within a factor of eight in time."""
    groups: list[list[Mark]] = []
    for mark in sorted(marks, key=lambda m: m.seconds):
        if groups and mark.seconds < 8.0 * groups[-1][0].seconds:
            groups[-1].append(mark)
        else:
            groups.append([mark])
    return groups


def _name(axes: Axes, marks: Sequence[Mark], top: float) -> None:
    """Names of marks beside all of them, a gap apart, in the order in which the lines to the marks cross least."""
    if not marks:
        return
    left = marks[0].side == "left"
    edge = min(m.seconds for m in marks) / _LINE if left else max(m.seconds for m in marks) * _LINE
    gap = _GAP * top
    ordered = min(permutations(marks), key=lambda order: _tangle(order, _heights(order, gap), gap))
    for mark, height in zip(ordered, _heights(ordered, gap), strict=True):
        axes.plot([mark.seconds, edge], [100.0 * mark.error, height], color=mark.colour, lw=0.9, alpha=0.8, zorder=2)
        _write(axes, mark, (edge, height), top, ha="right" if left else "left")


def _write(axes: Axes, mark: Mark, place: tuple[float, float], top: float, *, ha: Literal["left", "right"]) -> None:
    percent = f"{100.0 * mark.error:.0f} %" if top > 15.0 else f"{100.0 * mark.error:.1f} %"
    named = axes.annotate(
        f"{mark.name}  {percent}",
        place,
        xytext=(-3 if ha == "right" else 3, 0),
        textcoords="offset points",
        ha=ha,
        va="center",
        fontsize=_SIZE,
        color=BLACK,
        weight="bold" if mark.advised else "normal",
    )
    named.set_in_layout(False)


def _heights(ordered: Sequence[Mark], gap: float) -> list[float]:
    """Heights of the names from below [%], at least a gap apart, around the mean of the marks."""
    heights = [100.0 * mark.error for mark in ordered]
    for _ in range(100):
        for k, (below, above) in enumerate(pairwise(heights)):
            short = gap - (above - below)
            if short > 0.0:
                heights[k], heights[k + 1] = below - 0.5 * short, above + 0.5 * short
    return heights


def _tangle(ordered: Sequence[Mark], heights: Sequence[float], gap: float) -> float:
    """How far lines go up or down, in gaps; and ten more for two of which one crosses the other's mark's height."""
    marks = list(zip(ordered, heights, strict=True))
    total = sum(((height - 100.0 * mark.error) / gap) ** 2 for mark, height in marks)
    edge = min if ordered[0].side == "left" else max
    outermost = edge(mark.seconds for mark in ordered)
    for mark, height in marks:
        for other, other_height in marks:
            # The line of the mark further from the names passes the nearer one on the side on which its name stands.
            nearer = abs(_decades(other.seconds, outermost)) < abs(_decades(mark.seconds, outermost))
            if nearer and (100.0 * mark.error - 100.0 * other.error) * (height - other_height) < 0.0:
                total += 10.0
    return total


def _decades(seconds: float, since: float) -> float:
    return math.log10(seconds / since)

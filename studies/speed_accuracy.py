"""The figure that answers what to choose: error against the time of one evaluation, simulated and real grains."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.result import BLACK, GREY, label_axes, new_figure

__all__ = ["Mark", "front", "speed_accuracy_figure"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """One choice: `seconds` of an evaluation, and its mean `error`, a share.

    `peer`: not by this package. `side` of the mark on which its name stands.
    """

    name: str
    seconds: float
    error: float
    colour: str
    peer: bool = False
    default: bool = False
    side: Literal["left", "right"] = "left"


def front(marks: Sequence[Mark]) -> list[Mark]:
    """The Pareto front: the marks for which no other is both faster and more accurate, ordered by time."""
    best: list[Mark] = []
    for mark in sorted(marks, key=lambda m: (m.seconds, m.error)):
        if not best or mark.error < best[-1].error:
            best.append(mark)
    return best


_TICKS = {1e-6: "1 µs", 1e-5: "10 µs", 1e-4: "0.1 ms", 1e-3: "1 ms", 1e-2: "10 ms", 1e-1: "0.1 s", 1.0: "1 s"}
_PERIOD_OF_THE_NODE = 2e-3  # s: at 500 Hz
_ROOM = 2.9  # decades of time that a name takes
_GAP = 0.065  # between two names, over the height of the panel


def speed_accuracy_figure(simulated: Sequence[Mark], real: Sequence[Mark]) -> Figure:
    """Two panels; one without marks says that its recordings are absent."""
    figure = new_figure(11.0, 4.8)
    panels = figure.subplots(1, 2, width_ratios=(1.15, 1.0))
    kinds = (
        ("Simulated grains, 11 runs", "Median error of the force [%]"),
        ("Real sand: plates and a wheel", "RMS error of the force over its peak [%]"),
    )
    for axes, marks, (title, error) in zip(panels, (simulated, real), kinds, strict=True):
        _draw(axes, marks)
        label_axes(axes, x="Time of one evaluation, one core", y=error, title=title)
    return figure


def _draw(axes: Axes, marks: Sequence[Mark]) -> None:
    axes.set_xscale("log")
    if not marks:
        axes.text(0.5, 0.5, "the recordings are absent", transform=axes.transAxes, ha="center")
        return
    top = 1.2 * max(100.0 * m.error for m in marks)
    axes.set_ylim(0.0, top)
    best = front(marks)
    times, errors = [m.seconds for m in best], [100.0 * m.error for m in best]
    axes.step(times, errors, where="post", color=GREY, lw=7.0, alpha=0.3, solid_capstyle="round", zorder=1)
    for mark in marks:
        shape = "D" if mark.peer else "o"
        fill = "white" if mark.peer else mark.colour
        size = 13.0 if mark.default else 9.0
        axes.plot(mark.seconds, 100.0 * mark.error, shape, color=mark.colour, mfc=fill, mew=1.8, ms=size, zorder=3)
    for side in ("left", "right"):
        for group in _near([m for m in marks if m.side == side]):
            _name(axes, group, top)
    low, high = min(m.seconds for m in marks), max(m.seconds for m in marks)
    room = 3.0 * 10.0**_ROOM  # beside the marks, for names; the longest are on the left
    axes.set_xlim(low / (6.0 * room), high * (0.9 * room if high < 0.1 else 4.0))
    shown = {t: text for t, text in _TICKS.items() if 0.3 * low < t < 2.0 * high}
    axes.set_xticks(list(shown), list(shown.values()))
    axes.minorticks_off()
    axes.axvline(_PERIOD_OF_THE_NODE, color=GREY, lw=1.0, ls="--", zorder=0)
    place = axes.get_xaxis_transform()
    axes.text(_PERIOD_OF_THE_NODE, 0.97, " period at 500 Hz", transform=place, fontsize=8, color=GREY, va="top")
    front_line = "Pareto front: no model is faster and more accurate"
    axes.plot(times[:1], [-1.0], color=GREY, lw=7.0, alpha=0.3, label=front_line)
    axes.legend(loc="lower right" if errors[-1] > 0.3 * top else "upper left", fontsize=8, frameon=False)


def _near(marks: Sequence[Mark]) -> list[list[Mark]]:
    """Marks in groups within a factor of four in time."""
    groups: list[list[Mark]] = []
    for mark in sorted(marks, key=lambda m: m.seconds):
        if groups and mark.seconds < 8.0 * groups[-1][0].seconds:
            groups[-1].append(mark)
        else:
            groups.append([mark])
    return groups


def _name(axes: Axes, marks: Sequence[Mark], top: float) -> None:
    """Names of marks beside all of them, from the least error upwards, a gap apart."""
    if not marks:
        return
    left = marks[0].side == "left"
    edge = min(m.seconds for m in marks) / 1.9 if left else max(m.seconds for m in marks) * 1.9
    ordered = sorted(marks, key=lambda m: m.error)
    heights: list[float] = []
    for mark in ordered:
        wanted = 100.0 * mark.error - (0.25 if left else 1.0) * _GAP * top * (len(ordered) - 1)
        heights.append(max(wanted, heights[-1] + _GAP * top if heights else 0.03 * top))
    for mark, height in zip(ordered, heights, strict=True):
        axes.plot([mark.seconds, edge], [100.0 * mark.error, height], color=mark.colour, lw=0.8, alpha=0.7, zorder=2)
        percent = f"{100.0 * mark.error:.0f} %" if top > 12.0 else f"{100.0 * mark.error:.1f} %"
        named = axes.annotate(
            f"{mark.name}  {percent}",
            (edge, height),
            xytext=(-3 if left else 3, 0),
            textcoords="offset points",
            ha="right" if left else "left",
            va="center",
            fontsize=9.5,
            color=BLACK,
            weight="bold" if mark.default else "normal",
        )
        named.set_in_layout(False)

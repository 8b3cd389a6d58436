"""The second chart: error against simulated grains, and what each modelling choice takes beside the simulation."""

from collections.abc import Mapping, Sequence
from statistics import mean
from typing import TYPE_CHECKING

from rft_ros.studies.figure import BLACK, BLUE, GREEN, GREY, ORANGE, label_axes, new_figure
from rft_ros.studies.model_choice import GROUPS, PACKINGS, Choice, Judged
from rft_ros.studies.outcome import Outcome, TextTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["averaged", "colour_of", "model_outcome", "simulated_seconds"]

Walls = Mapping[str, tuple[float, float]]


def averaged(judged: Sequence[Judged], group: str) -> dict[Choice, tuple[float, float]]:
    """Of each choice: seconds for a run, and error, means over the runs of a group."""
    mine = [j for j in judged if GROUPS[group](j.run)]
    return {
        choice: (
            mean(j.time * j.states for j in mine if j.choice == choice),
            mean(j.error for j in mine if j.choice == choice),
        )
        for choice in dict.fromkeys(j.choice for j in mine)
    }


def simulated_seconds(walls: Walls, group: str) -> tuple[float, float] | None:
    """Least and most that the simulations of a group took [s]; None where it is not known."""
    spans = [span for name, span in walls.items() if GROUPS[group](name)]
    return (min(low for low, _ in spans), max(high for _, high in spans)) if spans else None


def colour_of(choice: Choice) -> str:
    """Published, refined, with memory."""
    if choice.mobilization_length:
        return GREEN
    return ORANGE if choice.integration == "centroid" else BLUE


def model_outcome(judged: Sequence[Judged], walls: Walls) -> Outcome:
    """Figure, numbers, and a table of errors by choice and group."""
    groups = {group: averaged(judged, group) for group in GROUPS}
    choices = list(dict.fromkeys(j.choice for j in judged))
    rows = tuple(
        (
            choice.name,
            *(f"{100.0 * groups[group][choice][1]:.1f} %" for group in GROUPS),
            f"{1e6 * mean(j.time for j in judged if j.choice == choice):.1f} µs",
        )
        for choice in choices
    )
    return Outcome(
        name="models",
        title="Which modelling choice buys accuracy against simulated grains",
        figure=_draw(groups, walls),
        numbers={
            "models": {
                "run": [j.run for j in judged],
                "choice": [j.choice.name for j in judged],
                "integration": [j.choice.integration for j in judged],
                "alpha_y": [j.choice.alpha_y for j in judged],
                "tolerance": [j.choice.tolerance for j in judged],
                "mobilization_length": [j.choice.mobilization_length for j in judged],
                "plates": [j.plates for j in judged],
                "zeta": [j.zeta for j in judged],
                "time_us": [1e6 * j.time for j in judged],
                "median_error": [j.error for j in judged],
            }
        },
        table=TextTable(header=("choice", *GROUPS, "an evaluation"), rows=rows),
    )


def _draw(groups: dict[str, dict[Choice, tuple[float, float]]], walls: Walls) -> "Figure":
    figure = new_figure(14.0, 9.0)
    for axes, (group, found) in zip(figure.subplots(2, 2).ravel(), groups.items(), strict=True):
        _draw_group(axes, found, simulated_seconds(walls, group))
        label_axes(axes, x="Time for a run [s]", y="Median error of the force [%]", title=group)
    figure.suptitle("Force against simulated grains (discrete elements): what each modelling choice buys, and takes")
    return figure


def _draw_group(axes: "Axes", found: dict[Choice, tuple[float, float]], simulated: tuple[float, float] | None) -> None:
    axes.set_xscale("log")
    low, high = (100.0 * p for p in PACKINGS)
    axes.axhspan(low, high, color="0.92", zorder=0)
    ranked = sorted(found.items(), key=lambda item: -item[1][1])
    top = max(100.0 * error for _, error in found.values())
    fastest = min(seconds for seconds, _ in found.values())
    for place, (choice, (seconds, error)) in enumerate(ranked):
        marker = "s" if choice.tolerance else "o"
        hollow = choice.alpha_y == "linear"
        colour = colour_of(choice)
        axes.plot(seconds, 100.0 * error, marker, color=colour, mfc="none" if hollow else colour, ms=8)
        axes.annotate(
            f"{choice.name}: {100.0 * error:.1f} %",
            (seconds, 100.0 * error),
            xytext=(0.34, 0.95 - 0.07 * place),
            textcoords="axes fraction",
            fontsize=8,
            va="center",
            arrowprops={"arrowstyle": "-", "color": colour, "lw": 0.6, "alpha": 0.6},
        )
    if simulated:
        x = (simulated[0] * simulated[1]) ** 0.5
        axes.errorbar(
            x,
            0.5 * (low + high),
            yerr=0.5 * (high - low),
            xerr=[[x - simulated[0]], [simulated[1] - x]],
            fmt="D",
            color=BLACK,
            capsize=3,
        )
        text = f"discrete elements,\n{simulated[0]:.0f}–{simulated[1]:.0f} s;\ntwo packings"
        axes.annotate(text, (x, high), xytext=(0, 6), textcoords="offset points", ha="center", fontsize=8)
    axes.text(
        0.01,
        0.5 * (low + high),
        " two packings differ",
        transform=axes.get_yaxis_transform(),
        fontsize=7,
        color=GREY,
        va="center",
    )
    axes.set_xlim(0.3 * fastest, 3e3)
    axes.set_ylim(0.0, 1.18 * max(top, high))

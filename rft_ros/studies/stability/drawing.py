"""How the sweeps are drawn and tabled: colour tells the rule, dashes the α_y model."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import INTEGRATIONS, Integration
from rft_ros.studies.figure import BLUE, VERMILION
from rft_ros.studies.outcome import Columns, Outcome, TextTable
from rft_ros.studies.stability.sweep import Line

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "DEGREES",
    "MILLIMETRES",
    "RULE_COLOUR",
    "Unit",
    "by_rule_outcome",
    "draw_lines",
    "jump_outcome",
    "magnitude",
]

Array = NDArray[np.float64]

RULE_COLOUR = {"centroid": VERMILION, "refined": BLUE}
"""Colour of each rule of integration."""
_DASH = {"constant": "-", "linear": "--"}
_WIDTH = {"centroid": 2.4, "refined": 1.4}
_MOST_POINTS = 500  # of a line, besides the steepest steps


@dataclass(frozen=True, slots=True, kw_only=True)
class Unit:
    """A unit that people read: its name, how many of it make one SI unit, and the value shown as 0."""

    name: str
    per_si: float
    zero: float = 0.0


DEGREES = Unit(name="°", per_si=180.0 / np.pi)
MILLIMETRES = Unit(name="mm", per_si=1e3)
"""What sweeps are drawn over."""


def magnitude(forces: Array) -> Array:
    """Size of each force [N]."""
    return np.asarray(np.linalg.norm(forces, axis=1))


def draw_lines(
    axes: "Axes",
    lines: Sequence[Line],
    unit: Unit,
    *,
    shown: Callable[[Array], Array] = magnitude,
    label: str = "{rule}, α_y {alpha_y}",
) -> None:
    """Draw what `shown` makes of the forces against the swept value."""
    for line in lines:
        y = shown(line.forces)
        steps = np.abs(np.diff(y))
        keep = np.zeros(len(y), dtype=np.bool_)
        keep[:: max(1, len(y) // _MOST_POINTS)] = True
        for k in np.argsort(steps)[-8:]:
            keep[k : k + 2] = True
        axes.plot(
            (line.values[keep] - unit.zero) * unit.per_si,
            y[keep],
            color=RULE_COLOUR[line.rule],
            ls=_DASH[line.alpha_y],
            lw=_WIDTH[line.rule],
            label=label.format(rule=line.rule, alpha_y=line.alpha_y),
        )


def jump_outcome(name: str, title: str, figure: "Figure", lines: Sequence[Line], unit: Unit) -> Outcome:
    """A figure with the jumps and noise gains of its lines as numbers and table; values in `unit`."""
    return Outcome(
        name=name,
        title=title,
        figure=figure,
        numbers={name: _numbers(lines, unit)},
        table=_table(lines, unit),
    )


def by_rule_outcome(
    name: str, title: str, figure: "Figure", *, of: str, what: str, values: Mapping[str, Mapping[Integration, float]]
) -> Outcome:
    """A figure with a number [1] for each of some things (`of`) by each rule; `what`: the number's name in the CSV."""
    return Outcome(
        name=name,
        title=title,
        figure=figure,
        numbers={
            name: {of: list(values), **{f"{what}_{rule}": [v[rule] for v in values.values()] for rule in INTEGRATIONS}}
        },
        table=TextTable(
            header=(of, *INTEGRATIONS),
            rows=tuple(
                (thing, *(f"{100.0 * by_rule[rule]:.2g} %" for rule in INTEGRATIONS))
                for thing, by_rule in values.items()
            ),
        ),
    )


def _numbers(lines: Sequence[Line], unit: Unit) -> Columns:
    """The lines' jumps and noise gains as columns."""
    return {
        "sweep": [line.sweep for line in lines],
        "rule": [line.rule for line in lines],
        "alpha_y": [line.alpha_y for line in lines],
        "largest_jump_over_local_force": [line.jump for line in lines],
        f"at_{_ascii(unit)}": [(line.at - unit.zero) * unit.per_si for line in lines],
        f"noise_gain_per_{_ascii(unit)}": [line.gain / unit.per_si for line in lines],
    }


def _table(lines: Sequence[Line], unit: Unit) -> TextTable:
    """For people: a row a line."""
    return TextTable(
        header=(
            "sweep",
            "rule",
            "α_y",
            "largest jump, of the local force",
            "at",
            f"noise gain, of the force per {unit.name}",
        ),
        rows=tuple(
            (
                line.sweep,
                line.rule,
                line.alpha_y,
                f"{100.0 * line.jump:.2g} %",
                f"{(line.at - unit.zero) * unit.per_si:.2f} {unit.name}",
                f"{100.0 * line.gain / unit.per_si:.2g} %",
            )
            for line in lines
        ),
    )


def _ascii(unit: Unit) -> str:
    return unit.name.replace("°", "deg").replace("/", "_per_")

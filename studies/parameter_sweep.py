"""Sweeping one parameter through a discontinuity: the force along it, its jumps and its noise gain.

Colour tells the rule of integration, the dash the α_y model.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from rft_ros.rft import (
    ANGULAR_VELOCITY,
    INTEGRATIONS,
    QUATERNION,
    VELOCITY,
    Integration,
    Plates,
    checked_states,
    wrenches,
)
from rft_ros.tool import load_tool
from rft_ros.tool.refine import refined_plates
from rft_ros.tool.tool import centroid_plates
from studies.paper import ALPHA_Y, law
from studies.result import BLUE, VERMILION, StudyResult, result_of_rows

__all__ = ["ANGLE_STEP", "DEGREES", "LENGTH_STEP", "MILLIMETRES", "RULE_COLOUR", "BothRules", "Line", "Sweep"]
__all__ += ["Unit"]
__all__ += ["both_rules", "by_rule_result", "draw_lines", "evenly", "jump_result", "jumps", "measured"]
__all__ += ["scene_states", "shipped"]

Array = NDArray[np.float64]

BothRules = Mapping[Integration, Plates]
"""The same tool for each rule of integration."""

ANGLE_STEP = 1e-4
"""Steps [rad] over which a force must not jump; a degree has 175."""

LENGTH_STEP = 1e-5
"""Steps [m] over which a force must not jump: the noise of good encoders."""

_FEEBLE = 0.01  # of the largest force along a sweep


def both_rules(mesh: trimesh.Trimesh) -> BothRules:
    """The plates of a mesh in the tool frame [m] by the published and by the refined rule."""
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64)
    return {"centroid": centroid_plates(vertices, faces), "refined": refined_plates(vertices, faces)}


def shipped(name: str) -> BothRules:
    """The plates of a shipped mesh by both rules."""
    return {rule: load_tool(name, integration=rule).plates for rule in INTEGRATIONS}


def evenly(low: float, high: float, step: float) -> Array:
    """Values from low to high, `step` apart, half a step off the multiples of `step`."""
    return np.asarray((np.arange(np.floor(low / step), np.ceil(high / step)) + 0.5) * step)


def scene_states(
    attitude: Rotation,
    *,
    velocity: ArrayLike,
    height: ArrayLike = -0.05,
    spin: ArrayLike = (0.0, 0.0, 0.0),
) -> Array:
    """States, shape [n, 13], at x = y = 0: attitudes, velocities [m/s], heights [m], spins [rad/s], or one of each."""
    q = np.atleast_2d(attitude.as_quat())
    v, z, w = np.atleast_2d(velocity), np.atleast_1d(height), np.atleast_2d(spin)
    states = np.zeros((max(len(q), len(v), len(z), len(w)), 13))
    states[:, 2], states[:, QUATERNION], states[:, VELOCITY], states[:, ANGULAR_VELOCITY] = z, q, v, w
    return checked_states(states)


def jumps(forces: Array) -> Array:
    """Change over each step less the mean change of its two neighbours, over the local force; shape [n - 3].

    `forces`: at even steps of a parameter, shape [n, k]. A local force below 1 % of the largest counts as 1 % of it.
    """
    change = np.diff(forces, axis=0)
    beyond = np.linalg.norm(change[1:-1] - 0.5 * (change[:-2] + change[2:]), axis=1)
    size = np.linalg.norm(forces, axis=1)
    local = np.maximum(size[1:-2], size[2:-1])
    return np.asarray(beyond / np.maximum(local, max(_FEEBLE * float(size.max()), 1e-300)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Line:
    """Forces [N], shape [n, 3], along a sweep's values, shape [n], by one rule with one α_y model.

    `jump`: the largest, over the local force, and `at` which value. `gain`: the steepest change of force per unit of
    the value, jumps excluded, over the largest force.
    """

    sweep: str
    rule: Integration
    alpha_y: str
    values: Array
    forces: Array
    jump: float
    at: float
    gain: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sweep:
    """One parameter swept: `states` from `values`, which are evenly spaced [rad, m or m/s]."""

    name: str
    tool: BothRules
    values: Array
    states: Callable[[Array], Array]
    zeta: float = 1.0


_JUMP = 1e-3  # larger steps are jumps and do not count as slope


def measured(sweep: Sweep, *, rules: Sequence[Integration] = INTEGRATIONS) -> tuple[Line, ...]:
    """Run the sweep by these rules with both α_y models of the paper."""
    states = sweep.states(sweep.values)
    step = float(sweep.values[1] - sweep.values[0])
    lines = []
    for rule in rules:
        plates = sweep.tool[rule]
        for model in ALPHA_Y:
            forces = wrenches(plates, law(model, zeta=sweep.zeta), states)[:, :3]
            beyond = jumps(forces)
            largest = int(np.argmax(beyond))
            change = np.linalg.norm(np.diff(forces, axis=0), axis=1)[1:-1]
            slope = np.where(beyond < _JUMP, change, 0.0).max() / step
            lines.append(
                Line(
                    sweep=sweep.name,
                    rule=rule,
                    alpha_y=model,
                    values=sweep.values,
                    forces=forces,
                    jump=float(beyond[largest]),
                    at=float(sweep.values[largest + 1] + 0.5 * step),
                    gain=float(slope / max(np.linalg.norm(forces, axis=1).max(), 1e-300)),
                )
            )
    return tuple(lines)


RULE_COLOUR = {"centroid": VERMILION, "refined": BLUE}
"""Colour of each rule of integration."""
_DASH = {"constant": "-", "linear": "--"}
_WIDTH = {"centroid": 2.4, "refined": 1.4}
_MOST_POINTS = 500  # of a line, besides the steepest steps


@dataclass(frozen=True, slots=True, kw_only=True)
class Unit:
    """A unit for display: its name, how many make one SI unit."""

    name: str
    per_si: float


DEGREES = Unit(name="°", per_si=180.0 / np.pi)
MILLIMETRES = Unit(name="mm", per_si=1e3)
"""Units of the swept values."""


def draw_lines(
    axes: Axes,
    lines: Sequence[Line],
    unit: Unit,
    *,
    component: int | None = None,
    label: str = "{rule}, α_y {alpha_y}",
) -> None:
    """Draw a component of the forces, or their magnitude, over the swept value."""
    for line in lines:
        y = np.linalg.norm(line.forces, axis=1) if component is None else line.forces[:, component]
        steps = np.abs(np.diff(y))
        keep = np.zeros(len(y), dtype=np.bool_)
        keep[:: max(1, len(y) // _MOST_POINTS)] = True
        for k in np.argsort(steps)[-8:]:
            keep[k : k + 2] = True
        axes.plot(
            line.values[keep] * unit.per_si,
            y[keep],
            color=RULE_COLOUR[line.rule],
            ls=_DASH[line.alpha_y],
            lw=_WIDTH[line.rule],
            label=label.format(rule=line.rule, alpha_y=line.alpha_y),
        )


def jump_result(name: str, title: str, figure: Figure, lines: Sequence[Line], unit: Unit) -> StudyResult:
    """A figure with the jumps and noise gains of its lines, as numbers and as a table; values in `unit`."""
    ascii_unit = unit.name.replace("°", "deg").replace("/", "_per_")
    rows = [
        (line.sweep, line.rule, line.alpha_y, line.jump, line.at * unit.per_si, line.gain / unit.per_si)
        for line in lines
    ]
    return result_of_rows(
        name,
        title,
        figure,
        rows,
        ("sweep", "sweep", "{}"),
        ("rule", "rule", "{}"),
        ("α_y", "alpha_y", "{}"),
        ("largest jump, of the local force", "largest_jump_over_local_force", "{:.2g} %", 100.0),
        ("at", f"at_{ascii_unit}", f"{{:.2f}} {unit.name}"),
        (f"noise gain, of the force per {unit.name}", f"noise_gain_per_{ascii_unit}", "{:.2g} %", 100.0),
    )


def by_rule_result(
    name: str, title: str, figure: Figure, *, of: str, what: str, values: Mapping[str, Mapping[Integration, float]]
) -> StudyResult:
    """A figure with a number [1] for each thing (`of`) by each rule; `what`: the number's name in the CSV."""
    return result_of_rows(
        name,
        title,
        figure,
        [(thing, *(by_rule[rule] for rule in INTEGRATIONS)) for thing, by_rule in values.items()],
        (of, of, "{}"),
        *((rule, f"{what}_{rule}", "{:.2g} %", 100.0) for rule in INTEGRATIONS),
    )

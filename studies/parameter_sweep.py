"""Sweeping one parameter through a discontinuity: the force along it, and its jumps.

Colour tells the rule of integration, the dash the α_y model.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from matplotlib.axes import Axes
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
from rft_ros.tool import centroid_plates, load_tool, refined_plates
from studies.paper import ALPHA_Y, law
from studies.result import BLUE, VERMILION

__all__ = [
    "ANGLE_STEP",
    "LENGTH_STEP",
    "RULE_COLOUR",
    "BothRules",
    "Line",
    "Sweep",
    "both_rules",
    "draw_lines",
]
__all__ += ["evenly", "jumps", "measured", "scene_states", "shipped"]

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
    return {
        "centroid": centroid_plates(vertices, faces),
        "refined": refined_plates(vertices, faces),
    }


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
    states[:, 2], states[:, QUATERNION], states[:, VELOCITY], states[:, ANGULAR_VELOCITY] = (
        z,
        q,
        v,
        w,
    )
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

    `jump`: the largest, over the local force.
    """

    rule: Integration
    alpha_y: str
    values: Array
    forces: Array
    jump: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sweep:
    """One parameter swept: `states` from `values`, which are evenly spaced [rad, m or m/s]."""

    name: str
    tool: BothRules
    values: Array
    states: Callable[[Array], Array]
    zeta: float = 1.0


def measured(sweep: Sweep, *, rules: Sequence[Integration] = INTEGRATIONS) -> tuple[Line, ...]:
    """Run the sweep by these rules with both α_y models of the paper."""
    states = sweep.states(sweep.values)
    lines = []
    for rule in rules:
        for model in ALPHA_Y:
            forces = wrenches(sweep.tool[rule], law(model, zeta=sweep.zeta), states)[:, :3]
            jump = float(jumps(forces).max())
            lines.append(
                Line(rule=rule, alpha_y=model, values=sweep.values, forces=forces, jump=jump)
            )
    return tuple(lines)


RULE_COLOUR = {"centroid": VERMILION, "refined": BLUE}
"""Colour of each rule of integration."""
_DASH = {"constant": "-", "linear": "--"}
_WIDTH = {"centroid": 2.4, "refined": 1.4}
_MOST_POINTS = 500  # of a line, besides the steepest steps


def draw_lines(
    axes: Axes, lines: Sequence[Line], per_unit: float, *, component: int | None = None
) -> None:
    """Draw a component of the forces, or their magnitude, over the swept value times `per_unit`."""
    for line in lines:
        y = np.linalg.norm(line.forces, axis=1) if component is None else line.forces[:, component]
        keep = np.zeros(len(y), dtype=np.bool_)
        keep[:: max(1, len(y) // _MOST_POINTS)] = True
        for k in np.argsort(np.abs(np.diff(y)))[-8:]:
            keep[k : k + 2] = True
        label = f"{line.rule}, α_y {line.alpha_y}"
        (drawn,) = axes.plot(
            line.values[keep] * per_unit, y[keep], label=label, color=RULE_COLOUR[line.rule]
        )
        drawn.set(linestyle=_DASH[line.alpha_y], linewidth=_WIDTH[line.rule])

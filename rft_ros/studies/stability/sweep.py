"""A parameter taken through a bad place: the force along it, its jumps and its noise gain, by rule and α_y model."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from rft_ros.rft import INTEGRATIONS, Integration, Plates, checked_states, wrenches
from rft_ros.studies.paper import ALPHA_Y, law
from rft_ros.tool import load_tool
from rft_ros.tool.refine import refined_plates
from rft_ros.tool.tool import centroid_plates

__all__ = ["ANGLE_STEP", "LENGTH_STEP", "BothRules", "Line", "Sweep", "both_rules", "evenly", "jumps", "measured"]
__all__ += ["scene_states", "shipped"]

Array = NDArray[np.float64]
BothRules = Mapping[Integration, Plates]
"""The same tool for each rule of integration."""

ANGLE_STEP = 1e-4
"""Steps [rad] over which a force must not jump; a degree has 175."""

LENGTH_STEP = 1e-5
"""Steps [m] over which a force must not jump: the noise of good encoders."""

_FEEBLE = 0.01  # of the largest force along a sweep: where it begins from nothing, jumps are measured by that


def both_rules(vertices: Array, faces: NDArray[np.int64]) -> BothRules:
    """The plates of a mesh in the tool frame [m] by the published and by the refined rule."""
    return {"centroid": centroid_plates(vertices, faces), "refined": refined_plates(vertices, faces)}


def shipped(name: str) -> BothRules:
    """The plates of a shipped mesh by both rules."""
    return {rule: load_tool(name, integration=rule).plates for rule in INTEGRATIONS}


def evenly(low: float, high: float, step: float) -> Array:
    """Values from low to high, `step` apart, none of them exactly at a round number of steps from zero."""
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
    states[:, 2], states[:, 3:7], states[:, 7:10], states[:, 10:13] = z, q, v, w
    return checked_states(states)


def jumps(forces: Array) -> Array:
    """How far each step's change lies beyond the mean of its neighbours', over the local force; shape [n - 3].

    `forces`: at even steps of a parameter, shape [n, k]. Forces below a hundredth of the largest count as that.
    """
    change = np.diff(forces, axis=0)
    beyond = np.linalg.norm(change[1:-1] - 0.5 * (change[:-2] + change[2:]), axis=1)
    size = np.linalg.norm(forces, axis=1)
    local = np.maximum(size[1:-2], size[2:-1])
    return np.asarray(beyond / np.maximum(local, max(_FEEBLE * float(size.max()), 1e-300)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Line:
    """Forces [N], shape [n, 3], along a sweep's values, shape [n], by one rule with one α_y model.

    `jump`: the largest, over the local force, `at` a value; `gain`: the steepest change of force away from it, over the
    largest force, for each unit of the value.
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
    """One parameter through a bad place: `states` from `values`, which are evenly spaced [rad, m or m/s]."""

    name: str
    tool: BothRules
    values: Array
    states: Callable[[Array], Array]
    zeta: float = 1.0


_JUMP = 1e-3  # steps that count as jumps do not count as slope


def measured(sweep: Sweep, *, rules: Sequence[Integration] = INTEGRATIONS) -> tuple[Line, ...]:
    """The sweep by these rules with both α_y models of the paper."""
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

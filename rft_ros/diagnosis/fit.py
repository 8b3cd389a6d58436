"""The fit of a cell: all of its continuous parameters at once, from the misfit of force and torque over a trial.

What is given is a prior with a tolerance (`TOLERANCES`). What the trial does not determine stays at the given value,
with an error that says so. Most parameters are linear in the readings; delay, surface and λ are not, and come from
Gauss-Newton steps around a coarse search.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from rft_ros.diagnosis.trial import Array, Trial, stretches, thin_rows
from rft_ros.estimator import GRAVITY
from rft_ros.parameters import LoadCell
from rft_ros.rft import (
    ANGULAR_VELOCITY,
    FORCE,
    POSE,
    POSITION,
    STATE,
    TORQUE,
    VELOCITY,
    Law,
    Memory,
    displacements_between,
    wrenches_in_time,
)
from rft_ros.rft.motion_kinds import MOTIONS, kind_of_motion
from rft_ros.tool import Tool


class Tolerance(NamedTuple):
    """How far a given value may be off without harm, the unit, and what that is for.

    `size`: number of components.
    """

    value: float
    size: int
    unit: str
    reason: str


TOLERANCES = {
    "zeta": Tolerance(0.3, 1, "of its logarithm", "beds of the same grains, and motions"),
    "mass": Tolerance(0.03, 1, "kg", "cables, screws"),
    "moment": Tolerance(0.003, 3, "kg m", "mass times centre of mass, of the same"),
    "force_bias": Tolerance(0.02, 3, "of the greatest force", "drift of a load cell"),
    "torque_bias": Tolerance(0.02, 3, "of that times the tool's size", "drift of a load cell"),
    "turn": Tolerance(
        3.0, 3, "degrees", "grains push plates up to 3° out of the model's direction"
    ),
    "lever": Tolerance(0.01, 3, "m", "where the grains' force acts on the tool"),
    "surface": Tolerance(0.003, 1, "m", "levelling of a bed"),
    "delay": Tolerance(
        0.008, 1, "s", "time between two samples; half that between two poses, if longer"
    ),
    "length": Tolerance(0.5, 1, "of its logarithm", "λ differs between grains"),
    "power": Tolerance(0.3, 1, "of depth", "growth of the force with depth unlike the model's"),
    "kinds": Tolerance(
        0.2, 4, "of ζ", "ζ of rest, drag, turn and withdrawal over that of a press"
    ),
    "zero_change": Tolerance(0.02, 6, "of the greatest force", "a zero that moves"),
}
"""Tolerances of the given values; the last three are of what no parameter describes."""

NUISANCES = ("power", "kinds", "zero_change")

MODEL_ERROR_SHARE = 0.06
"""Error of the model's force over the force, where all parameters are right."""
FLOOR_SHARE = 0.015
"""The same over the greatest force, and the drift of a load cell."""
MIN_LENGTH_M = 1e-4
"""Of grains without memory, too: with it, real ones hold their force at rest."""
MAX_LENGTH_M = 0.03
UNKNOWN_LENGTH_TOLERANCE = 1.5
"""Tolerance of the logarithm of a λ that is not given."""
ROBUST_FACTOR = 3.0
"""Standard errors beyond which a residual counts linearly."""
USUAL_MISFIT_RATIO = 0.5
"""Misfit per stretch of right cells by errors of the model, beside that by the noise of the load cell."""
MIN_USUAL_ZETA = 0.2
MAX_USUAL_ZETA = 3.0
"""Range of ζ of dry grains: with others, forces in another unit or a wrong mesh are likelier."""
REST_M = 1e-6
"""Path between two moments below which the tool rests."""
START_M = 0.01
"""Path over which a force of the grains depends on what the tool did before the first moment."""
BLOCK_COUNT = 100
MOMENTS_COUNT = 600
TOOL_TOLERANCE_SHARE = 0.02


def _slices() -> dict[str, slice]:
    """Where the numbers of each name lie among all of them."""
    ends = np.cumsum([tolerance.size for tolerance in TOLERANCES.values()]).tolist()
    return {
        name: slice(end - tolerance.size, end)
        for (name, tolerance), end in zip(TOLERANCES.items(), ends, strict=True)
    }


_SLICES = _slices()
NUMBERS = _SLICES["zero_change"].stop


def crossed(a: Array, b: Array) -> Array:
    """a cross b along the last axis; numpy's own takes three times as long."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def _beside(values: Array) -> Array:
    """At each of n moments the mean of those before and after it, whose noise is not its own, shape [n, ...]."""
    rows = np.arange(len(values))
    values_before = values[np.maximum(rows - 1, 0)]
    values_after = values[np.minimum(rows + 1, len(values) - 1)]
    return np.asarray(0.5 * (values_before + values_after))


def rows_of(name: str) -> slice:
    """Where the numbers of a name lie among all of them."""
    return _SLICES[name]


def cross_matrices(v: Array) -> Array:
    """Matrices M with M @ x = x cross v, shape [n, 3, 3]."""
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1] = v[:, 2]
    out[:, 0, 2] = -v[:, 1]
    out[:, 1, 0] = -v[:, 2]
    out[:, 1, 2] = v[:, 0]
    out[:, 2, 0] = v[:, 1]
    out[:, 2, 1] = -v[:, 0]
    return out


@dataclass(frozen=True, kw_only=True, eq=False)
class Setup:
    """What is given of a cell: load cell, tool, law (with ζ and λ) and the height of the surface [m].

    `reads_in_world`: the readings are in world axes. `lag`: of a filter in the load cell's driver [s]. `zero_columns`:
    of a zero that moves, what each of six numbers adds to a reading in tool axes, at each moment, shape [n, 6, 6].
    `units` of force [N] and torque [N m]. `late`: of the readings, on top of the delay with which the trial was read
    [s]. `has_torque`: whether the load cell gives torques; without, only the force counts.
    """

    cell: LoadCell
    tool: Tool
    law: Law
    surface: float
    reads_in_world: bool = False
    lag: float = 0.0
    units: tuple[float, float] = (1.0, 1.0)
    late: float = 0.0
    zero_columns: Array | None = None
    has_torque: bool = True

    def thinned(self, count: int) -> "Setup":
        """The same for a trial that is thinned."""
        if self.zero_columns is None:
            return self
        return replace(
            self, zero_columns=self.zero_columns[thin_rows(len(self.zero_columns), count)]
        )

    @property
    def length(self) -> float:
        """λ [m]."""
        return max(self.law.mobilization_length, MIN_LENGTH_M)

    def cell_axes(self, trial: Trial) -> Array:
        """The matrices that turn readings into tool axes at the moments of a trial, shape [n, 3, 3]."""
        if self.reads_in_world:
            return np.asarray(self.cell.sign * np.swapaxes(trial.matrices, 1, 2))
        return np.repeat(self.in_tool[None], len(trial), axis=0)

    @cached_property
    def in_tool(self) -> Array:
        """The matrix that turns readings into the tool's axes and the sign of a force on the tool, shape [3, 3]."""
        return self.cell.sign * Rotation.from_quat(self.cell.quaternion).as_matrix()


class Basis(NamedTuple):
    """The wrench at ζ = 1 in tool axes about the tool's middle, shape [n, 6], and the depth of the lowest point [m]."""

    wrench: Array
    depth: Array


class Model:
    """The model's wrench along the poses of a trial at some of its moments, for any surface and λ."""

    def __init__(self, trial: Trial, setup: Setup) -> None:
        self._tool = setup.tool
        self._law = replace(setup.law, zeta=1.0, density=0.0)
        n = len(trial)
        states = np.zeros((n, len(STATE)))
        states[:, POSE] = trial.poses
        self._moved = displacements_between(np.vstack([np.zeros(len(STATE)), states[:-1]]), states)
        displacement = self._moved
        span = np.maximum(np.diff(trial.time, prepend=trial.time[0] - 1.0), 1e-4)[:, None]
        turn = 0.5 * np.column_stack(
            [
                displacement[:, 10] - displacement[:, 8],
                displacement[:, 5] - displacement[:, 9],
                displacement[:, 6] - displacement[:, 4],
            ]
        )
        states[:, VELOCITY] = displacement[:, POSITION] / span
        states[:, ANGULAR_VELOCITY] = turn / span
        self._states = states
        self._into_tool = np.swapaxes(trial.matrices, 1, 2)
        self._middle = np.array(self._tool.middle)
        self.low = self._tool.lowest_points(states)[0]
        going = displacement[:, POSITION] + crossed(turn, trial.matrices @ self._middle)
        angle = 0.5 * self._tool.size * np.linalg.norm(turn, axis=1)
        distance = np.linalg.norm(going, axis=1) + angle
        self.kinds = [
            "rest" if distance < REST_M else kind_of_motion(x, y, z, angle)
            for (x, y, z), angle, distance in zip(
                going.tolist(), angle.tolist(), distance.tolist(), strict=True
            )
        ]
        self.path = np.cumsum(distance)
        self._found: dict[tuple[float, float], Basis] = {}

    def at(self, surface: float, length: float) -> Basis:
        """The model's wrench with a surface height and a λ [m]."""
        key = round(surface, 7), round(length, 7)
        if key not in self._found:
            if len(self._found) > 200:
                self._found.clear()
            law = replace(self._law, mobilization_length=length)
            world = wrenches_in_time(
                self._tool.plates,
                law,
                self._states,
                Memory(self._tool.plates),
                displacements=self._moved,
                surface_height=surface,
            )
            force = np.einsum("nij,nj->ni", self._into_tool, world[:, FORCE])
            torque = np.einsum("nij,nj->ni", self._into_tool, world[:, TORQUE])
            torque = torque - crossed(self._middle, force)
            self._found[key] = Basis(np.hstack([force, torque]), surface - self.low)
        return self._found[key]


@dataclass(frozen=True, eq=False)
class Fit:
    """Fitted numbers of a cell, `TOLERANCES` by name, and their standard errors; logarithms of ζ and λ.

    `misfit`: the robust sum of squares over the independent stretches, priors included; `count` of the stretches.
    `residuals`, and the wrench of the `model` about the tool's middle in tool axes [N], [N m], each shape [n, 6].
    """

    values: Mapping[str, Array]
    errors: Mapping[str, Array]
    misfit: float
    count: float
    residuals: Array = field(repr=False)
    model: Array = field(repr=False)

    @property
    def zeta(self) -> float:
        """ζ."""
        return float(np.exp(self.values["zeta"][0]))

    @property
    def per_stretch(self) -> float:
        """The misfit of a stretch: compare it with `Problem.usual`."""
        return self.misfit / self.count


class _Slopes(NamedTuple):
    """Derivatives of the model's wrench in tool axes by surface [1/m] and logarithm of λ, and where they were taken."""

    surface: float
    length: float
    surface_slope: Array
    length_slope: Array

    def is_near(self, surface: float, length: float) -> bool:
        """Whether they hold at another surface and λ [m], too."""
        return abs(surface - self.surface) < 1e-3 and abs(np.log(length / self.length)) < 0.15


FREEDOM_FACTOR = 300.0
TIED_FREEDOM_FACTORS = {"lever": 20.0, "turn": 20.0, "moment": 20.0, "delay": 30.0}
"""How many times as far as its tolerance a free number may be off; of some a straight press tells only a part."""
MIN_EIGENVALUE = 1e-12
"""Added to the normal matrix with ones on its diagonal: rounding makes eigenvalues below 0."""
STEP_M = 5e-4
LENGTH_STEP_FACTOR = 1.1
"""Steps of the surface and of λ by which the derivatives are taken."""


class Problem:
    """The fit of one trial with one set-up: what does not change while its numbers do."""

    def __init__(self, trial: Trial, setup: Setup, *, model: Model | None = None) -> None:
        self.setup = setup
        self.trial = trial
        self.tool = setup.tool
        self.time = trial.time
        self.model = model or Model(trial, setup)
        self.count_of = stretches(trial.time, self.model.path)
        self.count = float(self.count_of.sum())
        self.middle = np.array(setup.tool.middle)
        self._slopes: _Slopes | None = None
        self._readings: dict[float, Array] = {}
        kinds = np.array(self.model.kinds)
        self.kinds = np.column_stack([kinds == kind for kind in ("rest", *MOTIONS[1:])]) * 1.0
        self._weigh()

    def beside(self, trial: Trial, setup: Setup) -> "Problem":
        """The fit of another trial or set-up, with the same forces of the model where poses and tool are the same."""
        is_same = trial is self.trial and setup.tool is self.tool and setup.law is self.setup.law
        return Problem(trial, setup, model=self.model if is_same else None)

    def _weigh(self) -> None:
        """Standard errors of force and torque at each moment, from the reading alone."""
        reading = self.reading(0.0)
        low = self.model.low
        top = low >= np.quantile(low, 0.9)
        zero = np.median(reading[top], axis=0)
        size = np.linalg.norm((reading - zero)[:, FORCE], axis=1)
        self.peak = float(np.quantile(size, 0.99)) + 1e-9
        noise = np.repeat(self.setup.units, 3) * self.trial.readings.noise
        force_noise = float(noise[FORCE].max())
        torque_noise = float(noise[TORQUE].max())
        lever = float(np.linalg.norm(np.array(self.setup.cell.position) - self.middle))
        half = 0.5 * self.tool.size
        self.half = half
        error = np.sqrt(
            (MODEL_ERROR_SHARE * size) ** 2 + (FLOOR_SHARE * self.peak) ** 2 + force_noise**2
        )
        twist = np.sqrt((half * 0.5 * error) ** 2 + (lever * force_noise) ** 2 + torque_noise**2)
        self.error = np.column_stack([error, twist])
        noise_share = (force_noise / error) ** 2 + (
            (lever * force_noise) ** 2 + torque_noise**2
        ) / twist**2
        misfit_of_noise = float(self.count_of @ noise_share)
        self.usual = USUAL_MISFIT_RATIO + misfit_of_noise / max(self.count, 1e-9)
        # `Readings.at` has half of the variance of a reading, and a lever turns two of three components into torque
        self.misfit_of_noise = misfit_of_noise / 3.0
        self.sigma = np.repeat(1.0 / self.error, 3, axis=1)
        if not self.setup.has_torque:
            self.sigma[:, TORQUE] = 0.0
        scale = np.ones(NUMBERS)
        for name, tolerance in TOLERANCES.items():
            scale[_SLICES[name]] = tolerance.value
        scale[_SLICES["delay"]] = max(TOLERANCES["delay"].value, 0.5 * self.trial.interval)
        if not self.setup.law.mobilization_length:
            scale[_SLICES["length"]] = UNKNOWN_LENGTH_TOLERANCE
        scale[_SLICES["turn"]] = np.radians(TOLERANCES["turn"].value)
        scale[_SLICES["force_bias"]] = max(TOLERANCES["force_bias"].value * self.peak, force_noise)
        scale[_SLICES["torque_bias"]] = max(
            TOLERANCES["torque_bias"].value * self.peak * half
            + lever * scale[_SLICES["force_bias"]][0],
            torque_noise,
        )
        scale[_SLICES["zero_change"]] = np.repeat(
            (scale[_SLICES["force_bias"]][0], scale[_SLICES["torque_bias"]][0]), 3
        )
        self.scale = scale

    def reading(self, late: float) -> Array:
        """The readings of the moments in tool axes, with the sign on the tool, shape [n, 6]."""
        if late not in self._readings:
            if len(self._readings) > 100:
                self._readings.clear()
            raw = self.trial.readings.at(self.trial.time + self.setup.late + late)
            bias = np.array(self.setup.cell.bias)
            raw = bias + np.repeat(self.setup.units, 3) * (raw - bias)
            self._readings[late] = self.into_tool(raw)
        return self._readings[late]

    def into_tool(self, raw: Array) -> Array:
        """Readings as the driver gave them, in tool axes and with the sign of a wrench on the tool, shape [n, 6]."""
        axes = self.setup.cell_axes(self.trial)
        return np.asarray(np.einsum("nij,nkj->nki", axes, raw.reshape(-1, 2, 3)).reshape(-1, 6))

    def given(self) -> Array:
        """The given numbers; bias in tool axes, logarithms of ζ and λ."""
        cell = self.setup.cell
        x = np.zeros(NUMBERS)
        x[_SLICES["zeta"]] = np.log(self.setup.law.zeta)
        x[_SLICES["mass"]] = cell.mass
        turn = self.setup.in_tool
        # the moment of the weight needs no sign
        proper = turn * cell.sign
        x[_SLICES["moment"]] = cell.mass * (proper @ np.array(cell.center_of_mass))
        x[_SLICES["force_bias"]] = turn @ np.array(cell.bias[:3])
        x[_SLICES["torque_bias"]] = turn @ np.array(cell.bias[3:])
        x[_SLICES["surface"]] = self.setup.surface
        x[_SLICES["length"]] = np.log(self.setup.length)
        return x

    def residual(self, x: Array, *, jacobian: bool = False) -> tuple[Array, Array, Array | None]:
        """Misfit of force and torque about the tool's middle, shape [n, 6]; the model's wrench; and the derivatives."""
        n = len(self.time)
        surface = float(x[_SLICES["surface"]][0])
        length = float(np.exp(x[_SLICES["length"]][0]))
        late = float(x[_SLICES["delay"]][0])
        basis = self.basis(surface, length)
        g = basis.wrench
        turn = Rotation.from_rotvec(x[_SLICES["turn"]]).as_matrix()
        lever = np.array(self.setup.cell.position) + x[_SLICES["lever"]] - self.middle
        reading = self.reading(late)
        force = reading[:, FORCE] @ turn.T
        torque = reading[:, TORQUE] @ turn.T
        weight = GRAVITY * self.trial.down
        mass = x[_SLICES["mass"]][0]
        grains = force - x[_SLICES["force_bias"]] - mass * weight
        couple = torque - x[_SLICES["torque_bias"]] - crossed(x[_SLICES["moment"]], weight)
        about = couple + crossed(lever, grains)
        deep = np.log(np.clip(basis.depth / max(basis.depth.max(), 1e-3), 0.05, 1.0))
        kinds = self.kinds
        zeta = float(np.exp(x[_SLICES["zeta"]][0]))
        growth = 1.0 + x[_SLICES["power"]][0] * deep + kinds @ x[_SLICES["kinds"]]
        factor = zeta * growth
        model = factor[:, None] * g
        e = np.hstack([grains, about]) - model
        zero_columns = self.setup.zero_columns
        if zero_columns is not None:
            zero_change = zero_columns @ x[_SLICES["zero_change"]]
            e[:, FORCE] -= zero_change[:, FORCE]
            e[:, TORQUE] -= zero_change[:, TORQUE] + crossed(lever, zero_change[:, FORCE])
        unknown_rows = self.unknown_rows(surface)
        e[unknown_rows] = 0.0
        if not jacobian:
            return e, model, None
        J = np.zeros((n, 6, NUMBERS))
        J[:, :, _SLICES["zeta"]] = -model[:, :, None]
        J[:, :3, _SLICES["mass"]] = -weight[:, :, None]
        J[:, 3:, _SLICES["mass"]] = -crossed(lever, weight)[:, :, None]
        J[:, 3:, _SLICES["moment"]] = -cross_matrices(weight)
        J[:, :3, _SLICES["force_bias"]] = -np.eye(3)
        J[:, 3:, _SLICES["force_bias"]] = cross_matrices(
            np.tile(lever, (1, 1))
        )  # -(lever x b) = b x lever
        J[:, 3:, _SLICES["torque_bias"]] = -np.eye(3)
        turn_slope = cross_matrices(force)
        J[:, :3, _SLICES["turn"]] = turn_slope
        lever_matrix = -cross_matrices(lever[None])[0]  # lever x
        J[:, 3:, _SLICES["turn"]] = cross_matrices(torque) + lever_matrix @ turn_slope
        J[:, 3:, _SLICES["lever"]] = cross_matrices(grains)
        J[:, :, _SLICES["power"]] = -(zeta * deep[:, None] * g)[:, :, None]
        J[:, :, _SLICES["kinds"]] = -zeta * g[:, :, None] * kinds[:, None, :]
        if zero_columns is not None:
            J[:, FORCE, _SLICES["zero_change"]] = -zero_columns[:, FORCE]
            J[:, TORQUE, _SLICES["zero_change"]] = (
                -zero_columns[:, TORQUE] - lever_matrix @ zero_columns[:, FORCE]
            )
        slopes = self._slopes_at(surface, length)
        J[:, :, _SLICES["surface"]] = -(factor[:, None] * slopes.surface_slope)[:, :, None]
        J[:, :, _SLICES["length"]] = -(factor[:, None] * slopes.length_slope)[:, :, None]
        modelled = np.hstack([force, torque + crossed(lever, force)]) - e
        J[:, :, _SLICES["delay"]] = self._change_in_time(modelled)[:, :, None]
        J[unknown_rows] = 0.0
        return e, model, J

    def unknown_rows(self, surface: float) -> slice:
        """The first moments of a trial that begins in the grains: their force depends on what was before."""
        if self.model.low[0] >= surface:
            return slice(0)
        return slice(int(np.searchsorted(self.model.path, START_M)))

    def _change_in_time(self, modelled: Array) -> Array:
        """How fast a modelled reading changes with time, in tool axes, shape [n, 6].

        The load cell's own axes count as fixed. The changes of the measured reading are those of its noise, too.
        """
        axes = self.setup.cell_axes(self.trial)
        parts = modelled.reshape(-1, 2, 3)
        in_cell = np.einsum("nji,nkj->nki", axes, parts)
        # a stamp may repeat
        time = np.cumsum(np.maximum(np.diff(self.time, prepend=self.time[0]), 1e-4))
        change = np.gradient(in_cell, time, axis=0)
        return np.asarray(np.einsum("nij,nkj->nki", axes, change).reshape(-1, 6))

    def _slopes_at(self, surface: float, length: float) -> "_Slopes":
        """The derivatives of the model's wrench, as they were computed last if that was near."""
        last = self._slopes
        if last is None or not last.is_near(surface, length):
            g = self.basis(surface, length).wrench
            higher = self.basis(surface + STEP_M, length).wrench
            longer = self.basis(surface, length * LENGTH_STEP_FACTOR).wrench
            last = _Slopes(
                surface,
                length,
                (higher - g) / STEP_M,
                (longer - g) / np.log(LENGTH_STEP_FACTOR),
            )
            self._slopes = last
        return last

    def basis(self, surface: float, length: float) -> Basis:
        """The model's wrench as the load cell's driver would give it: behind its filter."""
        basis_by_values = self.model.at(surface, length)
        if self.setup.lag > 0.0:
            return Basis(
                filtered(self.trial.time, basis_by_values.wrench, self.setup.lag),
                basis_by_values.depth,
            )
        return basis_by_values

    def misfit(self, e: Array) -> tuple[float, Array]:
        """The robust sum of squares over the independent stretches, and the weight of each moment and part."""
        square = (
            np.column_stack(
                [
                    ((e * self.sigma)[:, :3] ** 2).sum(axis=1),
                    ((e * self.sigma)[:, 3:] ** 2).sum(axis=1),
                ]
            )
            / 3.0
        )
        root = np.sqrt(1.0 + square / ROBUST_FACTOR**2)
        cost = 2.0 * ROBUST_FACTOR**2 * (root - 1.0) * self.count_of[:, None]
        weight = self.count_of[:, None] / root / 3.0
        return float(cost.sum()), np.repeat(weight, 3, axis=1)


def filtered(time: Array, values: Array, lag: float) -> Array:
    """Values behind a filter of first order with this time constant [s], exact for values linear between the times."""
    out = values.copy()
    for k in range(1, len(time)):
        span = max(time[k] - time[k - 1], 1e-6)
        fade = np.exp(-span / lag)
        slope = (values[k] - values[k - 1]) / span
        out[k] = values[k] - slope * lag + (out[k - 1] - values[k - 1] + slope * lag) * fade
    return out


def _normal_equations(rows: Array, values: Array) -> tuple[Array, Array]:
    """The normal matrix and the right sides, by blocks so small that no library starts threads for them."""
    normal = np.zeros((rows.shape[1], rows.shape[1]))
    right_sides = np.zeros((rows.shape[1], values.shape[1]))
    for k in range(0, len(rows), BLOCK_COUNT):
        part = rows[k : k + BLOCK_COUNT]
        normal += part.T @ part
        right_sides += part.T @ values[k : k + BLOCK_COUNT]
    return normal, right_sides


def _inverse(normal: Array) -> Array:
    """The inverse of a normal matrix whose numbers differ by up to 20 digits: each one counts by its own size."""
    size = np.sqrt(np.abs(np.diag(normal)))
    scale = np.outer(size, size)
    return np.asarray(np.linalg.inv(normal / scale + MIN_EIGENVALUE * np.eye(len(size))) / scale)


def fit(
    problem: Problem,
    free: Collection[str] = (),
    *,
    start: Mapping[str, Any] | None = None,
    steps: int = 12,
) -> Fit:
    """Fit all numbers; those in `free` hardly with a prior.

    `start`: first values of some numbers.
    """
    given_values = problem.given()
    x = given_values.copy()
    for name, value in (start or {}).items():
        x[_SLICES[name]] = value
    prior = 1.0 / problem.scale**2
    for name in sorted({*free}):
        prior[_SLICES[name]] /= TIED_FREEDOM_FACTORS.get(name, FREEDOM_FACTOR) ** 2
    low = np.log(MIN_LENGTH_M)
    high = np.log(MAX_LENGTH_M)

    def cost_at(values_tried: Array) -> float:
        cost, _ = problem.misfit(problem.residual(values_tried)[0])
        return cost + float(prior @ (values_tried - given_values) ** 2)

    total = cost_at(x)
    lever = _SLICES["lever"]
    lever_size = TOLERANCES["lever"].size
    covariance = np.zeros(NUMBERS)
    # the errors of freed numbers are those as if what is given were right
    told_rows = np.array(
        [
            row
            for name in sorted({"zeta", *NUISANCES, *free})
            for row in range(NUMBERS)[_SLICES[name]]
        ]
    )
    for _ in range(steps):
        e, _, J = problem.residual(x, jacobian=True)
        assert J is not None
        _, weight = problem.misfit(e)
        root = np.sqrt(weight) * problem.sigma
        lever_columns = J[:, :, lever].copy()
        # a shorter lever makes the noise of the force smaller in the torque: what the noise of other moments does not
        # show, too, is no evidence for it (instrumental variables)
        J[:, :, lever] = _beside(lever_columns)
        normal, right_sides = _normal_equations(
            (root[:, :, None] * J).reshape(-1, NUMBERS),
            (root[:, :, None] * np.dstack([e, lever_columns])).reshape(-1, 1 + lever_size),
        )
        gradient = right_sides[:, 0] + prior * (x - given_values)
        slopes = normal.copy()
        slopes[:, lever] = right_sides[:, 1:]
        move = -_inverse(slopes + np.diag(prior)) @ gradient
        normal += np.diag(prior)
        inverse = _inverse(normal)
        covariance = np.diag(inverse).copy()
        covariance[told_rows] = np.diag(_inverse(normal[np.ix_(told_rows, told_rows)]))
        # bounded steps of what is not linear
        limit = np.full(NUMBERS, np.inf)
        limit[_SLICES["surface"]] = 0.01
        limit[_SLICES["delay"]] = 0.05
        limit[_SLICES["length"]] = 0.7
        limit[_SLICES["turn"]] = 0.3
        limit[_SLICES["zeta"]] = 1.0
        share = float(min(1.0, (limit / np.maximum(np.abs(move), 1e-12)).min()))
        has_gain = False
        for _ in range(5):
            new = x + share * move
            new[_SLICES["length"]] = np.clip(new[_SLICES["length"]], low, high)
            trial_cost = cost_at(new)
            if trial_cost < total:
                has_gain = True
                break
            share *= 0.4
        if not has_gain:
            break
        gain = total - trial_cost
        x = new
        total = trial_cost
        if gain < 1e-3 * total + 1e-3:
            break
    e, model, _ = problem.residual(x)
    data, _ = problem.misfit(e)
    spread = max(data / (2.0 * problem.count), 1.0)
    errors = np.sqrt(covariance * spread)
    return Fit(
        values={name: x[rows].copy() for name, rows in _SLICES.items()},
        errors={name: errors[rows].copy() for name, rows in _SLICES.items()},
        misfit=total,
        count=problem.count,
        residuals=e,
        model=model,
    )

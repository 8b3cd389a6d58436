"""What a cell is judged on: one frozen value, from a recording or from messages collected live."""

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.diagnosis.air import MASS, SPREAD, columns_in_air, fit_in_air, spread
from rft_ros.diagnosis.cell_along import CellAlong
from rft_ros.estimator import Estimator
from rft_ros.parameters import LoadCell, Settings
from rft_ros.rft import FORCE, POSE, STATE, TORQUE, VELOCITY, Law, rotate_vectors
from rft_ros.rft.frames import Placement
from rft_ros.tool import Tool

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
"""Indices of moments, shape [n]."""

ENOUGH = 20
"""Fewest moments on which something is judged."""

LEAST_FORCE = 0.2
"""Smaller forces [N] are not judged."""

_SAME = 0.95  # correlation beyond which a tiny reading is that of the grains in another unit, such as kN
_CLEAR = 0.001  # m above the surface, where the tool is in the air despite noise of the poses
_MOST = 600  # moments in the air that are fitted


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """A cell's parameters, and n estimates that have a reading of the load cell, in the order of time.

    `time` [s] since the first, shape [n]; `state` [n, 13], columns `STATE`; `depth` of the lowest point [m], negative
    in the air; `speed` of the fastest plate [m/s]; `predicted` and `measured` (compensated) wrenches [n, 6], [N, N m],
    in the axes of the load cell about its origin. `pose_time` [s], shape [m], and `poses` [m, 7]: every pose, also
    those without an estimate. `place_on_tf`: of the sensor in the tool, by fixed transforms; `links`: their names.
    `has_torque`: whether the load cell gives torques; without it they are 0. `named`: the parameters that the user has
    set. `tare`: the length of a replay's tare [s]. `complete`: no message is
    missing. `above`: how far above the surface the measured force begins [m], within the errors of the surface.
    """

    settings: Settings
    load_cell: LoadCell
    tool: Tool
    law: Law
    time: Array
    state: Array
    depth: Array
    speed: Array
    predicted: Array
    measured: Array
    pose_time: Array
    poses: Array
    place_on_tf: Placement | None = None
    links: str = ""
    has_torque: bool = True
    named: Collection[str] = field(default=("surface_height",))
    tare: float | None = None
    complete: bool = True
    above: float = 0.0

    @cached_property
    def cell_along(self) -> CellAlong:
        """The load cell at the moments."""
        return CellAlong(self.load_cell, self.state)

    @property
    def down(self) -> Array:
        """The direction of gravity in the axes of the load cell, shape [n, 3]."""
        return self.cell_along.down

    @cached_property
    def with_weight(self) -> Array:
        """The measured wrench before the tool's weight was subtracted, shape [n, 6]."""
        return self.measured + self.cell_along.weight

    @property
    def raw(self) -> Array:
        """The wrench that the driver gave, with the sign of one on the tool, shape [n, 6]."""
        return self.with_weight + self.load_cell.sign * np.array(self.load_cell.bias)

    @property
    def force(self) -> Array:
        """The measured force, less the bias and the weight of the parameters [N], shape [n, 3]."""
        return self.measured[:, FORCE]

    @property
    def model(self) -> Array:
        """The predicted force [N], shape [n, 3]."""
        return self.predicted[:, FORCE]

    @property
    def velocity(self) -> Array:
        """Of the tool frame's origin [m/s], shape [n, 3]."""
        return self.state[:, VELOCITY]

    @property
    def is_enough(self) -> bool:
        """Whether the moments suffice to judge something on them."""
        return len(self.time) >= ENOUGH

    def at(self, rows: NDArray[Any]) -> "Evidence":
        """The same at some of the moments: their rows, or of each whether it is one."""
        arrays = ("time", "state", "depth", "speed", "predicted", "measured")
        return replace(self, **{name: getattr(self, name)[rows] for name in arrays})

    def thinned(self, count: int) -> "Evidence":
        """At most `count` of the moments, evenly."""
        return self.at(np.arange(0, len(self.time), max(1, -(-len(self.time) // count))))

    @cached_property
    def in_air(self) -> NDArray[np.bool_]:
        """Whether the tool is above the surface, the given one and that of the measured contact; shape [n]."""
        return np.asarray(self.depth <= -(self.above + _CLEAR))

    @cached_property
    def air(self) -> "Evidence":
        """The moments in the air."""
        return self.at(self.in_air)

    @property
    def in_grains(self) -> NDArray[np.bool_]:
        """Whether the tool's lowest point is below the surface, shape [n]."""
        return np.asarray(self.depth > 0.0)

    @cached_property
    def columns_in_air(self) -> Array:
        """Columns of the ten numbers of `rft_ros.diagnosis.air`, shape [n, 6, 10]."""
        return columns_in_air(self.cell_along.gravity)

    @cached_property
    def zero(self) -> Array:
        """The ten numbers of what the load cell reads in the air beyond the parameters, 0 if the air was not seen.

        Unless the attitudes there separate bias and weight, all is bias.
        """
        free = np.ones(10, dtype=np.bool_)
        free[MASS:] = self.air.is_enough and spread(self.air.down) >= SPREAD
        values = np.zeros(10)
        if self.air.is_enough:
            air = self.air.thinned(_MOST)
            values[free] = fit_in_air(air.columns_in_air[:, :, free], air.measured).values
        return values

    @cached_property
    def push(self) -> "Evidence":
        """The moments in the grains but for the way out, where their force is best known.

        The measured wrench is there without what the load cell reads in the air.
        """
        rising = self.state[:, STATE.index("vz")]
        known = (self.speed > self.settings.rest_speed) | (self.law.mobilization_length > 0.0)
        pushed = self.at(self.in_grains & (rising <= 0.5 * self.speed) & known)
        return replace(pushed, measured=pushed.measured - pushed.columns_in_air @ self.zero)

    @cached_property
    def push_is_seen(self) -> bool:
        """Whether grains push the tool in the model and in the load cell."""
        model = self.push.model
        force = self.push.force
        if not self.push.is_enough or np.abs(model).max() < LEAST_FORCE:
            return False
        alike = (model * force).sum() > _SAME * np.sqrt((model**2).sum() * (force**2).sum())
        return bool(alike or np.abs(force).max() >= 0.1 * LEAST_FORCE)

    @property
    def place_parameter(self) -> str:
        """What places the load cell in the tool, other than a parameter: the transforms; "" if parameters do."""
        s = self.settings
        if s.sensor_source != "tf":
            return ""
        ends = f"from tool_frame {s.tool_frame!r} to sensor_frame {s.sensor_frame!r}"
        return f"the transform {ends} on /tf_static ({self.links})"

    def with_cell(self, cell: LoadCell) -> "Evidence":
        """As if the load cell had this sign and quaternion."""
        other = replace(self, load_cell=cell)
        turn = other.cell_along.from_world_axes @ self.cell_along.to_world
        model = np.hstack(
            [rotate_vectors(turn, self.predicted[:, part]) for part in (FORCE, TORQUE)]
        )
        reading = self.with_weight * cell.sign / self.load_cell.sign
        return replace(other, predicted=model, measured=reading - other.cell_along.weight)

    def read_in(self, axes: Array) -> "Evidence":
        """As if the reading were in other axes, which these matrices turn into those of the load cell.

        `axes`: one of shape [3, 3], or one a moment, [n, 3, 3]. The tool's weight is subtracted afterwards.
        """
        parts = self.with_weight.reshape(-1, 2, 3) @ np.swapaxes(axes, -1, -2)
        return replace(self, measured=parts.reshape(-1, 6) - self.cell_along.weight)


def evidence_of(
    rows: NDArray[np.void], estimator: Estimator, *, poses: Array | None = None
) -> Evidence:
    """The evidence of a run: `rows` of its estimates, `rft_ros.bags.estimates.ROW`, and its estimator.

    `poses`: stamp [ns], position and quaternion of every pose, shape [m, 8]; without them, those of the rows. Where
    stamps go back, the longest part is taken.
    """
    s = estimator.settings
    transforms = estimator.transforms
    rows = rows[~np.isnan(rows["compensated"][:, 0])]
    rows = _longest(rows, rows["stamp"])
    if poses is None:
        poses = np.column_stack([rows["stamp"], rows["state"][:, POSE]])
    poses = _longest(poses, poses[:, 0])
    links = transforms.links(s.tool_frame, s.sensor_frame) if s.sensor_source == "tf" else ()
    # a torque that the load cell does not give agrees with any model
    is_unknown = np.isnan(rows["compensated"])
    return Evidence(
        settings=s,
        load_cell=estimator.load_cell,
        tool=estimator.model.tool,
        law=estimator.model.law,
        time=_seconds(rows["stamp"]),
        pose_time=_seconds(poses[:, 0]),
        poses=poses[:, 1:],
        state=np.array(rows["state"]),
        depth=np.array(rows["depth"]),
        speed=np.array(rows["speed"]),
        predicted=np.where(is_unknown, 0.0, rows["predicted"]),
        measured=np.where(is_unknown, 0.0, rows["compensated"]),
        place_on_tf=transforms.fixed(s.tool_frame, s.sensor_frame),
        links=", ".join(links),
        has_torque=not is_unknown[:, TORQUE].any(),
    )


def _longest(rows: NDArray[Any], stamps: NDArray[Any]) -> NDArray[Any]:
    """The longest part of the rows in which no stamp goes back."""
    if not len(rows):
        return rows
    return max(np.split(rows, np.flatnonzero(np.diff(stamps) < 0) + 1), key=len)


def _seconds(stamps: NDArray[Any]) -> Array:
    """Since the first [s]."""
    return np.asarray(1e-9 * (stamps - stamps[:1]))

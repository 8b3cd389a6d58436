"""What the hypotheses are judged on: one frozen value, from a recording or from messages collected live."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rft_ros.estimator import Estimator
from rft_ros.estimator.load_cell import GRAVITY
from rft_ros.parameters import LoadCell, Settings
from rft_ros.rft import FORCE, POSE, QUATERNION, STATE, VELOCITY
from rft_ros.rft.frames import Placement
from rft_ros.tool import Tool

__all__ = ["ENOUGH", "LEAST_FORCE", "Array", "Evidence", "Finding", "evidence_of", "listed"]


class Finding(NamedTuple):
    """Whether the set-up is right in one point, and a sentence on it, which says what to do if it is not."""

    ok: bool
    text: str


def listed(numbers: Iterable[float]) -> str:
    """Numbers as a parameter file takes them."""
    return "[" + ", ".join(f"{round(n, 4) + 0.0:g}" for n in numbers) + "]"


Array = NDArray[np.float64]

ENOUGH = 20
"""Fewest moments on which a hypothesis is judged."""

LEAST_FORCE = 0.2
"""Smaller forces [N] are not judged."""

_SAME = 0.95  # correlation beyond which a tiny reading is that of the grains in another unit, such as kN


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """A cell's parameters, and n estimates that have a reading of the load cell, in the order of time.

    `time` [s] since the first, shape [n]; `state` [n, 13], columns `STATE`; `depth` of the lowest point [m], negative
    in the air; `speed` of the fastest plate [m/s]; `predicted` and `measured` (compensated) wrenches [n, 6], [N, N m],
    in the axes of the load cell about its origin. `pose_time` [s], shape [m], and `poses` [m, 7]: every pose, also
    those without an estimate. `place_on_tf`: of the sensor in the tool, by fixed transforms; `links`: their names.
    `named`: the parameters that the user has set. `tare`: the length of a replay's tare [s]. `complete`: no message is
    missing.
    """

    settings: Settings
    load_cell: LoadCell
    tool: Tool
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
    named: Collection[str] = field(default=("surface_height",))
    tare: float | None = None
    complete: bool = True

    @cached_property
    def to_cell(self) -> Rotation:
        """The n turns from world axes to the axes of the load cell."""
        return (Rotation.from_quat(self.state[:, QUATERNION]) * Rotation.from_quat(self.load_cell.quaternion)).inv()

    @cached_property
    def weight(self) -> Array:
        """The tool's weight in the axes of the load cell [N], shape [n, 3]."""
        return _array(self.to_cell.apply((0.0, 0.0, -GRAVITY * self.load_cell.mass)))

    @cached_property
    def raw(self) -> Array:
        """Force that the driver gave, with the sign of a force on the tool [N], shape [n, 3]."""
        return _array(self.force + self.weight + self.load_cell.sign * np.array(self.load_cell.bias[:3]))

    @property
    def force(self) -> Array:
        """The measured force [N], shape [n, 3]."""
        return _array(self.measured[:, FORCE])

    @property
    def in_grains(self) -> NDArray[np.bool_]:
        """Whether the tool's lowest point is below the surface, shape [n]."""
        return self.depth > 0.0

    @cached_property
    def pushed(self) -> NDArray[np.bool_]:
        """Whether the tool is in the grains and not pulled out, where the force of grains is best known; shape [n]."""
        rising: Array = self.state[:, STATE.index("vz")]
        return np.asarray(self.in_grains & (rising <= 0.5 * self.speed))

    @cached_property
    def push(self) -> tuple[Array, Array]:
        """Predicted force and measured one less that in the air, while the tool is pushed [N], shape [m, 3]."""
        return self.predicted[self.pushed, FORCE], self.without_air(self.force)[self.pushed]

    @cached_property
    def push_is_seen(self) -> bool:
        """Whether grains push the tool in the model and in the load cell."""
        predicted, measured = self.push
        if len(predicted) < ENOUGH or np.abs(predicted).max() < LEAST_FORCE:
            return False
        alike = (predicted * measured).sum() > _SAME * np.sqrt((predicted**2).sum() * (measured**2).sum())
        return bool(alike or np.abs(measured).max() >= 0.1 * LEAST_FORCE)

    def without_air(self, readings: Array) -> Array:
        """Readings, shape [n, k], less their mean in the air, if the air was seen."""
        air = ~self.in_grains
        return _array(readings - readings[air].mean(axis=0)) if air.sum() >= ENOUGH else readings

    @cached_property
    def velocity(self) -> Array:
        """Of the tool frame's origin [m/s], shape [n, 3]."""
        return _array(self.state[:, VELOCITY])

    @property
    def place_parameter(self) -> str:
        """What places the load cell in the tool, other than a parameter: the transforms; "" if parameters do."""
        s = self.settings
        if s.sensor_source != "tf":
            return ""
        return (
            f"the transform from tool_frame {s.tool_frame!r} to sensor_frame {s.sensor_frame!r} on /tf_static"
            f" ({self.links})"
        )


def evidence_of(rows: NDArray[np.void], estimator: Estimator, *, poses: Array | None = None) -> Evidence:
    """The evidence of a run: `rows` of its estimates, `rft_ros.bags.estimates.ROW`, and its estimator.

    `poses`: stamp [ns], position and quaternion of every pose, shape [m, 8]; without them, those of the rows. Where
    stamps go back, the longest part is taken.
    """
    s, transforms = estimator.settings, estimator.transforms
    rows = rows[~np.isnan(rows["compensated"][:, 0])]
    rows = _longest(rows, rows["stamp"])
    if poses is None:
        poses = np.column_stack([rows["stamp"], rows["state"][:, POSE]])
    poses = _longest(poses, poses[:, 0])
    return Evidence(
        settings=s,
        load_cell=estimator.load_cell,
        tool=estimator.model.tool,
        time=_seconds(rows["stamp"]),
        pose_time=_seconds(poses[:, 0]),
        poses=poses[:, 1:],
        state=np.array(rows["state"]),
        depth=np.array(rows["depth"]),
        speed=np.array(rows["speed"]),
        predicted=np.array(rows["predicted"]),
        measured=np.array(rows["compensated"]),
        place_on_tf=transforms.fixed(s.tool_frame, s.sensor_frame),
        links=", ".join(transforms.links(s.tool_frame, s.sensor_frame)) if s.sensor_source == "tf" else "",
    )


def _longest(rows: NDArray[Any], stamps: NDArray[Any]) -> NDArray[Any]:
    """The longest part of the rows in which no stamp goes back."""
    if not len(rows):
        return rows
    return max(np.split(rows, np.flatnonzero(np.diff(stamps) < 0) + 1), key=len)


def _seconds(stamps: NDArray[Any]) -> Array:
    """Since the first [s]."""
    return _array(1e-9 * (stamps - stamps[:1]))


def _array(values: object) -> Array:
    return np.asarray(values, dtype=np.float64)

"""What a cell is judged on: one frozen value, from a recording or from messages collected live."""

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rft_ros.diagnosis.trial import Array, Readings, Trial
from rft_ros.estimator import GRAVITY, Estimator
from rft_ros.parameters import Config, LoadCell
from rft_ros.rft import FORCE, POSE, QUATERNION, TORQUE, VELOCITY, Law
from rft_ros.rft.frames import ANGULAR_VELOCITY, Placement
from rft_ros.tool import Tool

ENOUGH = 20
"""Fewest moments on which something is judged."""


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """A cell's parameters, and n poses that have a reading of the load cell, in the order of time.

    `time` [s] since the first, shape [n]; `state` [n, 13], columns `STATE`; `readings` of the load cell as its driver
    gave them, in its sign and its axes or those of the world [N], [N m], shape [n, 6], the given delay removed.
    `pose_time` [s], shape [m], and `poses` [m, 7]: every pose, also those without an estimate. `place_on_tf`: of the
    sensor in the tool, by fixed transforms; `links`: their names. `has_torque`: whether the load cell gives torques;
    without it they are 0. `named`: the parameters that the user has set. `tare`: the length of a replay's tare [s].
    `complete`: no message is missing.
    """

    config: Config
    load_cell: LoadCell
    tool: Tool
    law: Law
    time: Array
    state: Array
    readings: Array
    pose_time: Array
    poses: Array
    place_on_tf: Placement | None = None
    links: str = ""
    has_torque: bool = True
    named: Collection[str] = field(default=("surface_height",))
    tare: float | None = None
    complete: bool = True

    @cached_property
    def height(self) -> Array:
        """World z of the tool's lowest point [m], shape [n]."""
        return self.tool.lowest_points(self.state)[0]

    @property
    def depth(self) -> Array:
        """Of the lowest point below the surface [m], negative in the air, shape [n]."""
        return self.config.surface_height - self.height

    @property
    def speed(self) -> Array:
        """Upper bound of the speed of the tool's plates [m/s], shape [n]."""
        linear = np.linalg.norm(self.state[:, VELOCITY], axis=1)
        angular = np.linalg.norm(self.state[:, ANGULAR_VELOCITY], axis=1)
        return np.asarray(linear + self.tool.plates.reach * angular)

    @property
    def trial(self) -> Trial:
        """The moments and the readings alone."""
        return Trial(
            time=self.time,
            poses=self.state[:, POSE],
            readings=Readings(time=self.time, wrenches=self.readings),
        )

    @property
    def place_parameter(self) -> str:
        """What places the load cell in the tool, other than a parameter: the transforms; "" if parameters do."""
        frames = self.config.frames
        if frames.sensor_source != "tf":
            return ""
        ends = f"from tool_frame {frames.tool!r} to sensor_frame {frames.sensor!r}"
        links = f" ({self.links})" if self.links else ""
        return f"the transform {ends} on /tf_static{links}"


def evidence_of(
    rows: NDArray[np.void],
    estimator: Estimator,
    *,
    poses: Array | None = None,
    tare: float | None = None,
) -> Evidence:
    """The evidence of a run: `rows` of its estimates, `rft_ros.bags.estimates.ROW`, and its estimator.

    `poses`: stamp [ns], position and quaternion of every pose, shape [m, 8]; without them, those of the rows. Where
    stamps go back, the longest part is taken. `tare`: the first seconds, which give the bias.
    """
    frames = estimator.config.frames
    transforms = estimator.transforms
    rows = rows[~np.isnan(rows["compensated"][:, 0])]
    rows = _longest(rows, rows["stamp"])
    if poses is None:
        poses = np.column_stack([rows["stamp"], rows["state"][:, POSE]])
    poses = _longest(poses, poses[:, 0])
    links = transforms.links(frames.tool, frames.sensor) if frames.sensor_source == "tf" else ()
    # a torque that the load cell does not give counts as none
    is_unknown = np.isnan(rows["compensated"])
    state = np.array(rows["state"])
    compensated = np.where(is_unknown, 0.0, rows["compensated"])
    time = _seconds(rows["stamp"])
    cell = estimator.load_cell
    readings = readings_of(compensated, cell, state, in_world=frames.sensor_source == "world")
    if tare and len(time):
        offset = cell.sign * compensated[time <= tare].mean(axis=0)
        fx, fy, fz, tx, ty, tz = (np.array(cell.bias) + offset).tolist()
        cell = replace(cell, bias=(fx, fy, fz, tx, ty, tz))
    return Evidence(
        config=estimator.config,
        load_cell=cell,
        tool=estimator.model.tool,
        law=estimator.model.law,
        time=time,
        pose_time=_seconds(poses[:, 0]),
        poses=poses[:, 1:],
        state=state,
        readings=readings,
        place_on_tf=transforms.fixed(frames.tool, frames.sensor),
        links=", ".join(links),
        has_torque=not is_unknown[:, TORQUE].any(),
        tare=tare,
    )


def readings_of(compensated: Array, cell: LoadCell, states: Array, *, in_world: bool) -> Array:
    """The readings of which these wrenches were compensated, as the driver gave them, shape [n, 6].

    `compensated`: less bias and weight, in the axes of the load cell and with the sign of a wrench on the tool.
    """
    if not len(states):
        return np.zeros((0, 6))
    to_world = Rotation.from_quat(states[:, QUATERNION]) * Rotation.from_quat(cell.quaternion)
    weight = cell.mass * to_world.inv().apply((0.0, 0.0, -GRAVITY))
    with_weight = compensated + np.hstack([weight, np.cross(cell.center_of_mass, weight)])
    readings = cell.sign * with_weight + np.array(cell.bias)
    if not in_world:
        return np.asarray(readings)
    return np.hstack([to_world.apply(readings[:, part]) for part in (FORCE, TORQUE)])


def _longest(rows: NDArray[Any], stamps: NDArray[Any]) -> NDArray[Any]:
    """The longest part of the rows in which no stamp goes back."""
    if not len(rows):
        return rows
    return max(np.split(rows, np.flatnonzero(np.diff(stamps) < 0) + 1), key=len)


def _seconds(stamps: NDArray[Any]) -> Array:
    """Since the first [s]."""
    return np.asarray(1e-9 * (stamps - stamps[:1]))

"""A recording as arrays: the tool's states, and the load cell's raw reading at each."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d
from scipy.spatial.transform import Rotation

from rft_ros.bags.playback import ReplayOptions, play, topics_of
from rft_ros.bags.reading import Recording, bag_name
from rft_ros.errors import InputError
from rft_ros.estimator import Estimate, Estimator, LoadCell
from rft_ros.estimator.load_cell import GRAVITY
from rft_ros.parameters import Values, model_of, settings_of
from rft_ros.tool import Tool

__all__ = ["Track", "read_track"]

_BOTTOMLESS = -1e9
"""A surface height [m] that no tool reaches, so that the estimator also answers poses at rest in the grains."""

_SMOOTHING = 0.1  # time over which velocities are averaged before they classify the motion [s]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Track:
    """One recording: n moments in time order.

    `name` of the bag. `begin`: header stamp of the first moment [ns]. `time`: since then [s], shape [n]. `states`:
    shape [n, 13], columns `rft_ros.rft.STATE`. `readings`: of the load cell, raw sign, sensor axes [N], [N m], shape
    [n, 6]. `rest_speed` [m/s]: below it the tool is at rest.
    """

    name: str
    begin: int
    time: NDArray[np.float64]
    states: NDArray[np.float64]
    readings: NDArray[np.float64]
    tool: Tool
    rest_speed: float

    def rotations(self) -> NDArray[np.float64]:
        """Rotation of the tool frame into the world at each moment, shape [n, 3, 3], no unit."""
        return np.asarray(Rotation.from_quat(self.states[:, 3:7]).as_matrix())

    def heights(self) -> NDArray[np.float64]:
        """World z of the tool's lowest point [m], shape [n]."""
        return np.asarray(self.states[:, 2] + (self.rotations()[:, 2] @ self.tool.corners.T).min(axis=1))

    def smooth_twists(self) -> NDArray[np.float64]:
        """Velocity of the tool frame's origin [m/s], angular velocity [rad/s], world axes, over 0.1 s, shape [n, 6]."""
        step = float(np.median(np.diff(self.time))) if len(self.time) > 1 else _SMOOTHING
        count = max(1, round(_SMOOTHING / step))
        # uniform_filter1d would leave 1e-18 in place of 0, and walls along the motion would count as leading
        return np.asarray(correlate1d(self.states[:, 7:13], np.full(count, 1.0 / count), axis=0, mode="nearest"))

    def smooth_states(self) -> NDArray[np.float64]:
        """The states with averaged velocities, shape [n, 13], units of `STATE`: noise must not look like rest."""
        return np.hstack([self.states[:, :7], self.smooth_twists()])

    def speeds(self) -> NDArray[np.float64]:
        """An upper bound on the speed of the tool's plates [m/s], shape [n]."""
        twists = self.smooth_twists()
        turning = np.linalg.norm(twists[:, 3:], axis=1) * self.tool.plates.reach
        return np.asarray(np.linalg.norm(twists[:, :3], axis=1) + turning)

    def sensor_rotations(self, cell: LoadCell) -> NDArray[np.float64]:
        """Rotation of the sensor frame into the world at each moment, shape [n, 3, 3], no unit."""
        return np.asarray(self.rotations() @ Rotation.from_quat(cell.quaternion).as_matrix())

    def gravity_in_sensor(self, cell: LoadCell) -> NDArray[np.float64]:
        """Acceleration of gravity in sensor axes [m/s²], shape [n, 3]."""
        return -GRAVITY * self.sensor_rotations(cell)[:, 2, :]

    def grain_forces(self, cell: LoadCell) -> NDArray[np.float64]:
        """Measured force of the grains on the tool, minus bias and weight, world axes [N], shape [n, 3]."""
        measured = cell.sign * (self.readings[:, :3] - np.array(cell.bias[:3]))
        in_sensor = measured - cell.mass * self.gravity_in_sensor(cell)
        return np.asarray(np.einsum("nij,nj->ni", self.sensor_rotations(cell), in_sensor))


def read_track(bag: Path, values: Values, options: ReplayOptions | None = None) -> Track:
    """Read a bag's poses, each with the twist and load-cell reading that the estimator uses for it.

    `values`: the node's parameters. `options`: None for the whole bag; the tare is ignored. Raises InputError for a bag
    with fewer than two poses that have both.
    """
    options = options or ReplayOptions()
    # the error of a reduced tool would bias every fit; the fits know level ground only
    values = {**values, "tolerance": 0.0, "ground.cell": 0.0, "ground.file": ""}
    topics, model = topics_of(values, options.remap), model_of(values)
    # without bias and weight the estimator's compensated wrench is the raw reading
    settings = replace(
        settings_of(values),
        load_cell=LoadCell(),
        sensor_source="parameters",
        surface_height=_BOTTOMLESS,
        max_rate=0.0,
    )
    estimator = Estimator(settings, model)
    with Recording(bag, topics, start=options.start, end=options.end) as recording:
        answers = play(recording, estimator, bag.name)
        states = [estimator.state.copy() for _, answer in answers if isinstance(answer, Estimate)]
    rows = [
        (measurement.stamp, state, measurement.compensated)
        for state, measurement in zip(states, estimator.measurements(), strict=True)
        if measurement.compensated is not None
    ]
    # a bag recorded in a loop steps back in time and repeats stamps
    stamps, first = np.unique(np.array([stamp for stamp, _, _ in rows], dtype=np.int64), return_index=True)
    if len(stamps) < 2:
        reasons = "".join(f"; {counted}" for counted in estimator.counted())
        raise InputError(
            f"bag '{bag}' has {len(stamps)} poses with a velocity and a load-cell sample"
            f" (topics {', '.join(topics.values())}{reasons})"
        )
    return Track(
        name=bag_name(bag),
        begin=int(stamps[0]),
        time=(stamps - stamps[0]) * 1e-9,
        states=np.array([rows[k][1] for k in first]),
        readings=np.array([rows[k][2] for k in first]),
        tool=model.tool,
        rest_speed=settings.rest_speed,
    )

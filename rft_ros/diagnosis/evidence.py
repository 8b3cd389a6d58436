"""What a cell is judged on: one frozen value, from a recording or from messages collected live."""

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rft_ros.estimator import GRAVITY, Estimator
from rft_ros.parameters import LoadCell, Settings
from rft_ros.rft import (
    FORCE,
    POSE,
    QUATERNION,
    SLACK,
    STATE,
    TORQUE,
    VELOCITY,
    Law,
    Memory,
    displacements_followed,
    wrenches,
    wrenches_in_time,
)
from rft_ros.rft.frames import Placement
from rft_ros.tool import Tool

Array = NDArray[np.float64]
Rows = NDArray[np.bool_]

ENOUGH = 20
"""Fewest moments on which something is judged."""

LEAST_FORCE = 0.2
"""Smaller forces [N] are not judged."""

_SAME = 0.95  # correlation beyond which a tiny reading is that of the grains in another unit, such as kN
_BEGUN = 0.05  # of the greatest force of a descent: a larger one shows that the tool has touched the grains
# m, and this share of the depth: together the greatest error of surface_height
_CONTACT_ERROR = 0.005
_CONTACT_SHARE = 0.1
_DEPTHS = 50  # depths at which the force of a contact is computed
_ALIKE = 0.94  # cosine of the angle by which the tool may turn on its way down
_CLEAR = 0.001  # m above the surface, where the tool is in the air despite noise of the poses
_SEPARATE = 0.02  # least singular value, of the greatest, at which the attitudes in the air separate weight and bias
_LIGHT = 0.1  # scale of the weight in that fit: what the attitudes do not separate counts as bias


class Contact(NamedTuple):
    """Where the measured force begins on the longest descent.

    `above`: how far above the expected surface, and `allowed`, the greatest error of that [m]. `row`: of the deepest
    moment; `rise`: from there to where the force exceeds its `share` of the greatest one [m].
    """

    above: float
    allowed: float
    row: int
    rise: float
    share: float


def predicted(tool: Tool, law: Law, cell: LoadCell, states: Array, surface: float) -> Array:
    """The model's wrench [N], [N m] in the axes of the load cell about its origin, shape [n, 6].

    `states`: shape [n, 13]. `surface` [m]: a height, the same everywhere.
    """
    plates = tool.plates
    if law.mobilization_length > 0.0:
        moved = displacements_followed(states, reach=plates.reach, dead_band=SLACK)
        found = wrenches_in_time(
            plates, law, states, Memory(plates), displacements=moved, surface_height=surface
        )
    else:
        found = wrenches(plates, law, states, surface_height=surface)
    rotation = Rotation.from_quat(states[:, QUATERNION])
    torque = found[:, TORQUE] - np.cross(rotation.apply(cell.position), found[:, FORCE])
    to_cell = (rotation * Rotation.from_quat(cell.quaternion)).inv()
    return np.hstack([to_cell.apply(found[:, FORCE]), to_cell.apply(torque)])


def solved(columns: Array, values: Array, *, least: float) -> Array:
    """Coefficients of columns, shape [n, k], by least squares, of singular values from `least` of the greatest on.

    By normal equations, which take a tenth of the time for thousands of moments.
    """
    inverse = np.linalg.pinv(columns.T @ columns, rcond=least**2, hermitian=True)
    return np.asarray(inverse @ (columns.T @ values))


def cross(vectors: Array) -> Array:
    """Matrices that give the cross products of n vectors with another one, shape [n, 3, 3]."""
    return np.swapaxes(np.cross(vectors[:, None, :], np.eye(3)), 1, 2)


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
    named: Collection[str] = field(default=("surface_height",))
    tare: float | None = None
    complete: bool = True

    @cached_property
    def to_cell(self) -> Rotation:
        """The n turns from world axes to the axes of the load cell."""
        return (
            Rotation.from_quat(self.state[:, QUATERNION])
            * Rotation.from_quat(self.load_cell.quaternion)
        ).inv()

    @cached_property
    def down(self) -> Array:
        """The direction of gravity in the axes of the load cell, shape [n, 3]."""
        return np.asarray(self.to_cell.apply((0.0, 0.0, -1.0)))

    @cached_property
    def with_weight(self) -> Array:
        """The measured wrench before the tool's weight was subtracted, shape [n, 6]."""
        weight = GRAVITY * self.load_cell.mass * self.down
        return self.measured + np.hstack([weight, np.cross(self.load_cell.center_of_mass, weight)])

    @cached_property
    def raw(self) -> Array:
        """Force that the driver gave, with the sign of a force on the tool [N], shape [n, 3]."""
        return self.with_weight[:, FORCE] + self.load_cell.sign * np.array(self.load_cell.bias[:3])

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

    @cached_property
    def contact(self) -> Contact | None:
        """Where the measured force begins on the longest descent; None if it does not begin.

        Only magnitudes of forces are compared, which a wrong sign or mounting does not change.
        """
        if not len(self.time):
            return None
        deepest_later = np.maximum.accumulate(self.depth[::-1])[::-1]
        way = np.arange(int((deepest_later - self.depth).argmax()), len(self.depth))
        way = way[np.diff(np.maximum.accumulate(self.depth[way]), prepend=-np.inf) > 0.0]
        way = way[self.down[way] @ self.down[way[-1]] > _ALIKE]
        depth = self.depth[way]
        measured = self.force[way]
        noise = float(np.linalg.norm(np.std(measured[:ENOUGH], axis=0)))
        force = np.linalg.norm(measured - np.median(measured[:ENOUGH], axis=0), axis=1)
        share = max(LEAST_FORCE, _BEGUN * force.max(), 5.0 * noise) / max(force.max(), 1e-9)
        begins = _onset(force, share)
        if begins is None:
            return None
        expected = _onset(np.linalg.norm(self.model[way], axis=1), share)
        at = 0.0 if expected is None else float(depth[expected])
        rise = float(depth[-1] - depth[begins])
        allowed = _CONTACT_ERROR + _CONTACT_SHARE * rise
        return Contact(at - float(depth[begins]), allowed, int(way[-1]), rise, share)

    @cached_property
    def in_air(self) -> Rows:
        """Whether the tool is above the surface, the given one and that of the measured contact; shape [n]."""
        above = max(self.contact.above, 0.0) + _CLEAR if self.contact else 0.0
        return np.asarray(self.depth <= -above)

    @property
    def in_grains(self) -> Rows:
        """Whether the tool's lowest point is below the surface, shape [n]."""
        return np.asarray(self.depth > 0.0)

    @cached_property
    def of_zero(self) -> Array:
        """Columns of what the load cell reads without grains: bias, and a weight in world axes; shape [n, 3, 6]."""
        weight = _LIGHT * self.to_cell.as_matrix()
        return np.concatenate([np.broadcast_to(np.eye(3), weight.shape), weight], axis=2)

    def zero_from(self, rows: Rows) -> Array:
        """Bias and weight in world axes [N], shape [6], beyond those of the parameters, at some rows."""
        return solved(self.of_zero[rows].reshape(-1, 6), self.force[rows].ravel(), least=_SEPARATE)

    @cached_property
    def clean(self) -> Array:
        """The measured wrench less what the load cell reads in the air, if the air was seen; shape [n, 6]."""
        if self.in_air.sum() < ENOUGH:
            return self.measured
        force = self.force - self.of_zero @ self.zero_from(self.in_air)
        return np.hstack(
            [force, self.measured[:, TORQUE] - self.measured[self.in_air, TORQUE].mean(axis=0)]
        )

    @cached_property
    def pushed(self) -> Rows:
        """Whether the tool is in the grains and not pulled out, where the force of grains is best known; shape [n]."""
        rising = self.state[:, STATE.index("vz")]
        known = (self.speed > self.settings.rest_speed) | (self.law.mobilization_length > 0.0)
        return np.asarray(self.in_grains & (rising <= 0.5 * self.speed) & known)

    @property
    def push(self) -> tuple[Array, Array]:
        """Predicted and measured force while the tool is pushed [N], shape [m, 3]."""
        return self.model[self.pushed], self.clean[self.pushed, FORCE]

    @cached_property
    def push_is_seen(self) -> bool:
        """Whether grains push the tool in the model and in the load cell."""
        model, force = self.push
        if len(model) < ENOUGH or np.abs(model).max() < LEAST_FORCE:
            return False
        alike = (model * force).sum() > _SAME * np.sqrt((model**2).sum() * (force**2).sum())
        return bool(alike or np.abs(force).max() >= 0.1 * LEAST_FORCE)

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

    def thinned(self, count: int) -> "Evidence":
        """At most `count` of the moments at which the tool moves or is in the air."""
        rows = np.flatnonzero(self.in_air | (self.speed > self.settings.rest_speed))
        rows = rows[:: max(1, -(-len(rows) // count))]
        arrays = ("time", "state", "depth", "speed", "predicted", "measured")
        return replace(self, **{name: getattr(self, name)[rows] for name in arrays})

    def with_cell(self, cell: LoadCell) -> "Evidence":
        """As if the load cell had this sign and quaternion."""
        other = replace(self, load_cell=cell)
        turn = other.to_cell * self.to_cell.inv()
        model = np.hstack([turn.apply(self.predicted[:, part]) for part in (FORCE, TORQUE)])
        reading = self.with_weight * cell.sign / self.load_cell.sign
        weight = other.with_weight - other.measured
        return replace(other, predicted=model, measured=reading - weight)

    def seen(self, state: Array, cell: LoadCell) -> "Evidence":
        """As if the states and the load cell's place were these, and the surface where the measured force begins."""
        heights = self.tool.lowest_points(state)[0]
        in_air = heights.min(initial=np.inf) - heights
        as_if = replace(
            self, state=state, load_cell=cell, depth=in_air, predicted=0.0 * self.predicted
        )
        return as_if.at_contact(heights)

    def at_contact(self, heights: Array | None = None) -> "Evidence":
        """As if the surface were where the measured force begins, on a way straight down in the deepest attitude.

        `heights`: of the tool's lowest points [m], shape [n], if they are known.
        """
        contact = self.contact
        if contact is None:
            return self
        if heights is None:
            heights = self.tool.lowest_points(self.state)[0]
        depths = np.linspace(0.0, 2.0 * contact.rise, 2 * _DEPTHS + 1)
        way = np.repeat(self.state[[contact.row]], len(depths), axis=0)
        way[:, VELOCITY] = (0.0, 0.0, -1.0)
        way[:, STATE.index("pz")] -= heights[contact.row] + depths
        force = np.linalg.norm(
            predicted(self.tool, self.law, self.load_cell, way, 0.0)[:, FORCE], axis=1
        )
        begun = force[: _DEPTHS + 1] >= contact.share * force[_DEPTHS:]
        height = float(heights[contact.row] + contact.rise + depths[int(np.argmax(begun[1:])) + 1])
        return replace(
            self,
            settings=replace(self.settings, surface_height=height),
            depth=height - heights,
            predicted=predicted(self.tool, self.law, self.load_cell, self.state, height),
        )


def _onset(force: Array, share: float) -> int | None:
    """The row after which the force exceeds this share of its peak, with the fewest exceptions; None without one."""
    if share >= 0.5:
        return None
    loud = np.where(force > share * force.max(), 1, -1)
    row = int(np.argmax(np.append(loud[::-1].cumsum()[::-1], 0)))
    return row if ENOUGH // 2 <= row <= len(force) - ENOUGH // 2 else None


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
        predicted=np.array(rows["predicted"]),
        measured=np.array(rows["compensated"]),
        place_on_tf=transforms.fixed(s.tool_frame, s.sensor_frame),
        links=", ".join(transforms.links(s.tool_frame, s.sensor_frame))
        if s.sensor_source == "tf"
        else "",
    )


def _longest(rows: NDArray[Any], stamps: NDArray[Any]) -> NDArray[Any]:
    """The longest part of the rows in which no stamp goes back."""
    if not len(rows):
        return rows
    return max(np.split(rows, np.flatnonzero(np.diff(stamps) < 0) + 1), key=len)


def _seconds(stamps: NDArray[Any]) -> Array:
    """Since the first [s]."""
    return np.asarray(1e-9 * (stamps - stamps[:1]))

"""The groups of parameters: what `Config` consists of.

A field is made by `setting`, whose `Parameter` is the one source of its name, default, bounds, unit and description.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from rft_ros.errors import InputError
from rft_ros.ground import HeightMap, read_height_map
from rft_ros.parameters.medium_file import read_alpha_y_table, read_medium
from rft_ros.parameters.parameter import setting
from rft_ros.rft import (
    ALPHA_Y_MODELS,
    INERTIA,
    LAW_NUMBERS,
    LAWS,
    MEDIA,
    SURFACE_FRICTION,
    Integration,
    Law,
    Medium,
    Table,
    alpha_y_model,
    law_named,
    medium_named,
)
from rft_ros.rft.frames import Placement, Quaternion, Vector, Wrench
from rft_ros.rft.motion_kinds import MOTIONS
from rft_ros.tool import Tool, load_tool

MESH = (
    "path, package:// or file:// URI, robot.urdf#link, or name of a shipped mesh (plate, ellipsoid, root_tip, sphere,"
    " abb_plate, scoop)"
)
"""The forms of a value of mesh.file, for help texts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshConfig:
    """The tool: its mesh, where the mesh lies in the tool frame, and how it becomes plates."""

    file: str = setting(
        "mesh.file",
        "plate",
        f"Tool mesh: {MESH}; a path is relative to the parameter file.",
        kind="file",
        option="mesh",
    )
    scale: float = setting(
        "mesh.scale",
        0.0,
        "Metres per mesh unit. 0.0: the unit that the file declares (COLLADA, glTF, URDF), or a millimetre.",
        "m",
        (0.0, 1e6),
        least=1e-9,
        option="scale",
    )
    origin: Vector = setting(
        "mesh.origin",
        (0.0, 0.0, 0.0),
        "Where the tool frame's origin lies, in mesh-file coordinates.",
        "mesh units",
        option="origin",
    )
    quaternion: Quaternion = setting(
        "mesh.quaternion",
        (0.0, 0.0, 0.0, 1.0),
        "Orientation of the mesh file's axes in tool_frame, unit length.",
        "xyzw",
        kind="quaternion",
        option="rotate",
    )
    hull: bool = setting(
        "mesh.hull",
        False,
        "Compute forces on the convex hull of the tool: for a hollow tool whose hollows fill with grains.",
        option="hull",
    )
    integration: Integration = setting(
        "integration",
        "refined",
        "Integration rule. refined: cuts facets at the surface, and lets a facet's force grow gradually as it "
        "turns towards the motion. centroid: as published, evaluates each facet at its centroid.",
        option="integration",
    )
    tolerance: float = setting(
        "tolerance",
        0.025,
        "Reduce the tool to the fewest plates whose force and torque deviate by at most this share in 95 % of "
        "random motions. 0.0: use all plates.",
        bounds=(0.0, 1.0),
        option="tolerance",
    )

    def load(self) -> Tool:
        """Load the tool. Raises InputError."""
        return load_tool(
            self.file,
            scale=self.scale,
            origin=self.origin,
            quaternion=self.quaternion,
            hull=self.hull,
            integration=self.integration,
            tolerance=self.tolerance,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class MediumConfig:
    """The traction law, the numbers of the grains, and what is known of their calibration.

    `zeta_error`, `calibrated_depth` and `grain_diameter` are None if they are not known; the parameter is 0 then.
    Raises InputError if they are not positive.
    """

    law: str = setting(
        "law",
        "treers2021",
        "Traction law. agarwal2023 has its own coefficients and ignores medium.name, medium.file and alpha_y.model.",
        choices=LAWS,
        option="law",
    )
    name: str = setting(
        "medium.name",
        "generic",
        "Medium whose coefficients give the stresses, as measured by Li et al. 2013. medium.zeta scales them.",
        choices=tuple(MEDIA),
        option="medium",
    )
    file: str = setting(
        "medium.file",
        "",
        "A medium of your own in place of medium.name: nine coefficients (YAML), or a measured stress map (CSV).",
        "N/cm3",
        kind="file",
    )
    zeta: float = setting(
        "medium.zeta",
        1.0,
        "Scale factor of the medium, from calibration.",
        bounds=(1e-6, 1e6),
        option="zeta",
    )
    mobilization_length: float = setting(
        "medium.mobilization_length",
        0.003,
        "Memory of the grains: displacement over which the force at 30 mm depth reaches 63 % of its full value. "
        "With memory the force holds at rest. 0.0: no memory, as published.",
        "m",
        (0.0, 1e3),
        option="mobilization_length",
    )
    density: float = setting(
        "medium.density",
        0.0,
        "Bulk density, for the grains' inertia. 0.0: no inertia.",
        "kg/m3",
        (0.0, 1e5),
        option="density",
    )
    inertia: float = setting(
        "medium.inertia",
        INERTIA,
        "Factor of the grains' inertia on an upright plate. On a level plate that moves down it is three times "
        "as large.",
        bounds=(0.0, 100.0),
        option="inertia",
    )
    surface_friction: float = setting(
        "medium.surface_friction",
        SURFACE_FRICTION,
        "Coefficient of friction between grains and tool, for law agarwal2023.",
        bounds=(0.0, 10.0),
        option="surface_friction",
    )
    zeta_error: float | None = setting(
        "medium.zeta_error",
        0.0,
        "Relative standard error of medium.zeta. 0.0: not known.",
        bounds=(0.0, 2.0),
        is_optional=True,
    )
    calibrated_depth: float | None = setting(
        "medium.calibrated_depth",
        0.0,
        "Greatest depth reached in the calibration. Estimates at greater depth get the flag deep. 0.0: not known.",
        "m",
        (0.0, 1e3),
        is_optional=True,
    )
    grain_diameter: float | None = setting(
        "medium.grain_diameter",
        0.0,
        "Mean diameter of the grains. Estimates with a tool under five grains wide get the flag few_grains. 0.0: not "
        "known.",
        "m",
        (0.0, 1.0),
        is_optional=True,
    )
    calibrated_motions: str = setting(
        "medium.calibrated_motions",
        "",
        f"Kinds of motion that the calibration had, with commas: {', '.join(MOTIONS)}. Another kind is reported once. "
        "Empty: not known.",
        kind="motions",
    )
    alpha_y_model: str = setting(
        "alpha_y.model",
        "linear",
        "Model of the sideways stress: the stress along the horizontal direction that lies in the plate.",
        choices=ALPHA_Y_MODELS,
        option="alpha_y",
    )
    alpha_y_table: str = setting(
        "alpha_y.table",
        "",
        "CSV file for alpha_y.model table, with the columns beta, alpha_y, or beta, gamma, alpha_y. Its header "
        "may name other units.",
        "deg, N/cm3",
        kind="file",
    )

    def __post_init__(self) -> None:
        for name in ("zeta_error", "calibrated_depth", "grain_diameter"):
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                raise InputError(
                    f"{name} is {value}; it must be positive, or None if it is not known"
                )

    def parts(self) -> "dict[str, Part]":
        """The files that have to be loaded. Raises InputError if a parameter that belongs to another one is missing."""
        found: dict[str, Part] = {}
        if self.file:
            found["medium"] = MediumFile(file=self.file)
        if self.alpha_y_model == "table":
            if not self.alpha_y_table:
                raise InputError(
                    "alpha_y.model 'table' needs alpha_y.table to name a CSV file; set that first"
                )
            found["table"] = AlphaYTable(file=self.alpha_y_table)
        return found

    def law_of(self, parts_by_name: Mapping[str, Any]) -> Law:
        """The law. `parts_by_name`: of `load_parts`, those of the medium and of α_y."""
        medium = parts_by_name.get("medium") or medium_named(self.name)
        alpha_y = alpha_y_model(self.alpha_y_model, medium, parts_by_name.get("table"))
        numbers = {name: getattr(self, name) for name in LAW_NUMBERS}
        return law_named(self.law, medium, alpha_y, **numbers)


@dataclass(frozen=True, slots=True, kw_only=True)
class MediumFile:
    """A medium of one's own."""

    file: str = setting("medium.file", "")

    def load(self) -> Medium:
        """Read it. Raises InputError."""
        return read_medium(self.file)


@dataclass(frozen=True, slots=True, kw_only=True)
class AlphaYTable:
    """A table of α_y, in use."""

    file: str = setting("alpha_y.table", "")
    model: str = setting("alpha_y.model", "table")

    def load(self) -> Table:
        """Read it. Raises InputError."""
        return read_alpha_y_table(self.file)


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundConfig:
    """The map of the ground at the start."""

    cell: float = setting(
        "ground.cell",
        0.0,
        "Side of a cell of the height map of the ground. 0.0: the ground is a level plane.",
        "m",
        (0.0, 1.0),
        least=1e-4,
    )
    file: str = setting(
        "ground.file",
        "",
        "Heights of the ground at the start, in world_frame: CSV with columns x, y, h, or NPZ. Needs ground.cell.",
        "m",
        kind="file",
    )

    def load(self) -> HeightMap:
        """Read the map, or make one of unknown heights. Raises InputError."""
        if self.file:
            return read_height_map(Path(self.file), self.cell)
        return HeightMap.unknown(self.cell)


Part = MeshConfig | GroundConfig | MediumFile | AlphaYTable
"""A part of the model that takes time to load."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FeedforwardConfig:
    """The wrench for controllers."""

    gain: float = setting(
        "feedforward.gain",
        0.0,
        "Factor of the prediction on ~/wrench_feedforward. -1.0: the wrench that cancels the force of the "
        "grains. 0.0: publish no such wrench.",
        bounds=(-2.0, 2.0),
    )
    frame: Literal["sensor_frame", "tool_frame", "world_frame"] = setting(
        "feedforward.frame",
        "sensor_frame",
        "Axes of ~/wrench_feedforward. Its torque is about the sensor's origin in sensor_frame, otherwise about "
        "the tool frame's origin.",
        applies="restart",
    )
    limit: tuple[float, float] = setting(
        "feedforward.limit",
        (20.0, 2.0),
        "Largest force and largest torque of ~/wrench_feedforward.",
        "N, N m",
        (0.0, 1e4),
    )
    rise_time: float = setting(
        "feedforward.rise_time",
        0.2,
        "Least time from zero to feedforward.limit, and back. When the node ends, the way back takes at most 0.25 s.",
        "s",
        (0.01, 1.0),
    )
    timeout: float = setting(
        "feedforward.timeout",
        0.1,
        "Without an estimate for this time, ~/wrench_feedforward goes to zero.",
        "s",
        (0.005, 1.0),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class LearningConfig:
    """The filter that estimates the grains from the load cell."""

    mode: Literal["off", "observe", "apply"] = setting(
        "learning.mode",
        "off",
        "Estimate the medium from the load cell. observe: only report the estimates. apply: also correct the "
        "predictions.",
    )
    lag: float = setting(
        "learning.lag",
        0.002,
        "Path of the tool between a load-cell sample and the first prediction that uses it.",
        "m",
        (1e-5, 1.0),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class FramesConfig:
    """The names of the frames, and the source of the sensor's place on the tool.

    Raises InputError if world and tool frame have the same name, because the frame_id of a twist then does not say in
    which axes the twist is.
    """

    world: str = setting("world_frame", "world", "frame_id of poses; z up.")
    tool: str = setting("tool_frame", "tool", "Frame of the mesh; twists may be in its axes.")
    sensor: str = setting(
        "sensor_frame", "ft_sensor", "frame_id of the load cell, and of all published wrenches."
    )
    sensor_source: Literal["parameters", "tf", "world"] = setting(
        "sensor.frame_source",
        "parameters",
        "Source of the sensor's place on the tool. parameters: sensor.position and sensor.quaternion. tf: fixed "
        "transforms. world: as parameters, but the readings are in the axes of world_frame, whatever their "
        "frame_id says.",
    )

    def __post_init__(self) -> None:
        if self.world == self.tool:
            raise InputError(
                f"world_frame and tool_frame are both '{self.tool}'; name two different frames"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadCell:
    """The load cell's mounting, sign and bias, and the mass attached to it: the parameters ``sensor.*``."""

    position: Vector = setting(
        "sensor.position",
        (0.0, 0.0, 0.0),
        "Origin of sensor_frame in tool_frame.",
        "m",
        (-1e3, 1e3),
    )
    quaternion: Quaternion = setting(
        "sensor.quaternion",
        (0.0, 0.0, 0.0, 1.0),
        "Orientation of sensor_frame in tool_frame, unit length.",
        "xyzw",
        kind="quaternion",
    )
    sign: float = setting(
        "sensor.sign",
        1.0,
        "1.0: the driver reports the force that acts on the tool. -1.0: the force with which the tool pushes.",
        bounds=(-1.0, 1.0),
        kind="sign",
    )
    bias: Wrench = setting(
        "sensor.bias",
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        "Reading of the load cell without load: fx, fy, fz, tx, ty, tz.",
        "N, N m",
        (-1e6, 1e6),
    )
    mass: float = setting(
        "sensor.mass", 0.0, "Mass that hangs below the load cell.", "kg", (0.0, 1e3)
    )
    center_of_mass: Vector = setting(
        "sensor.center_of_mass",
        (0.0, 0.0, 0.0),
        "Centre of that mass in sensor_frame.",
        "m",
        (-1e3, 1e3),
    )
    delay: float = setting(
        "sensor.delay",
        0.0,
        "How much later than the poses' stamps those of the load cell are for one event; negative: earlier.",
        "s",
        (-10.0, 10.0),
    )

    @property
    def place(self) -> Placement:
        """The sensor frame in the tool frame."""
        return Placement(self.position, self.quaternion)

    def at(self, place: Placement) -> "LoadCell":
        """The same load cell at another place in the tool frame."""
        return replace(self, position=place.position, quaternion=place.quaternion)


@dataclass(frozen=True, slots=True, kw_only=True)
class InputsConfig:
    """Sources of pose and velocity, greatest age of a sample, rate of estimates, and the speed of a tool at rest."""

    pose_source: Literal["topic", "tf"] = setting(
        "pose_source",
        "topic",
        "Source of the pose. topic: ~/pose. tf: the transforms of TF.",
        applies="restart",
    )
    tf_rate: float = setting(
        "tf_rate",
        0.0,
        "Rate of the poses from TF. 0.0: a pose at each stamp of the load cell.",
        "Hz",
        (0.0, 1e4),
    )
    twist_source: Literal["topic", "pose_difference"] = setting(
        "twist_source",
        "topic",
        "Source of the velocity. topic: ~/twist. pose_difference: computed from the last poses.",
    )
    twist_window: float = setting(
        "twist_window",
        0.2,
        "Longest span of poses to which pose_difference fits a curve.",
        "s",
        (1e-4, 1.0),
    )
    max_input_age: float = setting(
        "max_input_age",
        0.1,
        "Greatest time between a pose and another sample that is used with it.",
        "s",
        (1e-6, 1e6),
    )
    max_rate: float = setting(
        "max_rate",
        0.0,
        "Highest rate of estimates. 0.0: an estimate at every pose.",
        "Hz",
        (0.0, 1e6),
    )
    rest_speed: float = setting(
        "rest_speed",
        2e-4,
        "A tool that is slower than this is at rest, and may be tared. If the model has no memory and the tool is "
        "in the grains, there is no estimate.",
        "m/s",
        (0.0, 1e3),
    )

    @property
    def max_age(self) -> int:
        """`max_input_age` [ns]."""
        return round(1e9 * self.max_input_age)

"""One value for all parameters, in groups: what YAML files, the command line, ROS and Python code set alike.

A field is made by `setting`, whose `Parameter` is the one source of its name, default, bounds, unit and description.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from rft_ros.errors import InputError, shown
from rft_ros.ground import HeightMap, read_height_map
from rft_ros.parameters.medium_file import read_alpha_y_table, read_medium
from rft_ros.parameters.parameter import (
    Value,
    Values,
    field_values,
    parameter_fields,
    parameter_values,
    setting,
    with_values,
)
from rft_ros.parameters.settings import LoadCell, Model, Settings
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
from rft_ros.rft.frames import Quaternion, Vector
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
    """The traction law and the numbers of the grains."""

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


Part = MeshConfig | GroundConfig | MediumFile | AlphaYTable
"""A part of the model that takes time to load."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Config:
    """All parameters.

    `settings`: of the estimator, with frames, sources, learning and load cell. `executor`: of rclpy.
    """

    mesh: MeshConfig = field(default_factory=MeshConfig)
    medium: MediumConfig = field(default_factory=MediumConfig)
    feedforward: FeedforwardConfig = field(default_factory=FeedforwardConfig)
    ground: GroundConfig = field(default_factory=GroundConfig)
    executor: Literal["events", "single"] = setting(
        "executor",
        "events",
        "Executor of rclpy. events uses half the CPU of single.",
        applies="restart",
    )
    settings: Settings = field(default_factory=Settings)

    @classmethod
    def of(cls, values: "Config | Values") -> "Config":
        """From values by the names of the parameters; those that are missing have their defaults.

        A `Config` is returned as it is. Raises InputError that names a value that is not allowed, or a name that no
        parameter has.
        """
        if isinstance(values, Config):
            return values
        _check_names(values)
        return cls(
            mesh=MeshConfig(**field_values(MeshConfig, values)),
            medium=MediumConfig(**field_values(MediumConfig, values)),
            feedforward=FeedforwardConfig(**field_values(FeedforwardConfig, values)),
            ground=GroundConfig(**field_values(GroundConfig, values)),
            **field_values(cls, values),
            settings=Settings(
                **field_values(Settings, values),
                load_cell=LoadCell(**field_values(LoadCell, values)),
            ),
        )

    @property
    def values(self) -> dict[str, Value]:
        """The values by the names of the parameters, as YAML files and ROS have them."""
        groups = (self.mesh, self.medium, self.feedforward, self.ground, self, self.settings)
        found: dict[str, Value] = {}
        for group in (*groups, self.settings.load_cell):
            found |= parameter_values(group)
        return found

    def changed(self, values: Values) -> "Config":
        """The same with other values of some parameters. Raises InputError as `of`."""
        _check_names(values)
        load_cell = with_values(self.settings.load_cell, values)
        return replace(
            with_values(self, values),
            mesh=with_values(self.mesh, values),
            medium=with_values(self.medium, values),
            feedforward=with_values(self.feedforward, values),
            ground=with_values(self.ground, values),
            settings=replace(with_values(self.settings, values), load_cell=load_cell),
        )

    def parts(self) -> dict[str, Part]:
        """The parts of the model that have to be loaded.

        Raises InputError if a parameter that belongs to another one is missing.
        """
        found: dict[str, Part] = {"tool": self.mesh}
        if self.ground.cell:
            found["ground"] = self.ground
        elif self.ground.file:
            raise InputError(
                f"ground.file '{self.ground.file}' needs ground.cell, the side of a cell [m]; it is 0"
            )
        return found | self.medium.parts()

    def model(
        self, parts_by_name: Mapping[str, Any] | None = None, *, generation: int = 0
    ) -> Model:
        """The model. `parts_by_name`: by `load_parts`; None: the parts are loaded here. Raises InputError."""
        if parts_by_name is None:
            parts_by_name = load_parts(self.parts())
        return Model(
            tool=parts_by_name["tool"],
            law=self.medium.law_of(parts_by_name),
            ground=parts_by_name.get("ground"),
            generation=generation,
        )


GROUPS = (
    MeshConfig,
    MediumConfig,
    FeedforwardConfig,
    GroundConfig,
    Config,
    Settings,
    LoadCell,
)
"""The dataclasses whose fields are the parameters."""

NAMES = frozenset(p.name for group in GROUPS for p in parameter_fields(group).values())


def _check_names(values: Values) -> None:
    """Raise InputError for a name that no parameter has."""
    unknown = values.keys() - NAMES
    if unknown:
        raise InputError(f"there is no parameter {shown(min(unknown))}")


def load_parts(parts: Mapping[str, Part]) -> dict[str, Any]:
    """Load parts of `Config.parts`. Raises InputError for what cannot be used."""
    return {name: part.load() for name, part in parts.items()}

"""What parameters stand for: the estimator's settings, the load cell, and the model of tool and medium."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, NamedTuple

from rft_ros.errors import InputError
from rft_ros.ground import HeightMap, read_height_map
from rft_ros.parameters.file import read_alpha_y_table
from rft_ros.parameters.table import Values
from rft_ros.rft import Law, Table, alpha_y_model, law_named, medium_named
from rft_ros.tool import Tool, ToolRequest

__all__ = ["TOOL_PARAMETERS", "LearningMode", "LoadCell", "Model", "Settings"]
__all__ += ["ModelFiles", "ModelParts", "model_files", "model_of", "settings_of", "tool_request"]

_Vector = tuple[float, float, float]

LearningMode = Literal["off", "observe", "apply"]
"""Whether the medium is learned from the load cell, and whether predictions use it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadCell:
    """The load cell's mounting, sign and bias, and the mass attached to it.

    `position` [m] and `quaternion` xyzw: sensor frame in the tool frame. `sign`: +1 if the driver reports the force on
    the tool, -1 if the force by the tool. `bias`: the driver's raw reading with nothing attached [N, N m].
    `mass` [kg] and `center_of_mass` [m, sensor frame]: of everything attached below the cell.
    """

    position: _Vector = (0.0, 0.0, 0.0)
    quaternion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    sign: float = 1.0
    bias: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    mass: float = 0.0
    center_of_mass: _Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Frames, sources, limits and learning in m, s, m/s, Hz.

    `max_rate` 0: answer every pose. `calibrated_depth` and `zeta_error` (relative standard error of ζ) 0: unknown.
    `tf_rate` 0: a pose from transforms at each load-cell stamp. `learning_lag`: path between a load-cell sample and the
    first prediction that it may change. Raises InputError if world and tool frame have one name: a twist could not say
    whose axes it is in.
    """

    world_frame: str = "world"
    tool_frame: str = "tool"
    sensor_frame: str = "ft_sensor"
    load_cell: LoadCell = field(default_factory=LoadCell)
    sensor_source: Literal["parameters", "tf"] = "parameters"
    surface_height: float = 0.0
    pose_source: Literal["topic", "tf"] = "topic"
    tf_rate: float = 0.0
    twist_source: Literal["topic", "pose_difference"] = "topic"
    twist_window: float = 0.2
    max_input_age: float = 0.1
    max_rate: float = 0.0
    rest_speed: float = 2e-4
    calibrated_depth: float = 0.0
    zeta_error: float = 0.0
    learning_mode: LearningMode = "off"
    learning_lag: float = 0.002

    def __post_init__(self) -> None:
        if self.world_frame == self.tool_frame:
            raise InputError(f"world_frame and tool_frame are both '{self.tool_frame}'; name two different frames")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Model:
    """A tool, a law and the ground at the start, replaced as a whole; `generation` counts the models of a run.

    `mobilization_length`: λ of the medium [m]; 0 disables memory, as published. `ground`: known heights; None: a level
    plane. The rest names the law's parameters.
    """

    tool: Tool
    law: Law
    medium: str
    zeta: float
    alpha_y: str
    law_name: str = "treers2021"
    mobilization_length: float = 0.0
    ground: HeightMap | None = None
    generation: int = 0


def settings_of(values: Values) -> Settings:
    """The estimator's settings from checked values."""
    v: Mapping[str, Any] = values
    same_name = {field.name: v[field.name] for field in fields(Settings) if field.name in v}
    return Settings(
        **same_name,
        load_cell=LoadCell(**{field.name: v[f"sensor.{field.name}"] for field in fields(LoadCell)}),
        sensor_source=v["sensor.frame_source"],
        calibrated_depth=v["medium.calibrated_depth"],
        zeta_error=v["medium.zeta_error"],
        learning_mode=v["learning.mode"],
        learning_lag=v["learning.lag"],
    )


_OF_TOOL = ("mesh.file", "mesh.scale", "mesh.origin", "integration", "tolerance")
TOOL_PARAMETERS = {name.removeprefix("mesh."): name for name in _OF_TOOL}
"""The parameter for each field of a `ToolRequest`."""


def tool_request(values: Values) -> ToolRequest:
    """The tool request from checked values."""
    v: Mapping[str, Any] = values
    return ToolRequest(**{field: v[name] for field, name in TOOL_PARAMETERS.items()})


class ModelParts(NamedTuple):
    """What a model takes from files that take time to load; None for what it does not."""

    tool: Tool | None = None
    ground: HeightMap | None = None


class ModelFiles(NamedTuple):
    """The files of `ModelParts`, to load them later or in another process; None: not to be loaded.

    `ground`: ground.cell and ground.file.
    """

    tool: ToolRequest | None = None
    ground: tuple[float, str] | None = None

    def load(self) -> ModelParts:
        """Load them. Raises InputError for what cannot be used."""
        return ModelParts(tool=self.tool and self.tool.load(), ground=_ground_of(*self.ground) if self.ground else None)

    def parameters(self) -> Values:
        """The parameters that give these files."""
        cell, file = self.ground or (0.0, "")
        of_tool: dict[str, Any] = {name: getattr(self.tool, field) for field, name in TOOL_PARAMETERS.items()}
        return {**of_tool, "ground.cell": cell, "ground.file": file}

    def __str__(self) -> str:
        """The parameters that name the files, with their values."""
        cell, ground = self.ground or (0.0, "")
        named = ("mesh.file", self.tool and self.tool.file), ("ground.file", ground)
        return " and ".join(f"{name} '{file}'" for name, file in named if file) or f"ground.cell {cell:g}"


def model_files(values: Values) -> ModelFiles:
    """The files of the model from checked values."""
    v: Mapping[str, Any] = values
    return ModelFiles(tool_request(values), (v["ground.cell"], v["ground.file"]))


def model_of(
    values: Values,
    *,
    tool: Tool | None = None,
    table: Table | None = None,
    ground: HeightMap | None = None,
    generation: int = 0,
) -> Model:
    """The model from checked values; loads the tool, the table of α_y and the ground unless they are given.

    Raises InputError for what cannot be used.
    """
    v: Mapping[str, Any] = values
    medium, alpha_y = medium_named(v["medium.name"]), v["alpha_y.model"]
    if alpha_y == "table" and not v["alpha_y.table"]:
        raise InputError("alpha_y.model 'table' needs alpha_y.table to name a CSV file; set that first")
    if alpha_y == "table":
        table = table or read_alpha_y_table(v["alpha_y.table"])
    of_law = {name: v[f"medium.{name}"] for name in ("zeta", "surface_friction", "density", "inertia")}
    return Model(
        tool=tool or tool_request(values).load(),
        law=law_named(v["law"], medium, alpha_y_model(alpha_y, medium, table), **of_law),
        law_name=v["law"],
        medium=medium.name,
        zeta=v["medium.zeta"],
        alpha_y=alpha_y,
        mobilization_length=v["medium.mobilization_length"],
        ground=ground or _ground_of(v["ground.cell"], v["ground.file"]),
        generation=generation,
    )


def _ground_of(cell: float, file: str) -> HeightMap | None:
    if file and not cell:
        raise InputError(f"ground.file '{file}' needs ground.cell, the side of a cell [m]; it is 0")
    if not cell:
        return None
    return read_height_map(Path(file), cell) if file else HeightMap.unknown(cell)

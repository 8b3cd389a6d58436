"""The estimator's settings, the load cell and the model of tool and grains, made from the values of parameters."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

from rft_ros.errors import InputError
from rft_ros.ground import HeightMap, read_height_map
from rft_ros.parameters.file import read_alpha_y_table
from rft_ros.parameters.medium_file import read_medium
from rft_ros.parameters.table import Values
from rft_ros.rft import LAW_NUMBERS, Law, Medium, Table, alpha_y_model, described, law_named, medium_named
from rft_ros.rft.placement import Vector
from rft_ros.tool import Tool, load_tool

__all__ = ["LoadCell", "Model", "Settings", "files_of", "ground_of", "load_files"]
__all__ += ["medium_of", "model_of", "read_small_file", "settings_of", "small_files_of", "tool_of"]
__all__ += ["CALIBRATED_ERROR", "GRAINS", "with_grains"]

CALIBRATED_ERROR = 0.15
"""Relative standard error that a ζ from a calibration is taken to have, if the calibration does not say."""

_UNCALIBRATED_ERROR = 1.0
"""The same for a ζ that may be no calibration at all: wide enough to learn any grains from ζ = 1 within centimetres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadCell:
    """The load cell's mounting, sign and bias, and the mass attached to it.

    `position` [m] and `quaternion` xyzw: place of the sensor frame in the tool frame. `sign`: +1 if the driver reports
    the force that acts on the tool, -1 if it reports the force with which the tool pushes. `bias`: the driver's raw
    reading with nothing attached [N, N m]. `mass` [kg] and `center_of_mass` [m, sensor frame]: of everything that is
    attached below the cell.
    """

    position: Vector = (0.0, 0.0, 0.0)
    quaternion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    sign: float = 1.0
    bias: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    mass: float = 0.0
    center_of_mass: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """The estimator's settings, in m, s, m/s and Hz. Each field is the parameter of the node with the same name.

    Some names differ: `load_cell` holds ``sensor.*``, `sensor_source` is ``sensor.frame_source``, `calibrated_depth`
    and `zeta_error` are ``medium.*``, and `learning_mode` and `learning_lag` are ``learning.*``. docs/node.md lists the
    parameters. A value of 0 has a special meaning in some fields. `max_rate`: every pose gets an estimate. `tf_rate`:
    transforms give a pose at each load-cell stamp. `calibrated_depth` and `zeta_error` are None if they are not known;
    the parameter is 0 then.

    Raises InputError if `world_frame` and `tool_frame` have the same name, because the frame_id of a twist then does
    not say in which axes the twist is, and for a `calibrated_depth` or `zeta_error` that is not positive.
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
    calibrated_depth: float | None = None
    zeta_error: float | None = None
    learning_mode: Literal["off", "observe", "apply"] = "off"
    learning_lag: float = 0.002

    def __post_init__(self) -> None:
        if self.world_frame == self.tool_frame:
            raise InputError(f"world_frame and tool_frame are both '{self.tool_frame}'; name two different frames")
        for name, value in (("calibrated_depth", self.calibrated_depth), ("zeta_error", self.zeta_error)):
            if value is not None and not value > 0.0:
                raise InputError(f"{name} is {value}; it must be positive, or None if it is not known")

    @property
    def strength_error(self) -> float:
        """Relative standard error of the strength of the grains, ζ, that predictions assume.

        If `zeta_error` is not known, it depends on what happens with a wrong ζ. With learning the load cell's readings
        correct it, so that a wide prior costs little. Without learning nothing does: a ζ of which nothing is known
        would have no useful standard deviation, so it is taken to be from a calibration.
        """
        if self.zeta_error is not None:
            return self.zeta_error
        return CALIBRATED_ERROR if self.learning_mode == "off" else _UNCALIBRATED_ERROR


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Model:
    """The model of tool and grains. It is immutable: a change of any part makes a new model.

    `law`: the traction law, with all parameters of the grains. `ground`: the map of the ground at the start; None: the
    ground is a level plane at ``surface_height``. `generation`: the node counts it up with each new model.
    """

    tool: Tool
    law: Law
    ground: HeightMap | None = None
    generation: int = 0

    @property
    def in_words(self) -> str:
        """Tool, rule and grains, such as "tool plate (672 plates), integration refined, law ..., memory 3 mm"."""
        plates = self.tool.reduction or f"{len(self.tool.plates):,} plates"
        rule = self.tool.plates.integration
        return f"tool {self.tool.name} ({plates}), integration {rule}, {described(self.law)}"


def settings_of(values: Values) -> Settings:
    """The estimator's settings from checked values."""
    same_name = {field.name: values[field.name] for field in fields(Settings) if field.name in values}
    return Settings(
        **same_name,
        load_cell=LoadCell(**{field.name: values[f"sensor.{field.name}"] for field in fields(LoadCell)}),
        sensor_source=values["sensor.frame_source"],
        calibrated_depth=values["medium.calibrated_depth"] or None,
        zeta_error=values["medium.zeta_error"] or None,
        learning_mode=values["learning.mode"],
        learning_lag=values["learning.lag"],
    )


def tool_of(values: Values) -> Tool:
    """Load the tool from checked values."""
    return load_tool(
        values["mesh.file"],
        scale=values["mesh.scale"],
        origin=values["mesh.origin"],
        quaternion=values["mesh.quaternion"],
        integration=values["integration"],
        tolerance=values["tolerance"],
    )


def ground_of(values: Values) -> HeightMap | None:
    """Load the ground at the start from checked values; None: a level plane."""
    cell, file = values["ground.cell"], values["ground.file"]
    if file and not cell:
        raise InputError(f"ground.file '{file}' needs ground.cell, the side of a cell [m]; it is 0")
    if not cell:
        return None
    return read_height_map(Path(file), cell) if file else HeightMap.unknown(cell)


class _LoadedPart(NamedTuple):
    """A part of a model that takes time to load: its parameters, and the function of their values that loads it."""

    parameters: tuple[str, ...]
    load: Callable[[Values], Tool | HeightMap | None]


_OF_TOOL = ("mesh.file", "mesh.scale", "mesh.origin", "mesh.quaternion", "integration", "tolerance")
_LOADED = {"tool": _LoadedPart(_OF_TOOL, tool_of), "ground": _LoadedPart(("ground.cell", "ground.file"), ground_of)}


def files_of(values: Values) -> dict[str, Values]:
    """The parts of a model that take time to load, and the values of the parameters that each needs.

    The keys are arguments of `model_of`.
    """
    return {name: {p: values[p] for p in part.parameters} for name, part in _LOADED.items()}


def load_files(files: Mapping[str, Values]) -> dict[str, Any]:
    """Load parts of `files_of`. Raises InputError for what cannot be used."""
    return {name: _LOADED[name].load(values) for name, values in files.items()}


def small_files_of(values: Values) -> dict[str, str]:
    """The files of the law, by parameter. They are small enough for a node to read them between two ticks."""
    files = {}
    if values["medium.file"]:
        files["medium.file"] = values["medium.file"]
    if values["alpha_y.model"] == "table":
        files["alpha_y.table"] = values["alpha_y.table"]
    return files


def read_small_file(parameter: str, file: str) -> Medium | Table:
    """Read one of `small_files_of`. Raises InputError for a file that cannot be used."""
    return read_medium(file) if parameter == "medium.file" else read_alpha_y_table(file)


def medium_of(values: Values) -> Medium:
    """The medium from checked values: of medium.file if it is set, otherwise of medium.name. Raises InputError."""
    return read_medium(values["medium.file"]) if values["medium.file"] else medium_named(values["medium.name"])


GRAINS = frozenset(f"medium.{name}" for name in LAW_NUMBERS)
"""Parameters that are fields of the law. A change of these changes the law and no other part of a model."""


def with_grains(model: Model, changes: Values) -> Model:
    """The next model, which differs in its law only. `changes`: checked values of parameters in `GRAINS`."""
    changed = {}
    for parameter, value in changes.items():
        field_name = parameter.removeprefix("medium.")
        if hasattr(model.law, field_name):  # surface_friction, for example, is a field of one law only
            changed[field_name] = value
    return replace(model, law=replace(model.law, **changed), generation=model.generation + 1)


def model_of(
    values: Values,
    *,
    tool: Tool | None = None,
    medium: Medium | None = None,
    table: Table | None = None,
    ground: HeightMap | None = None,
    generation: int = 0,
) -> Model:
    """The model from checked values. Parts that are not given are loaded. Raises InputError for unusable files."""
    medium, alpha_y = medium or medium_of(values), values["alpha_y.model"]
    if alpha_y == "table":
        table = table or read_alpha_y_table(values["alpha_y.table"])
    of_law = {name: values[f"medium.{name}"] for name in LAW_NUMBERS}
    return Model(
        tool=tool or tool_of(values),
        law=law_named(values["law"], medium, alpha_y_model(alpha_y, medium, table), **of_law),
        ground=ground or ground_of(values),
        generation=generation,
    )

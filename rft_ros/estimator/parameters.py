"""The parameters: the table that node, replay and docs share, checks of values, and parameter files without ROS."""

import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, fields
from pathlib import Path
from typing import Any, Literal

import yaml

from rft_ros.errors import InputError, file_errors, suggestion
from rft_ros.estimator.alpha_y_table import read_alpha_y_table
from rft_ros.estimator.settings import LoadCell, Model, Settings
from rft_ros.ground import HeightMap, read_height_map
from rft_ros.rft import (
    ALPHA_Y_MODELS,
    INERTIA,
    INTEGRATIONS,
    LAWS,
    MEDIA,
    SURFACE_FRICTION,
    alpha_y_model,
    law_named,
    medium_named,
)
from rft_ros.rft.frames import UNIT_TOLERANCE
from rft_ros.tool import Tool, ToolRequest, is_mesh_path
from rft_ros.yaml_file import read_yaml

__all__ = [
    "FILES",
    "NODE_KEYS",
    "PARAMETERS",
    "TOOL_PARAMETERS",
    "Parameter",
    "Value",
    "Values",
    "checked",
    "defaults",
    "flat",
    "gives",
    "model_of",
    "node_parameters",
    "parameter_tree",
    "path_beside",
    "read_parameter_file",
    "settings_of",
    "tool_request",
    "write_parameter_file",
]

Value = str | float | tuple[float, ...]
"""A parameter's value, in the parameter's type."""

Values = Mapping[str, Value]
"""The values of all parameters, by name."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter, of the type of its default. `low`, `high`: inclusive bounds on each number."""

    name: str
    default: Value
    description: str
    _: KW_ONLY
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()
    applies: Literal["live", "restart"] = "live"

    @property
    def type(self) -> Literal["string", "double", "double_array"]:
        """The parameter's ROS type."""
        if isinstance(self.default, str):
            return "string"
        return "double" if isinstance(self.default, float) else "double_array"


_ZERO3 = (0.0, 0.0, 0.0)

PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        "mesh.file",
        "plate",
        "Tool mesh: a path, a package:// URI, or the name of a shipped mesh"
        " (plate, ellipsoid, root_tip, sphere, abb_plate). A path is relative to the parameter file that names it.",
    ),
    Parameter("mesh.scale", 0.001, "Metres per mesh unit.", unit="m", low=1e-9, high=1e6),
    Parameter(
        "mesh.origin", _ZERO3, "Where the tool frame's origin lies, in mesh-file coordinates.", unit="mesh units"
    ),
    Parameter(
        "law",
        "treers2021",
        "Traction law: treers2021, or agarwal2023, which uses neither medium.name nor alpha_y.model.",
        choices=LAWS,
    ),
    Parameter(
        "medium.name", "generic", "Medium whose measured stresses are used (Li et al. 2013).", choices=tuple(MEDIA)
    ),
    Parameter("medium.zeta", 1.0, "Scale factor of the medium, from calibration.", low=1e-6, high=1e6),
    Parameter(
        "medium.zeta_error",
        0.0,
        "Relative standard error of medium.zeta, from calibration. 0.0: not known.",
        low=0.0,
        high=2.0,
    ),
    Parameter(
        "medium.mobilization_length",
        0.0,
        "Displacement to reach 63 % of full resistance at 30 mm depth; the force then holds while the tool"
        " rests. 0.0 disables memory, as published; enabling it takes a restart.",
        unit="m",
        low=0.0,
        high=1e3,
    ),
    Parameter(
        "medium.calibrated_depth",
        0.0,
        "Greatest depth of the calibration; deeper estimates are flagged. 0.0: not known.",
        unit="m",
        low=0.0,
        high=1e3,
    ),
    Parameter(
        "medium.density",
        0.0,
        "Bulk density of the grains, which adds their inertia to fast motion. 0.0: no inertia, as published; to or from"
        " 0.0 takes a restart.",
        unit="kg/m3",
        low=0.0,
        high=1e5,
    ),
    Parameter("medium.inertia", INERTIA, "Factor of the inertia of an upright plate.", low=0.0, high=100.0),
    Parameter(
        "medium.surface_friction",
        SURFACE_FRICTION,
        "Friction of the tool's surface; law agarwal2023 only.",
        low=0.0,
        high=10.0,
    ),
    Parameter("alpha_y.model", "constant", "Stress along the plate's horizontal direction e1.", choices=ALPHA_Y_MODELS),
    Parameter(
        "alpha_y.table",
        "",
        "CSV of beta, alpha_y or beta, gamma, alpha_y for alpha_y.model table; relative to the parameter"
        " file that names it.",
        unit="deg, N/cm3",
    ),
    Parameter(
        "integration",
        "refined",
        "Integration rule for plates: refined (exact where the surface cuts a plate, smooth at the leading"
        " edge, true to curved tools), or centroid (the published rule).",
        choices=INTEGRATIONS,
    ),
    Parameter(
        "tolerance",
        0.025,
        "Reduce the tool to the fewest plates whose wrench stays within this share of the force, at the"
        " 95th percentile of random motions; 0.0: the full tool.",
        low=0.0,
        high=1.0,
    ),
    Parameter(
        "learning.mode",
        "off",
        "Learn the medium from the load cell. observe: learn and report; apply: predict with what was learned."
        " From off to another mode takes a restart.",
        choices=("off", "observe", "apply"),
    ),
    Parameter(
        "learning.lag",
        0.002,
        "Path of the tool between a load-cell sample and the first prediction that it may change.",
        unit="m",
        low=1e-5,
        high=1.0,
    ),
    Parameter("surface_height", 0.0, "z of the undisturbed surface in world_frame.", unit="m", low=-1e6, high=1e6),
    Parameter(
        "ground.cell",
        0.0,
        "Side of the cells of a map of the ground's height. 0.0: a level plane at surface_height.",
        unit="m",
        low=0.0,
        high=1.0,
        applies="restart",
    ),
    Parameter(
        "ground.file",
        "",
        "Heights at the start: CSV with columns x, y, h, or NPZ with these arrays, in world_frame; relative to the"
        " parameter file that names it. Needs ground.cell; unknown cells are at surface_height.",
        unit="m",
        applies="restart",
    ),
    Parameter("world_frame", "world", "frame_id of poses; z up."),
    Parameter("tool_frame", "tool", "Frame of the mesh; twists may be in its axes."),
    Parameter("sensor_frame", "ft_sensor", "frame_id of the load cell, and of all published wrenches."),
    Parameter("sensor.position", _ZERO3, "Origin of sensor_frame in tool_frame.", unit="m", low=-1e3, high=1e3),
    Parameter(
        "sensor.quaternion",
        (0.0, 0.0, 0.0, 1.0),
        "Orientation of sensor_frame in tool_frame, unit length.",
        unit="xyzw",
    ),
    Parameter(
        "sensor.frame_source",
        "parameters",
        "Where the sensor is on the tool: sensor.position and sensor.quaternion, or fixed transforms from tool_frame to"
        " sensor_frame.",
        choices=("parameters", "tf"),
    ),
    Parameter(
        "sensor.sign",
        1.0,
        "1.0: the driver reports the force on the tool; -1.0: the force by the tool.",
        low=-1.0,
        high=1.0,
    ),
    Parameter(
        "sensor.bias",
        (0.0,) * 6,
        "What the driver reports with nothing attached: fx, fy, fz, tx, ty, tz.",
        unit="N, N m",
        low=-1e6,
        high=1e6,
    ),
    Parameter("sensor.mass", 0.0, "Mass that hangs below the load cell.", unit="kg", low=0.0, high=1e3),
    Parameter("sensor.center_of_mass", _ZERO3, "Centre of that mass in sensor_frame.", unit="m", low=-1e3, high=1e3),
    Parameter(
        "pose_source",
        "topic",
        "Pose from ~/pose, or from the transforms between world_frame and tool_frame, at the load cell's stamps.",
        choices=("topic", "tf"),
        applies="restart",
    ),
    Parameter(
        "tf_rate",
        0.0,
        "With pose_source tf: take poses at this rate; 0.0: at the stamps of the load cell.",
        unit="Hz",
        low=0.0,
        high=1e4,
    ),
    Parameter(
        "twist_source", "topic", "Velocity from ~/twist, or from the last poses.", choices=("topic", "pose_difference")
    ),
    Parameter(
        "twist_window",
        0.2,
        "Longest span of poses that pose_difference fits a curve to. A speed that their noise explains is rest.",
        unit="s",
        low=1e-4,
        high=1.0,
    ),
    Parameter(
        "max_input_age",
        0.1,
        "Greatest difference between a pose's stamp and those of the twist, wrenches and transforms used with it.",
        unit="s",
        low=1e-6,
        high=1e6,
    ),
    Parameter("max_rate", 0.0, "Answer at most this often; 0.0: every pose.", unit="Hz", low=0.0, high=1e6),
    Parameter(
        "rest_speed",
        2e-4,
        "Below this speed of its fastest point a tool in grains is at rest: no estimate (with memory: the last force).",
        unit="m/s",
        low=0.0,
        high=1e3,
    ),
    Parameter(
        "executor",
        "events",
        "rclpy executor. events: half the CPU time and a shorter latency; single: single-threaded.",
        choices=("events", "single"),
        applies="restart",
    ),
)
"""Every parameter, in the order in which they are documented."""

_BY_NAME = {p.name: p for p in PARAMETERS}


def defaults() -> dict[str, Value]:
    """Every parameter at its default."""
    return {p.name: p.default for p in PARAMETERS}


def checked(name: str, value: object) -> Value:
    """The value in the parameter's type. Raises InputError that names both and says what is allowed."""
    parameter = _BY_NAME.get(name)
    if parameter is None:
        raise InputError(f"there is no parameter '{name}'{suggestion(name, _BY_NAME)}")
    if parameter.type == "string":
        if value is False and "off" in parameter.choices:  # YAML, and so ROS, reads an unquoted off as false
            value = "off"
        if not isinstance(value, str):
            raise InputError(f"{name} is {value!r}; it must be a string")
        if parameter.choices and value not in parameter.choices:
            raise InputError(f"{name} is '{value}'; it must be one of {', '.join(parameter.choices)}")
        return value
    if parameter.type == "double":
        number = _number(parameter, value)
        if name == "ground.cell" and 0.0 < number < 1e-4:
            raise InputError(f"ground.cell is {number:g}; it must be 0, or at least 0.0001 m")
        if name == "sensor.sign" and abs(number) != 1.0:
            raise InputError(f"sensor.sign is {number:g}; it must be 1.0 or -1.0")
        return number
    assert isinstance(parameter.default, tuple)
    if isinstance(value, str) or not isinstance(value, Sequence) or len(value) != len(parameter.default):
        raise InputError(f"{name} is {value!r}; it must be {len(parameter.default)} numbers")
    numbers = tuple(_number(parameter, v) for v in value)
    if name == "sensor.quaternion":
        norm = math.hypot(*numbers)
        if not abs(norm - 1.0) <= UNIT_TOLERANCE:
            raise InputError(f"sensor.quaternion has norm {norm:g}; it must be 1")
        numbers = tuple(v / norm for v in numbers)
    return numbers


_LARGEST = sys.float_info.max  # also bounds integers too large for a double, at which math.isfinite raises


def _number(parameter: Parameter, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _LARGEST:
        raise InputError(f"{parameter.name} is {value!r}; it must be a finite number (such as 1.0)")
    if not parameter.low <= value <= parameter.high:
        raise InputError(f"{parameter.name} is {value:g}; it must lie between {parameter.low:g} and {parameter.high:g}")
    return float(value)


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


TOOL_PARAMETERS = {
    "file": "mesh.file",
    "scale": "mesh.scale",
    "origin": "mesh.origin",
    "integration": "integration",
    "tolerance": "tolerance",
}
"""The parameter for each field of a `ToolRequest`."""


def tool_request(values: Values) -> ToolRequest:
    """The tool request from checked values."""
    v: Mapping[str, Any] = values
    return ToolRequest(**{field: v[name] for field, name in TOOL_PARAMETERS.items()})


def model_of(
    values: Values, *, tool: Tool | None = None, ground: HeightMap | None = None, generation: int = 0
) -> Model:
    """The model from checked values; loads the tool and the ground unless they are given.

    Raises InputError for what cannot be used.
    """
    v: Mapping[str, Any] = values
    medium = medium_named(v["medium.name"])
    name = v["alpha_y.model"]
    if name == "table" and not v["alpha_y.table"]:
        raise InputError("alpha_y.model 'table' needs alpha_y.table to name a CSV file; set that first")
    table = read_alpha_y_table(v["alpha_y.table"]) if name == "table" else None
    return Model(
        tool=tool or tool_request(values).load(),
        law=law_named(
            v["law"],
            medium,
            alpha_y_model(name, medium, table),
            zeta=v["medium.zeta"],
            surface_friction=v["medium.surface_friction"],
            density=v["medium.density"],
            inertia=v["medium.inertia"],
        ),
        law_name=v["law"],
        medium=medium.name,
        zeta=v["medium.zeta"],
        alpha_y=name,
        mobilization_length=v["medium.mobilization_length"],
        ground=ground or _ground_of(v["ground.cell"], v["ground.file"]),
        generation=generation,
    )


def _ground_of(cell: float, file: str) -> HeightMap | None:
    if file and not cell:
        raise InputError(f"ground.file '{file}' needs ground.cell, the side of a cell [m]; it is 0")
    if not cell:
        return None
    if not file:
        return HeightMap.unknown(cell)
    with file_errors(f"ground.file '{file}'", "read"):
        return read_height_map(Path(file).expanduser(), cell)


NODE_KEYS = ("/**", "rft", "/rft", "/**/rft")
"""Top-level keys that hold parameters of the node `rft`; a later key overrides an earlier one."""


def parameter_tree(file: Path) -> dict[str, Any]:
    """The content of a parameter file, by node, with names as written, nested or flat.

    Raises InputError for what ROS cannot read either: invalid YAML, no node name, a list of mixed types.
    """
    tree = read_yaml(file, "parameter file")
    if not isinstance(tree, dict):
        raise InputError(f"parameter file '{file}' has no node name at its top level, such as '/**'")
    for name, value in flat(tree):
        if isinstance(value, list) and len({type(v) for v in value}) > 1:
            name = name.partition(".ros__parameters.")[2] or name
            raise InputError(
                f"parameter file '{file}': {name} is {value}; ROS takes lists of one type only, such as [0.0, 0.5]"
            )
    return tree


def node_parameters(file: Path, node_keys: tuple[str, ...]) -> dict[str, Any]:
    """The flat parameters of these nodes; a later key overrides an earlier one. Empty if the file has none of them."""
    tree = parameter_tree(file)
    found: dict[str, Any] = {}
    for key in node_keys:
        node = tree.get(key)
        if node is None:
            continue
        if not isinstance(node, dict) or not isinstance(node.get("ros__parameters"), dict):
            raise InputError(f"parameter file '{file}': '{key}' has no 'ros__parameters'")
        found.update(flat(node["ros__parameters"]))
    return found


def gives(file: Path, name: str, value: Value) -> bool:
    """Whether a parameter file gives a parameter of any node, in any namespace, this value."""
    return any(key.endswith(f"ros__parameters.{name}") and v == value for key, v in flat(parameter_tree(file)))


def flat(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Names, joined by dots, and values of a nested mapping."""
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def read_parameter_file(file: Path) -> dict[str, Value]:
    """Every parameter: the file's value for the node `rft`, checked, or the default.

    A relative path in `FILES` becomes relative to the file's folder.
    """
    values = defaults()
    given = node_parameters(file, NODE_KEYS)
    if not given:
        raise InputError(f"parameter file '{file}' has no parameters for the node 'rft' (keys {', '.join(NODE_KEYS)})")
    for name, value in given.items():
        if name == "use_sim_time" or name.startswith("qos_overrides."):
            continue
        try:
            values[name] = checked(name, value)
        except InputError as error:
            raise InputError(f"parameter file '{file}': {error}") from None
    for name in FILES:
        values[name] = path_beside(file.parent, name, str(values[name]))
    return values


FILES = ("mesh.file", "alpha_y.table", "ground.file")
"""Parameters that name a file, relative to the parameter file."""


def path_beside(folder: Path, name: str, path: str) -> str:
    """A relative path in a parameter of `FILES`, counted from a folder.

    Others stay: one from the root or the home folder, none, and for a mesh a shipped name or a package:// URI.
    """
    if not path or path.startswith("~") or (name == "mesh.file" and not is_mesh_path(path)):
        return path
    return str(folder / path)


def write_parameter_file(file: Path, values: Values, *, comment: str) -> None:
    """Write a new file that `read_parameter_file` and the node read. Raises InputError if it exists.

    A relative path in `FILES` is made absolute.
    """
    plain: dict[str, Any] = {name: list(v) if isinstance(v, tuple) else v for name, v in values.items()}
    for name in FILES:
        plain[name] = path_beside(Path.cwd(), name, plain[name])
    tree = {"/**": {"ros__parameters": plain}}
    with file_errors(f"parameter file '{file}'", "written"):
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("x", encoding="utf-8") as new:
            new.write(f"# {comment}\n" + yaml.safe_dump(tree, sort_keys=False))

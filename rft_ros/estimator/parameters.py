"""The one table of parameters: the node declares them, the replay reads them, the docs print them."""

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, Literal

from rft_ros.errors import InputError
from rft_ros.estimator.alpha_y_table import read_alpha_y_table
from rft_ros.estimator.settings import LoadCell, Model, Settings
from rft_ros.rft import ALPHA_Y_MODELS, MEDIA, alpha_y_model, medium_named, treers2021
from rft_ros.rft.frames import UNIT_TOLERANCE
from rft_ros.tool import Tool, load_tool

__all__ = ["PARAMETERS", "Parameter", "Value", "Values", "checked", "defaults", "model_of", "settings_of"]

Value = str | float | tuple[float, ...]
Values = Mapping[str, Value]


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One parameter: its type is that of its default. `low`, `high`: inclusive, for each number of it."""

    name: str
    default: Value
    unit: str
    description: str
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
        name="mesh.file",
        default="plate",
        unit="",
        description="Tool mesh: a path, a package:// URI, or the name of a shipped mesh"
        " (plate, ellipsoid, root_tip, sphere, abb_plate).",
    ),
    Parameter(name="mesh.scale", default=0.001, unit="m", low=1e-9, high=1e6, description="Metres per mesh unit."),
    Parameter(
        name="mesh.origin",
        default=_ZERO3,
        unit="mesh units",
        description="Where the tool frame's origin lies, in mesh-file coordinates.",
    ),
    Parameter(
        name="medium.name",
        default="generic",
        unit="",
        choices=tuple(MEDIA),
        description="Medium whose measured stresses are used (Li et al. 2013).",
    ),
    Parameter(
        name="medium.zeta",
        default=1.0,
        unit="",
        low=1e-6,
        high=1e6,
        description="Scale factor of the medium, from calibration.",
    ),
    Parameter(
        name="alpha_y.model",
        default="constant",
        unit="",
        choices=ALPHA_Y_MODELS,
        description="Stress along the plate's horizontal direction e1.",
    ),
    Parameter(
        name="alpha_y.table",
        default="",
        unit="deg, N/cm3",
        description="CSV of beta, alpha_y or beta, gamma, alpha_y for alpha_y.model table.",
    ),
    Parameter(
        name="integration",
        default="centroid",
        unit="",
        choices=("centroid",),
        description="Rule for plates: the published one takes depth and velocity at the centroid.",
    ),
    Parameter(
        name="surface_height",
        default=0.0,
        unit="m",
        low=-1e6,
        high=1e6,
        description="z of the undisturbed surface in world_frame.",
    ),
    Parameter(name="world_frame", default="world", unit="", description="frame_id of poses; z up."),
    Parameter(name="tool_frame", default="tool", unit="", description="Frame of the mesh; twists may be in its axes."),
    Parameter(
        name="sensor_frame",
        default="ft_sensor",
        unit="",
        description="frame_id of the load cell, and of all published wrenches.",
    ),
    Parameter(
        name="sensor.position",
        default=_ZERO3,
        unit="m",
        low=-1e3,
        high=1e3,
        description="Origin of sensor_frame in tool_frame.",
    ),
    Parameter(
        name="sensor.quaternion",
        default=(0.0, 0.0, 0.0, 1.0),
        unit="xyzw",
        description="Orientation of sensor_frame in tool_frame, unit length.",
    ),
    Parameter(
        name="sensor.sign",
        default=1.0,
        unit="",
        low=-1.0,
        high=1.0,
        description="1.0: the driver reports the force on the tool; -1.0: the force by the tool.",
    ),
    Parameter(
        name="sensor.bias",
        default=(0.0,) * 6,
        unit="N, N m",
        low=-1e6,
        high=1e6,
        description="What the driver reports with nothing attached: fx, fy, fz, tx, ty, tz.",
    ),
    Parameter(
        name="sensor.mass",
        default=0.0,
        unit="kg",
        low=0.0,
        high=1e3,
        description="Mass that hangs below the load cell.",
    ),
    Parameter(
        name="sensor.center_of_mass",
        default=_ZERO3,
        unit="m",
        low=-1e3,
        high=1e3,
        description="Centre of that mass in sensor_frame.",
    ),
    Parameter(
        name="twist_source",
        default="topic",
        unit="",
        choices=("topic", "pose_difference"),
        description="Velocity from ~/twist, or from the last poses.",
    ),
    Parameter(
        name="twist_window",
        default=0.05,
        unit="s",
        low=1e-4,
        high=1.0,
        description="Span of poses that pose_difference fits a line to.",
    ),
    Parameter(
        name="max_input_age",
        default=0.1,
        unit="s",
        low=1e-6,
        high=1e6,
        description="Greatest difference between a pose's stamp and those of the twist and wrench used with it.",
    ),
    Parameter(
        name="max_rate",
        default=0.0,
        unit="Hz",
        low=0.0,
        high=1e6,
        description="Answer at most this often; 0.0: every pose.",
    ),
    Parameter(
        name="rest_speed",
        default=2e-4,
        unit="m/s",
        low=0.0,
        high=1e3,
        description="Below this speed of its fastest point a tool in the grains is at rest: no estimate.",
    ),
    Parameter(
        name="executor",
        default="single",
        unit="",
        choices=("single", "events"),
        applies="restart",
        description="rclpy executor: single-threaded, or the experimental one with half its latency.",
    ),
)

_BY_NAME = {p.name: p for p in PARAMETERS}


def defaults() -> dict[str, Value]:
    """Every parameter at its default."""
    return {p.name: p.default for p in PARAMETERS}


def checked(name: str, value: object) -> Value:
    """The value in the parameter's own type, or InputError with a sentence that names both and says what is allowed."""
    parameter = _BY_NAME.get(name)
    if parameter is None:
        near = get_close_matches(name, _BY_NAME, n=1)
        raise InputError(f"there is no parameter '{name}'" + (f"; did you mean '{near[0]}'?" if near else ""))
    if parameter.type == "string":
        if not isinstance(value, str):
            raise InputError(f"{name} is {value!r}; it must be a string")
        if parameter.choices and value not in parameter.choices:
            raise InputError(f"{name} is '{value}'; it must be one of {', '.join(parameter.choices)}")
        return value
    if parameter.type == "double":
        number = _number(parameter, value)
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


_LARGEST = sys.float_info.max  # also bounds integers that are no double, which math.isfinite raises at


def _number(parameter: Parameter, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _LARGEST:
        raise InputError(f"{parameter.name} is {value!r}; it must be a finite number (such as 1.0)")
    if not parameter.low <= value <= parameter.high:
        raise InputError(f"{parameter.name} is {value:g}; it must lie between {parameter.low:g} and {parameter.high:g}")
    return float(value)


def settings_of(values: Values) -> Settings:
    """The estimator's settings in checked values."""
    v: Mapping[str, Any] = values
    cell = LoadCell(
        position=v["sensor.position"],
        quaternion=v["sensor.quaternion"],
        sign=v["sensor.sign"],
        bias=v["sensor.bias"],
        mass=v["sensor.mass"],
        center_of_mass=v["sensor.center_of_mass"],
    )
    plain = ("world_frame", "tool_frame", "sensor_frame", "surface_height", "twist_source", "twist_window")
    gates = ("max_input_age", "max_rate", "rest_speed")
    return Settings(load_cell=cell, **{name: v[name] for name in (*plain, *gates)})


def model_of(values: Values, *, tool: Tool | None = None, generation: int = 0) -> Model:
    """The model in checked values; loads the tool unless it is given. InputError names what cannot be used."""
    v: Mapping[str, Any] = values
    medium = medium_named(v["medium.name"])
    name = v["alpha_y.model"]
    if name == "table" and not v["alpha_y.table"]:
        raise InputError("alpha_y.model 'table' needs alpha_y.table to name a CSV file; set that first")
    table = read_alpha_y_table(v["alpha_y.table"]) if name == "table" else None
    return Model(
        tool=tool or load_tool(v["mesh.file"], scale=v["mesh.scale"], origin=v["mesh.origin"]),
        law=treers2021(medium, alpha_y_model(name, medium, table), zeta=v["medium.zeta"]),
        medium=medium.name,
        zeta=v["medium.zeta"],
        alpha_y=name,
        generation=generation,
    )

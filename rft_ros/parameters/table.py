"""The table of all parameters, which node, replay and docs share, and checks of values."""

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from difflib import get_close_matches
from typing import Any, Literal

from rft_ros.errors import InputError, shown
from rft_ros.parameters.settings import LoadCell, Settings
from rft_ros.rft import ALPHA_Y_MODELS, INERTIA, INTEGRATIONS, LAWS, MEDIA, SURFACE_FRICTION
from rft_ros.rft.frames import UNIT_TOLERANCE

__all__ = ["MESH", "PARAMETERS", "Parameter", "Value", "Values", "checked", "defaults", "unknown_parameter"]

Value = str | float | tuple[float, ...]
"""A parameter's value, in the parameter's type."""

Values = Mapping[str, Any]
"""The values of all parameters, by name, each a `Value`."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter. Its values have the type of `default`.

    `bounds`: least and greatest value of each number. `least`: of a length [m] that may be 0, the least other value.
    `kind`: "frame" for the name of a frame, "quaternion" for the four numbers of a rotation, "sign" for 1 or -1.
    `choices`: the values that a text may have; empty: any. `applies`: "live", or "restart" if the running node refuses
    a change.
    """

    name: str
    default: Value
    description: str
    unit: str = ""
    bounds: tuple[float, float] = (-math.inf, math.inf)
    _: KW_ONLY
    kind: Literal["", "frame", "quaternion", "sign"] = ""
    least: float = 0.0
    choices: tuple[str, ...] = ()
    applies: Literal["live", "restart"] = "live"


MESH = (
    "path, package:// or file:// URI, robot.urdf#link, or name of a shipped mesh (plate, ellipsoid, root_tip, sphere,"
    " abb_plate, scoop)"
)
"""The forms of a value of mesh.file, for help texts."""

_ORIGIN, _IDENTITY = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
_SETTINGS, _LOAD_CELL = Settings(), LoadCell()
"""The defaults of the parameters that are fields of these."""

PARAMETERS = (
    Parameter("mesh.file", "plate", f"Tool mesh: {MESH}; a path is relative to the parameter file."),
    Parameter(
        "mesh.scale",
        0.0,
        "Metres per mesh unit. 0.0: the unit that the file declares (COLLADA, glTF, URDF), or a millimetre.",
        "m",
        (0.0, 1e6),
        least=1e-9,
    ),
    Parameter("mesh.origin", _ORIGIN, "Where the tool frame's origin lies, in mesh-file coordinates.", "mesh units"),
    Parameter(
        "mesh.quaternion",
        _IDENTITY,
        "Orientation of the mesh file's axes in tool_frame, unit length.",
        "xyzw",
        kind="quaternion",
    ),
    Parameter(
        "law",
        "treers2021",
        "Traction law. agarwal2023 has its own coefficients and ignores medium.name, medium.file and alpha_y.model.",
        choices=LAWS,
    ),
    Parameter(
        "medium.name",
        "generic",
        "Medium whose coefficients give the stresses, as measured by Li et al. 2013. medium.zeta scales them.",
        choices=tuple(MEDIA),
    ),
    Parameter(
        "medium.file",
        "",
        "A medium of your own in place of medium.name: nine coefficients (YAML), or a measured stress map (CSV).",
        "N/cm3",
    ),
    Parameter("medium.zeta", 1.0, "Scale factor of the medium, from calibration.", bounds=(1e-6, 1e6)),
    Parameter(
        "medium.zeta_error",
        _SETTINGS.zeta_error or 0.0,
        "Relative standard error of medium.zeta. 0.0: not known.",
        bounds=(0.0, 2.0),
    ),
    Parameter(
        "medium.mobilization_length",
        0.003,
        "Memory of the grains: displacement over which the force at 30 mm depth reaches 63 % of its full value. "
        "With memory the force holds at rest. 0.0: no memory, as published.",
        "m",
        (0.0, 1e3),
    ),
    Parameter(
        "medium.calibrated_depth",
        _SETTINGS.calibrated_depth or 0.0,
        "Greatest depth reached in the calibration. Estimates at greater depth get the flag deep. 0.0: not known.",
        "m",
        (0.0, 1e3),
    ),
    Parameter("medium.density", 0.0, "Bulk density, for the grains' inertia. 0.0: no inertia.", "kg/m3", (0.0, 1e5)),
    Parameter(
        "medium.inertia",
        INERTIA,
        "Factor of the grains' inertia on an upright plate. On a level plate that moves down it is three times as "
        "large.",
        bounds=(0.0, 100.0),
    ),
    Parameter(
        "medium.surface_friction",
        SURFACE_FRICTION,
        "Coefficient of friction between grains and tool, for law agarwal2023.",
        bounds=(0.0, 10.0),
    ),
    Parameter(
        "alpha_y.model",
        "linear",
        "Model of the sideways stress: the stress along the horizontal direction that lies in the plate.",
        choices=ALPHA_Y_MODELS,
    ),
    Parameter(
        "alpha_y.table",
        "",
        "CSV file for alpha_y.model table, with the columns beta, alpha_y, or beta, gamma, alpha_y. Its header may "
        "name other units; without a header they stand in this order.",
        "deg, N/cm3",
    ),
    Parameter(
        "integration",
        "refined",
        "Integration rule. refined: cuts facets at the surface, and lets a facet's force grow gradually as it turns "
        "towards the motion. centroid: as published, evaluates each facet at its centroid.",
        choices=INTEGRATIONS,
    ),
    Parameter(
        "tolerance",
        0.025,
        "Reduce the tool to the fewest plates whose force and torque deviate by at most this share in 95 % of random "
        "motions. 0.0: use all plates.",
        bounds=(0.0, 1.0),
    ),
    Parameter(
        "learning.mode",
        _SETTINGS.learning_mode,
        "Estimate the medium from the load cell. observe: only report the estimates. apply: also correct the "
        "predictions.",
        choices=("off", "observe", "apply"),
    ),
    Parameter(
        "learning.lag",
        _SETTINGS.learning_lag,
        "Path of the tool between a load-cell sample and the first prediction that uses it.",
        "m",
        (1e-5, 1.0),
    ),
    Parameter(
        "feedforward.gain",
        0.0,
        "Factor of the prediction on ~/wrench_feedforward. -1.0: the wrench that cancels the force of the "
        "grains. 0.0: publish no such wrench.",
        bounds=(-2.0, 2.0),
    ),
    Parameter(
        "feedforward.frame",
        "sensor_frame",
        "Axes of ~/wrench_feedforward. Its torque is about the sensor's origin in sensor_frame, otherwise "
        "about the tool frame's origin.",
        choices=("sensor_frame", "tool_frame", "world_frame"),
        applies="restart",
    ),
    Parameter(
        "feedforward.limit",
        (20.0, 2.0),
        "Largest force and largest torque of ~/wrench_feedforward.",
        "N, N m",
        (0.0, 1e4),
    ),
    Parameter(
        "feedforward.rise_time",
        0.2,
        "Least time from zero to feedforward.limit, and back. When the node ends, the way back takes at most 0.25 s.",
        "s",
        (0.01, 1.0),
    ),
    Parameter(
        "feedforward.timeout",
        0.1,
        "Without an estimate for this time, ~/wrench_feedforward goes to zero.",
        "s",
        (0.005, 1.0),
    ),
    Parameter(
        "surface_height", _SETTINGS.surface_height, "z of the undisturbed surface in world_frame.", "m", (-1e6, 1e6)
    ),
    Parameter(
        "ground.cell",
        0.0,
        "Side of a cell of the height map of the ground. 0.0: the ground is a level plane.",
        "m",
        (0.0, 1.0),
        least=1e-4,
    ),
    Parameter(
        "ground.file",
        "",
        "Heights of the ground at the start, in world_frame: CSV with columns x, y, h, or NPZ. Needs ground.cell.",
        "m",
    ),
    Parameter("world_frame", _SETTINGS.world_frame, "frame_id of poses; z up.", kind="frame"),
    Parameter("tool_frame", _SETTINGS.tool_frame, "Frame of the mesh; twists may be in its axes.", kind="frame"),
    Parameter(
        "sensor_frame",
        _SETTINGS.sensor_frame,
        "frame_id of the load cell, and of all published wrenches.",
        kind="frame",
    ),
    Parameter("sensor.position", _LOAD_CELL.position, "Origin of sensor_frame in tool_frame.", "m", (-1e3, 1e3)),
    Parameter(
        "sensor.quaternion",
        _LOAD_CELL.quaternion,
        "Orientation of sensor_frame in tool_frame, unit length.",
        "xyzw",
        kind="quaternion",
    ),
    Parameter(
        "sensor.frame_source",
        _SETTINGS.sensor_source,
        "Source of the sensor's place on the tool. parameters: sensor.position and sensor.quaternion. tf: "
        "fixed transforms. world: as parameters, but the readings are in the axes of world_frame, whatever their "
        "frame_id says.",
        choices=("parameters", "tf", "world"),
    ),
    Parameter(
        "sensor.sign",
        _LOAD_CELL.sign,
        "1.0: the driver reports the force that acts on the tool. -1.0: the force with which the tool pushes.",
        bounds=(-1.0, 1.0),
        kind="sign",
    ),
    Parameter(
        "sensor.bias",
        _LOAD_CELL.bias,
        "Reading of the load cell without load: fx, fy, fz, tx, ty, tz.",
        "N, N m",
        (-1e6, 1e6),
    ),
    Parameter("sensor.mass", _LOAD_CELL.mass, "Mass that hangs below the load cell.", "kg", (0.0, 1e3)),
    Parameter(
        "sensor.center_of_mass", _LOAD_CELL.center_of_mass, "Centre of that mass in sensor_frame.", "m", (-1e3, 1e3)
    ),
    Parameter(
        "sensor.delay",
        _LOAD_CELL.delay,
        "How much later than the poses' stamps those of the load cell are for one event; negative: earlier.",
        "s",
        (-10.0, 10.0),
    ),
    Parameter(
        "pose_source",
        _SETTINGS.pose_source,
        "Source of the pose. topic: ~/pose. tf: the transforms of TF.",
        choices=("topic", "tf"),
        applies="restart",
    ),
    Parameter(
        "tf_rate",
        _SETTINGS.tf_rate,
        "Rate of the poses from TF. 0.0: a pose at each stamp of the load cell.",
        "Hz",
        (0.0, 1e4),
    ),
    Parameter(
        "twist_source",
        _SETTINGS.twist_source,
        "Source of the velocity. topic: ~/twist. pose_difference: computed from the last poses.",
        choices=("topic", "pose_difference"),
    ),
    Parameter(
        "twist_window",
        _SETTINGS.twist_window,
        "Longest span of poses to which pose_difference fits a curve.",
        "s",
        (1e-4, 1.0),
    ),
    Parameter(
        "max_input_age",
        _SETTINGS.max_input_age,
        "Greatest time between a pose and another sample that is used with it.",
        "s",
        (1e-6, 1e6),
    ),
    Parameter(
        "max_rate", _SETTINGS.max_rate, "Highest rate of estimates. 0.0: an estimate at every pose.", "Hz", (0.0, 1e6)
    ),
    Parameter(
        "rest_speed",
        _SETTINGS.rest_speed,
        "A tool that is slower than this is at rest. The filter is then not updated. If the model has no memory and "
        "the tool is in the grains, there is no estimate either.",
        "m/s",
        (0.0, 1e3),
    ),
    Parameter(
        "executor",
        "events",
        "Executor of rclpy. events uses half the CPU of single.",
        choices=("events", "single"),
        applies="restart",
    ),
)
"""Every parameter, in the order in which they are documented."""

_BY_NAME = {p.name: p for p in PARAMETERS}
_LONGEST, _LONGEST_FRAME = 4096, 256  # characters, of a path and of a frame
_LARGEST = sys.float_info.max  # a comparison with it also refuses large integers, for which math.isfinite raises


def defaults() -> dict[str, Any]:
    """Every parameter at its default."""
    return {p.name: p.default for p in PARAMETERS}


def unknown_parameter(name: str) -> str:
    """A sentence for a parameter that does not exist; it proposes the most similar name."""
    if len(name) > _LONGEST_FRAME:
        return f"there is no parameter with a name of {len(name):,} characters"
    similar = get_close_matches(name, _BY_NAME, n=1)
    if similar:
        return f"there is no parameter '{name}'; did you mean '{similar[0]}'?"
    return f"there is no parameter '{name}'"


def checked(name: str, value: object) -> Value:
    """The value in the parameter's type. Raises InputError that names parameter and value and says what is allowed."""
    parameter = _BY_NAME.get(name)
    if parameter is None:
        raise InputError(unknown_parameter(name))
    default, choices = parameter.default, parameter.choices
    if isinstance(default, str):
        if value is False and "off" in choices:  # YAML, and so ROS, reads an unquoted off as false
            value = "off"
        if not isinstance(value, str):
            raise InputError(f"{name} is {shown(value)}; it must be a string")
        limit = _LONGEST_FRAME if parameter.kind == "frame" else _LONGEST
        if len(value) > limit:
            raise InputError(f"{name} has {len(value):,} characters; the limit is {limit:,}")
        if choices and value not in choices:
            raise InputError(f"{name} is {shown(value)}; it must be one of {', '.join(choices)}")
        return value
    if isinstance(default, float):
        number = _number(parameter, value)
        if 0.0 < number < parameter.least:
            raise InputError(f"{name} is {number:g}; it must be 0, or at least {parameter.least:g} m")
        if parameter.kind == "sign" and abs(number) != 1.0:
            raise InputError(f"{name} is {number:g}; it must be 1.0 or -1.0")
        return number
    if isinstance(value, str) or not isinstance(value, Sequence) or len(value) != len(default):
        raise InputError(f"{name} is {shown(value)}; it must be {len(default)} numbers")
    numbers = tuple(_number(parameter, v) for v in value)
    if parameter.kind == "quaternion":
        norm = math.hypot(*numbers)
        if not abs(norm - 1.0) <= UNIT_TOLERANCE:
            raise InputError(f"{name} has norm {norm:g}; it must be 1")
        numbers = tuple(v / norm for v in numbers)
    return numbers


def _number(parameter: Parameter, value: object) -> float:
    name, (low, high) = parameter.name, parameter.bounds
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _LARGEST:
        raise InputError(f"{name} is {shown(value)}; it must be a finite number (such as 1.0)")
    if not low <= value <= high:
        raise InputError(f"{name} is {value:g}; it must lie between {low:g} and {high:g}")
    return float(value)

"""Values of the parameters in `parameter_table`: checked, and made into what the estimator needs."""

import math
import sys
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Any

from rft_ros.errors import InputError
from rft_ros.estimator.alpha_y_table import read_alpha_y_table
from rft_ros.estimator.parameter_table import PARAMETERS, Parameter, Value, Values
from rft_ros.estimator.settings import LoadCell, Model, Settings
from rft_ros.rft import alpha_y_model, medium_named, treers2021
from rft_ros.rft.frames import UNIT_TOLERANCE
from rft_ros.tool import Tool, ToolRequest

__all__ = [
    "PARAMETERS",
    "TOOL_PARAMETERS",
    "Parameter",
    "Value",
    "Values",
    "checked",
    "defaults",
    "model_of",
    "settings_of",
    "tool_request",
]

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
    depth = v["medium.calibrated_depth"]
    return Settings(load_cell=cell, calibrated_depth=depth, **{name: v[name] for name in (*plain, *gates)})


TOOL_PARAMETERS = {
    "file": "mesh.file",
    "scale": "mesh.scale",
    "origin": "mesh.origin",
    "integration": "integration",
    "tolerance": "tolerance",
}
"""Which parameter holds each field of a `ToolRequest`."""


def tool_request(values: Values) -> ToolRequest:
    """The tool that checked values ask for."""
    v: Mapping[str, Any] = values
    return ToolRequest(**{field: v[name] for field, name in TOOL_PARAMETERS.items()})


def model_of(values: Values, *, tool: Tool | None = None, generation: int = 0) -> Model:
    """The model in checked values; loads the tool unless it is given. InputError names what cannot be used."""
    v: Mapping[str, Any] = values
    medium = medium_named(v["medium.name"])
    name = v["alpha_y.model"]
    if name == "table" and not v["alpha_y.table"]:
        raise InputError("alpha_y.model 'table' needs alpha_y.table to name a CSV file; set that first")
    table = read_alpha_y_table(v["alpha_y.table"]) if name == "table" else None
    return Model(
        tool=tool or tool_request(values).load(),
        law=treers2021(medium, alpha_y_model(name, medium, table), zeta=v["medium.zeta"]),
        medium=medium.name,
        zeta=v["medium.zeta"],
        alpha_y=name,
        mobilization_length=v["medium.mobilization_length"],
        generation=generation,
    )

"""One parameter: its default, its allowed values and what it means; and the check of a value."""

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import (
    KW_ONLY,
    dataclass,
    field,
    fields,
    replace,
)
from functools import cache
from typing import (
    Any,
    Literal,
    NoReturn,
    TypeVar,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

from rft_ros.errors import InputError, shown
from rft_ros.rft.frames import UNIT_NORM_TOLERANCE_RATIO
from rft_ros.rft.motion_kinds import MOTIONS

Value = str | bool | float | tuple[float, ...]
"""A parameter's value, in the parameter's type."""

_Group = TypeVar("_Group")

Values = Mapping[str, Any]
"""The values of all parameters, by name, each a `Value`."""

_MAX_CHARACTER_COUNT = 4096  # of a text
# a comparison with it also refuses large integers, for which math.isfinite raises
_LARGEST = sys.float_info.max


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter. Its values have the type of `default`.

    `bounds`: least and greatest value of each number. `least`: of a length [m] that may be 0, the least other value.
    `kind`: "file" for a file's path, "motions" for names of `MOTIONS` with commas, "quaternion" for the four numbers of
    a rotation, "sign" for 1 or -1. `is_optional`: as a field of a dataclass it is None where it has its default.
    `choices`: the values that a text may have; empty: any. `applies`: "live", or "restart" if the running node refuses
    a change. `option`: its short name on the command line (``--alpha-y`` for alpha_y) and in a study of `rft sweep`;
    empty: none.
    """

    name: str
    default: Value
    description: str = ""
    unit: str = ""
    bounds: tuple[float, float] = (-math.inf, math.inf)
    _: KW_ONLY
    least: float = 0.0
    kind: Literal["", "file", "motions", "quaternion", "sign"] = ""
    is_optional: bool = False
    choices: tuple[str, ...] = ()
    applies: Literal["live", "restart"] = "live"
    option: str = ""

    def checked(self, value: object) -> Value:
        """The value in the parameter's type. Raises InputError that names parameter and value, and what is allowed."""
        if isinstance(self.default, str):
            return self._text(value)
        if isinstance(self.default, bool):
            if not isinstance(value, bool):
                self._refuse(value, "true or false")
            return value
        if isinstance(self.default, float):
            return self._number(value)
        count = len(self.default)
        if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != count:
            self._refuse(value, f"{count} numbers")
        numbers = tuple(map(self._number, value))
        return self._unit(numbers) if self.kind == "quaternion" else numbers

    def _refuse(self, value: object, allowed_values: str) -> NoReturn:
        raise InputError(f"{self.name} is {shown(value)}; it must be {allowed_values}")

    def _text(self, value: object) -> str:
        if value is False and "off" in self.choices:  # as YAML reads an unquoted off
            return "off"
        if not isinstance(value, str):
            self._refuse(value, "a string")
        if len(value) > _MAX_CHARACTER_COUNT:
            self._refuse(value, f"a text of at most {_MAX_CHARACTER_COUNT:,} characters")
        if self.choices and value not in self.choices:
            self._refuse(value, f"one of {', '.join(self.choices)}")
        motions = {motion.strip() for motion in value.split(",")}
        if self.kind == "motions" and not motions <= {"", *MOTIONS}:
            self._refuse(value, f"some of {', '.join(MOTIONS)}, with commas")
        return value

    def _number(self, value: object) -> float:
        allowed_values = "a finite number (such as 1.0)"
        if isinstance(value, bool) or not isinstance(value, int | float):
            self._refuse(value, allowed_values)
        if not abs(value) <= _LARGEST:
            self._refuse(value, allowed_values)
        low, high = self.bounds
        if not low <= value <= high:
            raise InputError(f"{self.name} is {value:g}; it must lie between {low:g} and {high:g}")
        if 0.0 < value < self.least:
            self._refuse(value, f"0, or at least {self.least:g} m")
        if self.kind == "sign" and abs(value) != 1.0:
            self._refuse(value, "1.0 or -1.0")
        return float(value)

    def _unit(self, numbers: tuple[float, ...]) -> tuple[float, ...]:
        """The quaternion with a norm of exactly 1."""
        norm = math.hypot(*numbers)
        if not abs(norm - 1.0) <= UNIT_NORM_TOLERANCE_RATIO:
            raise InputError(f"{self.name} has norm {norm:g}; it must be 1")
        return tuple(v / norm for v in numbers)


def setting(*given: Any, **options: Any) -> Any:
    """A field of a dataclass with the value of the `Parameter` of these arguments.

    If its type is a Literal, that gives the choices.
    """
    parameter = Parameter(*given, **options)
    default = None if parameter.is_optional else parameter.default
    return field(default=default, metadata={"parameter": parameter})


@cache
def parameter_fields(owner: type) -> dict[str, Parameter]:
    """The parameters that are fields of a dataclass, by the names of the fields."""
    hints = get_type_hints(owner)
    found = {}
    for f in fields(owner):
        if "parameter" in f.metadata:
            parameter = f.metadata["parameter"]
            if get_origin(hints[f.name]) is Literal:
                parameter = replace(parameter, choices=get_args(hints[f.name]))
            found[f.name] = parameter
    return found


def with_values(group: _Group, values: Values) -> _Group:
    """The same dataclass with other values of those fields that are among these parameters. Raises InputError."""
    owner: type = type(group)
    given: dict[str, Any] = {}
    for name, parameter in parameter_fields(owner).items():
        if parameter.name in values:
            value = parameter.checked(values[parameter.name])
            is_unset = parameter.is_optional and value == parameter.default
            given[name] = None if is_unset else value
    if not given:
        return group
    changed: _Group = replace(cast(Any, group), **given)
    return changed


def parameter_values(group: object) -> dict[str, Value]:
    """The values of the fields of a dataclass that are parameters, by the names of the parameters."""
    owner: type = type(group)
    found: dict[str, Value] = {}
    for name, parameter in parameter_fields(owner).items():
        value = getattr(group, name)
        found[parameter.name] = parameter.default if value is None else value
    return found

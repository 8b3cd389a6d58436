"""Parameters by name: the check of a value, and those that name a file or have a short name."""

from rft_ros.errors import InputError
from rft_ros.parameters.config import PARAMETERS, unknown_parameter
from rft_ros.parameters.parameter import Value

_BY_NAME = {p.name: p for p in PARAMETERS}

FILES = tuple(p.name for p in PARAMETERS if p.kind == "file")
"""Parameters that name a file. A relative path in them starts at the folder of the parameter file."""

OPTIONS = {p.option: p for p in PARAMETERS if p.option}
"""The parameter of each short name."""


def checked(name: str, value: object) -> Value:
    """The value in the parameter's type. Raises InputError that names parameter and value and says what is allowed."""
    if name not in _BY_NAME:
        raise InputError(unknown_parameter(name))
    return _BY_NAME[name].checked(value)

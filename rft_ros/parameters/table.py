"""Parameters by name: the check of a value, and those that name a file or have a short name."""

from difflib import get_close_matches

from rft_ros.errors import InputError, shown
from rft_ros.parameters.config import PARAMETERS
from rft_ros.parameters.parameter import Value

_BY_NAME = {p.name: p for p in PARAMETERS}

FILES = tuple(p.name for p in PARAMETERS if p.kind == "file")
"""Parameters that name a file. A relative path in them starts at the folder of the parameter file."""

OPTIONS = {p.option: p for p in PARAMETERS if p.option}
"""The parameter of each short name."""


def unknown_parameter(name: str) -> str:
    """A sentence for a parameter that does not exist; it proposes the most similar name."""
    similar = get_close_matches(name[:99], _BY_NAME, n=1)
    if similar:
        return f"there is no parameter {shown(name)}; did you mean '{similar[0]}'?"
    return f"there is no parameter {shown(name)}"


def checked(name: str, value: object) -> Value:
    """The value in the parameter's type. Raises InputError that names parameter and value and says what is allowed."""
    if name not in _BY_NAME:
        raise InputError(unknown_parameter(name))
    return _BY_NAME[name].checked(value)

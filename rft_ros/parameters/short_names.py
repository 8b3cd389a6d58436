"""Short names of parameters in design studies and in options of the command line, such as `zeta` for `medium.zeta`."""

from collections.abc import Mapping
from typing import Any

from rft_ros.parameters.medium_file import is_medium_file
from rft_ros.parameters.table import Values, checked, defaults
from rft_ros.rft import LAW_NUMBERS

__all__ = ["OF_MEDIUM", "OF_TOOL", "SHORT_NAMES", "parameters_of"]

OF_TOOL = {
    "mesh": "mesh.file",
    "scale": "mesh.scale",
    "origin": "mesh.origin",
    "rotate": "mesh.quaternion",
    "integration": "integration",
    "tolerance": "tolerance",
}
"""The parameter of each short name in an entry on a tool."""

OF_MEDIUM = {
    "law": "law",
    "medium": "medium.name",
    "alpha_y": "alpha_y.model",
    "surface_height": "surface_height",
    **{name: f"medium.{name}" for name in LAW_NUMBERS},
}
"""The parameter of each short name in an entry on a medium."""

SHORT_NAMES = OF_TOOL | OF_MEDIUM
"""The parameter of each short name."""


def parameters_of(entry: Mapping[str, Any]) -> Values:
    """The node's parameters from an entry's short names; the others have their defaults. Raises InputError.

    Tools are not reduced. Without an integration, a tool has the rule of its file.
    """
    given = {SHORT_NAMES[key]: value for key, value in entry.items()}
    medium = given.get("medium.name")
    if isinstance(medium, str) and is_medium_file(medium):
        given |= {"medium.name": defaults()["medium.name"], "medium.file": medium}
    checks = {name: checked(name, value) for name, value in given.items()}
    return {**defaults(), "tolerance": 0.0, "integration": None, **checks}

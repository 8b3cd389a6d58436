"""Makes a `Config` from the short names of options and studies."""

from collections.abc import Mapping
from typing import Any

from rft_ros.parameters.config import Config
from rft_ros.parameters.medium_file import is_medium_file
from rft_ros.parameters.table import OPTIONS, checked


def config_of_options(entry: Mapping[str, Any]) -> Config:
    """The parameters from an entry's short names; the others have their defaults. Raises InputError.

    Tools are not reduced. A medium with a suffix or a folder is a file.
    """
    given = {OPTIONS[name].name: value for name, value in entry.items()}
    medium = given.get("medium.name")
    if isinstance(medium, str) and is_medium_file(medium):
        given["medium.file"] = given.pop("medium.name")
    checks = {name: checked(name, value) for name, value in given.items()}
    return Config.of({"tolerance": 0.0, **checks})

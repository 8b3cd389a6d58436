"""The sections of a parameter file: the parameters that it sets for the nodes of one name, as ROS reads them.

test/ros/test_parameter_files.py compares them with those of real nodes.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rft_ros.errors import InputError, shown
from rft_ros.yaml_file import read_yaml, yaml_content

Given = bool | int | float | str | list[bool] | list[int] | list[float] | list[str]
"""A value in a parameter file, of the type that ROS reads."""

_KEY = "ros__parameters"
_PART = r"(\*\*?|[A-Za-z_][A-Za-z0-9_]*)"
_NODE = re.compile(f"/?{_PART}(/{_PART})*")


@dataclass(frozen=True, slots=True)
class Section:
    """The parameters that a file sets for the nodes of one name.

    `key`: the name as it is written. `name`: the full name with its namespace, which begins with "/"; ``/*`` stands for
    one part of any name and ``/**`` for any number of parts. `parameters`: by name with dots.
    """

    key: str
    parameters: dict[str, Given]

    @property
    def name(self) -> str:
        """The full name."""
        return self.key if self.key.startswith("/") else f"/{self.key}"

    def is_for(self, node: str) -> bool:
        """Whether the node with this full name takes the parameters."""
        pattern = self.name.replace("/**", r"(/\w+)*").replace("/*", r"/\w+")
        return bool(re.fullmatch(pattern, node, re.ASCII))


def flat(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """The names of a nested mapping, joined by dots, with their values."""
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def read_sections(file: Path) -> list[Section]:
    """The sections of a parameter file in their order. Raises InputError for a file that ROS reads otherwise."""
    tree = read_yaml(file, "parameter file")
    try:
        if not isinstance(tree, Mapping):
            raise InputError("it has no node name at its top level, such as '/**'")
        sections: dict[str, Section] = {}
        for section in _sections(tree, ""):
            if section.key in sections:
                raise InputError(
                    f"'{section.key}' stands twice; put its parameters into one section"
                )
            sections[section.key] = section
    except InputError as error:
        raise InputError(f"parameter file '{file}': {error}") from None
    return list(sections.values())


def read_value(text: str, named: str) -> Given:
    """The value that ROS reads from ``-p NAME:=text``. Raises InputError, which calls the text `named`."""
    return _checked(named, yaml_content(text, named))


def _sections(tree: Mapping[str, Any], parent: str) -> Iterator[Section]:
    """The sections in a mapping whose keys are names of nodes and namespaces below `parent`."""
    for name, content in tree.items():
        key = f"{parent.rstrip('/')}/{name}" if parent else name
        if name == _KEY:
            raise InputError(f"'{name}' stands where the name of a node is needed, such as '/**'")
        if parent and "/" in name:
            raise InputError(f"'{name}' stands below '{parent}'; write both in one: '{key}'")
        if not isinstance(content, Mapping) or not content:
            where = key if content == {} else parent or key
            raise InputError(
                f"'{where}' has no '{_KEY}'; write '{_KEY}:' below it, and the parameters below that"
            )
        if _KEY not in content:
            yield from _sections(content, key)
            continue
        if len(content) > 1:
            raise InputError(
                f"'{key}' has more than '{_KEY}'; write the rest as a section of its own"
            )
        if not _NODE.fullmatch(key):
            raise InputError(f"'{key}' is no name of a node to ROS; correct it")
        yield Section(key, _parameters(content[_KEY], key))


def _parameters(tree: Any, key: str) -> dict[str, Given]:
    """The parameters below a section's key, by name with dots."""
    if not isinstance(tree, Mapping):
        raise InputError(
            f"'{key}' has a '{_KEY}' without names of parameters; write them below it, as name: value"
        )
    found: dict[str, Given] = {}
    for name, value in flat(tree):
        if name in found:
            raise InputError(f"'{name}' stands twice; remove one")
        found[name] = _checked(name, value)
    return found


def _checked(name: str, value: Any) -> Given:
    """A value of a type that ROS has."""
    if value is None:
        raise InputError(
            f"{name} has no value, where ROS stops or reads text; give it one, or quotes around text"
        )
    items = value if isinstance(value, list) else [value]
    if any(isinstance(item, list | Mapping) for item in items):
        raise InputError(
            f"{name} is {shown(value)}; ROS takes lists of values only, such as [0.0, 0.5]"
        )
    if len(set(map(type, items))) > 1:
        raise InputError(
            f"{name} is {shown(value)}; ROS takes lists of one type only, such as [0.0, 0.5]"
        )
    given: Given = value
    return given

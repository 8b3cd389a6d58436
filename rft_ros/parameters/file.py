"""Reads and writes parameter files. They mean here what they mean to ROS."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rft_ros.errors import InputError, shown
from rft_ros.files import resolved
from rft_ros.parameters.config import Config
from rft_ros.parameters.parameter import Value, Values
from rft_ros.parameters.sections import Given, Section, read_sections
from rft_ros.parameters.table import FILES, checked
from rft_ros.tool import is_mesh_path, locate_mesh
from rft_ros.yaml_file import write_yaml

NODE = "/rft"
"""The node's full name, without a namespace."""


def sections_for(sections: list[Section], node: str = NODE) -> list[Section]:
    """The sections that hold a node's parameters; a later one overrides an earlier one.

    `ros2 param dump` writes a namespace before the node's name, such as /cell/rft. If a file has no section for /rft
    and one such section, that one is taken.
    """
    found = [section for section in sections if section.is_for(node)]
    if found or node != NODE:
        return found
    in_a_namespace = [section for section in sections if section.name.endswith(NODE)]
    return in_a_namespace if len(in_a_namespace) == 1 else []


def node_parameters(file: Path, node: str = NODE) -> dict[str, Given]:
    """The parameters that a file sets for a node, by name with dots. Raises InputError if there are none."""
    sections = read_sections(file)
    found = _merged(sections_for(sections, node))
    if not found:
        there = ", ".join(section.key for section in sections)
        advice = "name a node of it by --node" if node == NODE else "correct --node"
        raise InputError(
            f"parameter file '{file}' has no parameters for the node {node}; its sections are {there}: {advice}"
        )
    return found


def section_parameters(file: Path, name: str) -> dict[str, Given]:
    """The parameters of the section of this name alone; empty where there is none."""
    return _merged(section for section in read_sections(file) if section.name == f"/{name}")


def _merged(sections: Iterable[Section]) -> dict[str, Given]:
    """The parameters of all these sections; a later one overrides an earlier one."""
    found: dict[str, Given] = {}
    for section in sections:
        found |= section.parameters
    return found


def checked_in_file(file: Path, given: Mapping[str, Given]) -> dict[str, Value]:
    """Checked values of the table's parameters in a file, with whole paths."""
    values: dict[str, Value] = {}
    try:
        for name, value in given.items():
            if name == "use_sim_time":
                if not isinstance(value, bool):
                    raise InputError(f"use_sim_time is {shown(value)}; it must be true or false")
            elif not name.startswith("qos_overrides."):
                values[name] = checked(name, value)
    except InputError as error:
        raise InputError(f"parameter file '{file}': {error}") from None
    return placed(values, file.parent)


def read_parameter_file(file: Path, node: str = NODE) -> Config:
    """The parameters that the file sets for the node, checked; the others have their defaults.

    Relative paths are taken from the file's folder (`path_beside`). Raises InputError.
    """
    return Config.of(checked_in_file(file, node_parameters(file, node)))


def named_files(config: Config) -> list[Path]:
    """The files that are set in the parameters of `FILES`."""
    named = (config.medium.file, config.medium.alpha_y_table, config.ground.file)
    return [
        *([locate_mesh(config.mesh.file)] if config.mesh.file else []),
        *map(Path, filter(None, named)),
    ]


def path_beside(folder: Path, name: str, path: str) -> str:
    """A value of a parameter of `FILES`: a relative path is joined to `folder`; other paths, names and URIs stay."""
    if not path or path.startswith("~") or (name == "mesh.file" and not is_mesh_path(path)):
        return path
    return str(folder / path)


def placed(values: Values, folder: Path) -> dict[str, Value]:
    """The values with relative paths in `FILES` joined to a folder."""
    paths = {name: path_beside(folder, name, values[name]) for name in FILES if name in values}
    return {**values, **paths}


def write_parameter_file(file: Path, config: Config, *, comment: str) -> None:
    """Write a file for `read_parameter_file` and the node; relative paths in `FILES` become absolute."""
    tree = {"/**": {"ros__parameters": placed(config.values, Path.cwd())}}
    write_yaml(file, "parameter file", tree, [comment])


Tree = dict[str, dict[str, dict[str, Any]]]
"""Of each section of a parameter file: "ros__parameters", and in it the values by name."""


def tree_for(source: Path, file: Path, node: str = NODE) -> tuple[Tree, dict[str, Any]]:
    """The sections of a parameter file `source`, to be written to `file`, and the parameters that decide for a node.

    Relative paths begin at the folder of `file` then.
    """
    sections = read_sections(source)
    tree: Tree = {s.key: {"ros__parameters": {**s.parameters}} for s in sections}
    parameters: dict[str, Any] = {}
    for section in sections_for(sections, node):
        parameters = tree[section.key]["ros__parameters"]  # at last those that override the others
        for name in parameters.keys() & set(FILES):
            given = str(parameters[name])
            found = path_beside(resolved(source).parent, name, given)
            if found != given:
                parameters[name] = os.path.relpath(found, resolved(file).parent)
    return tree, parameters


def write_changed(
    file: Path,
    source: Path,
    changes: Values,
    *,
    node: str = NODE,
    others: Mapping[str, Mapping[str, Given]] | None = None,
) -> None:
    """Write a parameter file `source` with other values of some parameters of a node; comments are lost.

    `others`: values by name of other sections, such as rft_replay, by the section's name without a namespace.
    """
    tree, parameters = tree_for(source, file, node)
    parameters |= changes
    for name, values in (others or {}).items():
        key = f"/{name}" if f"/{name}" in tree else name
        tree.setdefault(key, {"ros__parameters": {}})["ros__parameters"] |= values
    write_yaml(file, "parameter file", tree, [])

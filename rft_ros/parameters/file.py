"""Files of parameters: parameter files, read without ROS as ROS reads them, and written; tables of α_y."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from rft_ros.errors import InputError
from rft_ros.files import read_text, read_yaml, whole
from rft_ros.parameters.table import Value, Values, checked, defaults
from rft_ros.rft import Table
from rft_ros.tool import is_mesh_path, locate_mesh

__all__ = ["FILES", "NODE", "flat", "named_files", "node_keys", "node_parameters", "parameter_tree"]
__all__ += ["path_beside", "read_alpha_y_table", "read_parameter_file", "write_parameter_file"]

NODE = "/rft"
"""The node's full name, without a namespace."""


def node_keys(tree: Mapping[str, Any], node: str = NODE) -> list[str]:
    """The top-level keys that hold a node's parameters; a later key overrides an earlier one.

    For /rft, if there are none, the one of rft in a namespace, as `ros2 param dump` writes it.
    """
    bare = node.strip("/")
    found = [key for key in ("/**", bare, f"/{bare}", f"/**/{bare.rpartition('/')[2]}") if key in tree]
    others = [key for key in tree if isinstance(key, str) and key.endswith(NODE)]
    return others if node == NODE and not found and len(others) == 1 else found


def parameter_tree(file: Path) -> dict[str, Any]:
    """The content of a parameter file, by node, nested or flat. Raises InputError for what ROS cannot read either."""
    tree = read_yaml(file, "parameter file")
    if not isinstance(tree, dict):
        raise InputError(f"parameter file '{file}' has no node name at its top level, such as '/**'")
    for name, value in flat(tree):
        if isinstance(value, list) and len({type(v) for v in value}) > 1:
            name = name.partition(".ros__parameters.")[2] or name
            needed = "ROS takes lists of one type only, such as [0.0, 0.5]"
            raise InputError(f"parameter file '{file}': {name} is {value}; {needed}")
    return tree


def node_parameters(file: Path, node: str = NODE, *, keys: Iterable[str] | None = None) -> dict[str, Any]:
    """The flat parameters of a node, or of these top-level keys, of which a later one overrides an earlier one."""
    tree = parameter_tree(file)
    found: dict[str, Any] = {}
    for key in node_keys(tree, node) if keys is None else keys:
        section = tree.get(key)
        if section is None:
            continue
        if not isinstance(section, dict) or not isinstance(section.get("ros__parameters"), dict):
            raise InputError(f"parameter file '{file}': '{key}' has no 'ros__parameters'")
        found.update(flat(section["ros__parameters"]))
    return found


def flat(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Names, joined by dots, and values of a nested mapping."""
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def read_parameter_file(file: Path, node: str = NODE) -> dict[str, Value]:
    """Every parameter: the file's value for the node, checked, or the default; paths as by `path_beside`."""
    values = defaults()
    given = node_parameters(file, node)
    if not given:
        there = ", ".join(map(str, parameter_tree(file)))
        raise InputError(f"parameter file '{file}' has no parameters for the node {node}; its sections are {there}")
    for name, value in given.items():
        if name == "use_sim_time" or name.startswith("qos_overrides."):
            continue
        try:
            values[name] = checked(name, value)
        except InputError as error:
            raise InputError(f"parameter file '{file}': {error}") from None
    for name in FILES:
        values[name] = path_beside(file.parent, name, values[name])
    return values


FILES = ("mesh.file", "medium.file", "alpha_y.table", "ground.file")
"""Parameters that name a file, relative to the parameter file."""


def named_files(values: Values) -> list[Path]:
    """The files that the parameters of `FILES` name."""
    return [(locate_mesh if name == "mesh.file" else Path)(values[name]) for name in FILES if values[name]]


def path_beside(folder: Path, name: str, path: str) -> str:
    """A relative path in a parameter of `FILES`, counted from a folder; other paths, mesh names and URIs stay."""
    if not path or path.startswith("~") or (name == "mesh.file" and not is_mesh_path(path)):
        return path
    return str(folder / path)


def write_parameter_file(file: Path, values: Values, *, comment: str) -> None:
    """Write a file that `read_parameter_file` and the node read; a relative path in `FILES` becomes absolute."""
    plain: dict[str, Any] = {name: list(v) if isinstance(v, tuple) else v for name, v in values.items()}
    for name in FILES:
        plain[name] = path_beside(Path.cwd(), name, plain[name])
    tree = {"/**": {"ros__parameters": plain}}
    with whole(file, "parameter file") as part:
        part.write_text(f"# {comment}\n" + yaml.safe_dump(tree, sort_keys=False), encoding="utf-8")


_MAX_TABLE = 4 * 2**20  # 180 x 360 pairs have half of it


def read_alpha_y_table(file: str) -> Table:
    """A table from a CSV file with the columns β [deg], α_y [N/cm³], or β, γ [deg], α_y on a full grid.

    Lines that begin with #, and a first line of words, are skipped. Raises InputError.
    """
    if not file:
        raise InputError("alpha_y.model 'table' needs alpha_y.table to name a CSV file; set that first")
    name, rows = f"alpha_y.table '{file}'", list[list[float]]()
    lines = enumerate(read_text(Path(file), "alpha_y.table", limit=_MAX_TABLE).splitlines(), start=1)
    numbered = [(k, line) for k, line in lines if line.strip() and line.lstrip()[0] != "#"]
    for number, line in numbered:
        try:
            rows.append([float(cell) for cell in line.split(",")])
        except ValueError:
            if number != numbered[0][0] or not line.lstrip(' "')[:1].isalpha():
                raise InputError(f"{name} line {number} is not numbers") from None
    if {len(row) for row in rows} not in ({2}, {3}):
        raise InputError(f"{name} needs rows of 2 numbers (beta, alpha_y) or 3 (beta, gamma, alpha_y)")
    *angles, stresses = np.array(rows).T
    if not np.isfinite(rows).all():
        raise InputError(f"{name} has a value that is not finite")
    if stresses.min() < 0.0:
        raise InputError(f"{name} has a negative alpha_y ({stresses.min():g}); it opposes the motion")
    beta, i = np.unique(angles[0], return_inverse=True)
    gamma, j = np.unique(angles[1] if len(angles) > 1 else np.zeros(len(rows)), return_inverse=True)
    pairs = len(beta) * len(gamma)
    values = np.full((len(beta), len(gamma)) if pairs == len(rows) else (1, 1), np.nan)
    if pairs == len(rows):
        values[i, j] = stresses
    if np.isnan(values).any():
        grid = f"a grid of {len(beta)} beta x {len(gamma)} gamma values needs each pair once ({pairs} rows)"
        raise InputError(f"{name} has {len(rows)} rows; {grid}")
    table = Table.sampled(np.deg2rad(beta), np.deg2rad(gamma), values)
    if not np.isfinite([table.beta_nodes, table.gamma_nodes]).all():
        raise InputError(f"{name} has angles that are too close together")
    return table

"""Reading a ROS 2 parameter file without ROS: the same YAML that ``rft_node --params-file`` takes."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rft_ros.errors import InputError
from rft_ros.estimator.parameters import Value, checked, defaults
from rft_ros.yaml_file import read_yaml

__all__ = ["NODE_KEYS", "node_parameters", "parameter_tree", "read_parameter_file"]

NODE_KEYS = ("/**", "rft", "/rft", "/**/rft")
"""Top-level keys that hold parameters of the node `rft`, later ones over earlier ones."""


def _flat(tree: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def parameter_tree(file: Path) -> dict[str, Any]:
    """A parameter file as it is written: by node, nested and flat names as they come.

    Raises InputError for what ROS would not read either: no YAML, no node at the top, a list of mixed types.
    """
    tree = read_yaml(file, "parameter file")
    if not isinstance(tree, dict):
        raise InputError(f"parameter file '{file}' has no node name at its top level, such as '/**'")
    for name, value in _flat(tree):
        if isinstance(value, list) and len({type(v) for v in value}) > 1:
            name = name.partition(".ros__parameters.")[2] or name
            raise InputError(
                f"parameter file '{file}': {name} is {value}; ROS takes lists of one type only, such as [0.0, 0.5]"
            )
    return tree


def node_parameters(file: Path, node_keys: tuple[str, ...]) -> dict[str, Any]:
    """What a parameter file says for the nodes named, flat, later keys over earlier ones; {} if it names none."""
    tree = parameter_tree(file)
    flat: dict[str, Any] = {}
    for key in node_keys:
        node = tree.get(key)
        if node is None:
            continue
        if not isinstance(node, dict) or not isinstance(node.get("ros__parameters"), dict):
            raise InputError(f"parameter file '{file}': '{key}' has no 'ros__parameters'")
        flat.update(_flat(node["ros__parameters"]))
    return flat


def read_parameter_file(file: Path) -> dict[str, Value]:
    """Every parameter: the file's value where it has one for the node `rft`, checked; else the default."""
    values = defaults()
    flat = node_parameters(file, NODE_KEYS)
    if not flat:
        raise InputError(f"parameter file '{file}' has nothing for the node 'rft' (keys {', '.join(NODE_KEYS)})")
    for name, value in flat.items():
        if name == "use_sim_time" or name.startswith("qos_overrides."):
            continue
        try:
            values[name] = checked(name, value)
        except InputError as error:
            raise InputError(f"parameter file '{file}': {error}") from None
    return values

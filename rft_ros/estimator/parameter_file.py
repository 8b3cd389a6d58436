"""Reading a ROS 2 parameter file without ROS: the same YAML that ``rft_node --params-file`` takes."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from rft_ros.errors import InputError
from rft_ros.estimator.parameters import Value, checked, defaults

__all__ = ["NODE_KEYS", "node_parameters", "parameter_tree", "read_parameter_file"]

NODE_KEYS = ("/**", "rft", "/rft", "/**/rft")
"""Top-level keys that hold parameters of the node `rft`, later ones over earlier ones."""


class _Loader(yaml.SafeLoader):
    """Reads 1e-4 and 1.0e4 as numbers, as ROS does; to PyYAML alone they are strings."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$"), list("-+.0123456789")
)


def _flat(tree: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def parameter_tree(file: Path) -> dict[str, Any]:
    """A parameter file as it is written: by node, nested and flat names as they come."""
    try:
        tree = yaml.load(file.read_text(encoding="utf-8"), Loader=_Loader)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"parameter file '{file}' cannot be read: {error}") from None
    except yaml.YAMLError as error:
        raise InputError(f"parameter file '{file}' is not YAML: {' '.join(str(error).split())}") from None
    if not isinstance(tree, dict):
        raise InputError(f"parameter file '{file}' has no node name at its top level, such as '/**'")
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

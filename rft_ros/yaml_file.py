"""Read YAML as ROS does, with errors that name the file."""

import re
from pathlib import Path
from typing import Any

import yaml

from rft_ros.errors import InputError, reason_of

__all__ = ["read_yaml"]


class _Loader(yaml.SafeLoader):
    """Reads 1e-4 and 1.0e4 as numbers, as ROS does; PyYAML reads strings. Refuses an alias that contains itself."""

    def construct_document(self, node: yaml.Node) -> Any:
        self.deep_construct = True
        return super().construct_document(node)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$"), list("-+.0123456789")
)


def read_yaml(file: Path, what: str) -> Any:
    """Content of a YAML file. InputError, which calls the file `what`, where it cannot be read or is not YAML."""
    try:
        return yaml.load(file.read_text(encoding="utf-8"), Loader=_Loader)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{what} '{file}' cannot be read: {reason_of(error)}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # ValueError: the 99th day of a month
        raise InputError(f"{what} '{file}' is not YAML: {reason_of(error)}") from None

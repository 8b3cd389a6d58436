"""Where packages keep their shared files in this installation, and how to call this package's programs."""

import os
import shutil
import sys
import sysconfig
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

from rft_ros.errors import InputError

__all__ = ["program", "share_directory"]

_MODULES = {"rft": "rft_ros.cli", "rft_node": "rft_ros.node.main"}


def program(name: Literal["rft", "rft_node"]) -> str:
    """What to type to run one of this package's programs here.

    The name alone where it is on the PATH; ``ros2 run`` in a sourced ROS workspace, where it is not; else the script
    beside the running Python, as after ``make venv``, or the module.
    """
    if shutil.which(name):
        return name
    if shutil.which("ros2") and any((prefix / "lib" / "rft_ros" / name).is_file() for prefix in _ament_prefixes()):
        return f"ros2 run rft_ros {name}"
    script = Path(sys.executable).parent / name
    if script.is_file():
        return str(script.relative_to(Path.cwd()) if script.is_relative_to(Path.cwd()) else script)
    return f"{sys.executable} -m {_MODULES[name]}"


def share_directory(package: str) -> Path:
    """The package's share folder, which holds its meshes, configuration and launch files.

    Prefixes in AMENT_PREFIX_PATH come first, as in ROS. Next, if rft_ros runs from a source checkout, the checkout:
    its files belong to the running code, those of an older installation do not. Last, where pip puts data files.
    Raises InputError if the package is in none of them.
    """
    for folder in _candidates(package) if package.strip(".") else []:
        if folder.is_dir():
            return folder
    overlays = os.environ.get("AMENT_PREFIX_PATH") or "not set"
    raise InputError(f"package '{package}' has no share folder in AMENT_PREFIX_PATH ({overlays}) or {sys.prefix}")


def _ament_prefixes() -> list[Path]:
    return [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]


def _candidates(package: str) -> list[Path]:
    user = sysconfig.get_path("data", sysconfig.get_preferred_scheme("user"))
    installed = [Path(sys.prefix), Path(sysconfig.get_path("data")), Path(user)]
    return [
        *(prefix / "share" / package for prefix in _ament_prefixes()),
        *_checkout(package),
        *(prefix / "share" / package for prefix in installed),
    ]


def _checkout(package: str) -> list[Path]:
    """The folder above this Python package, if its package.xml says that it is `package`."""
    folder = Path(__file__).resolve().parents[1]
    try:
        name = ElementTree.parse(folder / "package.xml").findtext("name", "")
    except (OSError, ElementTree.ParseError):
        return []
    return [folder] if name.strip() == package else []

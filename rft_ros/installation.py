"""Folders of shared files in this installation, its version, and how to run ``rft``."""

import os
import shlex
import shutil
import sys
import sysconfig
from importlib.metadata import PackageNotFoundError, distribution, version
from importlib.util import find_spec
from pathlib import Path

from rft_ros.errors import InputError

_CHECKOUT = Path(__file__).resolve().parents[1]  # the source checkout, if rft_ros runs from one


def program() -> str:
    """The command line that starts ``rft`` here, quoted for a shell; simply its name if it is on the PATH."""
    if shutil.which("rft"):
        return "rft"
    if shutil.which("ros2") and any(
        (prefix / "lib" / "rft_ros" / "rft").is_file() for prefix in _ament_prefixes()
    ):
        return "ros2 run rft_ros rft"
    script = Path(sys.executable).parent / "rft"
    return (
        shlex.quote(str(script))
        if script.is_file()
        else f"{shlex.quote(sys.executable)} -m rft_ros.cli"
    )


def start_of_node(params: Path) -> str:
    """The command line that starts the node with a parameter file here: by ``ros2 launch``, if there is ``ros2``."""
    file = shlex.quote(str(params))
    if shutil.which("ros2"):
        return f"ros2 launch rft_ros rft.launch.py params_file:={file}"
    return f"rft_node --ros-args --params-file {file}"


def release() -> str:
    """The version of this package, or "not installed"."""
    try:
        return version("rft_ros")
    except PackageNotFoundError:
        return "not installed"


def is_ros_from_pypi() -> bool:
    """Whether ROS is that of PyPI's wheels, which have neither the `ros2` command nor tf2_msgs."""
    found = find_spec("rclpy")
    if found is None or found.origin is None:
        return False
    try:
        wheel = distribution("ros-rclpy")
    except PackageNotFoundError:
        return False
    # a sourced installation from apt comes before the wheels on Python's path
    return Path(str(wheel.locate_file("rclpy/__init__.py"))) == Path(found.origin)


def share_directory(package: str) -> Path:
    """The package's share folder: in AMENT_PREFIX_PATH, as in ROS, otherwise where pip installs data files.

    For rft_ros a source checkout is searched before pip's folders, which may hold files of an older version.
    """
    user = sysconfig.get_path("data", sysconfig.get_preferred_scheme("user"))
    places = [prefix / "share" / package for prefix in _ament_prefixes()]
    if package == "rft_ros" and (_CHECKOUT / "package.xml").is_file():
        places.append(_CHECKOUT)
    places += [
        Path(prefix) / "share" / package
        for prefix in (sys.prefix, sysconfig.get_path("data"), user)
    ]
    for folder in places if package.strip(".") else ():
        if folder.is_dir():
            return folder
    searched = (
        f"AMENT_PREFIX_PATH ({os.environ.get('AMENT_PREFIX_PATH') or 'not set'}) or {sys.prefix}"
    )
    raise InputError(
        f"package '{package}' has no share folder in {searched}; source the workspace that has it"
    )


def _ament_prefixes() -> list[Path]:
    return [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]

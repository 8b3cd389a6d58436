"""The project as someone else gets it: without what building and running leave, in surroundings without ROS."""

import os
import shutil
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

_OF_ROS = ("AMENT_", "CMAKE_PREFIX_PATH", "COLCON_", "LD_LIBRARY_PATH", "PYTHONPATH", "RMW_", "ROS_", "_ROS_WHEELS_")


def clean_copy(folder: Path) -> Path:
    """Copy the working tree to `folder`, leaving out what .gitignore names."""
    ignored = [line.strip("/") for line in (ROOT / ".gitignore").read_text(encoding="utf-8").split()]
    return Path(shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(".git", *ignored)))


def without_ros() -> dict[str, str]:
    """This process's environment without what a ROS setup file, or rclpy from PyPI at its start, puts there."""
    return {k: v for k, v in os.environ.items() if not k.startswith(_OF_ROS)}

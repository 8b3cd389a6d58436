"""The project as someone else gets it: a clean copy, its manifest, and its node started there."""

import ast
import contextlib
import fcntl
import os
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Iterable
from email import message_from_bytes
from functools import cache
from importlib.metadata import Distribution, distribution
from pathlib import Path
from typing import IO, TYPE_CHECKING

import pytest

from rft_ros.messages import TYPES

if TYPE_CHECKING:
    from catkin_pkg.package import Package

ROOT = Path(__file__).resolve().parents[2]
_LOCKS: list[IO[str]] = []  # held as long as the process lives

_OF_ROS = (
    "AMENT_",
    "CMAKE_PREFIX_PATH",
    "COLCON_",
    "LD_LIBRARY_PATH",
    "PYTHONPATH",
    "RMW_",
    "ROS_",
    "_ROS_WHEELS_",
)


def clean_copy(folder: Path) -> Path:
    """Copy the working tree to `folder` without what .gitignore names."""
    ignored = [
        line.strip("/") for line in (ROOT / ".gitignore").read_text(encoding="utf-8").split()
    ]
    return Path(shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(".git", *ignored)))


def share_machine_code(package: Path) -> None:
    """Give a copy of the package the checkout's machine code, so that the copy does not compile for 20 s.

    Without effect where numba's cache is not in the checkout, or the copy's sources differ: then the copy compiles.
    """
    folder = package.parent / "__pycache__"
    folder.mkdir(exist_ok=True)
    for file in (ROOT / "__pycache__").glob("rft_ros.*.nbc"):
        shutil.copy2(file, folder)


def required(lines: Iterable[str], *, extra: str) -> Iterable[Distribution]:
    """The installed distributions that these requirements ask for, and all that these ask for in turn.

    Fails if one is missing, or of a version that is not allowed.
    """
    from packaging.requirements import Requirement

    found: dict[tuple[str, frozenset[str]], Distribution] = {}
    left = [(line, frozenset({extra})) for line in lines]
    while left:
        line, extras = left.pop()
        wanted = Requirement(line)
        if wanted.marker and not any(wanted.marker.evaluate({"extra": e}) for e in ("", *extras)):
            continue
        one, of_it = distribution(wanted.name), frozenset(wanted.extras)
        assert wanted.specifier.contains(one.version, prereleases=True), (
            f"{line}: {one.version} is installed"
        )
        if (one.name, of_it) not in found:
            found[one.name, of_it] = one
            left += [(each, of_it) for each in one.requires or ()]
    return {name: one for (name, _), one in found.items()}.values()


def metadata(wheel: Path) -> dict[str, list[str]]:
    """What a wheel says of itself, by key."""
    with zipfile.ZipFile(wheel) as files:
        (name,) = (n for n in files.namelist() if n.endswith(".dist-info/METADATA"))
        message = message_from_bytes(files.read(name))
    return {key: message.get_all(key, []) for key in message}


def place(package: Distribution, folder: Path) -> None:
    """Put an installed distribution's files into another environment's site-packages, as links where possible."""
    for file in package.files or ():
        source, target = Path(str(file.locate())), folder / file
        if source.is_file() and not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            try:
                target.hardlink_to(source)
            except OSError:  # on another file system
                shutil.copy2(source, target)


def without_ros() -> dict[str, str]:
    """This process's environment without the variables of a ROS setup file, or of rclpy from PyPI."""
    return {k: v for k, v in os.environ.items() if not k.startswith(_OF_ROS)}


@cache
def own_domain() -> dict[str, str]:
    """Variables for a ROS domain on loopback that no other test process of this machine is in."""
    return {"ROS_DOMAIN_ID": str(free_domain()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}


def free_domain() -> int:
    """A ROS domain that no other test process of this machine is in, and that this one has not been given yet."""
    for domain in range(10, 100):
        lock = (Path(tempfile.gettempdir()) / f"rft_ros_domain_{domain}.lock").open("w")
        with contextlib.suppress(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            _LOCKS.append(lock)
            return domain
    raise AssertionError("all ROS domains are taken")


def manifest() -> "tuple[Package, list[str]]":
    """package.xml as ROS tools read it, and the warnings of catkin_pkg."""
    package = pytest.importorskip(
        "catkin_pkg.package", reason="needs catkin_pkg: pip install 'rft_ros[test]'"
    )
    warnings: list[str] = []
    return package.parse_package(str(ROOT), warnings=warnings), warnings


def third_party_imports() -> set[str]:
    """Top-level names that the package and its launch file import, anywhere in a module."""
    found = {
        kind.partition("/")[0] for kinds in TYPES.values() for kind in kinds
    }  # the node imports these by name
    for file in [*(ROOT / "rft_ros").rglob("*.py"), *(ROOT / "launch").glob("*.py")]:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.partition(".")[0])
    return found - sys.stdlib_module_names - {"rft_ros"}

"""What package.xml says, read as ROS tools read it, and what the package's sources import."""

import ast
import sys

import pytest
from clean_copy import ROOT

catkin_package = pytest.importorskip("catkin_pkg.package", reason="needs catkin_pkg: pip install 'rft_ros[test]'")


def manifest() -> tuple[catkin_package.Package, list[str]]:
    """The parsed package.xml, and all that catkin_pkg warns of."""
    warnings: list[str] = []
    return catkin_package.parse_package(str(ROOT), warnings=warnings), warnings


def third_party_imports() -> set[str]:
    """Top-level names that the package and its launch file import, at their head or where they need them."""
    found = set()
    for file in [*(ROOT / "rft_ros").rglob("*.py"), *(ROOT / "launch").glob("*.py")]:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.partition(".")[0])
    return found - sys.stdlib_module_names - {"rft_ros", "compression"}  # compression: Python 3.14's backports.zstd

"""Arrows between packages point one way, and only the node imports ROS (docs/architecture.md)."""

import ast
import subprocess
import sys
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / "rft_ros"
ALLOWED = {
    "errors": set(),
    "child_process": set(),
    "rft": set(),
    "installation": {"errors"},
    "tool": {"files", "installation", "rft", "errors"},
    "ground": {"files", "rft", "errors"},
    "parameters": {"ground", "tool", "rft", "errors", "files"},
    "estimator": {"parameters", "ground", "tool", "rft", "child_process", "errors"},
    "simulation": {"ground", "tool", "rft", "errors", "installation"},
    "report": {"files", "ground", "tool", "rft", "errors"},
    "files": {"errors"},
    "progress": set(),
    "states_file": {"files", "rft", "errors"},
    "bags": {"estimator", "parameters", "ground", "tool", "rft", "report", "errors", "progress", "files"},
    "node": {
        "installation",
        "child_process",
        "bags",
        "estimator",
        "parameters",
        "ground",
        "simulation",
        "sweeps",
        "tool",
        "files",
        "rft",
        "report",
        "errors",
    },
    "calibration": {"files", "bags", "estimator", "parameters", "tool", "rft", "report", "errors"},
    "sweeps": {"parameters", "tool", "rft", "states_file", "installation", "progress", "errors", "files"},
    "commands": {
        *("node", "bags", "estimator", "parameters", "tool", "rft", "report", "errors", "states_file"),
        *("calibration", "sweeps", "progress", "installation", "files"),
    },
    "cli": {"commands", "installation", "errors"},
}
ROS = ("rclpy", "rcl_interfaces", "std_srvs", "builtin_interfaces", "rosgraph_msgs", "launch")


def imported(file: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
    return names


def package(file: Path) -> str:
    return file.relative_to(PACKAGE).parts[0].removesuffix(".py")


FILES = sorted(file for file in PACKAGE.rglob("*.py") if file != PACKAGE / "__init__.py")


def test_a_package_imports_only_what_lies_below_it():
    for file in FILES:
        own = package(file)
        used = {name.split(".")[1] for name in imported(file) if name.startswith("rft_ros.")}
        assert used - {own} <= ALLOWED[own], file


def test_only_the_node_imports_ros():
    for file in FILES:
        ros = {n for n in imported(file) if n.split(".")[0] in ROS or n.split(".")[0].endswith("_msgs")}
        assert not ros or package(file) == "node", file


def test_the_package_and_the_command_work_where_there_is_no_ros(tmp_path):
    for name in ("rclpy", "geometry_msgs", "rcl_interfaces"):
        (tmp_path / f"{name}.py").write_text(f"raise ImportError('no {name}', name='{name}')\n")
    code = (
        "import sys; sys.path.insert(0, sys.argv.pop(1))\n"
        "import rft_ros.rft, rft_ros.tool, rft_ros.estimator, rft_ros.bags.replay\n"
        "from rft_ros.cli import main\n"
        "assert main(['check-mesh', 'plate']) == 0\n"
        "sys.exit(main(['demo', '-o', 'out']))\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 2
    assert "rft demo: the demo needs ROS 2" in done.stderr
    assert "source a ROS 2 setup file, or run pip install ros-jazzy-" in done.stderr
    assert "Traceback" not in done.stderr

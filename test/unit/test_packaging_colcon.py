"""``colcon build`` in a new workspace, its setup file sourced: what ROS finds there, and what runs from there."""

import importlib.util
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from distribution import clean_copy, own_domain, share_machine_code, start_and_stop

pytest.importorskip("colcon_core", reason="needs colcon: pip install 'rft_ros[test]'")

needs_ros = pytest.mark.skipif(importlib.util.find_spec("rclpy") is None, reason="ROS 2 is not installed")
SHARED = ("package.xml", "config/default.yaml", "config/demo.yaml", "launch/rft.launch.py", "rviz/rft.rviz")


def environment() -> dict[str, str]:
    """This process's, in a ROS domain of its own, with this process's Python where a shell finds it."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return os.environ | {"PATH": path} | own_domain()


def sourced(*command: str) -> list[str]:
    return ["bash", "-c", f". install/setup.bash && exec {shlex.join(command)}"]


def run(workspace: Path, *command: str) -> str:
    """What a command prints in the sourced workspace; it must succeed."""
    done = subprocess.run(sourced(*command), capture_output=True, text=True, cwd=workspace, env=environment())
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


# --symlink-install works with the setuptools below 80 that colcon-core asks for.
@pytest.fixture(scope="module", params=[(), ("--symlink-install",)], ids=["plain", "symlinks"])
def workspace(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace with nothing but this package in it, built."""
    folder = tmp_path_factory.mktemp("workspace")
    clean_copy(folder / "src" / "rft_ros")
    command = [sys.executable, "-m", "colcon", "build", *request.param]
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, env=environment())
    assert done.returncode == 0, done.stdout + done.stderr
    share_machine_code(package_of(folder))
    return folder


def package_of(workspace: Path) -> Path:
    """The code that runs after sourcing the workspace."""
    return Path(run(workspace, "python3", "-c", "import rft_ros; print(rft_ros.__path__[0])").strip())


def test_ros_finds_the_package_in_its_index(workspace):
    prefix = workspace / "install" / "rft_ros"
    assert run(workspace, "printenv", "AMENT_PREFIX_PATH").split(os.pathsep)[0].strip() == str(prefix)
    assert (prefix / "share" / "ament_index" / "resource_index" / "packages" / "rft_ros").is_file()
    if importlib.util.find_spec("ament_index_python"):
        code = "import ament_index_python as a; print(a.get_package_share_directory('rft_ros'))"
        assert Path(run(workspace, "python3", "-c", code).strip()) == prefix / "share" / "rft_ros"


def test_shared_files_are_installed(workspace):
    share = workspace / "install" / "rft_ros" / "share" / "rft_ros"
    assert [file for file in SHARED if not (share / file).is_file()] == []


def test_the_code_that_runs_is_the_workspaces(workspace):
    assert package_of(workspace).is_relative_to(workspace)


def test_the_command_runs_from_where_ros2_run_looks(workspace):
    rft = "install/rft_ros/lib/rft_ros/rft"
    assert "replay" in run(workspace, rft, "--help")
    assert f"({workspace}/install/rft_ros/share/rft_ros/meshes/plate.stl)" in run(workspace, rft, "check-mesh", "plate")
    said = run(workspace, rft, "--version").split()[-1]
    assert f"<version>{said}</version>" in (workspace / "src" / "rft_ros" / "package.xml").read_text(encoding="utf-8")


@needs_ros
@pytest.mark.parametrize("workspace", [()], ids=["plain"], indirect=True)
def test_the_node_starts_and_ends_from_where_ros2_launch_looks(workspace):
    command = sourced("install/rft_ros/lib/rft_ros/rft_node", "--ros-args", "-p", "mesh.file:=plate")
    status, said = start_and_stop(command, folder=workspace, environment=environment())
    assert "ready: tool plate" in said
    assert status == 0, said

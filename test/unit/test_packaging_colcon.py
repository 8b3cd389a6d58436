"""``colcon build`` in a new workspace, its setup file sourced: what ROS finds there, and what runs from there."""

import importlib.util
import os
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from distribution import clean_copy, own_domain, share_machine_code

pytestmark = pytest.mark.repository

pytest.importorskip("colcon_core", reason="needs colcon: pip install 'rft_ros[test]'")

SHARED = (
    "package.xml",
    "config/default.yaml",
    "config/demo.yaml",
    "launch/rft.launch.py",
    "rviz/rft.rviz",
)
RFT = "install/rft_ros/lib/rft_ros/rft"


def environment() -> dict[str, str]:
    """This process's, in a ROS domain of its own, with this process's Python where a shell finds it."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return os.environ | {"PATH": path} | own_domain()


def sourced(script: str) -> list[str]:
    return ["bash", "-ec", f". install/setup.bash; {script}"]


def run(workspace: Path, *command: str) -> str:
    """What a command prints in the workspace; it must succeed."""
    done = subprocess.run(
        command, capture_output=True, text=True, cwd=workspace, env=environment()
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_ros_finds_the_package_of_a_workspace_and_it_runs_from_there(tmp_path):
    clean_copy(tmp_path / "src" / "rft_ros")
    run(tmp_path, sys.executable, "-m", "colcon", "build")
    prefix = tmp_path / "install" / "rft_ros"
    share = prefix / "share" / "rft_ros"
    assert (prefix / "share" / "ament_index" / "resource_index" / "packages" / "rft_ros").is_file()
    assert [file for file in SHARED if not (share / file).is_file()] == []
    code = shlex.quote("import rft_ros; print(rft_ros.__path__[0])")
    script = (
        f"printenv AMENT_PREFIX_PATH; python3 -c {code}; {RFT} --version; {RFT} check-mesh plate"
    )
    prefixes, package, version, *mesh = run(tmp_path, *sourced(script)).splitlines()
    assert prefixes.split(os.pathsep)[0] == str(prefix)
    assert Path(package).is_relative_to(tmp_path)
    said = version.split()[-1]
    assert f"<version>{said}</version>" in (
        tmp_path / "src" / "rft_ros" / "package.xml"
    ).read_text(encoding="utf-8")
    assert f"({share}/meshes/plate.stl)" in "\n".join(mesh)
    if importlib.util.find_spec("rclpy") is None:
        return
    share_machine_code(Path(package))
    node = sourced("exec install/rft_ros/lib/rft_ros/rft_node --ros-args -p mesh.file:=plate")
    pipe, both = subprocess.PIPE, subprocess.STDOUT
    with subprocess.Popen(
        node, stdout=pipe, stderr=both, text=True, cwd=tmp_path, env=environment()
    ) as process:
        said = []
        for line in process.stdout:
            said.append(line)
            if "ready: tool plate" in line:
                process.send_signal(signal.SIGINT)
    assert process.returncode == 0, said
    assert any("ready: tool plate" in line for line in said)

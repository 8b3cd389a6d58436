"""The launch file under a real ``launch``, which PyPI does not have: ROS from apt does."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from harness import WAIT

pytest.importorskip(
    "launch_ros", reason="launch_ros is not installed; ros-jazzy-launch-ros from apt has it"
)
pytest.importorskip(
    "composition_interfaces", reason="composition_interfaces is not installed; ROS from apt has it"
)

FILE = Path(__file__).resolve().parents[2] / "launch" / "rft.launch.py"
RUN = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
service = LaunchService()
arguments = [tuple(a.split(":=", 1)) for a in sys.argv[2:]]
service.include_launch_description(
    LaunchDescription([IncludeLaunchDescription(sys.argv[1], launch_arguments=arguments)])
)
sys.exit(service.run())
"""


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """ROS's, with this package first in AMENT_PREFIX_PATH, as if colcon had installed it."""
    root, prefix = FILE.parents[1], tmp_path / "prefix"
    index = prefix / "share" / "ament_index" / "resource_index" / "packages"
    programs = prefix / "lib" / "rft_ros"
    for folder in (index, programs):
        folder.mkdir(parents=True)
    (index / "rft_ros").touch()
    (prefix / "share" / "rft_ros").symlink_to(root)
    node = programs / "rft_node"
    node.write_text(f'#!/bin/sh\nexec {sys.executable} {root / "scripts" / "rft_node"} "$@"\n')
    node.chmod(0o755)
    overlays = [str(prefix), *filter(None, [os.environ.get("AMENT_PREFIX_PATH")])]
    return {**os.environ, "AMENT_PREFIX_PATH": os.pathsep.join(overlays), "HOME": str(tmp_path)}


def launched(environment: dict[str, str], *arguments: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-c", RUN, str(FILE), *arguments]
    # A session of its own: Ctrl-C reaches launch and node together, and launch counts on that.
    return subprocess.Popen(
        command,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


@pytest.mark.parametrize(
    ("argument", "sentence"),
    [
        ("params_file:=~/cell.yaml", "params_file '~/cell.yaml' does not exist"),
        ("params_file:=/", "params_file '/' is a folder"),
        ("params_file:=/dev/null", "params_file '/dev/null' is a pipe or a device"),
        ("use_sim_time:=yess", 'Argument "use_sim_time" provided value "yess" is not valid'),
        ("rviz:=yess", 'Argument "rviz" provided value "yess" is not valid'),
        pytest.param(
            "rviz:=true",
            "rviz:=true needs the package rviz2",
            marks=pytest.mark.skipif(
                shutil.which("rviz2") is not None, reason="rviz2 is installed"
            ),
        ),
    ],
)
def test_an_argument_that_cannot_be_used_is_refused_before_anything_starts(
    environment, argument, sentence
):
    launch = launched(environment, argument)
    said, _ = launch.communicate(timeout=WAIT)
    assert launch.returncode == 1
    assert sentence in said
    assert "Traceback" not in said
    assert "process started" not in said


def test_a_parameter_file_in_the_home_folder_is_used_and_ctrl_c_ends_launch_and_node(
    environment, tmp_path
):
    (tmp_path / "cell.yaml").write_text("/**:\n  ros__parameters:\n    mesh.file: sphere\n")
    launch = launched(environment, "params_file:=~/cell.yaml")
    said = []
    assert launch.stdout
    for line in launch.stdout:
        said.append(line)
        if "ready: " in line:
            os.killpg(launch.pid, signal.SIGINT)
    launch.wait(WAIT)
    assert "ready: tool sphere" in "".join(said)
    assert "process has finished cleanly" in "".join(said)
    assert "escalating" not in "".join(said)


def test_the_launch_file_passes_launch_testing(environment):
    """`launch_test` in a process of its own: its plugin for pytest breaks under pytest 9."""
    pytest.importorskip(
        "launch_testing", reason="launch_testing is not installed; ros-jazzy-launch-testing has it"
    )
    command = [
        sys.executable,
        "-m",
        "launch_testing.launch_test",
        str(FILE.parents[1] / "test/ros/launch_file.py"),
    ]
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=2 * WAIT
    )
    assert done.returncode == 0, done.stdout + done.stderr

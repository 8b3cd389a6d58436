"""The examples for users without the `ros2` command."""

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rft_ros.cli import main

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def script(rft, name, *topics):
    """The command line of an example, with topics or services of the node `/rft` mapped to those of this one."""
    remaps = [word for topic in topics for word in ("-r", f"/rft/{topic}:={rft.name}/{topic}")]
    return [sys.executable, str(EXAMPLES / f"{name}.py"), "--ros-args", *remaps]


def test_the_script_sets_a_parameter(rft):
    command = script(rft, "set_parameter", "set_parameters")
    caller = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    rft.until(lambda: caller.poll() is not None)
    assert "successful=True" in caller.communicate()[0]
    assert rft.get("medium.zeta").double_value == 0.33


def test_the_script_records_a_bag_that_replays(rft, tmp_path):
    command = script(rft, "record_bag", "pose", "twist", "wrench_measured")
    recorder = subprocess.Popen(command, cwd=tmp_path)
    rft.until(
        lambda: min(p.get_subscription_count() for p in (rft.pose, rft.twist, rft.wrench)) == 2
    )  # the node and the recorder
    first = rft.moment()
    for k in range(200):
        rft.send(first + k * 10_000_000, z=-1e-4 * k)
        rft.spin(0.002)
    recorder.send_signal(signal.SIGINT)
    assert recorder.wait() == 0
    command = ["replay", str(tmp_path / "my_bag"), "-o", str(tmp_path / "out")]
    for topic in ("pose", "twist", "wrench_measured"):
        command += ["--remap", f"~/{topic}:={rft.name}/{topic}"]
    assert main(command) == 0
    assert (tmp_path / "out" / "estimates.csv").read_text().count("\n") > 50


def pressed(file, columns):
    """A CSV file of 300 states from the surface down, at 20 mm/s, with these columns."""
    states = np.zeros((300, 14))
    states[:, 0] = 0.01 * np.arange(300)
    states[:, 3], states[:, 7], states[:, 10] = -0.02 * states[:, 0], 1.0, -0.02
    header = ["t", "px", "py", "pz", "qx", "qy", "qz", "qw", "vx", "vy", "vz", "wx", "wy", "wz"][
        :columns
    ]
    np.savetxt(file, states[:, :columns], delimiter=",", comments="", header=",".join(header))


@pytest.mark.parametrize("columns", [8, 14], ids=["poses", "poses and velocities"])
def test_the_script_feeds_the_node_from_a_csv_and_prints_its_forces(rft, tmp_path, columns):
    pressed(tmp_path / "states.csv", columns)
    namespace = rft.name.rpartition("/")[0]
    feeder = subprocess.Popen(
        [*script(rft, "play_states"), "-r", f"__ns:={namespace}"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        text=True,
    )
    rft.until(lambda: feeder.poll() is not None)
    said = feeder.communicate()[0].splitlines()
    assert feeder.returncode == 0
    assert len(said) > 30
    assert float(said[-1].split()[2]) > 0.5


def test_the_script_says_what_it_waits_for_and_follows_remapped_topics(rft, tmp_path):
    pressed(tmp_path / "states.csv", 8)
    nobody = f"{rft.name}/nobody"
    command = script(rft, "play_states", "twist", "wrench_predicted")
    command += ["-r", f"/rft/pose:={nobody}"]
    said = tmp_path / "said"
    with said.open("w") as stream:
        feeder = subprocess.Popen(command, cwd=tmp_path, stderr=stream)
    # only the topic that nobody listens to is missing once the node's own are found
    last = f"waiting for the node: a subscription to {nobody}"
    rft.until(lambda: last in said.read_text().splitlines())
    feeder.terminate()
    feeder.wait()

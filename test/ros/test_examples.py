"""The examples for users without the `ros2` command."""

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np

from rft_ros.cli import main

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def script(rft, name):
    """The example of this name, for a node in another namespace."""
    text = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")
    return [sys.executable, "-c", text.replace('"/rft/', f'"{rft.name}/')]


def test_the_script_sets_a_parameter(rft):
    caller = subprocess.Popen(script(rft, "set_parameter"), stdout=subprocess.PIPE, text=True)
    rft.until(lambda: caller.poll() is not None)
    assert "successful=True" in caller.communicate()[0]
    assert rft.get("medium.zeta").double_value == 0.33


def test_the_script_records_a_bag_that_replays(rft, tmp_path):
    recorder = subprocess.Popen(script(rft, "record_bag"), cwd=tmp_path)
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


def test_the_script_feeds_the_node_from_a_csv_and_prints_its_forces(rft, tmp_path):
    states = np.zeros((300, 14))  # from the surface down, at 20 mm/s: the first may be lost
    states[:, 0] = 0.01 * np.arange(300)
    states[:, 3], states[:, 7], states[:, 10] = -0.02 * states[:, 0], 1.0, -0.02
    header = "t,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz"
    np.savetxt(tmp_path / "states.csv", states, delimiter=",", comments="", header=header)
    feeder = subprocess.Popen(
        script(rft, "play_states"), cwd=tmp_path, stdout=subprocess.PIPE, text=True
    )
    rft.until(lambda: feeder.poll() is not None)
    said = feeder.communicate()[0].splitlines()
    assert feeder.returncode == 0
    assert len(said) > 30
    assert float(said[-1].split()[2]) > 0.5

"""The scripts of docs/node.md for users without the `ros2` command."""

import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np

from rft_ros.cli import main

PAGE = Path(__file__).resolve().parents[2] / "docs" / "node.md"


def script(rft, word):
    """The page's script that has this word, for a node in another namespace."""
    (found,) = (text for text in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL) if word in text)
    return [sys.executable, "-c", found.replace('"/rft/', f'"{rft.name}/')]


def test_the_script_sets_a_parameter(rft):
    caller = subprocess.Popen(script(rft, "SetParameters"), stdout=subprocess.PIPE, text=True)
    rft.until(lambda: caller.poll() is not None)
    assert "successful=True" in caller.communicate()[0]
    assert rft.get("medium.zeta").double_value == 0.33


def test_the_script_records_a_bag_that_replays(rft, tmp_path):
    recorder = subprocess.Popen(script(rft, "Writer"), cwd=tmp_path)
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
    feeder = subprocess.Popen(script(rft, "loadtxt"), cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    rft.until(lambda: feeder.poll() is not None)
    said = feeder.communicate()[0].splitlines()
    assert feeder.returncode == 0
    assert len(said) > 30
    assert float(said[-1].split()[2]) > 0.5

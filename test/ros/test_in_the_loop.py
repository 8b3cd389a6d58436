"""The node in the loop: a MuJoCo arm feels what the node predicts, over DDS, and its holds are quiet."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest
from harness import NODE, WAIT

from rft_ros.installation import share_directory

pytest.importorskip("mujoco", reason="needs MuJoCo: pip install 'rft_ros[mujoco]'")

from rft_ros.node.stiffness import stiffness_message, stiffness_sums


def test_the_stiffness_survives_its_message():
    x, k = np.array([[0.01, 0.0, -0.02], [0.0, 0.03, 0.0], [-0.01, 0.01, 0.01]]), np.array([2e4, 1e4, 3e4])
    (a, b, c), products = x.T, np.einsum("k,ki,kj->ij", k, x, x)
    sums = np.array([k.sum(), k @ a, k @ b, k @ c, *np.diag(products), products[0, 1], products[0, 2], products[1, 2]])
    message = stiffness_message(5, "world", sums, np.array([0.4, 0.0, -0.02]))
    assert message.inertia.m == 6e4
    assert stiffness_sums(message, np.array([0.4, 0.0, -0.02])) == pytest.approx(sums)


def test_an_arm_that_feels_the_prediction_holds_still():
    parameters = share_directory("rft_ros") / "config" / "mujoco_arm.yaml"
    arm = [sys.executable, "-m", "rft_ros.node.mujoco_arm", "--rate", "125", "--stay", "1"]
    with subprocess.Popen([*NODE, "--params-file", str(parameters)]) as node:
        try:
            done = subprocess.run(arm, capture_output=True, text=True, timeout=WAIT)
        finally:
            node.terminate()
    assert done.returncode == 0, done.stderr
    poses, answers = map(int, re.match(r"(\d+) poses at 125 Hz, (\d+) answers", done.stdout).groups())
    assert answers == poses
    holds = re.findall(r"hold after \w+ +([\d.]+) N, scatter (\S+) of it", done.stdout)
    for (force, scatter), least in zip(holds, (10.0, 2.0, 0.1), strict=True):
        assert float(force) > least, done.stdout
        assert float(scatter) < 0.01, done.stdout


def test_the_demo_with_mujoco_measures_what_it_predicts(tmp_path):
    """The load cell of the simulated arm, tared and with its sign, reads the force that the arm was given."""
    command = [sys.executable, "-m", "rft_ros.cli", "demo", "--mujoco", "-o", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=WAIT)
    assert done.returncode == 0, done.stderr
    assert all(float(scatter) < 0.01 for scatter in re.findall(r"scatter (\S+) of it", done.stdout)), done.stdout
    summary = json.loads((tmp_path / "replay" / "summary.json").read_text())
    assert summary["median_relative_error"] < 0.02

"""The node in the loop: a MuJoCo arm feels what the node predicts, over DDS, and its holds are quiet."""

import json
import subprocess
import sys

import numpy as np
import pytest

from rft_ros.installation import share_directory

pytest.importorskip("mujoco", reason="needs MuJoCo: pip install 'rft_ros[mujoco]'")

from rft_ros.node.mujoco_arm import stiffness_sums
from rft_ros.node.stiffness import stiffness_message


def test_the_stiffness_survives_its_message():
    x, k = np.array([[0.01, 0.0, -0.02], [0.0, 0.03, 0.0], [-0.01, 0.01, 0.01]]), np.array([2e4, 1e4, 3e4])
    (a, b, c), products = x.T, np.einsum("k,ki,kj->ij", k, x, x)
    sums = np.array([k.sum(), k @ a, k @ b, k @ c, *np.diag(products), products[0, 1], products[0, 2], products[1, 2]])
    message = stiffness_message(5, "world", sums, np.array([0.4, 0.0, -0.02]))
    assert message.inertia.m == 6e4
    assert stiffness_sums(message, np.array([0.4, 0.0, -0.02])) == pytest.approx(sums)


@pytest.mark.parametrize("rate", [125, 500])
def test_an_arm_that_feels_the_prediction_holds_still(rate):
    parameters = share_directory("rft_ros") / "config" / "mujoco_arm.yaml"
    with subprocess.Popen(
        [sys.executable, "-m", "rft_ros.node.main", "--ros-args", "--params-file", str(parameters)]
    ) as node:
        try:
            done = subprocess.run(
                [sys.executable, "-m", "rft_ros.node.mujoco_arm", "--rate", str(rate), "--stay", "1"],
                capture_output=True,
                text=True,
                timeout=600,
            )
        finally:
            node.terminate()
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["answers"] >= found["poses"] - 3
    # what is left after going back depends on the delay of the answers
    for hold, least in zip(found["holds"], (10.0, 2.0, 0.1), strict=True):
        assert hold["force"] > least, found
        assert hold["scatter"] < 0.01, found


def test_the_demo_with_mujoco_measures_what_it_predicts(tmp_path):
    """The load cell of the simulated arm, tared and with its sign, reads the force that the arm was given."""
    done = subprocess.run(
        [sys.executable, "-m", "rft_ros.cli", "demo", "--mujoco", "-o", str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "replay" / "summary.json").read_text())
    assert summary["median_relative_error"] < 0.02

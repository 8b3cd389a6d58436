"""The node in the loop: a MuJoCo arm feels what the node predicts, over DDS, and its holds are quiet."""

import json
import subprocess
import sys

import numpy as np
import pytest
from geometry_msgs.msg import InertiaStamped
from harness import WAIT, numbers, stamp_of
from recordings import cdr

from rft_ros.installation import share_directory

pytest.importorskip("mujoco", reason="needs MuJoCo: pip install 'rft_ros[mujoco]'")

from rft_ros.demo import mujoco_arm
from rft_ros.node.stiffness import stiffness_message, stiffness_sums


def test_the_stiffness_survives_its_message():
    x, k = np.array([[0.01, 0.0, -0.02], [0.0, 0.03, 0.0], [-0.01, 0.01, 0.01]]), np.array([2e4, 1e4, 3e4])
    (a, b, c), products = x.T, np.einsum("k,ki,kj->ij", k, x, x)
    sums = np.array([k.sum(), k @ a, k @ b, k @ c, *np.diag(products), products[0, 1], products[0, 2], products[1, 2]])
    message = stiffness_message(5, "world", sums, np.array([0.4, 0.0, -0.02]))
    assert message.inertia.m == 6e4
    assert stiffness_sums(message, np.array([0.4, 0.0, -0.02])) == pytest.approx(sums)


def test_an_arm_that_feels_the_prediction_holds_still(start_node):
    parameters = share_directory("rft_ros") / "config" / "mujoco_arm.yaml"
    rft, told = start_node("--params-file", str(parameters)), []
    rft.node.create_subscription(InertiaStamped, f"{rft.name}/stiffness", told.append, 1000)
    rft.wait_ready()
    predicted, stamp, holds = rft.received["wrench_predicted"], 0, {"press": [], "drag": [], "back": []}

    def answer(origin):
        rft.until(lambda: all(messages and stamp_of(messages[-1]) == stamp for messages in (predicted, told)))
        return tuple(numbers(predicted[-1])), stiffness_sums(told[-1], origin)

    for t, state, reading in mujoco_arm.moments(answer, rate=125.0, stay=1.0):
        stamp = round((t + 1.0) * 1e9)
        rft.wrench.publish(cdr("wrench", stamp, reading))
        rft.twist.publish(cdr("twist", stamp, state[7:]))
        rft.pose.publish(cdr("pose", stamp, state[:7]))
        for end, hold in zip((4.5, 6.5, 8.0), holds.values(), strict=True):
            if end - 0.4 < t < end:
                hold.append(numbers(predicted[-1])[:3])
    for hold, least in zip(holds.values(), (10.0, 2.0, 0.1), strict=True):
        force = np.linalg.norm(np.mean(hold, axis=0))
        assert force > least
        assert np.linalg.norm(np.ptp(hold, axis=0)) < 0.01 * force


def test_the_demo_with_mujoco_measures_what_it_predicts(tmp_path):
    """The load cell of the simulated arm, tared and with its sign, reads the force that the arm was given."""
    command = [sys.executable, "-m", "rft_ros.cli", "demo", "--mujoco", "-o", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=WAIT)
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "replay" / "summary.json").read_text())
    assert summary["median_relative_error"] < 0.02

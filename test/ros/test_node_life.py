"""The node among others: inputs that come and go, simulated time, namespaces, QoS that does not match."""

import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import TransformStamped, TwistStamped, WrenchStamped
from harness import WAIT, InlineWorker, numbers, parameters, predicted_by_the_core, stamp_of
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from recordings import cdr, transform_cdr
from rosgraph_msgs.msg import Clock

from rft_ros.bags.writing import BagWriter
from rft_ros.estimator import TransformSample
from rft_ros.messages import TYPES
from rft_ros.node import rft_node
from rft_ros.node.rft_node import RftNode
from rft_ros.node.topics import INPUTS

S = 1_000_000_000


def test_a_driver_that_dies_and_returns_is_taken_up_again(rft):
    rft.ask(rft.moment())
    rft.close_inputs()
    rft.until(lambda: rft.diagnostic("inputs")[1] == "no poses")
    assert rft.diagnostic("inputs")[0] == b"\x02"
    rft.open_inputs()
    rft.wait_ready()
    rft.ask(rft.moment())
    rft.until(lambda: rft.send(rft.moment()) or rft.diagnostic("inputs")[0] == b"\x00")


def test_poses_that_come_before_the_node_do_no_harm_and_poses_may_be_transforms_as_of_motion_capture(
    start_process,
):
    rft = start_process("-p", "mesh.file:=plate")
    predicted, expected = rft.received["wrench_predicted"], predicted_by_the_core()
    stamp, end, again = S, time.monotonic() + WAIT, time.monotonic() + 60.0
    while not predicted:
        assert time.monotonic() < end
        if (
            time.monotonic() > again
        ):  # as `Harness.call`: on a busy machine a match can stay one-sided for good
            again += 60.0
            rft.close_inputs()
            rft.open_inputs()
        stamp += 10_000_000
        rft.send(stamp)
        rft.spin(0.01)
    np.testing.assert_array_equal(numbers(predicted[0]), expected)

    rft.node.destroy_publisher(rft.pose)
    capture = rft.node.create_publisher(TransformStamped, f"{rft.name}/pose", 100)
    still, level = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)

    def answered():
        nonlocal stamp
        stamp += S
        rft.twist.publish(cdr("twist", stamp, (0.0, 0.0, -0.01, *still)))
        capture.publish(
            transform_cdr(TransformSample(stamp, "world", "tool", (0.0, 0.0, -0.01), level, False))
        )
        rft.spin(0.1)
        return stamp_of(predicted[-1]) == stamp

    rft.until(answered)
    np.testing.assert_array_equal(numbers(predicted[-1]), expected)


def test_the_node_waits_with_the_other_type_of_poses_while_the_middleware_has_the_first(
    start_node, monkeypatch
):
    """It ended by an error of rclpy. Here a publisher of the first type in the same process keeps it."""
    rft = start_node("-p", "mesh.file:=plate").wait_ready()
    monkeypatch.setattr(rft_node, "type_on", lambda *_, **_usual: TYPES["pose"][1])
    rft.until(lambda: rft._rft._poses is None)
    for _ in range(3):
        assert rft.diagnostic("inputs")[1] == "no poses"
    rft.node.destroy_publisher(rft.pose)
    rft.until(lambda: rft._rft._poses is not None)


def test_simulated_time_dates_the_diagnostics_and_changes_no_estimate(start_node):
    rft = start_node("-p", "mesh.file:=plate", "-p", "use_sim_time:=true").wait_ready()
    clock = rft.node.create_publisher(Clock, "/clock", 10)
    message = Clock()
    message.clock.sec = 1234
    np.testing.assert_array_equal(numbers(rft.ask(1230 * S)), predicted_by_the_core())

    def dated() -> bool:
        clock.publish(message)
        rft.diagnostic("inputs")
        return stamp_of(rft.diagnostics[-1]) == 1234 * S

    rft.until(dated)
    assert math.isclose(float(rft.diagnostic("inputs")[2]["pose_age_s"]), 4.0)


def test_a_pose_after_a_bag_loop_finds_the_twists_that_still_wait():
    """The node never spins here, so that no callback takes a twist before the pose's does."""
    node, peer = (
        RftNode(InlineWorker(), arguments=["--ros-args", "-r", "__ns:=/loop"]),
        rclpy.create_node("loop"),
    )
    twists = peer.create_publisher(TwistStamped, "/loop/rft/twist", 10)
    for moment in (100 * S, 10 * S):  # the bag loops
        end, estimates = time.monotonic() + WAIT, node.estimator.estimates
        while node.estimator.estimates == estimates:
            assert time.monotonic() < end, dict(node.estimator.counts)
            moment += 1_000_000
            twists.publish(cdr("twist", moment, (0.0, 0.0, -0.01, 0.0, 0.0, 0.0)))
            time.sleep(0.01)
            node._on_message("pose", cdr("pose", moment, (0.0, 0.0, -0.01, 0.0, 0.0, 0.0, 1.0)))
    node.destroy_node()
    peer.destroy_node()


def test_a_subscription_that_cannot_match_is_reported(rft):
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    topic = f"{rft.name}/wrench_predicted"
    subscription = rft.node.create_subscription(WrenchStamped, topic, lambda _: None, latched)
    rft.until(lambda: "incompatible QoS" in rft.said())
    rft.node.destroy_subscription(subscription)


def test_a_best_effort_driver_is_heard_by_default_and_not_where_reliability_is_asked_for(
    start_node,
):
    best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    rft = start_node("-p", "mesh.file:=plate")
    rft.close_inputs()
    rft.open_inputs(best_effort)
    rft.ask(rft.moment())
    reliable = start_node("-p", "mesh.file:=plate", reliable=True).wait_ready()
    reliable.close_inputs()
    reliable.open_inputs(best_effort)
    reliable.until(lambda: "'~/pose', offering incompatible QoS" in reliable.said())
    assert reliable.pose.get_subscription_count() == 0
    # of every other node of this process
    assert INPUTS["pose"].reliability == ReliabilityPolicy.BEST_EFFORT


def test_speed_beyond_the_papers_is_a_warning_with_the_number(rft):
    def warned():
        rft.send(rft.moment(), linear=(0.0, 0.0, -0.3))
        return "0.300 m/s is faster" in rft.diagnostic("estimates")[1]

    rft.until(warned)
    level, message, values = rft.last_status("estimates")
    assert level == b"\x01" and "inertia" in message
    assert {"latency_median_us", "latency_p99_us", "depth_m", "fastest_m_s"} <= values.keys()


def test_the_status_service_says_what_is_in_force(rft, tmp_path):
    def until(condition, poses=False):
        rft.until(lambda: (poses and rft.send(rft.moment())) or condition(*rft.trigger("status")))

    until(lambda good, said: not good and "tool plate in force; no poses come" in said)
    until(lambda good, said: good and said.endswith("tool plate in force"), poses=True)
    rft.send(rft.moment(), frame="camera")
    until(lambda good, said: not good and "pose_frame_unknown (" in said and "'camera'" in said)
    broken = tmp_path / "broken.stl"
    broken.write_text("no mesh")
    assert rft.set(mesh__file=str(broken))[0]
    until(lambda good, said: not good and "the last swap failed: mesh file" in said)
    assert rft.set(mesh__scale=0.002)[0]
    until(lambda good, said: good and "preparing" not in said, poses=True)
    assert rft.set(mesh__scale=0.001)[0]
    rft.until(lambda: rft.diagnostic("model")[2]["preparing"] == "")


def test_a_parameter_it_does_not_know_is_named(start_node):
    rft = start_node("-p", "mesh.file:=plate", "-p", "medium.zeeta:=2.0").wait_ready()
    rft.until(lambda: "no parameter 'medium.zeeta'" in rft.said())


def test_setting_a_misspelt_parameter_is_refused_with_its_name_and_the_nearest_one(rft):
    for service in (SetParameters, SetParametersAtomically):
        request = service.Request(parameters=parameters({"medium.zeeta": 2.0}))
        if service is SetParameters:
            result = rft.call(service, "set_parameters", request).results[0]
        else:
            result = rft.call(service, "set_parameters_atomically", request).result
        assert not result.successful
        assert "'medium.zeeta'" in result.reason
        assert "'medium.zeta'" in result.reason


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_demo_that_ends_early_says_why_ends_its_node_and_keeps_the_bag_before_it(
    tmp_path, number
):
    """SIGKILL to its node, or SIGTERM to the demo."""
    out = tmp_path / "out"
    with BagWriter(out / "bag"):
        pass
    before = sorted(out.rglob("*"))
    command = [sys.executable, "-m", "rft_ros.cli", "demo", "--seconds", "6", "-o", str(out)]
    demo = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert any("waiting for the node" in line for line in demo.stdout)
        lists = Path(f"/proc/{demo.pid}/task").glob("*/children")
        (node,) = [int(child) for threads in lists for child in threads.read_text().split()]
        os.kill(node if number == signal.SIGKILL else demo.pid, number)
        _, said = demo.communicate(timeout=WAIT)
    finally:
        demo.kill()
    assert "Traceback" not in said
    assert not Path(f"/proc/{node}").exists()
    assert sorted(out.rglob("*")) == before
    if number == signal.SIGTERM:
        assert (demo.returncode, said.splitlines()[-1]) == (130, "rft demo: interrupted")
    else:
        assert demo.returncode == 2
        ended = "rft demo: the node ended with status -9 before the demo was over; see its messages above"
        assert said.splitlines()[-1] == ended

"""The feed-forward for controllers, which keep the last wrench without a time limit: it never stays at a force."""

import math
import signal
import time
from itertools import pairwise

import numpy as np
import rclpy
from geometry_msgs.msg import WrenchStamped
from harness import numbers, predicted_by_the_core
from hypothesis import example, given
from hypothesis import strategies as st

from rft_ros.node.feedforward import FeedForward, Ramp
from rft_ros.parameters import FeedforwardConfig

LIMIT, TORQUE, RISE = 3.0, 0.3, 0.2
LARGEST_STEP = LIMIT * 0.02 / RISE  # in one message
component = st.floats(-1e6, 1e6)
wrench = st.tuples(*[component] * 6)


@example(targets=[((5e-324, 0.0, 0.0, 0.0, 0.0, 0.0), 0.02)], lowered=0.0)
@given(
    targets=st.lists(st.tuples(wrench, st.floats(0.0, 0.02)), max_size=20),
    lowered=st.floats(0.0, 1.0),
)
def test_size_and_rate_are_bounded_and_zero_is_reached_within_the_rise_time(targets, lowered):
    ramp = Ramp()
    before = np.zeros(6)
    for target, duration in targets:
        now = np.array(ramp.follow(target, duration, limits=(LIMIT, TORQUE), rise_time=RISE))
        for part, limit in ((slice(0, 3), LIMIT), (slice(3, 6), TORQUE)):
            assert np.linalg.norm(now[part]) <= limit * (1.0 + 1e-9)
            assert (
                np.linalg.norm(now[part] - before[part])
                <= limit * duration / RISE * (1.0 + 1e-9) + 1e-12
            )
        before = now
    limits = (lowered * LIMIT, lowered * TORQUE)
    for _ in range(math.ceil(RISE / 0.02) + 1):
        ramp.follow((0.0,) * 6, 0.02, limits=limits, rise_time=RISE)
    assert ramp.wrench == (0.0,) * 6


def test_it_follows_the_prediction_and_returns_to_zero_whatever_ends_the_estimates(start_process):
    rft = start_process(
        *(
            "-p",
            "mesh.file:=plate",
            "-p",
            "feedforward.gain:=-1.0",
            "-p",
            f"feedforward.limit:=[{LIMIT}, {TORQUE}]",
        ),
        *("-p", "feedforward.frame:=world_frame", "-p", f"feedforward.rise_time:={RISE}"),
        *("-p", "feedforward.timeout:=1.0"),  # poses come late from a busy machine
        *(
            "-p",
            "sensor.quaternion:=[1.0, 0.0, 0.0, 0.0]",
            "-p",
            "sensor.position:=[0.01, 0.0, 0.1]",
        ),
    )
    got: list[WrenchStamped] = []
    rft.node.create_subscription(WrenchStamped, f"{rft.name}/wrench_feedforward", got.append, 1000)
    rft.wait_ready()
    rft.until(lambda: rft.node.count_publishers(f"{rft.name}/wrench_feedforward") > 0)
    stamp = rft.moment()

    def forces():
        return np.array([numbers(m)[:3] for m in got]).reshape(-1, 3)

    def press(until, **inputs):
        def condition():
            nonlocal stamp
            stamp += 10_000_000
            rft.send(stamp, **inputs)
            rft.spin(0.005)
            return until()

        rft.until(condition)

    def force():
        return numbers(got[-1])[:3]  # not of `forces`, which take longer at each message

    def at_zero():
        return got and not force().any()

    def pressed():
        expected = -predicted_by_the_core(z=-0.002)
        return got and np.allclose(
            numbers(got[-1]), expected * min(1.0, LIMIT / abs(expected[2])), rtol=1e-6, atol=1e-6
        )

    def rises():
        press(lambda: got and np.linalg.norm(force()) > LIMIT * (1.0 - 1e-9), z=-0.02)
        assert force()[2] < 0.0  # the grains push up

    press(pressed, z=-0.002)
    assert got[-1].header.frame_id == "world"
    ends = {
        "the poses stop": lambda: rft.until(at_zero),
        "the poses have no direction": lambda: press(
            at_zero, z=-0.02, quaternion=(0.0, 0.0, 0.0, 0.0)
        ),
        "the twists stop": lambda: press(at_zero, z=-0.02, linear=None),
        "estimates are not trusted": lambda: press(at_zero, z=-0.02, linear=(0.0, 0.0, -0.5)),
        "the gain is set to 0": lambda: (rft.set(feedforward__gain=0.0), rft.until(at_zero)),
    }
    for end in ends.values():
        rises()
        end()
    rft.set(feedforward__gain=-1.0)
    rises()
    assert rft.process.poll() is None
    rft.process.send_signal(signal.SIGTERM)
    assert rft.process.wait() == 0
    rft.spin(0.5)
    assert at_zero()
    assert max(np.linalg.norm(b - a) for a, b in pairwise(forces())) <= LARGEST_STEP * (1.0 + 1e-6)
    assert np.linalg.norm(forces(), axis=1).max() <= LIMIT * (1.0 + 1e-9)


def test_it_goes_to_zero_while_the_nodes_callbacks_are_blocked(start_node):
    rft = start_node("-p", "mesh.file:=plate", "-p", "feedforward.gain:=-1.0").wait_ready()
    got: list[WrenchStamped] = []
    rft.node.create_subscription(WrenchStamped, f"{rft.name}/wrench_feedforward", got.append, 1000)
    rft.until(lambda: rft.node.count_publishers(f"{rft.name}/wrench_feedforward") > 0)
    rft.until(lambda: rft.send(rft.moment(), z=-0.02) or (got and numbers(got[-1]).any()))
    rft.spin(0.05)
    time.sleep(2.0)  # no callback runs: this is the thread that spins the node
    rft.spin(0.02)
    assert not numbers(got[-1]).any()


def test_its_thread_sleeps_while_there_is_no_wrench(monkeypatch):
    """Each time that it woke, it would take the GIL from a tick."""
    looks: list[float] = []
    monkeypatch.setattr(FeedForward, "_without_estimate", lambda _: looks.append(time.monotonic()))
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node("sleeping", context=context)
    made = FeedForward(node, None, FeedforwardConfig())
    time.sleep(0.5)
    assert len(looks) <= 1
    made.end()
    assert not made._watchdog.is_alive()
    node.destroy_node()
    context.shutdown()


def test_it_ends_without_an_error_after_ros_was_shut_down():
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node("ended", context=context)
    made = FeedForward(node, None, FeedforwardConfig())  # there is no estimate
    context.shutdown()
    made.end()
    node.destroy_node()

"""A six-axis MuJoCo arm as a ROS 2 process that feels what the node predicts: the node in the loop.

Publishes pose, twist and load cell of its tool, and applies the newest /rft/wrench_predicted. That is a tick old, so
the arm takes it along with /rft/stiffness to where the tool is now, and is implicit with the stiffness. Needs
config/mujoco_arm.yaml at the node. It presses, drags, goes back, and stays at each.
"""

import argparse
import json
import signal
import sys
import time
from contextlib import suppress
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import InertiaStamped, PoseStamped, TwistStamped, WrenchStamped
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.time import Time

from rft_ros.estimator.messages import wrench_cdr
from rft_ros.rft import rotation_matrix
from rft_ros.simulation.coupling import stiffness_matrix
from rft_ros.simulation.mujoco_grains import MujocoBody, import_mujoco
from rft_ros.simulation.six_axis_arm import SixAxisArm

Array = NDArray[np.float64]

SENSOR = np.array([0.0, 0.0, 0.12])
"""Place of the load cell in the tool frame [m]; its axes are the tool's."""

_STOPS = {"start": (0.45, 0.01), "press": (0.45, -0.02), "drag": (0.47, -0.02), "back": (0.46, -0.02)}  # x, z [m]
_SPEED, _PAUSE = 0.02, 2.0  # m/s; s in the air before the start, for a tare
_PATIENCE = 10.0  # s


class Answers:
    """The newest wrench and stiffness of the node, and the state of the tool that they belong to."""

    def __init__(self) -> None:
        self.states: dict[int, Array] = {}
        self.wrench, self.sums, self.state = np.zeros(6), np.zeros(10), np.zeros(13)
        self._wrenches: dict[int, Array] = {}
        self.count = self.echoes = self.newest = 0

    def predicted(self, message: WrenchStamped) -> None:
        """Keep a wrench until its stiffness comes."""
        f, t = message.wrench.force, message.wrench.torque
        self._wrenches[Time.from_msg(message.header.stamp).nanoseconds] = np.array([f.x, f.y, f.z, t.x, t.y, t.z])
        self.count += 1

    def echo(self, _message: WrenchStamped) -> None:
        """Count the answers of a node that only echoes, as bench/echo_node.py."""
        self.echoes += 1

    def stiffness(self, message: InertiaStamped) -> None:
        """Comes after the wrench of the same stamp, which is taken with it, into world axes about the tool's origin."""
        stamp = Time.from_msg(message.header.stamp).nanoseconds
        wrench, state = self._wrenches.pop(stamp, None), self.states.pop(stamp, None)
        if wrench is None or state is None:
            return
        axes = rotation_matrix(state[3:7])
        force, torque = axes @ wrench[:3], axes @ wrench[3:]
        self.wrench = np.concatenate([force, torque + np.cross(axes @ SENSOR, force)])
        self.sums, self.state, self.newest = stiffness_sums(message, state[:3]), state, stamp
        for old in [key for key in self.states if key < stamp]:
            del self.states[old]
            self._wrenches.pop(old, None)


def stiffness_sums(message: InertiaStamped, origin: Array) -> Array:
    """The inverse of `rft_ros.node.stiffness.stiffness_message`, same units, shape [10]."""
    i = message.inertia
    k = i.m
    x, y, z = np.array([i.com.x, i.com.y, i.com.z]) - origin
    half = 0.5 * (i.ixx + i.iyy + i.izz)
    squares = half - i.ixx + k * x * x, half - i.iyy + k * y * y, half - i.izz + k * z * z
    products = k * x * y - i.ixy, k * x * z - i.ixz, k * y * z - i.iyz
    return np.array([k, k * x, k * y, k * z, *squares, *products])


def _apply(body: MujocoBody, data: object, answers: Answers, dt: float) -> None:
    """Let the tool feel the grains' wrench for a step of dt [s]."""
    mujoco = import_mujoco()
    body.measure(data)
    state, moved, matrix = body.state[0], np.zeros(6), np.zeros((6, 6))
    if answers.sums[0] > 0.0:
        moved[:3] = state[:3] - answers.state[:3]
        mujoco.mju_subQuat(moved[3:], np.roll(state[3:7], 1), np.roll(answers.state[3:7], 1))
        moved[3:] = rotation_matrix(answers.state[3:7]) @ moved[3:]
    stiffness_matrix(answers.sums, matrix)
    body.hold(answers.wrench - matrix @ moved, answers.sums, dt, 0.1)


def run(rate: float, stay: float, listeners: int) -> dict[str, Any]:
    """Run the arm at a rate [Hz], staying `stay` [s] at each of three places; returns what the holds were."""
    steps = max(1, round(1000.0 / rate))
    arm = SixAxisArm(timestep=1.0 / (rate * steps))
    body = MujocoBody(arm.model, arm.body)
    stops = np.array([(x, 0.0, z) for x, z in _STOPS.values()])
    paths = np.linalg.norm(np.diff(stops, axis=0), axis=1) / _SPEED
    times = np.cumsum([0.0, _PAUSE, *(t for path in paths for t in (path, stay))])
    command = np.repeat(stops, 2, axis=0)
    arm.start(stops[0])
    answers = Answers()
    _apply(body, arm.data, answers, 0.001)  # compiles
    node = rclpy.create_node("mujoco_arm")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    reliable = QoSProfile(depth=100)
    poses = node.create_publisher(PoseStamped, "/rft/pose", reliable)
    twists = node.create_publisher(TwistStamped, "/rft/twist", reliable)
    cells = node.create_publisher(WrenchStamped, "/rft/wrench_measured", reliable)
    node.create_subscription(WrenchStamped, "/rft/wrench_predicted", answers.predicted, reliable)
    node.create_subscription(InertiaStamped, "/rft/stiffness", answers.stiffness, reliable)
    node.create_subscription(WrenchStamped, "/echo/wrench_predicted", answers.echo, reliable)
    pose, twist, serialise = PoseStamped(), TwistStamped(), wrench_cdr("ft_sensor")
    pose.header.frame_id = twist.header.frame_id = "world"

    def send(stamp: int) -> None:
        body.measure(arm.data)
        answers.states[stamp] = state = body.state[0].copy()
        pose.header.stamp = twist.header.stamp = Time(nanoseconds=stamp).to_msg()
        p, q, v, w = pose.pose.position, pose.pose.orientation, twist.twist.linear, twist.twist.angular
        p.x, p.y, p.z, q.x, q.y, q.z, q.w, v.x, v.y, v.z, w.x, w.y, w.z = state.tolist()
        fx, fy, fz, tx, ty, tz = arm.data.sensordata[:6].tolist()
        cells.publish(serialise(stamp, (fx, fy, fz, tx, ty, tz)))
        twists.publish(twist)
        poses.publish(pose)

    forces = np.zeros((round(times[-1] * rate), 3))
    late = 0
    try:
        while (
            min(p.get_subscription_count() for p in (poses, twists, cells)) < listeners
            or min(node.count_publishers(topic) for topic in ("/rft/wrench_predicted", "/rft/stiffness")) < 1
        ):
            executor.spin_once(timeout_sec=0.05)
        while answers.newest == 0:  # the node's answers may be discovered later than its inputs
            send(node.get_clock().now().nanoseconds)
            executor.spin_once(timeout_sec=0.05)
        while answers.states:  # the answers to these
            before = len(answers.states)
            executor.spin_once(timeout_sec=0.5)
            if len(answers.states) == before:
                break
        answers.count = answers.echoes = 0
        begin, stamp, tick = time.monotonic(), node.get_clock().now().nanoseconds, round(1e9 / rate)
        for k in range(len(forces)):
            send(stamp + k * tick)
            end = begin + (k + 1) / rate
            while (left := end - time.monotonic()) > 0.0:
                executor.spin_once(timeout_sec=left)
            # a simulator can wait: on a busy machine the arm falls behind, and its answers stay two ticks old at most
            oldest = stamp + (k - 2) * tick
            while k > 2 and answers.newest < oldest and time.monotonic() < end + _PATIENCE:
                executor.spin_once(timeout_sec=0.01)
            behind = max(time.monotonic() - end - 1.0 / rate, 0.0)
            late += behind > 0.0
            begin += behind
            arm.data.ctrl[:] = arm.joints([np.interp(k / rate, times, axis) for axis in command.T])
            for _ in range(steps):
                _apply(body, arm.data, answers, arm.model.opt.timestep)
                arm.step()
            forces[k] = body.wrench[:3]
        for _ in range(100):
            executor.spin_once(timeout_sec=0.01)
    finally:
        node.destroy_node()
    holds = []
    for name, end in zip(list(_STOPS)[1:], times[3::2], strict=True):
        half = forces[round((end - 0.5 * stay) * rate) : round(end * rate)]
        third, fourth = (float(np.linalg.norm(np.ptp(part, axis=0))) for part in np.array_split(half, 2))
        mean = float(np.linalg.norm(half.mean(axis=0)))
        scatter = float(np.linalg.norm(np.ptp(half, axis=0))) / max(mean, 1e-9)
        holds.append({"after": name, "force": mean, "scatter": scatter, "growth": fourth - third})
    counts = {"poses": len(forces), "answers": answers.count, "echoes": answers.echoes, "late": late}
    return {"rate": rate, **counts, "holds": holds}


def main() -> int:
    """Run the arm; print the holds to stderr as a table and to stdout as JSON."""
    parser = argparse.ArgumentParser(description="A MuJoCo arm in the loop with the node.")
    parser.add_argument("--rate", type=float, default=500.0, metavar="HZ", help="of the poses (default 500)")
    parser.add_argument("--stay", type=float, default=2.0, metavar="S", help="at each of three places [s] (default 2)")
    parser.add_argument("--listeners", type=int, default=1, metavar="N", help="start once N subscribe to the pose")
    given = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with suppress(KeyboardInterrupt):
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        try:
            found = run(given.rate, given.stay, given.listeners)
        finally:
            rclpy.try_shutdown()
        print("{poses} poses at {rate:g} Hz, {answers} answers, {late} late".format(**found), file=sys.stderr)
        for hold in found["holds"]:
            line = "hold after {after:5s} {force:8.3f} N, scatter {scatter:.1e} of it, grows by {growth:.1e} N"
            print(line.format(**hold), file=sys.stderr)
        print(json.dumps(found), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

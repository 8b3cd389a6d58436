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

import numpy as np
import rclpy
from geometry_msgs.msg import InertiaStamped, PoseStamped, TwistStamped, WrenchStamped
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.time import Time

from rft_ros.estimator.messages import wrench_cdr
from rft_ros.node.stiffness import stiffness_sums
from rft_ros.rft import rotation_matrix
from rft_ros.simulation.coupling import held, measure, put, stiffness_matrix
from rft_ros.simulation.mujoco_grains import import_mujoco
from rft_ros.simulation.six_axis_arm import SixAxisArm

Array = NDArray[np.float64]

SENSOR = np.array([0.0, 0.0, 0.12])
"""Place of the load cell in the tool frame [m]; its axes are the tool's."""

_WAYS = np.array([[0.45, 0, 0.01], [0.45, 0, -0.02], [0.47, 0, -0.02], [0.46, 0, -0.02]])  # m
_SPEED, _PAUSE = 0.02, 2.0  # m/s; s in the air before the start, for a tare
_PATIENCE = 10.0  # s


class Answers:
    """The newest wrench and stiffness of the node, by the pose that they belong to."""

    def __init__(self) -> None:
        self.states: dict[int, Array] = {}
        self.wrench, self.sums, self.state = np.zeros(6), np.zeros(10), np.zeros(13)
        self._wrenches: dict[int, Array] = {}
        self.count, self.newest = 0, 0

    def predicted(self, message: WrenchStamped) -> None:
        """Keep a wrench until its stiffness comes."""
        f, t = message.wrench.force, message.wrench.torque
        self._wrenches[Time.from_msg(message.header.stamp).nanoseconds] = np.array([f.x, f.y, f.z, t.x, t.y, t.z])
        self.count += 1

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


def _apply(arm: SixAxisArm, answers: Answers, dt: float) -> Array:
    """Write the grains' wrench to the arm's data for a step of dt [s]; returns it, shape [6]."""
    mujoco = import_mujoco()
    model, data, body = arm.model, arm.data, arm.body
    jacobian, solved, state = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros(13)
    inverse, free, wrench, after, matrix = np.zeros((6, 6)), np.zeros(6), np.zeros(6), np.zeros(6), np.zeros((6, 6))
    data.xfrc_applied[body] = 0.0
    mujoco.mj_forward(model, data)
    mujoco.mj_jacBody(model, data, jacobian[:3], jacobian[3:], body)
    mujoco.mj_solveM(model, data, solved, jacobian)
    measure(data.xpos[body], data.xquat[body], jacobian, solved, data.qvel, data.qacc, state, inverse, free)
    moved = np.zeros(6)
    if answers.sums[0] > 0.0:
        moved[:3] = state[:3] - answers.state[:3]
        mujoco.mju_subQuat(moved[3:], np.roll(state[3:7], 1), np.roll(answers.state[3:7], 1))
        moved[3:] = rotation_matrix(answers.state[3:7]) @ moved[3:]
    stiffness_matrix(answers.sums, matrix)
    now = answers.wrench - matrix @ moved
    held(now, answers.sums, inverse, state[7:], free, dt, 0.1, wrench, after)
    put(wrench, data.xpos[body], data.xipos[body], data.xfrc_applied[body])
    return wrench


def run(rate: float, stay: float, listeners: int) -> dict[str, object]:
    """Run the arm at a rate [Hz], staying `stay` [s] at each of three places; returns what the holds were."""
    arm = SixAxisArm(timestep=1.0 / (rate * max(1, round(1000.0 / rate))))
    steps = max(1, round(1000.0 / rate))
    paths = np.linalg.norm(np.diff(_WAYS, axis=0), axis=1) / _SPEED
    times = np.cumsum([0.0, _PAUSE, *(t for path in paths for t in (path, stay))])
    command = np.repeat(_WAYS, 2, axis=0)
    arm.start(_WAYS[0])
    answers = Answers()
    _apply(arm, answers, 0.001)  # compiles
    node = rclpy.create_node("mujoco_arm")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    reliable = QoSProfile(depth=100)
    poses = node.create_publisher(PoseStamped, "/rft/pose", reliable)
    twists = node.create_publisher(TwistStamped, "/rft/twist", reliable)
    cells = node.create_publisher(WrenchStamped, "/rft/wrench_measured", reliable)
    node.create_subscription(WrenchStamped, "/rft/wrench_predicted", answers.predicted, reliable)
    node.create_subscription(InertiaStamped, "/rft/stiffness", answers.stiffness, reliable)
    pose, twist, serialise = PoseStamped(), TwistStamped(), wrench_cdr("ft_sensor")
    pose.header.frame_id = twist.header.frame_id = "world"
    rows: list[Array] = []
    late = 0
    try:
        while (
            min(p.get_subscription_count() for p in (poses, twists, cells)) < listeners
            or min(node.count_publishers(topic) for topic in ("/rft/wrench_predicted", "/rft/stiffness")) < 1
        ):
            executor.spin_once(timeout_sec=0.05)

        def send(stamp: int) -> None:
            state = arm.state()
            pose.header.stamp = twist.header.stamp = Time(nanoseconds=stamp).to_msg()
            p, q, v, w = pose.pose.position, pose.pose.orientation, twist.twist.linear, twist.twist.angular
            p.x, p.y, p.z, q.x, q.y, q.z, q.w, v.x, v.y, v.z, w.x, w.y, w.z = state.tolist()
            answers.states[stamp] = state
            fx, fy, fz, tx, ty, tz = arm.data.sensordata[:6].tolist()
            cells.publish(serialise(stamp, (fx, fy, fz, tx, ty, tz)))
            twists.publish(twist)
            poses.publish(pose)

        while answers.newest == 0:  # the node's answers may be discovered later than its inputs
            send(node.get_clock().now().nanoseconds)
            executor.spin_once(timeout_sec=0.05)
        begin, stamp, tick = time.monotonic(), node.get_clock().now().nanoseconds, round(1e9 / rate)
        for k in range(round(times[-1] * rate)):
            send(stamp + k * tick)
            end = begin + (k + 1) / rate
            while (left := end - time.monotonic()) > 0.0:
                executor.spin_once(timeout_sec=left)
            # a simulator can wait: on a busy machine the arm falls behind, and its answers stay two ticks old at most
            oldest = stamp + (k - 2) * tick
            while k > 2 and answers.newest < oldest and time.monotonic() < end + _PATIENCE:
                executor.spin_once(timeout_sec=0.01)
            behind = max(time.monotonic() - end - 1.0 / rate, 0.0)
            late, begin = late + (behind > 0.0), begin + behind
            arm.data.ctrl[:] = arm.joints([np.interp(k / rate, times, axis) for axis in command.T])
            for _ in range(steps):
                wrench = _apply(arm, answers, arm.model.opt.timestep)
                arm.step()
            rows.append(wrench.copy())
    finally:
        node.destroy_node()
    forces = np.array(rows)[:, :3]
    holds = []
    for end in times[3::2]:
        last = forces[int((end - 0.5 * stay) * rate) : int(end * rate)]
        mean = float(np.linalg.norm(last.mean(axis=0)))
        holds.append({"force": mean, "scatter": float(np.linalg.norm(np.ptp(last, axis=0))) / max(mean, 1e-9)})
    return {"rate": rate, "poses": len(rows), "answers": answers.count, "late": int(late), "holds": holds}


def main() -> int:
    """Run the arm and print the holds as JSON."""
    parser = argparse.ArgumentParser(description="A MuJoCo arm in the loop with the node.")
    parser.add_argument("--rate", type=float, default=500.0, metavar="HZ", help="of the poses (default 500)")
    parser.add_argument("--stay", type=float, default=2.0, metavar="S", help="at each of three places [s] (default 2)")
    parser.add_argument("--listeners", type=int, default=1, metavar="N", help="start once N subscribe to the pose")
    given = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with suppress(KeyboardInterrupt):
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        try:
            print(json.dumps(run(given.rate, given.stay, given.listeners)), flush=True)
        finally:
            rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())

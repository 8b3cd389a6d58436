"""A six-axis MuJoCo arm as a ROS 2 process that feels what the node predicts: the node in the loop.

Publishes pose, twist and load cell of its tool, waits for the answer, as a simulator can, and feels it for a tick. It
takes the wrench along with /rft/stiffness to where the tool is then, and is implicit with the stiffness. Needs
config/mujoco_arm.yaml at the node. It presses, drags, goes back, and stays at each.
"""

import sys
import time

import numpy as np
from geometry_msgs.msg import InertiaStamped, WrenchStamped
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.time import Time

from rft_ros.estimator import Wrench
from rft_ros.node.arm import RELIABLE, Arm, arm_options, running_arm
from rft_ros.node.stiffness import stiffness_sums
from rft_ros.rft import rotation_matrix
from rft_ros.simulation.coupling import stiffness_matrix
from rft_ros.simulation.mujoco_grains import MujocoBody, import_mujoco
from rft_ros.simulation.six_axis_arm import SixAxisArm

Array = NDArray[np.float64]

_SENSOR = np.array([0.0, 0.0, 0.12])  # place of the load cell in the tool frame [m]; its axes are the tool's
_STOPS = {"start": (0.45, 0.01), "press": (0.45, -0.02), "drag": (0.47, -0.02), "back": (0.46, -0.02)}  # x, z [m]
_SPEED, _PAUSE = 0.02, 2.0  # m/s; s in the air before the start, for a tare
_PATIENCE = 1.0  # s; an answer that has not come by then is lost


class Grains:
    """The grains around the tool as the node told them last: their wrench and stiffness at a state of the tool."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._wrench, self._sums, self._state = np.zeros(6), np.zeros(10), np.zeros(13)
        self._asked: dict[int, Array] = {}  # states by stamp
        self._predicted: dict[int, WrenchStamped] = {}
        self._stiffness: dict[int, InertiaStamped] = {}
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(arm.node)
        arm.node.create_subscription(WrenchStamped, "/rft/wrench_predicted", self._on_predicted, RELIABLE)
        arm.node.create_subscription(InertiaStamped, "/rft/stiffness", self._on_stiffness, RELIABLE)

    def _on_predicted(self, message: WrenchStamped) -> None:
        self._predicted[Time.from_msg(message.header.stamp).nanoseconds] = message

    def _on_stiffness(self, message: InertiaStamped) -> None:
        self._stiffness[Time.from_msg(message.header.stamp).nanoseconds] = message

    def ask(self, stamp: int, state: Array, reading: Wrench) -> None:
        """Publish a state of the tool, shape [13], and its load cell's reading."""
        self._asked[stamp] = state
        self._arm.send(stamp, state, reading)

    def spin(self, end: float) -> None:
        """Take messages until a time of `time.monotonic` [s]."""
        while (left := end - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def answered(self, stamp: int, patience: float = _PATIENCE) -> bool:
        """Wait for the answer to `ask` and feel it from now on; whether it came in time."""
        end = time.monotonic() + patience
        while not (stamp in self._predicted and stamp in self._stiffness):
            if time.monotonic() > end:
                return False
            self._executor.spin_once(timeout_sec=0.01)
        self._state, stiffness = self._asked.pop(stamp), self._stiffness.pop(stamp)
        wrench, axes = self._predicted.pop(stamp).wrench, rotation_matrix(self._state[3:7])
        force = axes @ [wrench.force.x, wrench.force.y, wrench.force.z]
        torque = axes @ [wrench.torque.x, wrench.torque.y, wrench.torque.z]
        self._wrench = np.concatenate([force, torque + np.cross(axes @ _SENSOR, force)])
        self._sums = stiffness_sums(stiffness, self._state[:3])
        return True

    def apply(self, body: MujocoBody, data: object, dt: float) -> None:
        """Let the tool feel them for a step of dt [s]."""
        body.measure(data)
        state, moved, matrix = body.state[0], np.zeros(6), np.zeros((6, 6))
        if self._sums[0] > 0.0:
            moved[:3] = state[:3] - self._state[:3]
            import_mujoco().mju_subQuat(moved[3:], np.roll(state[3:7], 1), np.roll(self._state[3:7], 1))
            moved[3:] = rotation_matrix(self._state[3:7]) @ moved[3:]
        stiffness_matrix(self._sums, matrix)
        body.hold(self._wrench - matrix @ moved, self._sums, dt, 0.1)


def move(arm: Arm, *, rate: float, stay: float, listeners: int) -> None:
    """Move at a rate [Hz], staying `stay` [s] at each of three places; print what the holds were."""
    steps = max(1, round(1000.0 / rate))
    robot = SixAxisArm(timestep=1.0 / (rate * steps))
    body = MujocoBody(robot.model, robot.body)
    stops = np.array([(x, 0.0, z) for x, z in _STOPS.values()])
    paths = np.linalg.norm(np.diff(stops, axis=0), axis=1) / _SPEED
    times = np.cumsum([0.0, _PAUSE, *(t for path in paths for t in (path, stay))])
    command = np.repeat(stops, 2, axis=0)
    robot.start(stops[0])
    grains = Grains(arm)
    grains.apply(body, robot.data, 0.001)  # compiles

    def ask(stamp: int) -> None:
        body.measure(robot.data)
        fx, fy, fz, tx, ty, tz = robot.data.sensordata[:6].tolist()
        grains.ask(stamp, body.state[0].copy(), (fx, fy, fz, tx, ty, tz))

    arm.wait(listeners)
    ask(stamp := arm.now())
    while not grains.answered(stamp, 0.05):  # the node's answers may be discovered later than its inputs
        ask(stamp := arm.now())
    forces, tick, answers = np.zeros((round(times[-1] * rate), 3)), round(1e9 / rate), 0
    stamp, end = arm.now(), time.monotonic()
    for k in range(len(forces)):
        ask(stamp + k * tick)
        answers += grains.answered(stamp + k * tick)
        end = max(end + 1.0 / rate, time.monotonic())
        grains.spin(end)
        robot.data.ctrl[:] = robot.joints([np.interp(k / rate, times, axis) for axis in command.T])
        for _ in range(steps):
            grains.apply(body, robot.data, robot.model.opt.timestep)
            robot.step()
        forces[k] = body.wrench[:3]
    print(f"{len(forces)} poses at {rate:g} Hz, {answers} answers")
    for name, end in zip(list(_STOPS)[1:], times[3::2], strict=True):
        half = forces[round((end - 0.5 * stay) * rate) : round(end * rate)]
        force = float(np.linalg.norm(half.mean(axis=0)))
        scatter = float(np.linalg.norm(np.ptp(half, axis=0))) / max(force, 1e-9)
        print(f"hold after {name:5s} {force:8.3f} N, scatter {scatter:.1e} of it")


def main() -> int:
    """Run the arm until it is done, or SIGINT or SIGTERM."""
    parser = arm_options("A MuJoCo arm in the loop with the node.")
    parser.add_argument("--rate", type=float, default=500.0, metavar="HZ", help="of the poses (default 500)")
    parser.add_argument("--stay", type=float, default=2.0, metavar="S", help="at each of three places [s] (default 2)")
    given = parser.parse_args()
    with running_arm("mujoco_arm") as arm:
        move(arm, rate=given.rate, stay=given.stay, listeners=given.listeners)
    return 0


if __name__ == "__main__":
    sys.exit(main())

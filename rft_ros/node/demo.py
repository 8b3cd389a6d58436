"""``rft demo``: a real node, and a virtual arm that moves, watches, tares and records as a user would."""

import math
import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import InertiaStamped, PoseStamped, TwistStamped, WrenchStamped
from numpy.typing import NDArray
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.time import Time
from rich.box import SIMPLE
from rich.console import Console
from rich.live import Live
from rich.table import Table
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from rft_ros.bags.writing import BagWriter, check_replaceable
from rft_ros.errors import InputError
from rft_ros.estimator import Wrench
from rft_ros.files import whole_folder
from rft_ros.node import mujoco_arm, virtual_arm
from rft_ros.node.topics import type_name
from rft_ros.node.virtual_arm import PAUSE
from rft_ros.simulation.mujoco_grains import import_mujoco

_QOS = QoSProfile(depth=500)
_INPUTS = {"pose": PoseStamped, "twist": TwistStamped, "wrench_measured": WrenchStamped}
_SHOWN = ("predicted", "sigma", "compensated", "residual")
_OUTPUTS = {**{f"wrench_{name}": WrenchStamped for name in _SHOWN}, "medium_learned": JointState}
_PATIENCE = 1.0  # s; an answer that has not come by then is lost
_ELLIPSOID = "an ellipsoid on a virtual arm pitches into virtual grains; a real ROS 2 node predicts and learns."
_MUJOCO = "a six-axis MuJoCo arm presses a plate into grains and drags it. It feels what a real ROS 2 node answers."


def demo(bag: Path, parameters: Path, *, seconds: float, mujoco: bool) -> None:
    """Record a virtual arm for `seconds`, or with `mujoco` one that feels the node's forces; InputError if it fails."""
    if not seconds > PAUSE:
        raise InputError(f"--seconds is {seconds:g}; it must be over {PAUSE:g}, in which the arm rests in the air")
    if mujoco:
        import_mujoco()  # says what to install
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    check_replaceable(bag)
    console = Console(highlight=False)
    console.print(f"[bold]rft demo[/bold]: {_MUJOCO if mujoco else _ELLIPSOID}")
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # ROS must outlive the node's process
    rclpy.get_global_executor()  # `spin_once` would create it, where a signal may come half-way
    with whole_folder(bag.parent, [bag.name]) as part, BagWriter(part / bag.name) as writer:
        cell = _Cell(parameters, writer)
        try:
            console.print("waiting for the node, which may have to compile first ...")
            cell.wait()
            moments = mujoco_arm.moments(cell.answer) if mujoco else virtual_arm.moments(seconds)
            start, tare_at = time.monotonic(), PAUSE / 2.0
            with Live(console=console, refresh_per_second=8, get_renderable=cell.table) as live:
                for t, state, reading in moments:
                    start = max(start, time.monotonic() - t)
                    cell.spin(start + t)
                    cell.send(t, state, reading)
                    if t > tare_at:
                        answer = cell.call("tare")
                        live.console.print(f"t = {t:4.1f} s  tare: {answer.message}", soft_wrap=True)
                        tare_at = math.inf if answer.success else t + 0.3  # a busy machine may have delayed a twist
            cell.spin(time.monotonic() + 0.5)  # the last answers
        finally:
            cell.end()
    console.print(f"\n-> {bag} (rosbag2, MCAP)", soft_wrap=True)
    if "wrench_residual" not in cell.newest:
        raise InputError("no estimates came; see the node's messages above")


class _Cell:
    """A node in a process of its own, and the topics between it and an arm, recorded; the newest answer of each."""

    def __init__(self, parameters: Path, bag: BagWriter) -> None:
        self._bag, self._peer = bag, rclpy.create_node("rft_demo")
        self.newest: dict[str, Any] = {}
        self._publishers = {n: self._peer.create_publisher(kind, f"/rft/{n}", _QOS) for n, kind in _INPUTS.items()}
        for name, kind in {**_OUTPUTS, "stiffness": InertiaStamped}.items():
            self._peer.create_subscription(kind, f"/rft/{name}", partial(self._take, name), _QOS)
        self._begin = self._stamp = 0
        command = [sys.executable, "-m", "rft_ros.node.main", "--ros-args", "--params-file", str(parameters)]
        self._process = subprocess.Popen(command, start_new_session=True)  # Ctrl-C in the terminal does not reach it

    def _take(self, name: str, message: Any) -> None:
        self.newest[name] = message
        if name in _OUTPUTS:
            self._record(name, message)

    def _record(self, name: str, message: Any) -> None:
        self._bag.write_raw(f"/rft/{name}", type_name(type(message)), _stamp(message), serialize_message(message))

    def wait(self) -> None:
        """Until the node answers and listens."""
        self.call("status")
        self._until(lambda: min(p.get_subscription_count() for p in self._publishers.values()) > 0)
        self._begin = self._stamp = self._peer.get_clock().now().nanoseconds

    def send(self, t: float, state: NDArray[np.float64], reading: Wrench) -> None:
        """Publish and record a state, shape [13], and a reading of the load cell at a time from the start [s]."""
        self._stamp = self._begin + round(t * 1e9)
        pose, twist, measured = PoseStamped(), TwistStamped(), WrenchStamped()
        p, q, v, w = pose.pose.position, pose.pose.orientation, twist.twist.linear, twist.twist.angular
        p.x, p.y, p.z, q.x, q.y, q.z, q.w, v.x, v.y, v.z, w.x, w.y, w.z = state.tolist()
        f, m = measured.wrench.force, measured.wrench.torque
        f.x, f.y, f.z, m.x, m.y, m.z = reading
        for name, message in {"wrench_measured": measured, "twist": twist, "pose": pose}.items():
            message.header.frame_id = "ft_sensor" if message is measured else "world"
            message.header.stamp = Time(nanoseconds=self._stamp).to_msg()
            self._publishers[name].publish(message)
            self._record(name, message)

    def answer(self) -> tuple[Wrench, InertiaStamped] | None:
        """Prediction and stiffness at the last state that was sent; None if they are lost."""
        end = time.monotonic() + _PATIENCE
        names = "wrench_predicted", "stiffness"
        while not all(name in self.newest and _stamp(self.newest[name]) == self._stamp for name in names):
            if time.monotonic() > end:
                return None
            rclpy.spin_once(self._peer, timeout_sec=0.01)
        return _wrench(self.newest["wrench_predicted"]), self.newest["stiffness"]

    def spin(self, end: float) -> None:
        """Take answers until a time of `time.monotonic` [s]. InputError if the node has ended."""
        while (left := end - time.monotonic()) > 0.0:
            rclpy.spin_once(self._peer, timeout_sec=left)
        if (status := self._process.poll()) is not None:
            raise InputError(f"the node ended with status {status} before the demo was over; see its messages above")

    def _until(self, condition: Callable[[], bool]) -> None:
        while not condition():
            self.spin(time.monotonic() + 0.05)

    def call(self, service: str) -> Any:
        """The answer of a service."""
        client = self._peer.create_client(Trigger, f"/rft/{service}")
        self._until(client.service_is_ready)
        future = client.call_async(Trigger.Request())
        self._until(future.done)
        self._peer.destroy_client(client)
        return future.result()

    def table(self) -> Table:
        """The newest wrenches."""
        title = f"t = {1e-9 * (self._stamp - self._begin):4.1f} s   (on the tool, sensor frame)"
        table = Table(title=title, box=SIMPLE, padding=(0, 1, 0, 0), pad_edge=False)
        table.add_column("", min_width=11)
        for column in ("fx N", "fy N", "fz N", "tx N m", "ty N m", "tz N m"):
            table.add_column(column, justify="right", min_width=6)
        for name in _SHOWN:
            message = self.newest.get(f"wrench_{name}")
            table.add_row(name, *([f"{v:.3f}" for v in _wrench(message)] if message else ["-"] * 6))
        return table

    def end(self) -> None:
        """End the node, by SIGTERM or after 10 s by SIGKILL, and ROS."""
        self._process.terminate()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(10.0)
        self._process.kill()
        self._process.wait()
        self._peer.destroy_node()
        rclpy.try_shutdown()


def _stamp(message: Any) -> int:
    return int(Time.from_msg(message.header.stamp).nanoseconds)


def _wrench(message: WrenchStamped) -> Wrench:
    f, t = message.wrench.force, message.wrench.torque
    return f.x, f.y, f.z, t.x, t.y, t.z

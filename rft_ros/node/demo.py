"""``rft demo``: a real node and a virtual arm; the demo itself watches, tares and records, as a user would."""

import math
import os
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rich.box import SIMPLE
from rich.console import Console
from rich.live import Live
from rich.table import Table
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from rft_ros.bags.writing import BagWriter, check_replaceable
from rft_ros.errors import InputError
from rft_ros.estimator import WrenchSample
from rft_ros.estimator.messages import decoder
from rft_ros.files import whole_folder
from rft_ros.installation import program
from rft_ros.node.topics import MESSAGES, type_name
from rft_ros.node.virtual_arm import PAUSE

_WRENCH = MESSAGES["wrench"]
_SHOWN = ("predicted", "sigma", "compensated", "residual")
_RECORDED = {"pose": MESSAGES["pose"], "twist": MESSAGES["twist"], "wrench_measured": _WRENCH}
_RECORDED |= {f"wrench_{name}": _WRENCH for name in _SHOWN} | {"medium_learned": JointState}
_NODE, _ARM = "the node", "the arm"
_ELLIPSOID = "an ellipsoid on a virtual arm pitches into virtual grains; a real ROS 2 node predicts and learns."
_MUJOCO = "a six-axis MuJoCo arm presses a plate into grains and drags it. It feels what a real ROS 2 node answers."


def demo(bag: Path, parameters: Path, *, seconds: float, mujoco: bool = False) -> bool:
    """Run the demo and record it to `bag`, which appears when it is whole; whether estimates came.

    `seconds` of the virtual arm's motion; `mujoco`: instead, an arm that feels the node's forces.
    """
    if not seconds > PAUSE:
        raise InputError(f"--seconds is {seconds:g}; it must be over {PAUSE:g}, in which the arm rests in the air")
    arm = ["rft_ros.node.virtual_arm", "--seconds", f"{seconds:g}"]
    if mujoco:
        from rft_ros.simulation.mujoco_grains import import_mujoco

        import_mujoco()  # says what to install
        arm = ["rft_ros.node.mujoco_arm"]
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    check_replaceable(bag)
    console = Console(highlight=False)
    console.print(f"[bold]rft demo[/bold]: {_MUJOCO if mujoco else _ELLIPSOID} By hand, in terminals of your own:\n")
    console.print(f"  {program('rft_node')} --ros-args --params-file {parameters}", soft_wrap=True)
    console.print(f"  {sys.executable} -m {' '.join(arm)}\n", soft_wrap=True)
    signal.signal(signal.SIGTERM, _terminated)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # ROS must outlive the children
    rclpy.get_global_executor()  # `spin_once` would create it, where a signal may come half-way
    with whole_folder(bag.parent, [bag.name]) as part, BagWriter(part / bag.name) as writer:
        watcher = _Watcher(writer)
        try:
            watcher.start(_NODE, "rft_ros.node.main", "--ros-args", "--params-file", str(parameters))
            console.print("waiting for the node, which may have to compile first ...")
            watcher.call(GetParameters, "/rft/get_parameters", GetParameters.Request(names=["mesh.file"]))
            watcher.start(_ARM, *arm, "--listeners", "2")
            watcher.until(lambda: watcher.counts["pose"] > 0)
            _watch(watcher, console)
            watcher.spin(0.5)  # the last answers
        finally:
            watcher.end()
    console.print()
    if not watcher.counts["wrench_residual"]:
        console.print("[red]no estimates came[/red]; see the node's messages above")
        return False
    for name, count in watcher.counts.items():
        console.print(f"recorded {count:5d} /rft/{name}")
    console.print(f"-> {bag} (rosbag2, MCAP)", soft_wrap=True)
    return True


def _terminated(number: int, _: FrameType | None) -> NoReturn:
    """Leave all blocks, which ends the children. Exit status: that of a shell for this signal."""
    raise SystemExit(128 + number)


class _Watcher:
    """Runs the node and the arm; records topics and calls services, as `ros2 bag record` and `service call` would.

    `counts`: messages by topic; `newest`: the newest of each.
    """

    def __init__(self, bag: BagWriter) -> None:
        self._bag, self._node = bag, rclpy.create_node("rft_demo")
        self.children: dict[str, subprocess.Popen[bytes]] = {}
        self.counts, self.newest = dict.fromkeys(_RECORDED, 0), dict[str, bytes]()
        for name, message in _RECORDED.items():
            self._subscribe(name, message)

    def _subscribe(self, name: str, message: Any) -> None:
        def record(data: bytes) -> None:
            seconds, nanoseconds = struct.unpack_from("<iI", data, 4)
            # Log by stamp, a pose after its twist: a busy machine may deliver them in another order.
            stamp = seconds * 1_000_000_000 + nanoseconds + (name == "pose")
            self._bag.write_raw(f"/rft/{name}", type_name(message), stamp, data)
            self.counts[name] += 1
            self.newest[name] = data

        self._node.create_subscription(message, f"/rft/{name}", record, QoSProfile(depth=500), raw=True)

    def start(self, name: str, module: str, *arguments: str) -> None:
        """Start a child process, which Ctrl-C in the terminal does not reach."""
        command = [sys.executable, "-m", module, *arguments]
        self.children[name] = subprocess.Popen(command, start_new_session=True)

    def end(self) -> None:
        """End the children, by SIGTERM or after 10 s by SIGKILL, and ROS."""
        for child in self.children.values():
            child.terminate()
        for child in self.children.values():
            try:
                child.wait(10.0)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()
        self._node.destroy_node()
        rclpy.try_shutdown()

    def spin(self, seconds: float) -> None:
        """Receive messages for a while [s]. InputError if a child ended early; the arm may end once it is done."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            rclpy.spin_once(self._node, timeout_sec=min(left, 0.02))
        for name, child in self.children.items():
            status = child.poll()
            if status is not None and (status != 0 or name == _NODE):
                how = f"was ended by signal {-status}" if status < 0 else f"ended with exit status {status}"
                raise InputError(f"{name} {how} before the demo was over; see its messages above")

    def until(self, condition: Callable[[], bool]) -> None:
        """Spin until the condition holds."""
        while not condition():
            self.spin(0.05)

    def call(self, service_type: type, name: str, request: Any) -> Any:
        """The service's answer."""
        client = self._node.create_client(service_type, name)
        self.until(client.service_is_ready)
        future = client.call_async(request)
        self.until(future.done)
        self._node.destroy_client(client)
        return future.result()


def _watch(watcher: _Watcher, console: Console) -> None:
    """Show the wrenches until the arm is done; tare in the pause."""
    start, tare_at = time.monotonic(), PAUSE / 2.0
    with Live(console=console, refresh_per_second=8) as live:
        while watcher.children[_ARM].poll() is None:
            watcher.spin(0.1)
            elapsed = time.monotonic() - start
            if elapsed > tare_at:
                answer = watcher.call(Trigger, "/rft/tare", Trigger.Request())
                live.console.print(f"t = {elapsed:4.1f} s  tare: {answer.message}", soft_wrap=True)
                tare_at = math.inf if answer.success else elapsed + 0.3  # a busy machine may have delayed a twist
            live.update(_table(watcher.newest, f"t = {elapsed:4.1f} s   (on the tool, sensor frame)"))


def _table(newest: dict[str, bytes], title: str) -> Table:
    table, decode = Table(title=title, box=SIMPLE, padding=(0, 1, 0, 0), pad_edge=False), decoder("wrench", ros1=False)
    table.add_column("", min_width=11)
    for column in ("fx N", "fy N", "fz N", "tx N m", "ty N m", "tz N m"):
        table.add_column(column, justify="right", min_width=6)
    for name in _SHOWN:
        sample = decode(newest[f"wrench_{name}"]) if f"wrench_{name}" in newest else None
        table.add_row(name, *([f"{v:.3f}" for v in sample.wrench] if isinstance(sample, WrenchSample) else ["-"] * 6))
    return table

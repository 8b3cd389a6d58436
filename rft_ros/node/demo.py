"""``rft demo``: a real node and a virtual arm; the demo itself watches, tares and records, as a user would."""

import math
import os
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

import rclpy
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rcl_interfaces.srv import GetParameters
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rich.box import SIMPLE
from rich.console import Console
from rich.live import Live
from rich.table import Table
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from rft_ros.bags.writing import BagWriter, check_replaceable
from rft_ros.errors import InputError
from rft_ros.estimator import Wrench, WrenchSample
from rft_ros.estimator.messages import decoder
from rft_ros.files import whole_folder
from rft_ros.installation import program
from rft_ros.node.virtual_arm import PAUSE

_SHOWN = ("predicted", "sigma", "compensated", "residual")
_WAIT = 900.0  # s, for a node that compiles first beside other work; a node that ended is noticed at once
_NODE, _ARM = "the node", "the virtual arm"

_ELLIPSOID = (
    "an ellipsoid on a virtual arm pitches into virtual grains that are stronger than the model of a real ROS 2 node,"
    " weaker sideways, and have a hard layer. The node takes bias and weight off the load cell and learns the"
    " difference."
)
_MUJOCO = (
    "a six-axis MuJoCo arm presses a plate into grains, drags it, goes back, and stays at each. It feels what a real"
    " ROS 2 node answers."
)


def demo(bag: Path, parameters: Path, *, seconds: float, mujoco: bool = False) -> bool:
    """Run the demo and record it to `bag`, which appears when it is whole; whether estimates came.

    `seconds` of the virtual arm's motion; `mujoco`: instead, an arm that feels the node's forces.
    """
    if not seconds > PAUSE:
        raise InputError(f"--seconds is {seconds:g}; it must be over {PAUSE:g}, in which the arm rests in the air")
    program_of_arm = ["rft_ros.node.virtual_arm", "--seconds", f"{seconds:g}"]
    if mujoco:
        from rft_ros.simulation.mujoco_grains import import_mujoco

        import_mujoco()  # says what to install
        program_of_arm = ["rft_ros.node.mujoco_arm"]
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    check_replaceable(bag)
    console = Console(highlight=False)
    about = _MUJOCO if mujoco else _ELLIPSOID
    console.print(f"[bold]rft demo[/bold]: {about} By hand, in terminals of your own:\n")
    console.print(f"  {program('rft_node')} --ros-args --params-file {parameters}", soft_wrap=True)
    console.print(f"  {sys.executable} -m {' '.join(program_of_arm)}\n", soft_wrap=True)
    signal.signal(signal.SIGTERM, _terminated)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # ROS must outlive the children
    rclpy.get_global_executor()  # `spin_once` would create it, where a signal may come half-way
    try:
        with whole_folder(bag.parent, [bag.name]) as part, BagWriter(part / bag.name) as writer:
            watcher = _Watcher(writer)
            with watcher.process(_NODE, "rft_ros.node.main", "--ros-args", "--params-file", str(parameters)):
                console.print("waiting for the node, which may have to compile first ...")
                watcher.call(GetParameters, "/rft/get_parameters", GetParameters.Request(names=["mesh.file"]))
                with watcher.process(_ARM, *program_of_arm, "--listeners", "2") as arm:
                    _watch(watcher, console, arm)
            watcher.spin(0.2)
            watcher.node.destroy_node()
    finally:
        rclpy.try_shutdown()
    if "residual" not in watcher.wrenches:
        console.print("[red]no estimates came[/red]; see the node's messages above")
        return False
    for topic, count in watcher.counts.items():
        console.print(f"recorded {count:5d} {topic}")
    console.print(f"-> {bag} (rosbag2, MCAP)", soft_wrap=True)
    return True


def _terminated(number: int, _: FrameType | None) -> NoReturn:
    """Leave all blocks, which ends the children. Exit status: that of a shell for this signal."""
    raise SystemExit(128 + number)


class _Watcher:
    """Records and shows topics and calls services, as `ros2 bag record`, `topic echo` and `service call` would.

    `wrenches`: the newest by name of the node's topic.
    """

    def __init__(self, bag: BagWriter) -> None:
        self.node = rclpy.create_node("rft_demo")
        self._bag = bag
        self._decode = decoder("wrench", ros1=False)
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self.counts: dict[str, int] = {}
        self.wrenches: dict[str, Wrench] = {}
        self.learned = "nothing yet"
        for name, message in (("pose", PoseStamped), ("twist", TwistStamped), ("wrench_measured", WrenchStamped)):
            self._subscribe(message, name)
        for name in _SHOWN:
            self._subscribe(WrenchStamped, f"wrench_{name}", partial(self._on_wrench, name))
        self._subscribe(JointState, "medium_learned", self._on_learned)

    def _subscribe(self, message: type, name: str, show: Callable[[bytes], None] = lambda _: None) -> None:
        topic, type_name = f"/rft/{name}", f"{message.__module__.partition('.')[0]}/msg/{message.__name__}"
        self.counts[topic] = 0

        def record(data: bytes) -> None:
            seconds, nanoseconds = struct.unpack_from("<iI", data, 4)
            stamp = seconds * 1_000_000_000 + nanoseconds
            # Log by stamp, a pose after its twist: a busy machine may deliver them in another order.
            self._bag.write_raw(topic, type_name, stamp + (name == "pose"), data)
            self.counts[topic] += 1
            show(data)

        self.node.create_subscription(message, topic, record, QoSProfile(depth=500), raw=True)

    def _on_wrench(self, name: str, data: bytes) -> None:
        if isinstance(sample := self._decode(data), WrenchSample):
            self.wrenches[name] = sample.wrench

    def _on_learned(self, data: bytes) -> None:
        message = deserialize_message(data, JointState)
        values, errors = message.position, message.effort
        self.learned = f"vertical {values[0]:.2f} ± {errors[0]:.2f}, horizontal {values[1]:.2f} ± {errors[1]:.2f}"

    def spin(self, seconds: float) -> None:
        """Receive messages for a while [s]."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            rclpy.spin_once(self.node, timeout_sec=min(left, 0.02))

    @contextmanager
    def process(self, name: str, module: str, *arguments: str) -> Iterator["subprocess.Popen[bytes]"]:
        """A child process that ends with this block: by SIGTERM, or SIGKILL after 10 s."""
        process = subprocess.Popen([sys.executable, "-m", module, *arguments], start_new_session=True)
        self._children[name] = process
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def check_children(self) -> None:
        """Raise InputError if a child ended early; the arm may end once its time is up."""
        for name, child in self._children.items():
            status = child.poll()
            if status is None or (status == 0 and name == _ARM):
                continue
            how = f"was ended by signal {-status}" if status < 0 else f"ended with exit status {status}"
            raise InputError(f"{name} {how} before the demo was over; see its messages above")

    def until(self, condition: Callable[[], bool], what: str) -> None:
        """Spin until the condition holds; InputError, which names `what`, if it does not in time or a child ends."""
        end = time.monotonic() + _WAIT
        while not condition():
            self.check_children()
            if time.monotonic() > end:
                raise InputError(f"{what} within {_WAIT:g} s")
            self.spin(0.05)

    def call(self, service_type: type, name: str, request: Any) -> Any:
        """The service's answer; InputError if none comes in time or the node has ended."""
        client = self.node.create_client(service_type, name)
        self.until(client.service_is_ready, f"there was no service {name}")
        future = client.call_async(request)
        self.until(future.done, f"the service {name} gave no answer")
        self.node.destroy_client(client)
        return future.result()


def _watch(watcher: _Watcher, console: Console, arm: "subprocess.Popen[bytes]") -> None:
    """Show the wrenches until the arm is done; tare in the pause."""
    watcher.until(lambda: watcher.counts["/rft/pose"] > 0, "the virtual arm did not start")
    start = time.monotonic()
    tare_at, said = PAUSE / 2.0, -1.0
    with Live(console=console, refresh_per_second=8, transient=False) as live:
        while arm.poll() is None:
            watcher.spin(0.1)
            watcher.check_children()
            elapsed = time.monotonic() - start
            if elapsed > tare_at:
                answer = watcher.call(Trigger, "/rft/tare", Trigger.Request())
                live.console.print(f"t = {elapsed:4.1f} s  tare: {answer.message}", soft_wrap=True)
                tare_at = math.inf if answer.success else elapsed + 0.3  # a busy machine may have delayed a twist
            if console.is_terminal:
                live.update(_table(watcher, elapsed))
            elif elapsed - said >= 1.0:
                said = elapsed
                text = "  ".join(f"{name} {wrench[2]:6.3f}" for name, wrench in watcher.wrenches.items())
                console.print(f"t = {elapsed:4.1f} s  fz [N]: {text}")
    watcher.check_children()


def _table(watcher: _Watcher, elapsed: float) -> Table:
    title = f"t = {elapsed:4.1f} s   strength learned: {watcher.learned}   (on the tool, sensor frame)"
    table = Table(title=title, box=SIMPLE, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("", min_width=11)
    for column in ("fx N", "fy N", "fz N", "tx N m", "ty N m", "tz N m"):
        table.add_column(column, justify="right", min_width=6)
    for name in _SHOWN:
        wrench = watcher.wrenches.get(name)
        table.add_row(name, *([f"{v:.3f}" for v in wrench] if wrench else ["-"] * 6))
    return table

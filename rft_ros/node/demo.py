"""``rft demo``: a real node and a virtual arm; the demo itself watches, tares, swaps and records, as a user would."""

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
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rich.box import SIMPLE
from rich.console import Console
from rich.live import Live
from rich.table import Table
from std_srvs.srv import Trigger

from rft_ros.bags.writing import BagWriter
from rft_ros.errors import InputError, reason_of
from rft_ros.estimator import PoseSample, Wrench, WrenchSample
from rft_ros.estimator.messages import TYPES, decoder
from rft_ros.installation import program
from rft_ros.node.virtual_arm import PAUSE
from rft_ros.report.pictures import DepthTrace
from rft_ros.rft import rotation_matrix
from rft_ros.tool import load_tool, share_directory

__all__ = ["demo"]

_SHOWN = ("predicted", "compensated", "residual")
_WAIT = 120.0  # s, for a node that compiles first
_NODE, _ARM = "the node", "the virtual arm"


class Watcher:
    """Records and shows topics and calls services, as `ros2 bag record`, `topic echo` and `service call` would."""

    def __init__(self, bag: BagWriter) -> None:
        self.node = rclpy.create_node("rft_demo")
        self._bag = bag
        self._tool = load_tool("ellipsoid")
        self.children: dict[str, subprocess.Popen[bytes]] = {}
        self.counts: dict[str, int] = {}
        self.depth: dict[int, float] = {}
        self.swap: float | None = None
        self.wrenches: dict[str, list[tuple[int, Wrench]]] = {name: [] for name in _SHOWN}
        self._decode_pose, self._decode_wrench = decoder("pose", ros1=False), decoder("wrench", ros1=False)
        self._subscribe(PoseStamped, "/rft/pose", TYPES["pose"], self._on_pose)
        self._subscribe(TwistStamped, "/rft/twist", TYPES["twist"], lambda _: None)
        self._subscribe(WrenchStamped, "/rft/wrench_measured", TYPES["wrench"], lambda _: None)
        for name in _SHOWN:
            self._subscribe(WrenchStamped, f"/rft/wrench_{name}", TYPES["wrench"], partial(self._on_wrench, name))

    def _subscribe(self, message: type, topic: str, type_name: str, show: Callable[[bytes], None]) -> None:
        self.counts[topic] = 0

        def record(data: bytes) -> None:
            # Log by stamp, a pose after its twist: a busy machine may deliver them in another order.
            seconds, nanoseconds = struct.unpack_from("<iI", data, 4)
            logged = seconds * 1_000_000_000 + nanoseconds + (topic == "/rft/pose")
            self._bag.write_raw(topic, type_name, logged, data)
            self.counts[topic] += 1
            show(data)

        self.node.create_subscription(message, topic, record, QoSProfile(depth=500), raw=True)

    def _on_pose(self, data: bytes) -> None:
        if isinstance(pose := self._decode_pose(data), PoseSample):
            self.depth[pose.stamp] = -pose.position[2] - self._tool.lowest_point(rotation_matrix(pose.quaternion))

    def _on_wrench(self, name: str, data: bytes) -> None:
        if isinstance(sample := self._decode_wrench(data), WrenchSample):
            self.wrenches[name].append((sample.stamp, sample.wrench))

    def spin(self, seconds: float) -> None:
        """Receive messages for a while [s]."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            rclpy.spin_once(self.node, timeout_sec=min(left, 0.02))

    def check_children(self) -> None:
        """Raise InputError if a child ended early; the arm may end once its time is up."""
        for name, child in self.children.items():
            status = child.poll()
            if status is None or (status == 0 and name == _ARM):
                continue
            how = f"was ended by signal {-status}" if status < 0 else f"ended with exit status {status}"
            raise InputError(f"{name} {how} before the demo was over; see its messages above")

    def call(self, service_type: type, name: str, request: Any) -> Any:
        """The service's answer; InputError if none comes in time or the node has ended."""
        client = self.node.create_client(service_type, name)
        future = None
        end = time.monotonic() + _WAIT
        try:
            while time.monotonic() < end:
                if future is None and client.service_is_ready():
                    future = client.call_async(request)
                if future is not None and future.done():
                    return future.result()
                self.check_children()
                self.spin(0.05)
        finally:
            self.node.destroy_client(client)
        raise InputError(f"the service {name} gave no answer within {_WAIT:g} s")

    def trace(self) -> DepthTrace:
        """Force over depth on the way down, for the figure."""
        first = min(self.depth.values())
        columns = {
            name: [(self.depth[s], *wrench[:3]) for s, wrench in rows if self.depth.get(s, first) > first]
            for name, rows in self.wrenches.items()
        }
        return DepthTrace(
            measured=columns["compensated"],
            predicted=columns["predicted"],
            residual=columns["residual"],
            swap=self.swap,
        )


@contextmanager
def _process(module: str, *arguments: str) -> Iterator["subprocess.Popen[bytes]"]:
    """A child process that ends with this block: by SIGTERM, or SIGKILL after 10 s."""
    process = subprocess.Popen([sys.executable, "-m", module, *arguments], start_new_session=True)
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _terminated(number: int, _: FrameType | None) -> NoReturn:
    """Leave all blocks, which ends the children and closes the bag. Exit status: that of a shell for this signal."""
    raise SystemExit(128 + number)


def _table(watcher: Watcher, elapsed: float, model: str) -> Table:
    title = f"t = {elapsed:4.1f} s   alpha_y: {model}   (on the tool, sensor frame)"
    table = Table(title=title, box=SIMPLE, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("", min_width=11)
    for column in ("fx N", "fy N", "fz N", "tx N m", "ty N m", "tz N m"):
        table.add_column(column, justify="right", min_width=6)
    for name in _SHOWN:
        rows = watcher.wrenches[name]
        table.add_row(name, *([f"{v:.3f}" for v in rows[-1][1]] if rows else ["-"] * 6))
    return table


def demo(output: Path, *, seconds: float) -> DepthTrace | None:
    """Run the demo for `seconds` of arm motion and record it to ``bag`` in `output`; None if no estimate came."""
    if not seconds > PAUSE:
        raise InputError(f"--seconds is {seconds:g}; it must be over {PAUSE:g}, in which the arm rests in the air")
    console = Console()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"output folder '{output}' cannot be written: {reason_of(error)}") from None
    parameters = share_directory("rft_ros") / "config" / "demo.yaml"
    console.print("[bold]rft demo[/bold]: an ellipsoid on a virtual arm pitches into virtual grains;")
    console.print("a real ROS 2 node predicts the wrench, takes bias and weight off the load cell,")
    console.print("and publishes the residual. By hand, in terminals of your own:\n")
    console.print(f"  {program('rft_node')} --ros-args --params-file {parameters}", soft_wrap=True)
    console.print(f"  {sys.executable} -m rft_ros.node.virtual_arm --seconds {seconds:g}", soft_wrap=True)
    console.print("  ros2 topic echo /rft/wrench_residual")
    console.print("  ros2 service call /rft/tare std_srvs/srv/Trigger")
    console.print("  ros2 param set /rft alpha_y.model linear\n", highlight=False)
    signal.signal(signal.SIGTERM, _terminated)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # ROS must outlive the children
    try:
        with BagWriter(output / "bag") as bag:
            watcher = Watcher(bag)
            with _process("rft_ros.node.main", "--ros-args", "--params-file", str(parameters)) as node:
                watcher.children[_NODE] = node
                console.print("waiting for the node ...")
                watcher.call(GetParameters, "/rft/get_parameters", GetParameters.Request(names=["mesh.file"]))
                with _process("rft_ros.node.virtual_arm", "--seconds", str(seconds), "--listeners", "2") as arm:
                    watcher.children[_ARM] = arm
                    _watch(watcher, console, arm, seconds)
            watcher.spin(0.2)
            trace = watcher.trace()
            watcher.node.destroy_node()
    finally:
        rclpy.try_shutdown()
    if not trace.predicted or not trace.measured:
        console.print("[red]no estimates came[/red]; see the node's messages above")
        return None
    for topic, count in watcher.counts.items():
        console.print(f"recorded {count:5d} {topic}", highlight=False)
    console.print(f"-> {output / 'bag'} (rosbag2, MCAP)", soft_wrap=True, highlight=False)
    again = f"{program('rft')} replay {output / 'bag'} --params {parameters} --tare 2 -o {output / 'replay'}"
    console.print(f"the same offline: {again}", soft_wrap=True, highlight=False)
    return trace


def _watch(watcher: Watcher, console: Console, arm: "subprocess.Popen[bytes]", seconds: float) -> None:
    """Show the wrenches until the arm is done; tare in the pause, swap the α_y model half-way down."""
    deadline = time.monotonic() + _WAIT
    while not watcher.counts["/rft/pose"]:
        watcher.spin(0.05)
        watcher.check_children()
        if arm.poll() is not None or time.monotonic() > deadline:
            raise InputError("the virtual arm did not start")
    start = time.monotonic()
    swap_at = PAUSE + (seconds - PAUSE) / 2.0
    model, tare_at, said = "constant", PAUSE / 2.0, -1.0
    with Live(console=console, refresh_per_second=8, transient=False) as live:
        while arm.poll() is None:
            watcher.spin(0.1)
            watcher.check_children()
            elapsed = time.monotonic() - start
            if elapsed > tare_at:
                answer = watcher.call(Trigger, "/rft/tare", Trigger.Request())
                live.console.print(f"t = {elapsed:4.1f} s  tare: {answer.message}", highlight=False, soft_wrap=True)
                tare_at = math.inf if answer.success else elapsed + 0.3  # a busy machine may have delayed a twist
            if model == "constant" and elapsed > swap_at:
                value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="linear")
                request = SetParameters.Request(parameters=[Parameter(name="alpha_y.model", value=value)])
                result = watcher.call(SetParameters, "/rft/set_parameters", request).results[0]
                watcher.swap = list(watcher.depth.values())[-1]
                model = "linear" if result.successful else f"constant (refused: {result.reason})"
                live.console.print(f"t = {elapsed:4.1f} s  alpha_y.model set to {model}", highlight=False)
            if console.is_terminal:
                live.update(_table(watcher, elapsed, model))
            elif elapsed - said >= 1.0:
                said = elapsed
                text = "  ".join(f"{name} {rows[-1][1][2]:6.3f}" for name, rows in watcher.wrenches.items() if rows)
                console.print(f"t = {elapsed:4.1f} s  fz [N]: {text}", highlight=False)
    watcher.check_children()

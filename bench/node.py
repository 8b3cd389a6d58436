"""``make bench-node``: rft_node beside a bare echo node, in turn, over loopback DDS, at several rates and tool sizes.

`--busy 2` measures beside two processes that keep two cores busy; `--executor single` the other executor.

A driver process publishes wrench, twist and pose at the rate. A round trip ends when the driver's middleware receives
the answer, since the driver itself may be late on a busy machine. Figures of each node: ticks lost, round trip (median,
99th percentile), CPU seconds per second, resident memory.
"""

import argparse
import contextlib
import os
import platform
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np
import rclpy
import trimesh
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from rich.console import Console
from rich.table import Table

RATIOS = {"median": "median_us", "p99": "p99_us", "CPU": "cpu"}  # of rft_node over the echo node
_TICK = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """What one node did at one rate."""

    sent: int
    lost: int
    median_us: float
    p99_us: float
    cpu: float
    resident_mb: float


class Driver:
    """Publishes the three inputs of a node of this name and times the answers."""

    def __init__(self, name: str = "rft") -> None:
        self.node = rclpy.create_node(f"driver_of_{name}")
        qos = QoSProfile(
            history=HistoryPolicy.KEEP_LAST, depth=1000, reliability=ReliabilityPolicy.RELIABLE
        )
        self._pose = self.node.create_publisher(PoseStamped, f"/{name}/pose", qos)
        self._twist = self.node.create_publisher(TwistStamped, f"/{name}/twist", qos)
        self._wrench = self.node.create_publisher(WrenchStamped, f"/{name}/wrench_measured", qos)
        self.arrived: dict[int, int] = {}
        """When the middleware received an answer, by the pose's stamp, both in ns of the system's clock."""
        self.node.create_subscription(
            WrenchStamped, f"/{name}/wrench_predicted", self._on_answer, qos
        )
        self._epoch = time.time_ns()
        self.messages = PoseStamped(), TwistStamped(), WrenchStamped()
        pose, twist, wrench = self.messages
        pose.header.frame_id = twist.header.frame_id = "world"
        wrench.header.frame_id = "ft_sensor"
        pose.pose.position.z = -0.02
        pose.pose.orientation.w = 1.0
        twist.twist.linear.z = -0.01

    def _on_answer(self, message: WrenchStamped, received: dict[str, int]) -> None:
        stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        self.arrived.setdefault(stamp, received["received_timestamp"])

    def wait_for_node(self) -> None:
        """Until it answers."""
        end = time.monotonic() + 120.0
        asked: list[int] = []
        while not any(
            stamp in self.arrived for stamp in asked
        ):  # another node's late answers do not count
            if time.monotonic() > end:
                raise RuntimeError("the node does not answer")
            asked.append(self.new_stamp())
            self.send(asked[-1])
            rclpy.spin_once(self.node, timeout_sec=0.05)

    def new_stamp(self) -> int:
        """A stamp later than all before [ns]."""
        self._epoch = max(self._epoch + 1, time.time_ns())
        return self._epoch

    def send(self, stamp: int) -> int:
        """Publish the three inputs; the time at which the pose left [ns]."""
        pose, twist, wrench = self.messages
        for message in self.messages:
            message.header.stamp = Time(nanoseconds=stamp).to_msg()
        self._wrench.publish(wrench)
        self._twist.publish(twist)
        start = time.time_ns()
        self._pose.publish(pose)
        return start

    def stream(self, count: int, rate: float, each: Callable[[int], None]) -> dict[int, int]:
        """Send that many moments at the rate, calling `each(k)` before moment k, and wait for the answers.

        Returns when each pose left, by its stamp, both in ns.
        """
        sent: dict[int, int] = {}
        start = time.perf_counter()
        for k in range(count):
            while (left := start + k / rate - time.perf_counter()) > 0.0:
                rclpy.spin_once(self.node, timeout_sec=left)
            each(k)
            stamp = self.new_stamp()
            sent[stamp] = self.send(stamp)
        end = time.perf_counter() + 1.0
        while not sent.keys() <= self.arrived.keys() and time.perf_counter() < end:
            rclpy.spin_once(self.node, timeout_sec=0.05)
        return sent

    def drive(self, pid: int, rate: float, seconds: float) -> Run:
        """Send at the rate for the seconds; the first tenth warms up and is not counted."""
        count = round(rate * seconds)
        warm = count // 10
        at: dict[int, tuple[float, float]] = {}

        def read_clocks(k: int) -> None:
            if k in (warm, count - 1):
                at[k] = _cpu_seconds(pid), time.perf_counter()

        sent = self.stream(count, rate, read_clocks)
        cpu, wall = at[warm]
        last_cpu, last_wall = at[count - 1]
        used = (last_cpu - cpu) / (last_wall - wall)
        counted = list(sent.items())[warm:]
        trips = np.array([self.arrived[s] - t for s, t in counted if s in self.arrived]) / 1e3
        return Run(
            sent=len(counted),
            lost=len(counted) - len(trips),
            median_us=float(np.median(trips)),
            p99_us=float(np.percentile(trips, 99)),
            cpu=used,
            resident_mb=_resident_mb(pid),
        )


def _cpu_seconds(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / _TICK


def _resident_mb(pid: int) -> float:
    return (
        int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
    )


@contextlib.contextmanager
def running_node(*command: str) -> Iterator[int]:
    process = subprocess.Popen(
        [sys.executable, *command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        yield process.pid
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(20.0)


@contextlib.contextmanager
def busy_processes(count: int) -> Iterator[None]:
    """Processes that compute all the time, as other work beside the node does."""
    processes = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)
    ]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def sphere(folder: Path, elements: int) -> Path:
    """A UV sphere of 50 mm with about as many facets."""
    n = max(4, round((elements / 7) ** 0.5))
    mesh = trimesh.creation.uv_sphere(radius=25.0, count=[n, 2 * n])
    file = folder / f"sphere_{len(mesh.faces)}.stl"
    mesh.export(file)
    return file


def add_executor_and_busy(parser: argparse.ArgumentParser) -> None:
    """Add the options --executor and --busy."""
    parser.add_argument("--executor", choices=("events", "single"), default="events")
    parser.add_argument(
        "--busy",
        type=int,
        default=0,
        metavar="N",
        help="processes that keep a core busy meanwhile",
    )


def driver_alone() -> Driver:
    """A driver that meets no other nodes of this machine or its network."""
    os.environ["ROS_DOMAIN_ID"] = str(10 + os.getpid() % 90)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    rclpy.init()
    return Driver()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rates", type=float, nargs="+", default=[125.0, 500.0, 1000.0])
    parser.add_argument("--elements", type=int, nargs="+", default=[1000, 10_000, 50_000])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--repeat", type=int, default=3)
    add_executor_and_busy(parser)
    arguments = parser.parse_args()
    driver = driver_alone()
    executor = ["-p", f"executor:={arguments.executor}"]
    echo = [str(Path(__file__).with_name("echo_node.py")), "--ros-args", *executor]
    table = Table(
        title=f"executor {arguments.executor}, {arguments.busy} busy processes, {arguments.seconds:g} s a run, "
        f"median of {arguments.repeat} runs"
    )
    for column in (
        "rate Hz",
        "node",
        "lost / sent",
        "median us",
        "p99 us",
        "CPU %",
        "MB",
        *(f"x {f}" for f in RATIOS),
    ):
        table.add_column(column, justify="right")
    with tempfile.TemporaryDirectory() as folder, busy_processes(arguments.busy):
        for rate in arguments.rates:
            nodes = {"echo": echo}
            for elements in arguments.elements:
                mesh = sphere(Path(folder), elements)
                nodes[mesh.stem] = [
                    "-m",
                    "rft_ros.node.main",
                    "--ros-args",
                    "-p",
                    f"mesh.file:={mesh}",
                ]
                nodes[mesh.stem] += ["-p", "tolerance:=0.0", *executor]
            runs: dict[str, list[Run]] = {name: [] for name in nodes}
            for _ in range(arguments.repeat):
                for name, command in nodes.items():
                    with running_node(*command) as pid:
                        driver.wait_for_node()
                        runs[name].append(driver.drive(pid, rate, arguments.seconds))
            _add_rows(table, rate, runs)
    console = Console(width=120)
    console.print(table)
    console.print(
        f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    )


def _add_rows(table: Table, rate: float, runs: dict[str, list[Run]]) -> None:
    def of(name: str, field: str) -> float:
        return float(median(getattr(run, field) for run in runs[name]))

    for name, own in runs.items():
        ratios = [f"{of(name, f) / of('echo', f):.2f}" for f in RATIOS.values()]
        table.add_row(
            f"{rate:g}",
            name,
            f"{sum(r.lost for r in own)} / {sum(r.sent for r in own)}",
            f"{of(name, 'median_us'):.0f}",
            f"{of(name, 'p99_us'):.0f}",
            f"{100 * of(name, 'cpu'):.1f}",
            f"{of(name, 'resident_mb'):.0f}",
            *ratios,
        )


if __name__ == "__main__":
    main()

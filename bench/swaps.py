"""``make bench-swaps``: how late the answers are while rft_node compiles and swaps models, beside a bare echo node.

500 Hz, learning on. A driver sends one second to rft_node and the next one to the echo node, in turn, so that other
work on the machine delays both alike. Phases: the first 20 s after the node says "ready"; 20 s with swaps of the mesh
(1,000 to 5,000 triangles, reduced as by default), one a second once the last is in force, and ten changes of the medium
a second; 20 s without changes.
Figures of each phase: answers lost, round trip (median, 90th and 99th percentile), and the 99th percentile over that of
the echo node.

`--busy 2` measures beside two processes that keep two cores busy; `--cold` starts the node with an empty cache of
machine code, as after the installation; `--in-force` also says after how long a tool of 37,632 triangles is in force,
reduced, and again from the cache of reduced tools.
"""

import argparse
import itertools
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rclpy
import trimesh
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rich.console import Console
from rich.table import Table
from std_srvs.srv import Trigger

from bench.node import (
    Driver,
    add_executor_and_busy,
    busy_processes,
    driver_alone,
    running_node,
    sphere,
)

RATE_HZ = 500.0
PHASE_S = 20  # of each node, one second in turn with the other
MAX_WAIT_S = 300.0  # for a swap
STROKE_S = 4.0  # down and up again
SPEED_M_S = 0.01


def move(driver: Driver, k: int) -> None:
    """Move the tool of the messages to moment k, down and up in the grains, with a force that varies."""
    time_s = (k / RATE_HZ) % STROKE_S
    is_down = time_s < 0.5 * STROKE_S
    pose, twist, wrench = driver.messages
    pose.pose.position.z = -0.02 - SPEED_M_S * (time_s if is_down else STROKE_S - time_s)
    twist.twist.linear.z = -SPEED_M_S if is_down else SPEED_M_S
    wrench.wrench.force.z = 20.0 + k % 7


@dataclass(frozen=True)
class Trips:
    """Round trips of one node in one phase [ms]; infinite for an answer that was lost."""

    phase: str
    node: str
    all: NDArray[np.float64]

    @property
    def answered(self) -> NDArray[np.float64]:
        """Those of the answers that came."""
        return self.all[np.isfinite(self.all)]

    @property
    def in_words(self) -> str:
        """The percentiles, for a look while the measurement runs."""
        p50, p90, p99 = (self.percentile(percent) for percent in (50, 90, 99))
        return f"{self.phase}, {self.node}: median {p50:.2f}, p90 {p90:.2f}, p99 {p99:.2f} ms"

    def percentile(self, percent: float) -> float:
        """A percentile of the answers that came."""
        return float(np.percentile(self.answered, percent))


class Swapper:
    """Sets parameters of rft_node between two moments of a stream."""

    def __init__(self, driver: Driver, meshes: list[str]) -> None:
        self._driver = driver
        self._meshes = itertools.cycle(meshes)
        self._set = driver.node.create_client(SetParameters, "/rft/set_parameters")
        self._status = driver.node.create_client(Trigger, "/rft/status")
        driver.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        self._wanted = ""
        self._in_force = ""
        self.swaps = 0
        """Meshes that came into force."""

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == "/rft: model":
                tool = next(pair.value for pair in status.values if pair.key == "tool")
                if tool == self._wanted != self._in_force:
                    self.swaps += 1
                self._in_force = tool

    def set(self, name: str, value: str | float) -> None:
        """Set a parameter, without waiting for the answer."""
        if isinstance(value, str):
            given = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value)
        else:
            given = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
        parameter = Parameter(name=name, value=given)
        self._set.call_async(SetParameters.Request(parameters=[parameter]))

    def swap(self, k: int) -> None:
        """Before moment k: another mesh each second, if the last is in force, and ten changes of the medium."""
        within = k % round(RATE_HZ)
        if within == 250 and self._wanted in ("", self._in_force):
            mesh = next(self._meshes)
            self._wanted = Path(mesh).stem
            self.set("mesh.file", mesh)
        elif within % 100 == 25:
            self.set("medium.zeta", 0.5 + 0.1 * (within // 100))
        elif within % 100 == 75:
            self.set("alpha_y.model", ("linear", "constant")[within // 100 % 2])

    def in_force_after(self, mesh: str, tolerance: float) -> float:
        """Seconds from setting a mesh until the node has it, while it answers poses."""
        self.set("tolerance", tolerance)
        self.set("mesh.file", mesh)
        begin = time.monotonic()
        while time.monotonic() - begin < MAX_WAIT_S:
            self._driver.stream(round(0.2 * RATE_HZ), RATE_HZ, lambda _: None)
            asked = self._status.call_async(Trigger.Request())
            rclpy.spin_until_future_complete(self._driver.node, asked, timeout_sec=5.0)
            said = asked.result().message if asked.done() else ""
            if f"tool {Path(mesh).stem} in force" in said and "preparing" not in said:
                return time.monotonic() - begin
        return MAX_WAIT_S


def trips_in_turn(
    phase: str, drivers: dict[str, Driver], disturb: Callable[[int], None]
) -> list[Trips]:
    """One second to each node in turn. `disturb(k)` is called before moment k of rft_node."""
    seen: dict[str, list[float]] = {name: [] for name in drivers}
    for second in range(PHASE_S):
        for name, driver in drivers.items():

            def each(
                k: int, name: str = name, driver: Driver = driver, begin: int = second
            ) -> None:
                move(driver, k + begin * round(RATE_HZ))
                if name == "rft":
                    disturb(k)

            sent = driver.stream(round(RATE_HZ), RATE_HZ, each)
            seen[name] += [
                1e-6 * (driver.arrived[stamp] - left) if stamp in driver.arrived else np.inf
                for stamp, left in sent.items()
            ]
    return [Trips(phase, name, np.array(values)) for name, values in seen.items()]


def table_of(trips: list[Trips], title: str) -> Table:
    """A row for each node and phase."""
    table = Table(title=title)
    for column in ("phase", "node", "lost / sent", "median", "p90", "p99", "p99 over echo's"):
        table.add_column(column, justify="right")
    echo = {trip.phase: trip.percentile(99) for trip in trips if trip.node == "echo"}
    for trip in trips:
        table.add_row(
            trip.phase,
            trip.node,
            f"{len(trip.all) - len(trip.answered)} / {len(trip.all)}",
            *(f"{trip.percentile(percent):.2f}" for percent in (50, 90, 99)),
            f"{trip.percentile(99) / echo[trip.phase]:.2f}",
        )
    return table


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_executor_and_busy(parser)
    parser.add_argument("--cold", action="store_true", help="begin with an empty cache of code")
    parser.add_argument("--in-force", action="store_true", help="also time a reduced tool")
    arguments = parser.parse_args()
    drivers = {"rft": driver_alone(), "echo": Driver("echo")}
    executor = ["-p", f"executor:={arguments.executor}"]
    echo_file = str(Path(__file__).with_name("echo_node.py"))
    echo = [echo_file, "--ros-args", "-r", "__node:=echo", *executor]
    with tempfile.TemporaryDirectory() as folder, busy_processes(arguments.busy):
        os.environ["XDG_CACHE_HOME"] = folder  # of reduced tools: empty at the start
        if arguments.cold:
            os.environ["NUMBA_CACHE_DIR"] = folder
        meshes = [str(sphere(Path(folder), n)) for n in (2000, 5000, 3000, 1000)]
        parameters = {"mesh.file": meshes[-1], "learning.mode": "apply"}
        node = ["-m", "rft_ros.node.main", "--ros-args", *executor]
        for name, value in parameters.items():
            node += ["-p", f"{name}:={value}"]
        trips: list[Trips] = []
        with running_node(*echo), running_node(*node):
            for driver in drivers.values():
                driver.wait_for_node()
            swapper = Swapper(drivers["rft"], meshes)
            for phase, disturb in (
                ("first 20 s", _undisturbed),
                ("swaps", swapper.swap),
                ("no changes", _undisturbed),
            ):
                trips += trips_in_turn(phase, drivers, disturb)
                for trip in trips[-len(drivers) :]:
                    print(trip.in_words, flush=True)
            print(f"{swapper.swaps} swaps of the mesh")
            if arguments.in_force:
                tool = Path(folder) / "torus.stl"
                trimesh.creation.torus(30.0, 8.0, major_sections=196, minor_sections=96).export(
                    tool
                )
                cold_s = swapper.in_force_after(str(tool), 0.025)
                swapper.in_force_after(meshes[-1], 0.0)
                warm_s = swapper.in_force_after(str(tool), 0.025)
                print(
                    f"37,632 triangles, reduced: in force after {cold_s:.1f} s; from the cache after {warm_s:.1f} s"
                )
    beside = f"executor {arguments.executor}, {arguments.busy} busy processes"
    title = f"{RATE_HZ:g} Hz, {beside}: round trip in ms"
    Console(width=110).print(table_of(trips, title))


def _undisturbed(_: int) -> None:
    """Set nothing."""


if __name__ == "__main__":
    main()

"""``make bench-swaps``: what swaps cost the ticks. 500 Hz; mesh swaps up to 50,000 triangles, then ζ and α_y swaps.

For each phase: ticks sent and lost, round trip (median, 99th percentile, greatest), and how many took over 2 ms more
than the 99th percentile of the undisturbed phase. Then the time until a tool of 37,632 triangles is in force, reduced,
and again from the cache of reduced tools. `--busy 2` measures beside two processes that keep two cores busy.
"""

import argparse
import os
import tempfile
import time
from pathlib import Path

import numpy as np
import rclpy
import trimesh
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rich.console import Console
from rich.table import Table
from std_srvs.srv import Trigger

from bench.node import (
    add_executor_and_busy,
    busy_processes,
    driver_alone,
    running_node,
    sphere,
)

RATE = 500.0
LONGEST = 300.0  # s to wait for a swap


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_executor_and_busy(parser)
    arguments = parser.parse_args()
    driver = driver_alone()
    client = driver.node.create_client(SetParameters, "/rft/set_parameters")
    status = driver.node.create_client(Trigger, "/rft/status")
    answers = []

    def call(name: str, value: ParameterValue) -> None:
        parameter = Parameter(name=name, value=value)
        answers.append(client.call_async(SetParameters.Request(parameters=[parameter])))

    def in_force(mesh: str, tolerance: float) -> float:
        """Seconds from setting a mesh until the node has it, at `RATE`."""
        call(
            "tolerance",
            ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=tolerance),
        )
        call("mesh.file", ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=mesh))
        begin = time.monotonic()
        while time.monotonic() - begin < LONGEST:
            driver.stream(round(0.2 * RATE), RATE, lambda _: None)
            asked = status.call_async(Trigger.Request())
            rclpy.spin_until_future_complete(driver.node, asked, timeout_sec=5.0)
            said = asked.result().message if asked.done() else ""
            if f"tool {Path(mesh).stem} in force" in said and "preparing" not in said:
                return time.monotonic() - begin
        return LONGEST

    with tempfile.TemporaryDirectory() as folder, busy_processes(arguments.busy):
        os.environ["XDG_CACHE_HOME"] = folder  # of reduced tools: empty at the start
        meshes = [str(sphere(Path(folder), n)) for n in (1000, 10_000, 50_000, 5000)]
        command = [
            "-m",
            "rft_ros.node.main",
            "--ros-args",
            "-p",
            f"mesh.file:={meshes[0]}",
            "-p",
            "tolerance:=0.0",
        ]

        def swap_mesh(k: int) -> None:
            if k % 750 == 375:
                file = meshes[(k // 750 + 1) % len(meshes)]
                call(
                    "mesh.file",
                    ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=file),
                )

        def swap_model(k: int) -> None:
            if k % 50 == 25 and k % 100 == 25:
                value = 0.5 + (k // 100 % 10) / 10.0
                call(
                    "medium.zeta",
                    ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value),
                )
            elif k % 50 == 25:
                name = ("linear", "constant")[k // 100 % 2]
                call(
                    "alpha_y.model",
                    ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=name),
                )

        beside = f"executor {arguments.executor}, {arguments.busy} busy processes"
        table = Table(title=f"Swaps at {RATE:g} Hz, {beside}: round trip in us")
        for column in (
            "phase",
            "swaps",
            "lost / sent",
            "median",
            "p99",
            "greatest",
            "over p99 + 2 ms",
        ):
            table.add_column(column, justify="right")
        with running_node(*command, "-p", f"executor:={arguments.executor}"):
            driver.wait_for_node()
            limit = 0.0
            for phase, seconds, disturb in (
                ("warm-up", 3.0, lambda _: None),
                ("undisturbed", 30.0, lambda _: None),
                ("20 meshes", 30.0, swap_mesh),
                ("100 of ζ, α_y", 10.0, swap_model),
                ("undisturbed", 30.0, lambda _: None),
            ):
                answers.clear()
                sent = driver.stream(round(RATE * seconds), RATE, disturb)
                trips = (
                    np.array([driver.arrived.get(s, np.inf) - t for s, t in sent.items()]) / 1e3
                )
                good = trips[np.isfinite(trips)]
                for answer in answers:  # a busy machine answers after the stream has ended
                    rclpy.spin_until_future_complete(driver.node, answer, timeout_sec=LONGEST)
                refused = [
                    f.result()
                    for f in answers
                    if not (f.done() and f.result().results[0].successful)
                ]
                if refused:
                    raise RuntimeError(f"{len(refused)} swaps were not accepted: {refused[0]}")
                limit = limit or (
                    float(np.percentile(good, 99)) + 2000.0 if phase == "undisturbed" else 0.0
                )
                slow = int((good > limit).sum()) if limit else 0
                row = (np.median(good), np.percentile(good, 99), good.max())
                cells = [f"{v:.0f}" for v in row]
                table.add_row(
                    phase,
                    str(len(answers)),
                    f"{len(trips) - len(good)} / {len(trips)}",
                    *cells,
                    str(slow),
                )
            tool = Path(folder) / "torus.stl"
            trimesh.creation.torus(30.0, 8.0, major_sections=196, minor_sections=96).export(tool)
            cold = in_force(str(tool), 0.025)
            in_force(meshes[0], 0.0)
            warm = in_force(str(tool), 0.025)
    console = Console(width=110)
    console.print(table)
    console.print(
        f"37,632 triangles, reduced: in force after {cold:.1f} s; from the cache after {warm:.1f} s"
    )


if __name__ == "__main__":
    main()

"""``make bench-doctor``: what `rft doctor` says of twelve right cells and twenty wrong ones, live, over loopback DDS.

`--busy 2` asks beside two processes that keep two cores busy. For each cell: whether the fault is named (or, of a
right cell, none), whether the machine was called too busy to judge, and what else was to be fixed. Only the lines under
"else" may be wrong advice: read them.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
import yaml
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rich.console import Console
from rich.table import Table

from bench.node import busy_processes, running_node

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "unit"))
import cells  # type: ignore[import-not-found]
from recordings import cdr  # type: ignore[import-not-found]
from scipy.spatial.transform import Rotation

from rft_ros.rft import FORCE, POSE, POSITION, QUATERNION, TORQUE, TWIST, VELOCITY

# Hz; the recorded motion takes 10 s
RATE = 100.0
HASTE = 4
TILTED = Rotation.from_rotvec(np.radians(120.0) / np.sqrt(14.0) * np.array([1.0, 2.0, 3.0]))
TURNED = (
    (Rotation.from_quat(cells.MOUNT.quaternion) * Rotation.from_euler("x", 180, degrees=True))
    .as_quat()
    .tolist()
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """A cell's parameters, what its drivers do wrong, and a part of the line that names the fault."""

    named: str
    parameters: dict[str, Any] = field(default_factory=dict)
    frame: str = "world"
    silent: str = ""
    unstamped: bool = False
    scale: float = 1.0
    bias: float = 0.0
    old: int = 0
    late: int = 0  # stamps of the load cell [ns]
    friction: float = 0.0  # of the greatest force, against the motion
    clipped: float = 1.0  # greatest reading, of the greatest force
    repeated: int = 1  # how often each pose is sent
    noise: float = 0.0  # of the poses [m]
    torque: float = 1.0
    unit: float = 1.0  # of the poses, over a metre
    tilted: bool = False  # the tool, out of the world's axes
    in_world: bool = False  # the load cell reads in the world's axes


_DIFFERENCED = {"twist_source": "pose_difference"}
_RIGHT = {
    "right": Fault(named=""),
    "right, differenced": Fault(named="", parameters=_DIFFERENCED),
    "right, with memory": Fault(named="", parameters={"medium.mobilization_length": 0.003}),
    "right, learning": Fault(named="", parameters={"learning.mode": "apply"}),
    "right, a map": Fault(named="", parameters={"ground.cell": 0.004}),
    "right, tilted": Fault(named="", tilted=True),
    "right, world axes": Fault(
        named="", tilted=True, in_world=True, parameters={"sensor.frame_source": "world"}
    ),
    "right, hard grains": Fault(named="", scale=1.7),
    "right, soft grains": Fault(named="", scale=0.65),
    "right, quiet noise": Fault(named="", noise=3e-6, parameters=_DIFFERENCED),
    "right, tared": Fault(
        named="", bias=2.0, parameters={"sensor.bias": [0.0, 0.0, 2.0, 0.0, 0.0, 0.0]}
    ),
    "right, late by a known time": Fault(
        named="", late=80_000_000, parameters={"sensor.delay": 0.08}
    ),
}

FAULTS = {
    **_RIGHT,
    "frame of poses and twists": Fault(named="set world_frame: base", frame="base"),
    "sign": Fault(named="set sensor.sign: 1", parameters={"sensor.sign": -1.0}),
    "cell turned": Fault(
        named="by 180 degrees; set sensor.quaternion", parameters={"sensor.quaternion": TURNED}
    ),
    "no twists": Fault(named="twist: nothing on", silent="twist"),
    "no load cell": Fault(named="wrench: nothing on", silent="wrench"),
    "no stamps": Fault(named="have no stamp", unstamped=True),
    "mesh in metres": Fault(named="set mesh.scale: 0.001", parameters={"mesh.scale": 1e-6}),
    "surface 100 mm too high": Fault(
        named="set surface_height: 0.1", parameters={"surface_height": cells.SURFACE + 0.1}
    ),
    "load cell in kgf": Fault(named="measured over predicted force", scale=1.0 / 9.81),
    "not tared": Fault(named="load cell: it reads", bias=2.0),
    "load cell 80 ms late": Fault(named="set sensor.delay: 0.0", late=80_000_000),
    "friction in the air": Fault(named="zero that moves", friction=0.3),
    "load cell clipped": Fault(named="saturation", clipped=0.5),
    "poses repeated": Fault(named="each pose is sent", repeated=5),
    "poses with noise": Fault(named="the poses have a noise", noise=2e-4),
    "torque in N mm": Fault(named="not N mm", torque=1e3),
    "sensor 150 mm away": Fault(
        named="set sensor.position", parameters={"sensor.position": [0.15, 0.0, 0.05]}
    ),
    "reading in world axes": Fault(
        named="set sensor.frame_source: world", tilted=True, in_world=True
    ),
    "poses in mm": Fault(named="not millimetres", unit=1e3),
    "clocks differ by 0.5 s": Fault(named="synchronise the clocks", old=500_000_000),
}


def said_of(fault: Fault, folder: Path, seconds: float) -> list[str]:
    """The doctor's lines, but for the compilation."""
    parameters = {**cells.PARAMETERS, **fault.parameters}
    file = folder / "cell.yaml"
    file.write_text(yaml.safe_dump({"/**": {"ros__parameters": parameters}}))
    states = cells.motion(RATE / HASTE)
    states[:, VELOCITY] *= HASTE
    states[:, QUATERNION] = TILTED.as_quat() if fault.tilted else states[:, QUATERNION]
    loads = cells.loads(states)
    peak = abs(loads[:, 2]).max()
    loads[:, 2] += fault.friction * peak * np.sign(states[:, VELOCITY][:, 2])
    loads = (
        np.clip(loads, -fault.clipped * peak, fault.clipped * peak)
        if fault.clipped < 1.0
        else loads
    )
    loads = fault.scale * loads * ([1.0] * 3 + [fault.torque] * 3) + [
        0.0,
        0.0,
        fault.bias,
        0.0,
        0.0,
        0.0,
    ]
    if fault.in_world:
        to_world = Rotation.from_quat(states[:, QUATERNION]) * Rotation.from_quat(
            cells.MOUNT.quaternion
        )
        loads = np.hstack([to_world.apply(part) for part in (loads[:, FORCE], loads[:, TORQUE])])
    states[:, POSITION] += np.random.default_rng(1).normal(0.0, fault.noise, (len(states), 3))
    states[:, POSITION] = states[
        np.arange(len(states)) // fault.repeated * fault.repeated, POSITION
    ]
    states[:, POSITION] *= fault.unit
    rows = list(zip(states.tolist(), loads.tolist(), strict=True))
    driver = rclpy.create_node("drivers")
    kinds = {"wrench_measured": WrenchStamped, "twist": TwistStamped, "pose": PoseStamped}
    publish: dict[str, Callable[[bytes], None]] = {
        name: driver.create_publisher(kind, f"/rft/{name}", 10).publish
        for name, kind in kinds.items()
        if not fault.silent or not name.startswith(fault.silent)
    }
    command = [
        sys.executable,
        "-m",
        "rft_ros.cli",
        "doctor",
        str(file),
        "--seconds",
        f"{seconds:g}",
    ]
    with running_node("-m", "rft_ros.node.main", "--ros-args", "--params-file", str(file)):
        doctor = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        start = time.monotonic()
        k = 0
        while doctor.poll() is None:
            time.sleep(max(0.0, start + k / RATE - time.monotonic()))
            now = driver.get_clock().now().nanoseconds - fault.old
            state, load = rows[k % len(rows)]
            messages = {
                "wrench_measured": cdr("wrench", 0 if fault.unstamped else now + fault.late, load),
                "twist": cdr("twist", now, state[TWIST], fault.frame),
                "pose": cdr("pose", now, state[POSE], fault.frame),
            }
            for name, send in publish.items():
                send(messages[name])
            k += 1
        lines = doctor.communicate()[0].splitlines()
    driver.destroy_node()
    return [line for line in lines if "compiled" not in line]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--busy",
        type=int,
        default=0,
        metavar="N",
        help="processes that keep a core busy meanwhile",
    )
    parser.add_argument("--seconds", type=float, default=6.0, help="how long the doctor listens")
    parser.add_argument(
        "--only", nargs="+", default=list(FAULTS), metavar="FAULT", help="of " + ", ".join(FAULTS)
    )
    arguments = parser.parse_args()
    os.environ["ROS_DOMAIN_ID"] = str(10 + os.getpid() % 90)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    rclpy.init()
    table = Table(title=f"rft doctor beside {arguments.busy} busy processes", show_lines=True)
    for column in ("cell", "named", "too busy", "else"):
        table.add_column(column)
    with tempfile.TemporaryDirectory() as folder, busy_processes(arguments.busy):
        for name in arguments.only:
            fault = FAULTS[name]
            wrong = [
                line
                for line in said_of(fault, Path(folder), arguments.seconds)
                if line.startswith("FIX")
            ]
            busy = [line for line in wrong if "too busy" in line]
            named = [line for line in wrong if fault.named and fault.named in line]
            others = [line for line in wrong if line not in (*busy, *named)]
            right = not wrong if not fault.named else bool(named)
            table.add_row(name, "yes" if right else "no", "yes" if busy else "", "\n".join(others))
    Console(width=160).print(table)
    rclpy.shutdown()


if __name__ == "__main__":
    main()

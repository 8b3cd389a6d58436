"""``make bench-doctor``: what `rft doctor` says of twelve right cells and twenty wrong ones, live and from a bag.

Live is over loopback DDS; `--busy 2` asks beside two processes that keep two cores busy. For each cell: whether the
fault is named (or, of a right cell, none), whether the machine was called too busy to judge, and what else was to be
fixed. Only the lines under "else" may be wrong advice: read them. The last line counts the cells.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
import yaml
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rich.console import Console
from rich.table import Table

from bench.node import busy_processes, running_node
from bench.random_doctor import report

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "unit"))
import cells  # type: ignore[import-not-found]
from recordings import POSE as POSE_KIND  # type: ignore[import-not-found]
from recordings import START, cdr, write_messages
from recordings import TWIST as TWIST_KIND
from recordings import WRENCH as WRENCH_KIND
from scipy.spatial.transform import Rotation

from rft_ros.rft import FORCE, POSE, POSITION, QUATERNION, TORQUE, TWIST, VELOCITY

KINDS = {"wrench_measured": WRENCH_KIND, "twist": TWIST_KIND, "pose": POSE_KIND}
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
        named="set sensor.quaternion: [0, 0, 0.7071, 0.7071]",
        parameters={"sensor.quaternion": TURNED},
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
    "poses repeated": Fault(named="each pose is sent", repeated=5, noise=3e-6),
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


def rows_of(fault: Fault) -> list[tuple[list[float], list[float]]]:
    """The states and the readings of the load cell, at `RATE`."""
    states = cells.motion(RATE / HASTE)
    states[:, VELOCITY] *= HASTE
    states[:, QUATERNION] = TILTED.as_quat() if fault.tilted else states[:, QUATERNION]
    loads = cells.loads(states)
    peak = abs(loads[:, 2]).max()
    loads[:, 2] += fault.friction * peak * np.sign(states[:, VELOCITY][:, 2])
    if fault.clipped < 1.0:
        loads = np.clip(loads, -fault.clipped * peak, fault.clipped * peak)
    loads = fault.scale * loads * ([1.0] * 3 + [fault.torque] * 3)
    loads[:, 2] += fault.bias
    if fault.in_world:
        to_world = Rotation.from_quat(states[:, QUATERNION]) * Rotation.from_quat(
            cells.MOUNT.quaternion
        )
        loads = np.hstack([to_world.apply(part) for part in (loads[:, FORCE], loads[:, TORQUE])])
    states[:, POSITION] += np.random.default_rng(1).normal(0.0, fault.noise, (len(states), 3))
    measured = np.arange(len(states)) // fault.repeated * fault.repeated
    states[:, POSITION] = fault.unit * states[measured, POSITION]
    return list(zip(states.tolist(), loads.tolist(), strict=True))


def repeated_row(
    rows: list[tuple[list[float], list[float]]], k: int
) -> tuple[list[float], list[float]]:
    """Row k of the motion, which is repeated from where it ended: back at its start the pose would jump."""
    laps, row = divmod(k, len(rows))
    state, load = rows[row]
    first = rows[0][0]
    last = rows[-1][0]
    place = [
        p + laps * (end - begin)
        for p, begin, end in zip(state[POSITION], first[POSITION], last[POSITION], strict=True)
    ]
    return [*place, *state[POSITION.stop :]], load


def messages_of(
    fault: Fault, state: list[float], load: list[float], now: int
) -> Iterator[tuple[str, bytes]]:
    """The name of each topic and its message at a time [ns]."""
    stamp = now - fault.old
    of_wrench = 0 if fault.unstamped else stamp + fault.late
    if fault.silent != "wrench":
        yield "wrench_measured", cdr("wrench", of_wrench, load)
    if fault.silent != "twist":
        yield "twist", cdr("twist", stamp, state[TWIST], fault.frame)
    yield "pose", cdr("pose", stamp, state[POSE], fault.frame)


def command_of(fault: Fault, folder: Path, *more: str) -> tuple[Path, list[str]]:
    """The file of the cell's parameters, and the command that examines it."""
    file = folder / "cell.yaml"
    parameters = {**cells.PARAMETERS, **fault.parameters}
    file.write_text(yaml.safe_dump({"/**": {"ros__parameters": parameters}}))
    return file, [sys.executable, "-m", "rft_ros.cli", "doctor", str(file), *more]


def said_from_a_bag(fault: Fault, folder: Path, seconds: float) -> str:
    """What the doctor prints of a recording of these seconds; messages arrive 1 ms after they are sent."""
    rows = rows_of(fault)
    messages = [
        (now + 1_000_000, f"/rft/{name}", KINDS[name], data)
        for k in range(round(seconds * RATE))
        for now in [START + round(k * 1e9 / RATE)]
        for name, data in messages_of(fault, *repeated_row(rows, k), now)
    ]
    bag = folder / "bag"
    shutil.rmtree(bag, ignore_errors=True)
    _, command = command_of(fault, folder, "--bag", str(write_messages(bag, messages)))
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


def said_live(fault: Fault, folder: Path, seconds: float) -> str:
    """What the doctor prints while the cell runs."""
    rows = rows_of(fault)
    driver = rclpy.create_node("drivers")
    kinds = {"wrench_measured": WrenchStamped, "twist": TwistStamped, "pose": PoseStamped}
    publish: dict[str, Callable[[bytes], None]] = {
        name: driver.create_publisher(kind, f"/rft/{name}", 10).publish
        for name, kind in kinds.items()
        if not fault.silent or not name.startswith(fault.silent)
    }
    file, command = command_of(fault, folder, "--seconds", f"{seconds:g}")
    with running_node("-m", "rft_ros.node.main", "--ros-args", "--params-file", str(file)):
        doctor = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        start = time.monotonic()
        k = 0
        while doctor.poll() is None:
            time.sleep(max(0.0, start + k / RATE - time.monotonic()))
            now = driver.get_clock().now().nanoseconds
            for name, data in messages_of(fault, *repeated_row(rows, k), now):
                publish[name](data)
            k += 1
        said = doctor.communicate()[0]
    driver.destroy_node()
    return said


SAID = {"bag": said_from_a_bag, "live": said_live}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    busy = "processes that keep a core busy meanwhile"
    parser.add_argument("--busy", type=int, default=0, metavar="N", help=busy)
    seconds = "how long the doctor listens, and how long a recording is"
    parser.add_argument("--seconds", type=float, default=6.0, help=seconds)
    parser.add_argument("--ways", nargs="+", choices=SAID, default=list(SAID), help="default both")
    cells_help = "of " + ", ".join(FAULTS)
    parser.add_argument(
        "--only", nargs="+", default=list(FAULTS), metavar="FAULT", help=cells_help
    )
    parser.add_argument(
        "--random",
        type=int,
        metavar="N",
        help="in place of these, N random cells (`bench.random_doctor`)",
    )
    seed_help = "of the first random cell; each next one is 2 more. Choose limits on odd seeds, report even ones"
    parser.add_argument("--seed", type=int, default=0, help=seed_help)
    faults_help = "how many kinds of fault each random cell is given (default 4)"
    parser.add_argument("--faults", type=int, default=4, metavar="K", help=faults_help)
    kinds_help = "only these kinds of fault of random cells, or 'right'"
    parser.add_argument("--kinds", nargs="+", default=[], metavar="KIND", help=kinds_help)
    arguments = parser.parse_args()
    if arguments.random:
        report(
            arguments.random, seed=arguments.seed, faults=arguments.faults, kinds=arguments.kinds
        )
        return
    os.environ["ROS_DOMAIN_ID"] = str(10 + os.getpid() % 90)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    rclpy.init()
    table = Table(title=f"rft doctor beside {arguments.busy} busy processes", show_lines=True)
    for column in ("cell", "way", "named", "too busy", "else"):
        table.add_column(column)
    rights = 0
    with tempfile.TemporaryDirectory() as folder, busy_processes(arguments.busy):
        asked = list(product(arguments.only, arguments.ways))
        for name, way in asked:
            fault = FAULTS[name]
            said = SAID[way](fault, Path(folder), arguments.seconds).splitlines()
            wrong = [line for line in said if line.startswith("FIX")]
            busy_lines = [line for line in wrong if "too busy" in line]
            named = [line for line in wrong if fault.named and fault.named in line]
            others = [line for line in wrong if line not in (*busy_lines, *named)]
            right = bool(named) if fault.named else bool(said) and not wrong
            rights += right
            of_cell = ("yes" if right else "no", "yes" if busy_lines else "", "\n".join(others))
            table.add_row(name, way, *of_cell)
    console = Console(width=160)
    console.print(table)
    console.print(f"{rights} of {len(asked)} as they should be")
    rclpy.shutdown()


if __name__ == "__main__":
    main()

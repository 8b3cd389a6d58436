"""``make bench-replay``: `rft replay` beside a bare loop over the same bag with rosbags, and against real time.

The bag: pose, twist and wrench at 125 Hz of a plate that goes down, rests, is dragged and comes out, time and again.
The bare loop reads and deserialises the same messages, and serialises and writes as many wrenches as the replay, with
rosbags. The two take turns; figures are medians, the ratio is the median of each turn's. Neither draws a report.
"""

import platform
import sys
import tempfile
from functools import partial
from pathlib import Path
from statistics import median

import numpy as np
from rich.console import Console
from rich.table import Table
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from bench.kernel import cpu_model, ratio, seconds
from rft_ros.bags.replay import replay, replay_model
from rft_ros.bags.writing import BagWriter
from rft_ros.messages import TYPES, Role
from rft_ros.parameters import Config

RATE = 125
SECONDS = 60
TURNS = 7
MOST_RATIO = 1.5  # replay over bare loop
LEAST_SPEED = 50.0  # recorded time over wall time
STORE = get_typestore(Stores.ROS2_JAZZY)
TOPICS: dict[Role, str] = {
    "pose": "/rft/pose",
    "twist": "/rft/twist",
    "wrench": "/rft/wrench_measured",
}
LEGS = (
    ((0.0, 0.0, -0.02), 2.5),
    ((0.0, 0.0, 0.0), 1.0),
    ((0.02, 0.0, 0.0), 1.5),
    ((-0.012, 0.0, 0.02), 2.5),
)


def serialised(role: Role, stamp: int, frame: str, numbers: tuple[float, ...]) -> bytes:
    """A stamped message as CDR, by rosbags."""
    t = STORE.types
    name = {"pose": "Pose", "twist": "Twist", "wrench": "Wrench"}[role]
    vector = t["geometry_msgs/msg/Vector3"]
    point = t["geometry_msgs/msg/Point"]
    if role == "pose":
        parts = point(*numbers[:3]), t["geometry_msgs/msg/Quaternion"](*numbers[3:])
    else:
        parts = vector(*numbers[:3]), vector(*numbers[3:])
    header = t["std_msgs/msg/Header"](
        t["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9)), frame
    )
    message = t[f"geometry_msgs/msg/{name}Stamped"](header, t[f"geometry_msgs/msg/{name}"](*parts))
    return bytes(STORE.serialize_cdr(message, f"geometry_msgs/msg/{name}Stamped"))


def record(path: Path) -> int:
    """Write the bag; number of poses."""
    velocities = [v for v, seconds in LEGS for _ in range(round(seconds * RATE))]
    place = np.array([0.0, 0.0, 0.01])
    count = SECONDS * RATE
    with BagWriter(path) as bag:
        for k in range(count):
            stamp = 1_600_000_000_000_000_000 + k * (10**9 // RATE)
            velocity = velocities[k % len(velocities)]
            place = place + np.array(velocity) / RATE
            force = (0.5, 0.0, 800.0 * max(0.0, -float(place[2])), 0.0, 0.0, 0.0)
            rows: tuple[tuple[Role, str, tuple[float, ...]], ...] = (
                ("wrench", "ft_sensor", force),
                ("twist", "world", (*velocity, 0.0, 0.0, 0.0)),
                ("pose", "world", (*place.tolist(), 0.0, 0.0, 0.0, 1.0)),
            )
            for role, frame, numbers in rows:
                bag.write_raw(
                    TOPICS[role], TYPES[role][0], stamp, serialised(role, stamp, frame, numbers)
                )
    return count


def bare(bag: Path, out: Path, wrenches: int) -> None:
    """Read and deserialise every message; write wrenches, evenly spread over them."""
    written = 0
    kind = TYPES["wrench"][0]
    with (
        Reader(bag) as reader,
        Writer(out, version=9, storage_plugin=StoragePlugin.MCAP) as writer,
    ):
        connection = writer.add_connection("/rft/wrench_predicted", kind, typestore=STORE)
        share = wrenches / reader.message_count
        for number, (read, stamp, data) in enumerate(reader.messages(), start=1):
            STORE.deserialize_cdr(data, read.msgtype)
            while written < share * number:
                writer.write(
                    connection,
                    stamp,
                    serialised("wrench", stamp, "ft_sensor", (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)),
                )
                written += 1


def main() -> int:
    console = Console(width=100)
    values = Config().values
    model = replay_model(values)
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder, "bag")
        poses = record(bag)
        # compiles what is not yet compiled
        summary = replay(bag, Path(folder, "first"), values, model=model)
        # predicted and its standard deviation, compensated, residual
        wrenches = 4 * summary.estimates
        ours = []
        theirs = []
        for turn in range(TURNS):
            out = Path(folder, f"turn{turn}")
            theirs.append(seconds(partial(bare, bag, out / "bare", wrenches), 1))
            ours.append(seconds(partial(replay, bag, out / "replay", values, model=model), 1))
    cost = ratio(ours, theirs)
    speed = poses / RATE / median(ours)
    table = Table()
    for head in ("", "seconds", "µs a pose", "times real time"):
        table.add_column(head, justify="right" if head else "left")
    for name, times in (("rft replay", ours), ("bare loop with rosbags", theirs)):
        taken = median(times)
        table.add_row(
            name, f"{taken:.3f}", f"{1e6 * taken / poses:.0f}", f"{poses / RATE / taken:.0f}"
        )
    console.print(
        f"{cpu_model()}, Python {platform.python_version()}; {SECONDS} s of pose, twist and wrench at {RATE} Hz:"
        f" {3 * poses:,} messages in, {wrenches:,} wrenches out"
    )
    console.print(table)
    console.print(f"replay / bare loop: {cost:.2f} (target at most {MOST_RATIO})")
    console.print(f"times real time: {speed:.0f} (target at least {LEAST_SPEED:.0f})")
    return 0 if cost <= MOST_RATIO and speed >= LEAST_SPEED else 1


if __name__ == "__main__":
    sys.exit(main())

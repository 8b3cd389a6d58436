"""What a map of the ground costs: ``python -m bench.ground tick``, ``hour`` or ``node``.

tick: an estimator on a level plane and one on a map of 2 mm cells over 1 m², in turn; ellipsoid, 2,352 plates.
hour: an hour of raking in that bed, 125 poses and 5 clouds of 300,000 points a second, as fast as they can be computed.
node: poses at 500 Hz beside such clouds at 10 Hz; a bare echo node with and without them, and rft_node likewise.
"""

import argparse
import gc
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import median

import numpy as np

from rft_ros.estimator import Estimate, Estimator, PoseSample, Settings, TwistSample, WrenchSample
from rft_ros.ground import Cloud
from rft_ros.parameters import LearningMode, defaults, model_of

CELL = 0.002
POINTS = 300_000
RATE = 500
SLOW = 125  # Hz, in the hour of raking
START = 10**18


def clouds(count: int) -> list[np.ndarray]:
    """Beds of 1 m² as a camera sees them: waves 5 mm high, noise of 0.5 mm; shape [POINTS, 4], float32."""
    generator = np.random.default_rng(1)
    found = []
    for k in range(count):
        x, y = generator.uniform(-0.5, 0.5, (2, POINTS))
        z = 0.005 * np.sin(20.0 * x + k) * np.cos(15.0 * y) + generator.normal(0.0, 0.0005, POINTS)
        found.append(np.column_stack([x, y, z, 0.0 * x]).astype(np.float32))
    return found


def estimator(
    cell: float, *, learning: LearningMode = "off", memory: float = 0.0, background: ThreadPoolExecutor | None = None
) -> Estimator:
    """With the full ellipsoid."""
    values = {**defaults(), "mesh.file": "ellipsoid", "tolerance": 0.0, "ground.cell": cell}
    values["medium.mobilization_length"] = memory
    return Estimator(Settings(learning_mode=learning), model_of(values), background=background)


def rake(first: int, count: int, rate: int) -> Iterator[tuple[WrenchSample, TwistSample, PoseSample]]:
    """Poses of a tool that is drawn to and fro over the bed at 0.1 m/s, 10 mm deep, and lifted at each end."""
    for k in range(first, first + count):
        way = 0.1 * k / rate
        row, along = divmod(way, 0.8)
        sign = 1.0 if row % 2 == 0 else -1.0
        z = 0.02 if along < 0.05 else -0.01
        x, y = sign * (along - 0.4), -0.4 + 0.04 * (row % 20)
        stamp = START + k * (10**9 // rate)
        yield (
            WrenchSample(stamp, "ft_sensor", (-sign, 0.0, 1.0, 0.0, 0.0, 0.0)),
            TwistSample(stamp, "world", (0.1 * sign, 0.0, 0.0), (0.0, 0.0, 0.0)),
            PoseSample(stamp, "world", (x, y, z), (0.0, 0.0, 0.0, 1.0)),
        )


def tick_times(e: Estimator, first: int, count: int, rate: int = RATE) -> list[float]:
    """Time of each push_pose [us]."""
    found = []
    for wrench, twist, pose in rake(first, count, rate):
        e.push_wrench(wrench)
        e.push_twist(twist)
        start = time.perf_counter_ns()
        answer = e.push_pose(pose)
        found.append(1e-3 * (time.perf_counter_ns() - start))
        assert isinstance(answer, Estimate), answer
        e.measurements()
    return found


def tick() -> None:
    """Medians of 200 turns of 200 poses each."""
    bed = clouds(1)[0]
    for name, options in (
        ("as published", {}),
        ("memory", {"memory": 0.003}),
        ("memory, learning", {"memory": 0.003, "learning": "apply"}),
    ):
        level, mapped = (estimator(cell, **options) for cell in (0.0, CELL))
        first, turns = 2 * RATE, []
        for e in (level, mapped):
            tick_times(e, 1, 1)
            if e is mapped:
                e.push_surface(Cloud(START + 1, "world", *bed.T[:3]))
            tick_times(e, 2, RATE)
        gc.collect()
        gc.freeze()
        for _ in range(200):
            turns.append([median(tick_times(e, first, 200)) for e in (level, mapped)])
            first += 200
        on_level, on_map = np.median(turns, axis=0)
        ratio = median(b / a for a, b in turns)
        known = 0 if mapped.ground is None else len(mapped.ground.points())
        print(f"{name}: level plane {on_level:.1f} us, map of {known:,} cells {on_map:.1f} us, ratio {ratio:.2f}")


def hour(minutes: int) -> None:
    """Tick time and resident memory, minute by minute."""
    beds = clouds(8)
    with ThreadPoolExecutor(1) as background:
        e = estimator(CELL, learning="apply", memory=0.003, background=background)
        for minute in range(minutes):
            times: list[float] = []
            start = time.perf_counter()
            for part in range(5 * 60):
                first = (minute * 300 + part) * SLOW // 5 + 1
                bed = beds[part % len(beds)]
                e.push_surface(Cloud(START + first * (10**9 // SLOW), "world", *bed.T[:3]))
                times += tick_times(e, first, SLOW // 5, SLOW)
            if minute % 10 in (0, 9):
                cells = 0 if e.ground is None else e.ground.heights.size
                statm = Path("/proc/self/statm").read_text().split()
                resident = int(statm[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
                print(
                    f"minute {minute + 1}: tick {median(times):.1f} us (99 % {np.percentile(times, 99):.0f}),"
                    f" {cells:,} cells, {resident:.0f} MB, took {time.perf_counter() - start:.1f} s",
                    flush=True,
                )
        print(dict(e.counts))


def camera() -> None:
    """Publish clouds at 10 Hz until killed, serialised ahead: only the stamp changes."""
    import rclpy
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from rclpy.serialization import serialize_message
    from sensor_msgs.msg import PointCloud2, PointField

    rclpy.init()
    node = rclpy.create_node("camera")
    publisher = node.create_publisher(
        PointCloud2, "/rft/surface_points", QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    )
    bed = clouds(1)[0]
    message = PointCloud2(height=1, width=POINTS, point_step=16, row_step=16 * POINTS, is_dense=True)
    message.header.frame_id = "world"
    message.fields = [PointField(name=c, offset=4 * k, datatype=7, count=1) for k, c in enumerate("xyz")]
    message.data = bed.tobytes()
    data = bytearray(serialize_message(message))
    due = time.monotonic()
    while True:
        now = time.time_ns()
        data[4:12] = np.array(divmod(now, 10**9), dtype="<u4").tobytes()
        publisher.publish(bytes(data))
        due += 0.1
        time.sleep(max(0.0, due - time.monotonic()))


def node(seconds: float, repeat: int) -> None:
    """Poses lost by each node, in turn."""
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray

    from bench.node import Driver, Run, running_node

    os.environ["ROS_DOMAIN_ID"] = str(10 + os.getpid() % 90)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    rclpy.init()
    driver = Driver()
    counts: dict[str, str] = {}
    driver.node.create_subscription(
        DiagnosticArray,
        "/diagnostics",
        lambda m: counts.update({v.key: v.value for v in m.status[0].values if "surface" in v.key}),
        10,
    )
    echo = [str(Path(__file__).with_name("echo_node.py")), "--ros-args", "-p", "executor:=events"]
    rft = ["-m", "rft_ros.node.main", "--ros-args", "-p", "mesh.file:=ellipsoid", "-p", "tolerance:=0.0"]
    nodes = {
        "echo": (echo, False),
        "echo that takes the clouds": ([*echo, "-p", "clouds:=true"], True),
        "rft_node, level plane": (rft, False),
        "rft_node, map, clouds": ([*rft, "-p", f"ground.cell:={CELL}"], True),
    }
    runs: dict[str, list[Run]] = {name: [] for name in nodes}
    for _ in range(repeat):
        for name, (command, with_clouds) in nodes.items():
            counts.clear()
            with running_node(*command) as pid:
                driver.wait_for_node()
                publisher = subprocess.Popen([sys.executable, "-m", "bench.ground", "camera"]) if with_clouds else None
                time.sleep(4.0)  # until it publishes
                try:
                    runs[name].append(driver.drive(pid, RATE, seconds))
                finally:
                    if publisher is not None:
                        publisher.kill()
                        publisher.wait()
            print(name, runs[name][-1], counts, flush=True)
    for name, own in runs.items():
        trips = median(r.median_us for r in own), median(r.p99_us for r in own)
        print(
            f"{name}: lost {sum(r.lost for r in own)} of {sum(r.sent for r in own)}, round trip {trips[0]:.0f} us"
            f" (99 % {trips[1]:.0f}), CPU {100 * median(r.cpu for r in own):.0f} %,"
            f" {median(r.resident_mb for r in own):.0f} MB"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("tick", "hour", "node", "camera"))
    parser.add_argument("--minutes", type=int, default=60)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--repeat", type=int, default=3)
    arguments = parser.parse_args()
    if arguments.what == "node":
        node(arguments.seconds, arguments.repeat)
    elif arguments.what == "hour":
        hour(arguments.minutes)
    else:
        {"tick": tick, "camera": camera}[arguments.what]()


if __name__ == "__main__":
    main()

"""Bags for tests, written with rosbags: what a cell with a descending plate would have recorded; and their replays."""

import csv
from pathlib import Path

import mcap.writer
import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from rft_ros.bags.writing import BagWriter
from rft_ros.parameters import Config, checked
from rft_ros.rft import frames

ROS2 = get_typestore(Stores.ROS2_JAZZY)
ROS1 = get_typestore(Stores.ROS1_NOETIC)
POSE, TWIST, WRENCH = (f"geometry_msgs/msg/{name}Stamped" for name in ("Pose", "Twist", "Wrench"))
TF, TRANSFORM = "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/TransformStamped"
CLOUD = "sensor_msgs/msg/PointCloud2"
TOPICS = {
    "pose": ("/rft/pose", POSE),
    "twist": ("/rft/twist", TWIST),
    "wrench": ("/rft/wrench_measured", WRENCH),
}
FRAMES = {"pose": "world", "twist": "world", "wrench": "ft_sensor"}
START = 1_600_000_000_000_000_000
STEP = 10_000_000


def header(store, stamp: int, frame: str):
    time = store.types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    return store.types["std_msgs/msg/Header"](
        stamp=time, frame_id=frame, **({"seq": 0} if store is ROS1 else {})
    )


def message(store, role: str, stamp: int, values, frame: str | None = None):
    t, kind = store.types, TOPICS[role][1]
    head = header(store, stamp, FRAMES[role] if frame is None else frame)
    names = ("Point", "Quaternion") if role == "pose" else ("Vector3", "Vector3")
    parts = (
        t[f"geometry_msgs/msg/{n}"](*part)
        for n, part in zip(names, (values[:3], values[3:]), strict=True)
    )
    return t[kind](head, t[kind.removesuffix("Stamped")](*parts))


def cdr(role: str, stamp: int, values, frame: str | None = None) -> bytes:
    """A message of ROS 2."""
    return bytes(ROS2.serialize_cdr(message(ROS2, role, stamp, values, frame), TOPICS[role][1]))


def transforms_cdr(*transforms) -> bytes:
    """A TFMessage of these `TransformSample`s."""
    found = [_transform(one) for one in transforms]
    return bytes(ROS2.serialize_cdr(ROS2.types[TF](found), TF))


def transform_cdr(transform) -> bytes:
    """A TransformStamped, as motion capture sends poses."""
    return bytes(ROS2.serialize_cdr(_transform(transform), TRANSFORM))


def _transform(transform):
    t, head = ROS2.types, header(ROS2, transform.stamp, transform.parent)
    place = t["geometry_msgs/msg/Vector3"](*transform.position)
    pose = t["geometry_msgs/msg/Transform"](
        place, t["geometry_msgs/msg/Quaternion"](*transform.quaternion)
    )
    return t[TRANSFORM](head, transform.child, pose)


def cloud_cdr(
    points,
    *,
    ros1=False,
    dtype="<f4",
    names="xyz",
    height=1,
    padding=3,
    frame="world",
    pad_rows=0,
    stamp=START,
) -> bytes:
    """A PointCloud2, of ROS 1 if asked for."""
    store = ROS1 if ros1 else ROS2
    t = store.types
    size, (count, columns) = np.dtype(dtype).itemsize, np.shape(points)
    step, width = padding + columns * size, count // height
    packed = np.zeros((count, step), dtype=np.uint8)
    packed[:, padding:] = np.asarray(points).astype(dtype).view(np.uint8)
    rows = np.pad(packed.reshape(height, width * step), ((0, 0), (0, pad_rows)))
    kind = {"f4": 7, "f8": 8, "i4": 5}[dtype[1:]]
    fields = [
        t["sensor_msgs/msg/PointField"](n, padding + k * size, kind, 1)
        for k, n in enumerate(names)
    ]
    head = header(store, stamp, frame)
    cloud = t[CLOUD](
        head, height, width, fields, dtype[0] == ">", step, rows.shape[1], rows.ravel(), True
    )
    return bytes(store.serialize_ros1(cloud, CLOUD) if ros1 else store.serialize_cdr(cloud, CLOUD))


def moments(count: int = 60):
    """(role, log time, stamp, values) of a plate that hangs still for 0.2 s and then sinks 2 mm a step."""
    for k in range(count):
        stamp = START + k * STEP
        depth = max(0, k - 20) * 0.002
        speed = -0.2 if k > 20 else 0.0
        yield "wrench", stamp, stamp, (1.0, 2.0, 3.0 + 100.0 * depth, 0.1, 0.2, 0.3)
        yield "twist", stamp, stamp, (0.0, 0.0, speed, 0.0, 0.0, 0.0)
        yield "pose", stamp, stamp, (0.0, 0.0, 0.01 - depth, 0.0, 0.0, 0.0, 1.0)


def plunge(repeats: int = 1, *, noise: float = 0.0):
    """As `moments`, of a plate that goes from 10 mm above to 30 mm below, rests, is dragged, comes out: 6.5 s a repeat.

    `noise`: standard deviation of each component of its velocity [m/s]; the same numbers every time.
    """
    random = np.random.default_rng(7)
    legs = (
        (200, (0.0, 0.0, -0.02)),
        (50, (0.0, 0.0, 0.0)),
        (100, (0.02, 0.0, 0.0)),
        (300, (0.0, 0.0, 0.02)),
    )
    stamp = START
    for _ in range(repeats):
        place = np.array([0.0, 0.0, 0.01])
        for count, velocity in legs:
            for _ in range(count):
                place = place + 0.01 * np.array(velocity)
                shaken = np.array(velocity) + noise * random.standard_normal(3)
                force = 1000.0 * max(0.0, -place[2])
                yield "wrench", stamp, stamp, (0.05, 0.0, force, 0.0, 0.0, 0.0)
                yield "twist", stamp, stamp, (*shaken.tolist(), 0.0, 0.0, 0.0)
                yield "pose", stamp, stamp, (*place.tolist(), 0.0, 0.0, 0.0, 1.0)
                stamp += STEP


def write_ros2(
    path: Path, rows, *, plugin=StoragePlugin.MCAP, topics=TOPICS, compress=False, frames=FRAMES
) -> Path:
    bag = Writer(path, version=9, storage_plugin=plugin)
    if compress:
        mode = CompressionMode.STORAGE if plugin is StoragePlugin.MCAP else CompressionMode.FILE
        bag.set_compression(mode, CompressionFormat.ZSTD)
    with bag as writer:
        connections = {
            r: writer.add_connection(name, kind, typestore=ROS2)
            for r, (name, kind) in topics.items()
        }
        for role, time, stamp, values in rows:
            if role in connections:
                writer.write(connections[role], time, cdr(role, stamp, values, frames[role]))
    return path


def write_run(path: Path, time, states, readings, **named) -> Path:
    """A bag of what a load cell reads, twist and pose at each moment [s]; `named`: `topics` and `frames`."""
    columns = {
        "wrench": readings,
        "twist": states[:, frames.TWIST],
        "pose": states[:, frames.POSE],
    }
    stamps = [START + round(t * 1e9) for t in time]
    return write_ros2(
        path, [(r, t, t, columns[r][k]) for k, t in enumerate(stamps) for r in columns], **named
    )


def write_mcap(file, rows, *, encoding="cdr", profile="", **options):
    """A file as of another recorder than that of ROS 2, whose `profile` is "ros2"."""
    with file.open("wb") as stream:
        writer = mcap.writer.Writer(stream, **options)
        writer.start(profile)
        foreign = writer.register_schema("Log", "jsonschema", b"{}")
        channels = {"log": writer.register_channel("/log", "json", foreign)}
        for role, (topic, kind) in TOPICS.items():
            schema = writer.register_schema(kind, "ros2msg", b"")
            channels[role] = writer.register_channel(topic, encoding, schema)
        writer.add_message(channels["log"], rows[0][1], b"{}", 0)
        for role, time, stamp, values in rows:
            writer.add_message(channels[role], time, cdr(role, stamp, values), time)
        writer.finish()
    return file


def write_messages(path: Path, messages) -> Path:
    """A bag of (log time, topic, type, bytes), in the order of their times."""
    with BagWriter(path) as bag:
        for time, topic, kind, data in sorted(messages, key=lambda message: message[0]):
            bag.write_raw(topic, kind, time, data)
    return path


def write_ros1(path: Path, rows) -> Path:
    with Writer1(path) as writer:
        connections = {
            r: writer.add_connection(name, kind, typestore=ROS1)
            for r, (name, kind) in TOPICS.items()
        }
        for role, time, stamp, values in rows:
            data = ROS1.serialize_ros1(message(ROS1, role, stamp, values), TOPICS[role][1])
            writer.write(connections[role], time, data)
    return path


def values(**changes):
    """The default parameters but for these, whose dots are double underscores."""
    return Config().values | {
        k.replace("__", "."): checked(k.replace("__", "."), v) for k, v in changes.items()
    }


def rows_of(folder):
    """The table of a replay."""
    with (folder / "estimates.csv").open() as file:
        return list(csv.DictReader(file))

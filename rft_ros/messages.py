"""Decodes poses, TwistStamped, WrenchStamped, TFMessage and PointCloud2 (CDR, ROS 1); encodes wrenches (CDR).

The first three have a fixed layout, a header (stamp, frame_id) and then 6 or 7 doubles, so no message definition is
needed. Decoding a message with struct takes 0.9 us; rosbags takes 4.3 us and rclpy 16 us (an object at every level).
rosbags decodes clouds; their points are views of the message's bytes and not copied.
"""

import struct
from collections.abc import Callable, Sequence
from functools import cache, lru_cache, partial
from typing import Any, Literal

import numpy as np

from rft_ros.estimator import PoseSample, Sample, TransformSample, TwistSample, WrenchSample
from rft_ros.ground import Cloud

Role = Literal["pose", "twist", "wrench", "surface", "tf", "tf_static"]
"""The inputs of an estimator."""

_TRANSFORM = "geometry_msgs/msg/TransformStamped"
_CLOUD = "sensor_msgs/msg/PointCloud2"

TYPES: dict[Role, tuple[str, ...]] = {
    "pose": ("geometry_msgs/msg/PoseStamped", _TRANSFORM),
    "twist": ("geometry_msgs/msg/TwistStamped",),
    "wrench": ("geometry_msgs/msg/WrenchStamped",),
    "surface": (_CLOUD,),
    "tf": ("tf2_msgs/msg/TFMessage",),
    "tf_static": ("tf2_msgs/msg/TFMessage",),
}
"""Message types that the topic of a role may have. A pose as motion capture sends it is a transform from its frame."""

TOPICS: dict[Role, str] = {
    "pose": "~/pose",
    "twist": "~/twist",
    "wrench": "~/wrench_measured",
    "surface": "~/surface_points",
    "tf": "/tf",
    "tf_static": "/tf_static",
}
"""The node's own name for the topic of each role, before remaps."""

UNREADABLE = (ValueError, struct.error)
"""What a decoder raises for bytes that are not a message of its type."""


def unreadable_because(error: Exception) -> str:
    """Why the bytes are not a message, from an exception of `UNREADABLE`."""
    if isinstance(error, struct.error):
        return "it is shorter than its type"
    if isinstance(error, UnicodeDecodeError):
        return "the name of a frame is not UTF-8 text"
    return str(error)


_ORDERS = {b"\x00\x01": "<", b"\x00\x00": ">"}  # by the first bytes of plain CDR
_Content = tuple[int, str, Any]  # stamp [ns], frame_id, tuple of doubles


def _order(data: bytes, ros1: bool) -> str:
    order = "<" if ros1 else _ORDERS.get(data[:2])
    if order is None:
        raise ValueError(f"encoding {data[:2].hex() or 'missing'} is not plain CDR")
    return order


def _stamp(seconds: int, nanoseconds: int) -> int:
    if seconds >= 2**31 or nanoseconds >= 1_000_000_000:
        raise ValueError(
            f"stamp {seconds} s {nanoseconds} ns is not a time that ROS 2 can publish"
        )
    return seconds * 1_000_000_000 + nanoseconds


def _fixed_layout(count: int, *, ros1: bool) -> Callable[[bytes], _Content]:
    """A decoder of a header and `count` doubles. CDR ends the frame's name with a NUL and aligns the doubles."""
    head, nul, alignment = ("III", 0, 1) if ros1 else ("iII", 1, 8)
    layouts = {
        o: (struct.Struct(o + head), struct.Struct(f"{o}{count}d")) for o in _ORDERS.values()
    }

    def content(data: bytes) -> _Content:
        start, doubles = layouts[_order(data, ros1)]
        seconds, nanoseconds, length = start.unpack_from(data, 4)
        end = 16 + length
        frame = data[16 : end - nul].decode()
        return (
            _stamp(seconds, nanoseconds),
            frame,
            doubles.unpack_from(data, end + (4 - end) % alignment),
        )

    return content


def _transforms(
    data: bytes, *, ros1: bool, fixed: bool, one: bool = False
) -> tuple[TransformSample, ...]:
    """The transforms of a TFMessage, by struct as well: robots publish a hundred frames at 500 Hz.

    `one`: the message is a TransformStamped.
    """
    order = _order(data, ros1)
    # CDR begins with 4 bytes, from which on each number is aligned to its size; ROS 1 does neither
    begin, integer_alignment, double_alignment = (0, 1, 1) if ros1 else (4, 4, 8)
    # stamp, length of the parent's name
    header = struct.Struct(order + ("4xIII" if ros1 else "iII"))
    length = struct.Struct(f"{order}I")
    pose = struct.Struct(f"{order}7d")
    (count,) = (1,) if one else length.unpack_from(data, begin)
    offset = begin if one else begin + length.size
    transforms: list[TransformSample] = []
    for _ in range(count):
        offset += (begin - offset) % integer_alignment
        seconds, nanoseconds, parent_length = header.unpack_from(data, offset)
        offset += header.size
        parent = data[offset : offset + parent_length].rstrip(b"\x00").decode()
        offset += parent_length
        offset += (begin - offset) % integer_alignment
        (child_length,) = length.unpack_from(data, offset)
        offset += length.size
        child = data[offset : offset + child_length].rstrip(b"\x00").decode()
        offset += child_length
        offset += (begin - offset) % double_alignment
        x, y, z, *quaternion = pose.unpack_from(data, offset)
        offset += pose.size
        transforms.append(
            TransformSample(
                _stamp(seconds, nanoseconds), parent, child, (x, y, z), (*quaternion,), fixed
            )
        )
    return tuple(transforms)


def _pose_of_transform(data: bytes, *, ros1: bool) -> PoseSample:
    (transform,) = _transforms(data, ros1=ros1, fixed=False, one=True)
    return PoseSample(transform.stamp, transform.parent, transform.position, transform.quaternion)


_COORDINATES = {7: "f4", 8: "f8"}  # of PointField.datatype


@cache  # a decoder of clouds takes 0.3 s to make
def _clouds(*, ros1: bool) -> Callable[[bytes], Cloud]:
    """A decoder of a PointCloud2 with fields x, y and z of one or two floating-point types."""
    from rosbags.typesys import (
        Stores,
        get_typestore,
    )  # 4 MB, which a node without clouds does not need

    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    store.get_msgdef(_CLOUD)  # parsed at the start, so that the first cloud does not wait for it
    read = store.deserialize_ros1 if ros1 else store.deserialize_cdr

    def decode(data: bytes) -> Cloud:
        try:
            cloud: Any = read(memoryview(data), _CLOUD)
            order = ">" if cloud.is_bigendian else "<"
            places: Any = {
                field.name: (order + _COORDINATES[field.datatype], field.offset)
                for field in cloud.fields
                if field.name in ("x", "y", "z") and field.datatype in _COORDINATES
            }
            point = np.dtype(places)
        except Exception as error:  # rosbags' parsers raise anything on damage
            raise ValueError(f"not a cloud: {error}") from error
        if len(places) != 3 or point.itemsize > cloud.point_step:
            raise ValueError("the cloud has no fields x, y and z of type FLOAT32 or FLOAT64")
        if cloud.height > 1 and cloud.row_step < cloud.width * cloud.point_step:
            raise ValueError(
                f"the cloud's row_step, {cloud.row_step}, is less than a row of its points"
            )
        points = np.empty(0, point)
        if cloud.height and cloud.width:  # numpy raises ValueError where there are too few bytes
            steps = (cloud.row_step, cloud.point_step)
            points = np.ndarray((cloud.height, cloud.width), point, cloud.data, 0, steps)
        stamp = _stamp(cloud.header.stamp.sec, cloud.header.stamp.nanosec)
        axes = [points[name].reshape(-1) for name in "xyz"]
        return Cloud(stamp, cloud.header.frame_id, *axes)

    return decode


def decoder(role: Role, *, ros1: bool, kind: str = "") -> Callable[[bytes], Sample]:
    """A function from a serialised message to its sample; it raises one of `UNREADABLE` for other bytes.

    `kind`: which of `TYPES` the message has; by default the first.
    """
    if role in ("tf", "tf_static"):
        return partial(_transforms, ros1=ros1, fixed=role == "tf_static")
    if role == "surface":
        return _clouds(ros1=ros1)
    if kind == _TRANSFORM:
        return partial(_pose_of_transform, ros1=ros1)
    content = _fixed_layout(7 if role == "pose" else 6, ros1=ros1)
    if role == "wrench":
        return lambda data: WrenchSample(*content(data))
    sample = PoseSample if role == "pose" else TwistSample

    def decode(data: bytes) -> Sample:
        stamp, frame, numbers = content(data)
        return sample(stamp, frame, numbers[:3], numbers[3:])

    return decode


@lru_cache(maxsize=8)
def stamped_cdr(frame: str, count: int = 6) -> Callable[[int, Sequence[float]], bytes]:
    """A function from a stamp [ns] and `count` numbers to a serialised message in `frame`.

    It is a WrenchStamped ([N], [N m]) or a TwistStamped ([m/s], [rad/s]) of 6 numbers, or a PoseStamped of 7 ([m],
    xyzw).
    """
    name = frame.encode() + b"\x00"
    padding = -(12 + len(name)) % 8
    layout = struct.Struct(f"<4siII{len(name)}s{padding}x{count}d")

    def serialise(stamp: int, numbers: Sequence[float]) -> bytes:
        seconds, nanoseconds = divmod(stamp, 1_000_000_000)
        return layout.pack(b"\x00\x01\x00\x00", seconds, nanoseconds, len(name), name, *numbers)

    return serialise

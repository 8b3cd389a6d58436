"""PoseStamped, TwistStamped and WrenchStamped as bytes: CDR and ROS 1 in, CDR out.

Their layout is fixed, so no message definition is needed: a header (stamp, frame_id) and then 6 or 7 doubles. Decoding
with struct takes 0.9 us a message where rosbags takes 4.3 us and rclpy 16 us (objects with a class at every level).
"""

import struct
from collections.abc import Callable
from typing import Literal

from rft_ros.estimator import PoseSample, TwistSample, Wrench, WrenchSample

__all__ = ["TYPES", "UNREADABLE", "Role", "Sample", "decoder", "wrench_cdr"]

Role = Literal["pose", "twist", "wrench"]
Sample = PoseSample | TwistSample | WrenchSample
"""The inputs, and what each becomes."""

TYPES: dict[Role, str] = {
    "pose": "geometry_msgs/msg/PoseStamped",
    "twist": "geometry_msgs/msg/TwistStamped",
    "wrench": "geometry_msgs/msg/WrenchStamped",
}
"""Message type of each role's topic."""

UNREADABLE = (ValueError, struct.error)
"""What a decoder raises for bytes that are no such message."""

_Content = tuple[int, str, tuple[float, ...]]  # stamp [ns], frame_id, doubles
_Layout = tuple[struct.Struct, dict[int, struct.Struct]]


def _layout(head: str, byte_order: str) -> _Layout:
    return struct.Struct(byte_order + head), {n: struct.Struct(f"{byte_order}{n}d") for n in (6, 7)}


_CDR = {b"\x00\x01": _layout("iII", "<"), b"\x00\x00": _layout("iII", ">")}
_ROS1_HEAD, _ROS1_DOUBLES = _layout("4xIII", "<")


def _from_cdr(data: bytes, count: int) -> _Content:
    layout = _CDR.get(data[:2])
    if layout is None:
        raise ValueError(f"encoding {data[:2].hex() or 'missing'} is not plain CDR")
    head, doubles = layout
    seconds, nanoseconds, length = head.unpack_from(data, 4)
    frame = data[16 : 15 + length].decode()  # the length counts a final NUL
    aligned = 4 + (12 + length + 7) // 8 * 8
    return seconds * 1_000_000_000 + nanoseconds, frame, doubles[count].unpack_from(data, aligned)


def _from_ros1(data: bytes, count: int) -> _Content:
    seconds, nanoseconds, length = _ROS1_HEAD.unpack_from(data)
    frame = data[16 : 16 + length].decode()
    return seconds * 1_000_000_000 + nanoseconds, frame, _ROS1_DOUBLES[count].unpack_from(data, 16 + length)


def decoder(role: Role, *, ros1: bool) -> Callable[[bytes], Sample]:
    """The function that makes a sample of a serialised message; it raises ValueError or struct.error if it cannot."""
    content = _from_ros1 if ros1 else _from_cdr

    def pose(data: bytes) -> PoseSample:
        stamp, frame, (x, y, z, qx, qy, qz, qw) = content(data, 7)
        return PoseSample(stamp, frame, (x, y, z), (qx, qy, qz, qw))

    def twist(data: bytes) -> TwistSample:
        stamp, frame, (vx, vy, vz, wx, wy, wz) = content(data, 6)
        return TwistSample(stamp, frame, (vx, vy, vz), (wx, wy, wz))

    def wrench(data: bytes) -> WrenchSample:
        stamp, frame, (fx, fy, fz, tx, ty, tz) = content(data, 6)
        return WrenchSample(stamp, frame, (fx, fy, fz, tx, ty, tz))

    functions: dict[Role, Callable[[bytes], Sample]] = {"pose": pose, "twist": twist, "wrench": wrench}
    return functions[role]


def wrench_cdr(frame: str) -> Callable[[int, Wrench], bytes]:
    """The function that serialises a WrenchStamped of that frame from its stamp [ns] and wrench [N, N m]."""
    name = frame.encode() + b"\x00"
    padding = -(12 + len(name)) % 8
    layout = struct.Struct(f"<4siII{len(name)}s{padding}x6d")

    def serialise(stamp: int, wrench: Wrench) -> bytes:
        seconds, nanoseconds = divmod(stamp, 1_000_000_000)
        return layout.pack(b"\x00\x01\x00\x00", seconds, nanoseconds, len(name), name, *wrench)

    return serialise

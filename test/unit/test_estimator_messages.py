"""Messages as bytes: a stamp that no ROS message can have is unreadable, and every readable one can be published."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from recordings import transforms_cdr

from rft_ros.estimator import TransformSample
from rft_ros.estimator.messages import UNREADABLE, decoder, wrench_cdr

LAST = 2**31 - 1
WRENCH = struct.pack("<6d", *range(6))


def encoded(seconds: int, nanoseconds: int, *, ros1: bool) -> bytes:
    """A WrenchStamped with an empty frame_id."""
    if ros1:
        return struct.pack("<IIII", 0, seconds, nanoseconds, 0) + WRENCH
    return struct.pack("<4siII4x", b"\x00\x01\x00\x00", seconds, nanoseconds, 1) + WRENCH


@pytest.mark.parametrize("ros1", [False, True])
@pytest.mark.parametrize("stamp", [(5, 1_000_000_000), (LAST, 2**32 - 1)])
def test_a_second_has_less_than_1e9_nanoseconds(stamp, ros1):
    with pytest.raises(UNREADABLE):
        decoder("wrench", ros1=ros1)(encoded(*stamp, ros1=ros1))


def test_a_ros_1_stamp_that_ros_2_cannot_hold_is_unreadable():
    with pytest.raises(UNREADABLE):
        decoder("wrench", ros1=True)(encoded(LAST + 1, 0, ros1=True))


@pytest.mark.parametrize("ros1", [False, True])
def test_the_last_stamp_of_a_message_can_be_published_again(ros1):
    sample = decoder("wrench", ros1=ros1)(encoded(LAST, 999_999_999, ros1=ros1))
    assert sample.wrench == tuple(range(6))
    assert decoder("wrench", ros1=False)(wrench_cdr("")(sample.stamp, sample.wrench)) == sample


names = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=12)
doubles = st.floats(allow_nan=False)
transforms = st.builds(
    TransformSample,
    stamp=st.integers(0, LAST * 10**9),
    parent=names,
    child=names,
    position=st.tuples(*[doubles] * 3),
    quaternion=st.tuples(*[doubles] * 4),
    fixed=st.just(True),
)


def ros1_bytes(samples) -> bytes:
    """A ROS 1 TFMessage, which rosbags has no definition of."""
    data = struct.pack("<I", len(samples))
    for one in samples:
        data += struct.pack("<III", 7, *divmod(one.stamp, 10**9))
        for name in (one.parent.encode(), one.child.encode()):
            data += struct.pack("<I", len(name)) + name
        data += struct.pack("<7d", *one.position, *one.quaternion)
    return data


@given(st.lists(transforms, max_size=4))
def test_transforms_are_read_as_rosbags_writes_them(samples):
    for ros1, data in ((False, transforms_cdr(*samples)), (True, ros1_bytes(samples))):
        decode = decoder("tf_static", ros1=ros1)
        assert decode(data) == tuple(samples)
        for end in range(len(data) if samples else 0):
            with pytest.raises(UNREADABLE):
                decode(data[:end])

"""Messages as bytes: what rosbags serialises is what the decoders read; anything else, and no time, is unreadable."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from recordings import START, TRANSFORM, cloud_cdr, transform_cdr, transforms_cdr

from rft_ros.estimator import PoseSample, TransformSample
from rft_ros.messages import UNREADABLE, decoder, stamped_cdr

LAST = 2**31 - 1
WRENCH = struct.pack("<6d", *range(6))


def encoded(seconds: int, nanoseconds: int, *, ros1: bool) -> bytes:
    """A WrenchStamped with an empty frame_id."""
    if ros1:
        return struct.pack("<IIII", 0, seconds, nanoseconds, 0) + WRENCH
    return struct.pack("<4siII4x", b"\x00\x01\x00\x00", seconds, nanoseconds, 1) + WRENCH


@pytest.mark.parametrize("ros1", [False, True])
def test_the_last_stamp_can_be_published_again_and_larger_seconds_or_nanoseconds_are_refused(ros1):
    sample = decoder("wrench", ros1=ros1)(encoded(LAST, 999_999_999, ros1=ros1))
    assert sample.wrench == tuple(range(6))
    assert decoder("wrench", ros1=False)(stamped_cdr("")(sample.stamp, sample.wrench)) == sample
    for stamp in (
        (5, 1_000_000_000),
        (LAST, 2**32 - 1),
        *([(LAST + 1, 0)] if ros1 else []),
    ):  # ROS 2: negative times
        with pytest.raises(UNREADABLE):
            decoder("wrench", ros1=ros1)(encoded(*stamp, ros1=ros1))


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


@given(transforms)
def test_a_transform_as_of_motion_capture_is_a_pose(sent):
    pose = PoseSample(sent.stamp, sent.parent, sent.position, sent.quaternion)
    for ros1, data in ((False, transform_cdr(sent)), (True, ros1_bytes([sent])[4:])):
        decode = decoder("pose", ros1=ros1, kind=TRANSFORM)
        assert decode(data) == pose
        for end in range(len(data)):
            with pytest.raises(UNREADABLE):
                decode(data[:end])


POINTS = np.arange(12.0).reshape(4, 3)


@pytest.mark.parametrize("ros1", [False, True])
@pytest.mark.parametrize("dtype", ["<f4", ">f4", "<f8"])
@pytest.mark.parametrize(("height", "pad_rows"), [(1, 0), (2, 0), (2, 5)])
@pytest.mark.parametrize("frame", ["world", "a", ""])
def test_a_cloud_is_read_as_it_was_written(ros1, dtype, height, pad_rows, frame):
    data = cloud_cdr(
        POINTS,
        ros1=ros1,
        dtype=dtype,
        height=height,
        pad_rows=pad_rows,
        frame=frame,
        stamp=START + 34,
    )
    cloud = decoder("surface", ros1=ros1)(data)
    assert (cloud.stamp, cloud.frame) == (START + 34, frame)
    assert_array_equal(np.column_stack([cloud.x, cloud.y, cloud.z]), POINTS)


def test_a_cloud_without_points_is_empty_and_one_without_coordinates_unreadable():
    decode = decoder("surface", ros1=False)
    assert len(decode(cloud_cdr(np.empty((0, 3)))).x) == 0
    for change in ({"names": "xya"}, {"dtype": "<i4"}):
        with pytest.raises(UNREADABLE, match="x, y and z"):
            decode(cloud_cdr(POINTS, **change))


@given(cut=st.integers(0, 200), at=st.integers(0, 199), value=st.integers(0, 255))
def test_damaged_bytes_are_unreadable_or_a_cloud(cut, at, value):
    data = bytearray(cloud_cdr(POINTS))
    data[at % len(data)] = value
    try:
        cloud = decoder("surface", ros1=False)(bytes(data[: len(data) - cut]))
    except UNREADABLE:
        return
    assert len(cloud.x) == len(cloud.y) == len(cloud.z)
    np.nansum(cloud.z)

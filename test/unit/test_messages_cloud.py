"""PointCloud2 as bytes: what rosbags serialises is what the decoder reads; anything else is unreadable."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from rosbags.typesys import Stores, get_typestore

from rft_ros.estimator.messages import UNREADABLE, decoder

STORES = {False: get_typestore(Stores.ROS2_JAZZY), True: get_typestore(Stores.ROS1_NOETIC)}
KIND = "sensor_msgs/msg/PointCloud2"
POINTS = np.arange(12.0).reshape(4, 3)


def serialised(
    points=POINTS,
    *,
    ros1=False,
    dtype="<f4",
    names="xyz",
    height=1,
    padding=3,
    frame="world",
    pad_rows=0,
    stamp=12 * 10**9 + 34,
):
    store = STORES[ros1]
    t = store.types
    points = np.asarray(points)
    step = padding + points.shape[1] * np.dtype(dtype).itemsize
    width = len(points) // height
    rows = np.zeros((height, width * step + pad_rows), dtype=np.uint8)
    for k, point in enumerate(points):
        raw = np.frombuffer(point.astype(dtype).tobytes(), dtype=np.uint8)
        at = (k % width) * step + padding
        rows[k // width, at : at + len(raw)] = raw
    size = np.dtype(dtype).itemsize
    kind = {"f4": 7, "f8": 8, "i4": 5}[dtype[1:]]
    fields = [t["sensor_msgs/msg/PointField"](n, padding + k * size, kind, 1) for k, n in enumerate(names)]
    time = t["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    head = {"stamp": time, "frame_id": frame, **({"seq": 0} if ros1 else {})}
    header = t["std_msgs/msg/Header"](**head)
    cloud = t[KIND](header, height, width, fields, dtype[0] == ">", step, rows.shape[1], rows.ravel(), True)
    return bytes(store.serialize_ros1(cloud, KIND) if ros1 else store.serialize_cdr(cloud, KIND))


@pytest.mark.parametrize("ros1", [False, True])
@pytest.mark.parametrize("dtype", ["<f4", ">f4", "<f8"])
@pytest.mark.parametrize(("height", "pad_rows"), [(1, 0), (2, 0), (2, 5)])
@pytest.mark.parametrize("frame", ["world", "a", ""])
def test_a_cloud_is_read_as_it_was_written(ros1, dtype, height, pad_rows, frame):
    data = serialised(ros1=ros1, dtype=dtype, height=height, pad_rows=pad_rows, frame=frame)
    cloud = decoder("surface", ros1=ros1)(data)
    assert (cloud.stamp, cloud.frame) == (12 * 10**9 + 34, frame)
    assert_array_equal(np.column_stack([cloud.x, cloud.y, cloud.z]), POINTS)


def test_a_cloud_without_points_is_empty():
    assert len(decoder("surface", ros1=False)(serialised(np.empty((0, 3)))).x) == 0


@pytest.mark.parametrize("change", [{"names": "xya"}, {"dtype": "<i4"}])
def test_a_cloud_without_coordinates_is_unreadable(change):
    with pytest.raises(UNREADABLE, match="x, y and z"):
        decoder("surface", ros1=False)(serialised(**change))


@given(cut=st.integers(0, 200), at=st.integers(0, 199), value=st.integers(0, 255))
def test_damaged_bytes_are_unreadable_or_a_cloud(cut, at, value):
    data = bytearray(serialised())
    data[at % len(data)] = value
    try:
        cloud = decoder("surface", ros1=False)(bytes(data[: len(data) - cut]))
    except UNREADABLE:
        return
    assert len(cloud.x) == len(cloud.y) == len(cloud.z)
    np.nansum(cloud.z)

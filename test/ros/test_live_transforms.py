"""A node that takes the tool's pose from /tf and /tf_static answers as the replay of its inputs does."""

import importlib.util
import math
import sys
from pathlib import Path

import numpy as np
import pytest
import rclpy
from one_plate import LEVEL
from rclpy.qos import DurabilityPolicy, QoSProfile
from recordings import TF, cdr, transforms_cdr
from test_live_equals_replay import TOPICS, assert_equal

from rft_ros.bags.writing import BagWriter
from rft_ros.errors import InputError
from rft_ros.estimator import TransformSample
from rft_ros.installation import is_ros_from_pypi
from rft_ros.node import topics
from rft_ros.node.topics import has_tf2_msgs, message_class

STAND_IN = Path(__file__).with_name("stand_in")
if importlib.util.find_spec("tf2_msgs") is None:
    sys.path.insert(0, str(STAND_IN))
PARAMETERS = {
    "pose_source": "tf",
    "sensor.frame_source": "tf",
    "twist_source": "pose_difference",
    "mesh.file": "abb_plate",
    "world_frame": "sand",
}


def transform_publishers(node):
    """Of /tf and /tf_static, as tf2_ros's broadcasters publish them."""
    from tf2_msgs.msg import TFMessage

    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    return {
        "tf": node.create_publisher(TFMessage, "/tf", QoSProfile(depth=1000)),
        "tf_static": node.create_publisher(TFMessage, "/tf_static", latched),
    }


@pytest.mark.parametrize("late", [0, 60_000_000], ids=["prompt", "late"])
def test_live_transforms_equal_their_replay(start_node, tmp_path, late):
    """At 500 Hz, with a load cell at 200 Hz and a fixed mounting of tool and cell."""
    rft = start_node(*(a for k, v in PARAMETERS.items() for a in ("-p", f"{k}:={v}")))
    rft.get("mesh.file")
    publishers = transform_publishers(rft.node) | {"wrench_measured": rft.wrench}
    rft.until(lambda: all(p.get_subscription_count() > 0 for p in publishers.values()))
    start = 1_700_000_000_000_000_000
    links = (
        ("base", "sand", (0.1, 0.2, 0.0)),
        ("flange", "tool", (0.0, 0.0, 0.1)),
        ("tool", "ft_sensor", (0, 0, -0.05)),
    )
    fixed = transforms_cdr(*(TransformSample(start, *link, LEVEL) for link in links))
    arrivals = []
    with BagWriter(tmp_path / "inputs") as bag:
        bag.write_raw("/tf_static", TF, start, fixed)
        for k in range(750):
            stamp, pitch = start + k * 2_000_000, 0.15 * math.sin(0.008 * k)
            turn = (0.0, math.sin(pitch / 2), 0.0, math.cos(pitch / 2))
            moved = TransformSample(stamp, "base", "flange", (0.1, 0.2, -0.09 - 0.00004 * k), turn)
            arrivals.append((stamp + late, "tf", transforms_cdr(moved)))
        for k in range(300):
            stamp = start + k * 5_000_000 + 1
            arrivals.append(
                (
                    stamp,
                    "wrench_measured",
                    cdr("wrench", stamp, [0.0, 0.0, 0.01 * k, 0.0, 0.0, 0.0]),
                )
            )
        arrivals.sort(key=lambda a: a[0])
        for time, topic, data in arrivals:
            name, kind = ("/tf", TF) if topic == "tf" else (f"/rft/{topic}", TOPICS[topic])
            bag.write_raw(name, kind, time, data)
    publishers["tf_static"].publish(fixed)
    wrenches = 0
    for _, topic, data in arrivals:
        publishers[topic].publish(data)
        wrenches += topic == "wrench_measured"
        rft.until(lambda wrenches=wrenches: len(rft.received["wrench_predicted"]) >= wrenches - 20)
    rft.wrench.publish(cdr("wrench", start + 10_000_000_000, [0.0] * 6))
    replayed = assert_equal(rft, tmp_path / "inputs", PARAMETERS, tmp_path)
    assert len(replayed["wrench_residual"]) >= 290
    assert np.abs([w[2] for w in replayed["wrench_predicted"].values()]).max() > 0.1


def test_a_folder_of_sources_is_not_taken_for_the_package(tmp_path, monkeypatch):
    for name in ("tf2_msgs", "tf2_msgs.msg"):
        monkeypatch.setitem(sys.modules, name, None)  # so that what the block imports is forgotten
        del sys.modules[name]
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    (tmp_path / "tf2_msgs" / "msg").mkdir(parents=True)
    assert not has_tf2_msgs()
    with pytest.raises(InputError, match="tf2_msgs"):
        message_class(TF)


def test_without_tf2_msgs_the_sentence_names_the_package(start_node, monkeypatch):
    monkeypatch.setattr(topics, "is_ros_from_pypi", lambda: False)
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", None)
    words = "pose_source tf and sensor.frame_source tf need the package tf2_msgs: apt install ros-jazzy-tf2-msgs"
    with pytest.raises(InputError, match=words):
        start_node("-p", "pose_source:=tf")
    monkeypatch.setitem(sys.modules, "sensor_msgs.msg", None)
    with pytest.raises(
        InputError, match=r"PointCloud2 .* sensor_msgs: apt install ros-jazzy-sensor"
    ):
        message_class("sensor_msgs/msg/PointCloud2")


def test_with_the_wheels_of_pypi_the_sentence_recommends_nothing_that_they_do_not_have(
    start_node, monkeypatch
):
    monkeypatch.setattr(topics, "is_ros_from_pypi", lambda: True)
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", None)
    with pytest.raises(InputError, match=r"PyPI .* sensor\.position") as raised:
        start_node("-p", "sensor.frame_source:=tf")
    assert "apt install" not in str(raised.value)


def test_ros_is_that_of_pypi_where_rclpy_comes_from_its_wheel():
    assert is_ros_from_pypi() == ("site-packages" in rclpy.__file__)

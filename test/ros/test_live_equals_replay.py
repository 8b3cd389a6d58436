"""One estimator, two drivers: what the node answered live is what the replay of its inputs gives, to the last bit."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from harness import OUTPUTS, numbers, stamp_of
from rclpy.serialization import serialize_message
from rosbags.highlevel import AnyReader

from rft_ros.bags.replay import replay
from rft_ros.bags.writing import BagWriter
from rft_ros.estimator.parameters import checked, defaults

PARAMETERS = {
    "mesh.file": "ellipsoid",
    "medium.zeta": 0.33,
    "alpha_y.model": "linear",
    "sensor.position": [0.01, -0.02, 0.1],
    "sensor.quaternion": [1.0, 0.0, 0.0, 0.0],
    "sensor.bias": [1.0, -2.0, 3.0, 0.1, 0.2, 0.3],
    "sensor.mass": 0.4,
    "sensor.center_of_mass": [0.0, 0.01, 0.05],
}


OURS = {"integration": "refined", "medium.mobilization_length": 0.003}


@pytest.mark.parametrize(
    ("twist_source", "model"),
    [("topic", {}), ("pose_difference", {}), ("topic", OURS)],
    ids=["topic", "pose difference", "refined, with memory"],
)
def test_live_equals_replay(start_node, tmp_path, twist_source, model):
    parameters = {**PARAMETERS, **model, "twist_source": twist_source}
    arguments = [a for name, value in parameters.items() for a in ("-p", f"{name}:={value}")]
    rft = start_node(*arguments).wait_ready()
    early = rft.moment()
    while not rft.received["wrench_residual"]:  # until all three inputs have found the node
        early += 10_000_000
        rft.send(early, z=0.5)
        rft.spin(0.05)
    rft.spin(0.5)
    for messages in rft.received.values():
        messages.clear()
    random = np.random.default_rng(3)
    start, count = 1_700_000_000_000_000_000, 300
    with BagWriter(tmp_path / "inputs") as bag:
        record = {
            rft.wrench: ("/rft/wrench_measured", "geometry_msgs/msg/WrenchStamped"),
            rft.twist: ("/rft/twist", "geometry_msgs/msg/TwistStamped"),
            rft.pose: ("/rft/pose", "geometry_msgs/msg/PoseStamped"),
        }
        for k in range(count):
            t = k * 0.005
            stamp = start + k * 5_000_000 + int(random.integers(-100_000, 100_000))
            pose, twist, wrench = PoseStamped(), TwistStamped(), WrenchStamped()
            for message, frame in ((pose, "world"), (twist, "world"), (wrench, "ft_sensor")):
                message.header.frame_id = frame
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
            pitch = 0.15 * math.sin(4.0 * t)
            pose.pose.position.x, pose.pose.position.z = 0.002 * t, 0.02 - 0.02 * t
            pose.pose.orientation.y, pose.pose.orientation.w = math.sin(pitch / 2), math.cos(pitch / 2)
            twist.twist.linear.x, twist.twist.linear.z = 0.002, -0.02
            twist.twist.angular.y = 0.6 * math.cos(4.0 * t)
            f = wrench.wrench.force
            f.x, f.y, f.z = random.normal(size=3)
            for publisher, message in ((rft.wrench, wrench), (rft.twist, twist), (rft.pose, pose)):
                topic, kind = record[publisher]
                bag.write_raw(topic, kind, stamp, serialize_message(message))
                publisher.publish(message)
            rft.spin()
    answered = count - (2 if twist_source == "pose_difference" else 0)
    rft.until(lambda: all(len(rft.received[t]) == answered for t in OUTPUTS))

    values = defaults() | {name: checked(name, value) for name, value in parameters.items()}
    replay(tmp_path / "inputs", tmp_path / "replayed", values)
    with AnyReader([tmp_path / "replayed" / "estimates"]) as reader:
        replayed = {topic: {} for topic in OUTPUTS}
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            replayed[connection.topic.rpartition("/")[2]][stamp_of(message)] = numbers(message)
    for topic in OUTPUTS:
        live = {stamp_of(message): numbers(message) for message in rft.received[topic]}
        assert live.keys() == replayed[topic].keys()
        for stamp, wrench in live.items():
            np.testing.assert_array_equal(wrench, replayed[topic][stamp])
    assert np.abs([w[2] for w in replayed["wrench_predicted"].values()]).max() > 0.1

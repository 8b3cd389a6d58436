"""Record the node's inputs in the bag my_bag until Ctrl-C, for `rft replay` and `rft calibrate`."""

import time
from contextlib import suppress
from functools import partial

import rclpy
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.executors import ExternalShutdownException
from rclpy.qos import qos_profile_sensor_data
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

TOPICS = {
    "/rft/pose": PoseStamped,
    "/rft/twist": TwistStamped,
    "/rft/wrench_measured": WrenchStamped,
}


def record(bag, connection, data):
    """Write a serialised message, at the time of its arrival."""
    bag.write(connection, time.time_ns(), data)


rclpy.init()
node = rclpy.create_node("recorder")
with Writer("my_bag", version=9) as bag:
    types = get_typestore(Stores.ROS2_JAZZY)
    for topic, message in TOPICS.items():
        name = node.resolve_topic_name(topic)  # after `--ros-args -r /rft/pose:=T`
        connection = bag.add_connection(
            name, f"geometry_msgs/msg/{message.__name__}", typestore=types
        )
        node.create_subscription(
            message, topic, partial(record, bag, connection), qos_profile_sensor_data, raw=True
        )
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)

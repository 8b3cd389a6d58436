"""ROS in this process: its start, and the message classes and QoS of the node's topics."""

from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import rclpy
from rclpy._rclpy_pybind11 import UnknownROSArgsError
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from rft_ros.errors import InputError
from rft_ros.installation import is_ros_from_pypi
from rft_ros.messages import TYPES, Role

# Best effort matches every publisher, reliable or not; the depth holds bursts of a 1,000 Hz stream.
_SENSOR_DATA = QoSProfile(depth=200, reliability=ReliabilityPolicy.BEST_EFFORT)
INPUTS: dict[Role, QoSProfile] = {
    **dict.fromkeys(("pose", "twist", "wrench", "tf"), _SENSOR_DATA),
    # a cloud has megabytes
    "surface": QoSProfile(depth=2, reliability=ReliabilityPolicy.BEST_EFFORT),
    # latched: publishers send it to late subscribers, too
    "tf_static": QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL),
}
OUTPUTS = QoSProfile(depth=200)  # reliable


def type_name(message: Any) -> str:
    """The ROS name of a message class, such as geometry_msgs/msg/PoseStamped."""
    return f"{message.__module__.partition('.')[0]}/msg/{message.__name__}"


def has_tf2_msgs() -> bool:
    """Whether tf2_msgs is installed. A folder of that name where the node runs, such as its sources, does not count."""
    return getattr(find_spec("tf2_msgs"), "origin", None) is not None


def type_on(node: Node, role: Role, topic: str, *, usual: str) -> str:
    """Which of the `TYPES` of a role its topic has: that of a publisher, or the `usual` one if there is none."""
    found = {publisher.topic_type for publisher in node.get_publishers_info_by_topic(topic)}
    return next((kind for kind in TYPES[role] if kind in found), usual)


def waiting(subscription: Subscription) -> Iterator[tuple[bytes, dict[str, Any]]]:
    """The serialised messages in a subscription's queue, each with what the middleware says of its reception."""
    with subscription.handle:
        while (taken := subscription.handle.take_message(subscription.msg_type, True)) is not None:
            yield taken


def message_class(kind: str) -> Any:
    """The class of a message type. Raises InputError if its package is not installed."""
    package, _, name = kind.split("/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        raise InputError(_missing(kind, package)) from None


def _missing(kind: str, package: str) -> str:
    """The sentence on a message type whose package is not installed."""
    is_tf = package == "tf2_msgs"
    if is_tf and is_ros_from_pypi():
        return (
            "pose_source tf and sensor.frame_source tf need tf2_msgs, which ROS from PyPI does not have; take the pose"
            " from a topic and set sensor.position and sensor.quaternion, or use ROS from apt"
        )
    what = "pose_source tf and sensor.frame_source tf" if is_tf else f"{kind} messages"
    apt = f"apt install ros-jazzy-{package.replace('_', '-')}"
    remedy = "pip install ros-jazzy-common-interfaces" if is_ros_from_pypi() else apt
    return f"{what} need the package {package}: {remedy}"


def start_ros(**options: Any) -> None:
    """Call `rclpy.init` with these options.

    Raises InputError for an unknown argument, and if ROS cannot write its log, as in a read-only home.
    """
    try:
        rclpy.init(**options)
    except UnknownROSArgsError as error:
        raise InputError(f"unknown ROS argument {str(error).strip('[]')}") from None
    except RuntimeError as error:
        if "log" not in str(error).partition(":")[0]:
            raise
        why = " ".join(str(error).partition(", at ")[0].split())
        advice = "set ROS_LOG_DIR to a folder in which this user may write, such as /tmp/ros_log"
        raise InputError(f"ROS cannot write its log ({why}); {advice}") from None

"""Listen to a cell's inputs for a while, and look at who publishes and subscribes, as `rft doctor` does."""

import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import rclpy
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSCompatibility, QoSProfile, ReliabilityPolicy, qos_check_compatible
from sensor_msgs.msg import PointCloud2

from rft_ros.bags.checkup import Finding
from rft_ros.estimator.messages import TYPES, UNREADABLE, Role, Sample, decoder
from rft_ros.node.transforms import TRANSFORMS_QOS, transform_message

_INPUTS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT, durability=DurabilityPolicy.VOLATILE)
_MESSAGES: dict[Role, Any] = {
    "pose": PoseStamped,
    "twist": TwistStamped,
    "wrench": WrenchStamped,
    "surface": PointCloud2,
}
_NODE = "rft"


def listen(topics: Mapping[Role, str], seconds: float, push: Callable[[Sample, int], None]) -> list[Finding]:
    """Give `push` every message of these topics, and /tf_static, for `seconds`, with its arrival [ns].

    Returns findings about the node, publishers' types and QoS.
    """
    rclpy.init()
    try:
        node = rclpy.create_node("rft_doctor")
        wanted = dict(topics)
        if message := transform_message(needed="tf" in topics):
            wanted["tf_static"] = topics.get("tf", "/tf") + "_static"
        for role, topic in wanted.items():
            decode = decoder(role, ros1=False)
            callback = partial(_take, node, decode, push)
            qos = TRANSFORMS_QOS.get(role, _INPUTS)
            node.create_subscription(_MESSAGES.get(role) or message, topic, callback, qos, raw=True)
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            rclpy.spin_once(node, timeout_sec=min(left, 0.1))
        findings = [_of_node(node)]
        for role, topic in wanted.items():
            findings += _of_topic(node, role, topic)
        node.destroy_node()
        return findings
    finally:
        rclpy.try_shutdown()


def _take(node: Node, decode: Callable[[bytes], Sample], push: Callable[[Sample, int], None], data: bytes) -> None:
    try:
        sample = decode(data)
    except UNREADABLE:
        return
    push(sample, node.get_clock().now().nanoseconds)


def _of_node(node: Node) -> Finding:
    if _NODE in node.get_node_names():
        return Finding(True, f"node: {_NODE} runs")
    return Finding(False, f"node: no node {_NODE} was found; start it with ros2 launch rft_ros rft.launch.py")


def _of_topic(node: Node, role: Role, topic: str) -> list[Finding]:
    """Findings about the type and the QoS of a topic's publishers, by those that the node `rft` subscribes with."""
    publishers = node.get_publishers_info_by_topic(topic)
    subscriptions = [s for s in node.get_subscriptions_info_by_topic(topic) if s.node_name in (_NODE, "rft_doctor")]
    found = []
    for publisher in publishers:
        if publisher.topic_type != TYPES[role]:
            found.append(Finding(False, f"{role}: {topic} is {publisher.topic_type}; it must be {TYPES[role]}"))
        for subscription in subscriptions:
            compatible, why = qos_check_compatible(publisher.qos_profile, subscription.qos_profile)
            if compatible != QoSCompatibility.OK:
                pair = f"{publisher.node_name} publishes {topic} so that {subscription.node_name} cannot receive it"
                found.append(Finding(False, f"{role}: {pair} ({why.strip()}); change qos_overrides or the publisher"))
    if publishers and not found:
        found.append(Finding(True, f"{role}: {len(publishers)} publishers on {topic}, QoS compatible"))
    return found

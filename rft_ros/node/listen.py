"""Look at a running node, its inputs and who publishes them, as `rft doctor` does."""

import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSCompatibility, QoSProfile, ReliabilityPolicy, qos_check_compatible
from sensor_msgs.msg import PointCloud2

from rft_ros.bags.checkup import Finding
from rft_ros.errors import InputError
from rft_ros.estimator import Sample
from rft_ros.estimator.messages import UNREADABLE, Role, decoder
from rft_ros.node.transforms import TRANSFORMS_QOS, transform_message
from rft_ros.parameters import FILES, Value, Values, checked

__all__ = ["Listener"]

_INPUTS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT, durability=DurabilityPolicy.VOLATILE)
_MESSAGES = {"pose": PoseStamped, "twist": TwistStamped, "wrench": WrenchStamped, "surface": PointCloud2}
_DISCOVERY = 6.0  # s: DDS announces a node at the latest after 3 s, on a busy machine later
_MOST_NAMED = 5
_OURS = "rft_doctor"


class Listener:
    """A ROS node beside `name`, for use in a `with` block."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __enter__(self) -> "Listener":
        rclpy.init(args=[])  # the command line's --remap is not ROS's
        self._node = rclpy.create_node(_OURS)
        return self

    def __exit__(self, *_: object) -> None:
        self._node.destroy_node()
        rclpy.try_shutdown()

    def compare(self, values: Values, file: Path) -> tuple[Finding, Value]:
        """Whether the node runs with the parameters of `file`, `values`; and the bias in force, which a tare sets."""
        bias = values["sensor.bias"]
        if (running := self._running(list(values))) is None:
            advice = "start it with ros2 launch rft_ros rft.launch.py, or give --node"
            return Finding(False, f"node: no node {self._name} was found; {advice}"), bias
        own = running["sensor.bias"]
        differs = [name for name in values if name != "sensor.bias" and not _same(name, running[name], values[name])]
        if not differs:
            note = f"; sensor.bias is its own: {own}" if own != bias else ""
            return Finding(True, f"node: {self._name} runs with the parameters of {file}{note}"), own
        named = ", ".join(f"{name} {running[name]} (file: {values[name]})" for name in differs[:_MOST_NAMED])
        named += f" and {len(differs) - _MOST_NAMED} more" if len(differs) > _MOST_NAMED else ""
        advice = "restart it with the file, whose section must be for its name, or set them"
        return Finding(False, f"node: {self._name} runs with {named}; {advice}"), own

    def _running(self, names: list[str]) -> Values | None:
        client = self._node.create_client(GetParameters, f"{self._name}/get_parameters")
        if not client.wait_for_service(_DISCOVERY):
            return None
        future = client.call_async(GetParameters.Request(names=names))
        rclpy.spin_until_future_complete(self._node, future, timeout_sec=_DISCOVERY)
        found = (future.result().values if future.done() else None) or []
        try:
            return {n: checked(n, parameter_value_to_python(v)) for n, v in zip(names, found, strict=True)}
        except (InputError, ValueError):  # another kind of node, or no answer
            return None

    def listen(self, topics: Mapping[Role, str], seconds: float, push: Callable[[Sample, int], None]) -> list[Finding]:
        """Give `push` every message of these topics, and /tf_static, for `seconds`, with its arrival [ns].

        Returns findings about publishers' types and QoS.
        """
        wanted: dict[Role, tuple[str, Any]] = {role: (topic, _MESSAGES.get(role)) for role, topic in topics.items()}
        if message := transform_message(needed="tf" in topics):
            tf = topics.get("tf", "/tf")
            wanted["tf_static"] = f"{tf}_static", message
            if "tf" in topics:
                wanted["tf"] = tf, message
        for role, (topic, kind) in wanted.items():
            take = partial(self._take, decoder(role, ros1=False), push)
            self._node.create_subscription(kind, topic, take, TRANSFORMS_QOS.get(role, _INPUTS), raw=True)
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            rclpy.spin_once(self._node, timeout_sec=min(left, 0.1))
        return [f for role, (topic, kind) in wanted.items() for f in self._of_topic(role, topic, kind)]

    def _take(self, decode: Callable[[bytes], Sample], push: Callable[[Sample, int], None], data: bytes) -> None:
        try:
            sample = decode(data)
        except UNREADABLE:
            return
        push(sample, self._node.get_clock().now().nanoseconds)

    def _of_topic(self, role: Role, topic: str, kind: Any) -> list[Finding]:
        """Findings about the type and the QoS of a topic's publishers, by those that node and doctor ask for."""
        wanted = f"{kind.__module__.partition('.')[0]}/msg/{kind.__name__}"
        names = self._name, f"/{_OURS}"
        publishers = self._node.get_publishers_info_by_topic(topic)
        others = self._node.get_subscriptions_info_by_topic(topic)
        subscriptions = [s for s in others if f"{s.node_namespace.rstrip('/')}/{s.node_name}" in names]
        faults = []
        for publisher in publishers:
            if publisher.topic_type != wanted:
                faults.append(f"{role}: {topic} is {publisher.topic_type}; it must be {wanted}")
            for subscription in subscriptions:
                compatible, why = qos_check_compatible(publisher.qos_profile, subscription.qos_profile)
                if compatible != QoSCompatibility.OK:
                    pair = f"{publisher.node_name} publishes {topic} so that {subscription.node_name} cannot receive it"
                    faults.append(f"{role}: {pair} ({why.strip()}); change qos_overrides or the publisher")
        if publishers and not faults:
            return [Finding(True, f"{role}: {len(publishers)} publishers on {topic}, QoS compatible")]
        return [Finding(False, fault) for fault in faults]


def _same(name: str, running: Value, written: Value) -> bool:
    if name in FILES and running and written:
        running, written = (str(Path(str(file)).expanduser().resolve()) for file in (running, written))
    return running == written

"""Look at a running node, its inputs and who publishes them, as `rft doctor` does."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.exceptions import NameValidationException
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import QoSCompatibility, qos_check_compatible

from rft_ros.errors import InputError, reason_of
from rft_ros.estimator import Sample
from rft_ros.estimator.messages import UNREADABLE, Role, decoder
from rft_ros.files import expanded
from rft_ros.node.topics import INPUTS, message_class, transforms_come, type_name
from rft_ros.parameters import FILES, Value, Values, checked

_Finding = tuple[bool, str]  # as of `Checkup`
_DISCOVERY = 6.0  # s: DDS announces a node at the latest after 3 s, on a busy machine later
_OURS = "rft_doctor"


@contextmanager
def listener(name: str) -> Iterator["Listener"]:
    """A listener beside the node `name`. Raises InputError where it, or a topic in the block, is no name of ROS."""
    rclpy.init(args=[])  # the command line's --remap is not ROS's
    try:
        yield Listener(name)
    except NameValidationException as error:
        raise InputError(f"{reason_of(error).rstrip(' ^')}; mend --node or --remap") from None
    finally:
        rclpy.try_shutdown()


class Listener:
    """A ROS node beside `name`."""

    def __init__(self, name: str) -> None:
        self._name, self._node = name, rclpy.create_node(_OURS)

    def compare(self, values: Values, file: Path) -> tuple[_Finding, Value]:
        """Whether the node runs with the parameters of `file`, `values`; and the bias in force, which a tare sets."""
        if (running := self._running(list(values))) is None:
            advice = "start it with ros2 launch rft_ros rft.launch.py, or give --node"
            return (False, f"node: no node {self._name} was found; {advice}"), values["sensor.bias"]
        bias = running["sensor.bias"]
        differs = [
            f"{name} {running[name]} (file: {values[name]})"
            for name in values
            if name != "sensor.bias" and not _same(name, running[name], values[name])
        ]
        if not differs:
            note = f"; sensor.bias is its own: {bias}" if bias != values["sensor.bias"] else ""
            return (True, f"node: {self._name} runs with the parameters of {file}{note}"), bias
        advice = "restart it with the file, whose section must be for its name, or set them"
        return (False, f"node: {self._name} runs with {', '.join(differs)}; {advice}"), bias

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

    def listen(self, topics: Mapping[Role, str], seconds: float, push: Callable[[Sample, int], None]) -> list[_Finding]:
        """Give `push` every message for `seconds`, with its arrival [ns]; findings about publishers' types and QoS."""
        wanted = dict(topics)
        if transforms_come() or "tf" in topics:
            wanted["tf_static"] = f"{topics.get('tf', '/tf')}_static"
        for role, topic in wanted.items():
            take = partial(self._take, decoder(role, ros1=False), push)
            self._node.create_subscription(message_class(role), topic, take, INPUTS[role], raw=True)
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            rclpy.spin_once(self._node, timeout_sec=min(left, 0.1))
        return [f for role, topic in wanted.items() for f in self._publishers(role, topic)]

    def _take(self, decode: Callable[[bytes], Sample], push: Callable[[Sample, int], None], data: bytes) -> None:
        try:
            sample = decode(data)
        except UNREADABLE:
            return
        push(sample, self._node.get_clock().now().nanoseconds)

    def _publishers(self, role: Role, topic: str) -> list[_Finding]:
        """Findings about the type and the QoS of a topic's publishers, by those that node and doctor ask for."""
        names = self._name, f"/{_OURS}"
        publishers = self._node.get_publishers_info_by_topic(topic)
        others = self._node.get_subscriptions_info_by_topic(topic)
        subscriptions = [s for s in others if f"{s.node_namespace.rstrip('/')}/{s.node_name}" in names]
        faults = []
        for publisher in publishers:
            if publisher.topic_type != (kind := type_name(message_class(role))):
                faults.append(f"{role}: {topic} is {publisher.topic_type}; it must be {kind}")
            for subscription in subscriptions:
                compatible, why = qos_check_compatible(publisher.qos_profile, subscription.qos_profile)
                if compatible != QoSCompatibility.OK:
                    pair = f"{publisher.node_name} publishes {topic} so that {subscription.node_name} cannot receive it"
                    faults.append(f"{role}: {pair} ({why.strip()}); change qos_overrides or the publisher")
        if publishers and not faults:
            return [(True, f"{role}: {len(publishers)} publishers on {topic}, QoS compatible")]
        return [(False, fault) for fault in faults]


def _same(name: str, running: Value, written: Value) -> bool:
    if name in FILES and running and written:
        running, written = (str(expanded(str(file)).resolve()) for file in (running, written))
    return running == written

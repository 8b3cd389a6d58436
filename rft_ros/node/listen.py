"""Listen beside a running node: its parameters, who publishes its inputs, and their messages with arrival times."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from copy import copy
from typing import NamedTuple

import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.exceptions import NameValidationException
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import QoSCompatibility, qos_check_compatible
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from rft_ros.errors import InputError, reason_of
from rft_ros.messages import TYPES, Role
from rft_ros.node.topics import (
    INPUTS,
    has_tf2_msgs,
    message_class,
    start_ros,
    type_name,
    type_on,
    waiting,
)
from rft_ros.parameters import Values, checked

_DISCOVERY = 6.0  # s: DDS announces a node after 3 s at most, on a busy machine later
_OURS = "rft_doctor"
_DEPTH = 20_000  # length of a topic's queue: 20 s at 1 kHz, since a busy machine may stop this process for seconds
_PERIOD = 0.05  # s between two readings of the queues
_ORDER = [
    *reversed(TYPES)
]  # of messages that arrive together: a pose comes after what it is used with


class Message(NamedTuple):
    """A serialised message of a role, received at a time of the middleware [ns].

    `kind`: its type. `number`: its place among all messages of its publisher; None where the middleware does not count.
    """

    role: Role
    kind: str
    data: bytes
    received: int
    number: int | None


class Publisher(NamedTuple):
    """A publisher of a topic, its message type, and the subscribers that cannot receive its messages.

    `unheard`: for each such subscriber the name of its node, and the QoS policies that do not match.
    """

    node: str
    type: str
    unheard: tuple[tuple[str, str], ...]


class Topic(NamedTuple):
    """The topic of a role, the types that its messages may have, and its publishers."""

    role: Role
    name: str
    types: tuple[str, ...]
    publishers: tuple[Publisher, ...]


@contextmanager
def listener(name: str) -> Iterator["Listener"]:
    """A listener beside the node `name`. Raises InputError if that or a topic in the block is no valid ROS name."""
    start_ros(args=[])  # without sys.argv, whose --remap is an option of rft and not of ROS
    try:
        yield Listener(name)
    except NameValidationException as error:
        raise InputError(f"{reason_of(error).rstrip(' ^')}; correct --node or --remap") from None
    finally:
        rclpy.try_shutdown()


class Listener:
    """A ROS node beside `name`."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._node = rclpy.create_node(_OURS)
        self._discovered = time.monotonic() + _DISCOVERY
        self._topics: dict[Role, str] = {}
        self._kinds: dict[Role, str] = {}
        self._subscriptions: dict[Role, Subscription] = {}
        self.found = False
        """Whether the node exists, even if it does not answer."""

    def parameters(self, names: list[str]) -> Values | None:
        """The node's values of these parameters, checked; None if no such node answers."""
        client = self._node.create_client(GetParameters, f"{self._name}/get_parameters")
        self.found = client.wait_for_service(_DISCOVERY)
        if not self.found:
            return None
        future = client.call_async(GetParameters.Request(names=names))
        rclpy.spin_until_future_complete(self._node, future, timeout_sec=_DISCOVERY)
        if not future.done():
            return None
        values = map(parameter_value_to_python, future.result().values)
        try:
            return {name: checked(name, v) for name, v in zip(names, values, strict=True)}
        except ValueError:  # another kind of node
            return None

    def subscribe(self, topics: Mapping[Role, str]) -> None:
        """Subscribe to the topics of these roles, and wait some seconds until each has a publisher."""
        self._topics = dict(topics)
        if not has_tf2_msgs() and "tf" not in topics:
            self._topics.pop("tf_static", None)
        for role, topic in self._topics.items():
            self._subscribe(role, TYPES[role][0], topic)
        while time.monotonic() < self._discovered and not all(
            map(self._node.count_publishers, self._topics.values())
        ):
            time.sleep(_PERIOD)
        for role, topic in self._topics.items():
            kind = type_on(self._node, role, topic, usual=self._kinds[role])
            if kind != self._kinds[role]:
                self._node.destroy_subscription(self._subscriptions[role])
                self._subscribe(role, kind, topic)

    def listen(
        self,
        seconds: float,
        *,
        is_enough: Callable[[float, list[Message]], bool] = lambda _seconds, _messages: False,
    ) -> tuple[list[Message], list[Topic]]:
        """All messages within `seconds` [s], in the order of arrival, and the topics with their publishers.

        It ends earlier once `is_enough` returns True, which is called with the time [s] since the beginning and the
        messages that have come since the last call.
        """
        messages = list[Message]()
        begin = time.monotonic()
        end = begin + seconds
        while (left := end - time.monotonic()) > 0.0:
            time.sleep(min(left, _PERIOD))  # the middleware's own threads receive meanwhile
            new = [
                message
                for role, subscription in self._subscriptions.items()
                for message in _received(role, self._kinds[role], subscription)
            ]
            new.sort(key=_arrival)
            messages += new
            if is_enough(time.monotonic() - begin, new):
                break
        messages.sort(key=_arrival)
        return messages, [self._topic(role, name) for role, name in self._topics.items()]

    def _subscribe(self, role: Role, kind: str, topic: str) -> None:
        """Subscribe with the node's QoS and a longer queue. No executor spins; `waiting` reads the queue."""
        qos = copy(INPUTS[role])
        if role != "surface":
            qos.depth = _DEPTH
        self._kinds[role] = kind
        self._subscriptions[role] = self._node.create_subscription(
            message_class(kind), topic, lambda _: None, qos, raw=True
        )

    def _topic(self, role: Role, name: str) -> Topic:
        """The topic with its publishers, and which of the node and this listener cannot receive from them."""
        subscriptions = [
            subscription
            for subscription in self._node.get_subscriptions_info_by_topic(name)
            if _full_name(subscription) in (self._name, f"/{_OURS}")
        ]
        publishers = []
        for publisher in self._node.get_publishers_info_by_topic(name):
            unheard = []
            for subscription in subscriptions:
                compatible, why = qos_check_compatible(
                    publisher.qos_profile, subscription.qos_profile
                )
                if compatible != QoSCompatibility.OK:
                    unheard.append((subscription.node_name, why.strip()))
            publishers.append(Publisher(publisher.node_name, publisher.topic_type, tuple(unheard)))
        # the names that the classes have, since tests put another message in place of that of tf2_msgs
        types = [type_name(message_class(kind)) for kind in TYPES[role]]
        return Topic(role, name, tuple(types), tuple(publishers))


def _arrival(message: Message) -> tuple[int, int]:
    """Sorts messages by their arrival."""
    return message.received, _ORDER.index(message.role)


def _received(role: Role, kind: str, subscription: Subscription) -> Iterator[Message]:
    for data, info in waiting(subscription):
        number = info["publication_sequence_number"]
        yield Message(role, kind, data, info["received_timestamp"], number)


def _full_name(endpoint: TopicEndpointInfo) -> str:
    return f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"

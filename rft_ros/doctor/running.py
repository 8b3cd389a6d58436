"""Examine a running cell: the node's parameters, the publishers of its inputs, and what they send."""

from collections.abc import Iterator
from pathlib import Path

from rft_ros.doctor.cell import Cell
from rft_ros.doctor.checkup import Checkup
from rft_ros.doctor.finding import Finding
from rft_ros.estimator.messages import UNREADABLE, decoder
from rft_ros.files import resolved
from rft_ros.node.listen import Topic, listener
from rft_ros.parameters import FILES, Value, Values

__all__ = ["examine_running"]


def examine_running(cell: Cell, node: str, *, seconds: float) -> list[Finding]:
    """The findings on the cell beside the node of this full name, after listening for so long [s].

    Raises InputError where the node or a topic has no name of ROS.
    """
    with listener(node) as ros:
        running = ros.parameters(list(cell.values))
        messages, topics = ros.listen(cell.topics, seconds)
    # all estimates are made after listening: to listen takes no more than a look into the queues now and then
    values = {**cell.values, "sensor.bias": running["sensor.bias"]} if running else cell.values  # a tare sets it
    checkup = Checkup(values, cell.model, named=cell.named, topics=cell.topics)
    decode = {message.role: decoder(message.role, ros1=False) for message in messages}
    for message in messages:
        try:
            sample = decode[message.role](message.data)
        except UNREADABLE:
            continue
        checkup.push(sample, message.received)
    of_topics = [finding for topic in topics for finding in _of_topic(topic)]
    return [_of_node(node, running, cell.values, cell.file), *of_topics, *checkup.findings()]


def _of_node(node: str, running: Values | None, values: Values, file: Path) -> Finding:
    """Whether the node runs with the parameters of `file`, `values`."""
    if running is None:
        advice = "start it with ros2 launch rft_ros rft.launch.py, or give --node"
        return Finding(False, f"node: no node {node} was found; {advice}")
    differs = [
        f"{name} {running[name]} (file: {values[name]})"
        for name in values
        if name != "sensor.bias" and not _same(name, running[name], values[name])
    ]
    if not differs:
        bias = running["sensor.bias"]
        note = f"; sensor.bias is its own: {bias}" if bias != values["sensor.bias"] else ""
        return Finding(True, f"node: {node} runs with the parameters of {file}{note}")
    advice = "restart it with the file, whose section must be for its name, or set them"
    return Finding(False, f"node: {node} runs with {', '.join(differs)}; {advice}")


def _same(name: str, running: Value, written: Value) -> bool:
    if name in FILES and running and written:
        running, written = (str(resolved(str(file))) for file in (running, written))
    return running == written


def _of_topic(topic: Topic) -> Iterator[Finding]:
    """Whether the type and the QoS of a topic's publishers are those that node and doctor ask for."""
    right = True
    for publisher in topic.publishers:
        if publisher.type != topic.type:
            right = False
            yield Finding(False, f"{topic.role}: {topic.name} is {publisher.type}; it must be {topic.type}")
        for node, why in publisher.unheard:
            right = False
            pair = f"{publisher.node} publishes {topic.name} so that {node} cannot receive it"
            yield Finding(False, f"{topic.role}: {pair} ({why}); change qos_overrides or the publisher")
    if right and topic.publishers:
        count = len(topic.publishers)
        number = "1 publisher" if count == 1 else f"{count} publishers"
        yield Finding(True, f"{topic.role}: {number} on {topic.name}, QoS compatible")

"""Examines a running cell: the node's parameters, the publishers of its inputs, and the messages they send."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from rft_ros.diagnosis import Finding
from rft_ros.doctor.alternation import MIN_JUMPS
from rft_ros.doctor.checkup import Cell, Checkup, delayed
from rft_ros.doctor.seen_motion import SeenMotion
from rft_ros.estimator import Sample, Stamped
from rft_ros.files import resolved
from rft_ros.installation import start_of_node
from rft_ros.messages import UNREADABLE, Role, decoder
from rft_ros.node.listen import Message, Topic, listener
from rft_ros.parameters import FILES, Value, Values
from rft_ros.progress import busy, counted

_TASK = "hold the tool still in the air, push it down into the grains, drag it along x and along y"
MAX_LOST_SHARE = 0.01  # share of a topic's messages


def examine_running(
    cell: Cell, node: str, *, seconds: float, needs_node: bool = True
) -> list[Finding]:
    """The findings on a running cell, after listening for at most `seconds` [s]: less once a whole trial was seen.

    `node`: the full name of the node. `needs_node`: whether it is a fault if there is none.

    Raises InputError if the name of the node or of a topic is not valid in ROS.
    """
    seen_motion = SeenMotion(cell)
    decoders: dict[tuple[Role, str], Callable[[bytes], Sample]] = {}
    with listener(node) as ros:
        with busy(f"looking for {node} and the publishers of its inputs"):
            running = ros.parameters(list(cell.config.values))
            ros.subscribe(cell.topics)
        with counted(f"listening for at most {seconds:g} s: {_TASK}") as update:

            def is_enough(elapsed: float, messages: Sequence[Message]) -> bool:
                for sample, _ in _samples(messages, decoders):
                    seen_motion.add(sample)
                update(elapsed, f"still to see: {', '.join(seen_motion.missing) or 'nothing'}")
                return seen_motion.is_enough(elapsed)

            messages, topics = ros.listen(seconds, is_enough=is_enough)
    if running is not None:
        node_finding = _of_node(node, running, cell.config.values, cell.file)
    elif ros.found:
        sentence = f"{node} is there and does not answer"
        node_finding = Finding(
            name="node", said=sentence, advice="this machine is too busy, or it hangs"
        )
    else:
        advice = f"start it with {start_of_node(cell.file)}, or give --node"
        sentence = f"no node {node} was found"
        node_finding = Finding(
            name="node", ok=not needs_node, is_note=not needs_node, said=sentence, advice=advice
        )
    # the estimates are computed after listening, so that they take no CPU time while messages arrive
    # a tare changes it
    config = cell.config
    if running:
        config = config.changed({"sensor.bias": running["sensor.bias"]})
    checkup = Checkup(replace(cell, config=config))
    for sample, received in _as_if_in_time(
        list(_samples(messages, decoders)), limit=config.inputs.max_input_age
    ):
        checkup.push(sample, received)
    topic_findings = [finding for topic in topics for finding in _of_topic(topic)]
    lost = [finding for topic in topics for finding in _of_losses(topic, messages)]
    unseen = [
        Finding(
            name="motion",
            ok=True,
            is_note=True,
            said=f"not seen, so not all was judged: {', '.join(seen_motion.missing)}",
            advice=_TASK,
        )
    ]
    return [
        *lost,
        node_finding,
        *topic_findings,
        *checkup.findings(complete=not lost),
        *(unseen if seen_motion.missing else []),
    ]


def _samples(
    messages: Sequence[Message], decoders: dict[tuple[Role, str], Callable[[bytes], Sample]]
) -> Iterator[tuple[Sample, int]]:
    """The samples that can be read, each with the time at which it was received [ns].

    `decoders`: those made so far, by role and type.
    """
    for message in messages:
        role_and_type = message.role, message.kind
        if role_and_type not in decoders:
            decoders[role_and_type] = decoder(message.role, ros1=False, kind=message.kind)
        with suppress(*UNREADABLE):
            yield decoders[role_and_type](message.data), message.received


def _as_if_in_time(
    received: list[tuple[Sample, int]], *, limit: float
) -> list[tuple[Sample, int]]:
    """The same samples, sorted by their stamps if a busy machine has delayed them."""
    ages = defaultdict[type, list[float]](list)  # [s], by the kind of sample
    for sample, time in received:
        if isinstance(sample, Stamped):
            ages[type(sample)].append(1e-9 * (time - sample.stamp))
    if not any(delayed(np.array(role_ages), limit) for role_ages in ages.values()):
        return received

    def sent(one: tuple[Sample, int]) -> int:
        sample, _ = one
        if isinstance(sample, Stamped):
            return sample.stamp
        return max((transform.stamp for transform in sample if not transform.fixed), default=0)

    return sorted(received, key=sent)


def _of_losses(topic: Topic, messages: Sequence[Message]) -> Iterator[Finding]:
    """A finding if messages of a topic were lost, by the sequence numbers that its publisher gave them."""
    if (
        len(topic.publishers) != 1
    ):  # each publisher counts for itself, and a message does not name its publisher
        return
    numbers = [
        message.number
        for message in messages
        if message.role == topic.role and message.number is not None
    ]
    sent = max(numbers) - min(numbers) + 1 if numbers else 0
    lost = sent - len(numbers)
    if lost > MAX_LOST_SHARE * sent:
        sentence = f"{lost} of {sent} messages on {topic.name} were lost on the way: this machine is too busy to judge"
        yield Finding(name="machine", said=sentence, advice="end other work, and run again")


def _of_node(node: str, running: Values, values: Values, file: Path) -> Finding:
    """Whether the node runs with `values`, the parameters of `file`."""
    differs = [
        f"{name} {running[name]} (file: {values[name]})"
        for name in values
        if name != "sensor.bias" and not _same(name, running[name], values[name])
    ]
    if not differs:
        bias = running["sensor.bias"]
        note = (
            f"; its sensor.bias differs, as after a tare: {bias}"
            if bias != values["sensor.bias"]
            else ""
        )
        return Finding(
            name="node", ok=True, said=f"{node} runs with the parameters of {file}{note}"
        )
    advice = "restart it with the file, whose section must be for its name, or set them"
    return Finding(name="node", said=f"{node} runs with {', '.join(differs)}", advice=advice)


def _same(name: str, running: Value, written: Value) -> bool:
    if name in FILES and running and written:
        running, written = (str(resolved(str(file))) for file in (running, written))
    return running == written


def _of_topic(topic: Topic) -> Iterator[Finding]:
    """Whether node and doctor can receive the messages of a topic: type and QoS of its publishers."""
    right = True
    for publisher in topic.publishers:
        if publisher.type not in topic.types:
            right = False
            must = f"it must be {' or '.join(topic.types)}"
            yield Finding(name=topic.role, said=f"{topic.name} is {publisher.type}", advice=must)
        for node, why in publisher.unheard:
            right = False
            sentence = (
                f"{publisher.node} publishes {topic.name} so that {node} cannot receive it ({why})"
            )
            yield Finding(
                name=topic.role, said=sentence, advice="change qos_overrides or the publisher"
            )
    count = len(topic.publishers)
    if count > 1 and topic.role in MIN_JUMPS:
        right = False
        names = ", ".join(sorted(publisher.node for publisher in topic.publishers))
        sentence = f"{count} publishers on {topic.name} ({names}), whose messages are mixed"
        yield Finding(name=topic.role, said=sentence, advice="stop all but one")
    if right and topic.publishers:
        number = "1 publisher" if count == 1 else f"{count} publishers"
        yield Finding(name=topic.role, ok=True, said=f"{number} on {topic.name}, QoS compatible")

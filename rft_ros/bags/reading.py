"""Read recordings as samples in the order of their receive times: rosbag2 (MCAP, SQLite), ROS 1 bags, CSV tables."""

import heapq
import os
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from operator import itemgetter
from pathlib import Path
from typing import Any

from rft_ros.bags.options import ReplayOptions, topics_of
from rft_ros.bags.sources import Messages, Source, fault_of, sources_of
from rft_ros.bags.table import (
    MESSAGE_COLUMNS,
    config_for_table,
    config_of_tables,
    is_table,
    read_recorded_table,
    source_of_table,
)
from rft_ros.errors import InputError, file_errors
from rft_ros.estimator import Sample, TransformSample
from rft_ros.files import resolved
from rft_ros.logged_columns import parse_columns
from rft_ros.messages import TOPICS, TYPES, UNREADABLE, Role, decoder, unreadable_because
from rft_ros.parameters import Config, Values

_OPTIONAL: tuple[Role, ...] = ("wrench", "surface")
_PROPOSED_ROLES: tuple[Role, ...] = ("pose", "wrench")  # a topic of twists may be one of commands
_RANK: tuple[Role, ...] = ("surface", "wrench", "twist", "pose", "tf")
_INSTEAD: dict[Role, str] = {
    "pose": "pose_source: tf, or ",
    "twist": "twist_source: pose_difference, or ",
}
_OUTPUT_NAMES = {
    f"wrench_{name}" for name in ("predicted", "sigma", "compensated", "residual", "feedforward")
}
_MAX_DISORDER_NS = 100_000_000  # messages that lie up to this late in their file are put in order, as in split bags
_SORTED_COUNT = 256  # messages sorted at a time


def bag_name(bag: Path) -> str:
    """The bag's file name; bytes that are not UTF-8 are escaped, so that it can be printed and written."""
    return os.fsencode(resolved(bag).name).decode(errors="backslashreplace")


@contextmanager
def opened_recording(
    bag: Path,
    parameters: Config | Values,
    options: ReplayOptions | None = None,
    *,
    strict: bool = True,
    needs_wrench: bool = False,
) -> Iterator["Recording"]:
    """Open a recording for a `with` block and one `for` loop over its samples.

    `parameters`: all, or some by name; `config` of the recording has its kinds of poses and velocities. `options`: the
    topic of each role, and the part that is read, by receive time since the first message on any topic.

    Raises InputError for a path that is no recording, and for a topic that is missing or of another type. That of
    clouds may be missing; that of the load cell, too, where the bag has no other topic of its type, unless
    `needs_wrench`. If not `strict`, all may be missing, with the remedy of each in `missing`, and topics of another
    type are left out, with a sentence on each in `mistyped`.
    """
    replay_options = options or ReplayOptions()
    with ExitStack() as stack:
        with file_errors(f"bag '{bag}'", "read"):
            config = Config.of(parameters)
            faults: list[str] = []
            if is_table(bag):
                table_topics = topics_of(
                    config_of_tables(config), replay_options.remap, replay_options.node
                )
                columns = parse_columns(replay_options.columns)
                table = read_recorded_table(bag, columns=columns, topics=table_topics)
                config = config_for_table(table, config)
            topics = topics_of(config, replay_options.remap, replay_options.node)
            if is_table(bag):
                sources = [source_of_table(bag, table, topics, config.frames)]
            else:
                sources, faults = sources_of(bag, stack)
            recording = Recording(
                bag,
                config,
                topics,
                sources,
                options=replay_options,
                faults=faults,
                strict=strict,
                needs_wrench=needs_wrench,
            )
        yield recording


def check_recordings(
    bags: Iterable[Path], config: Config, options: ReplayOptions, *, needs_wrench: bool = False
) -> None:
    """Raise InputError as `opened_recording` does, before anything that takes long."""
    for bag in bags:
        with opened_recording(bag, config, options, needs_wrench=needs_wrench):
            pass


class Recording:
    """The samples of one open recording; memory does not grow with a bag. Made by `opened_recording`.

    Order: receive time (the bag's log time); at equal times surface, wrench, twist, pose, tf; then the file's.

    `topics`: of each role that is read; that of fixed transforms is read at once, into `fixed`. Of a damaged bag all
    that is intact is used, and `damage` describes the rest; messages that cannot be decoded are counted in
    `unreadable`. `first`, `last`: receive times of the first and the last message that may be read [ns]. `shift`: of
    the stamps of a table that begins at 0 [ns].
    """

    def __init__(
        self,
        bag: Path,
        config: Config,
        topics: Mapping[Role, str],
        sources: Sequence[Source],
        *,
        options: ReplayOptions,
        faults: list[str],
        strict: bool,
        needs_wrench: bool,
    ) -> None:
        self._sources = sorted(
            (source for source in sources if source.count), key=lambda source: source.first
        )
        self._faults = faults
        if not self._sources:
            why = f" ({'; '.join(faults)})" if faults else ""
            raise InputError(f"bag '{bag}' has no messages{why}")
        self.bag = bag
        self.config = config
        self.topics = dict(topics)
        fixed_topic = self.topics.pop("tf_static")
        self.mistyped: dict[Role, str] = {}
        self.missing: dict[Role, str] = {}
        """For each role whose topic the bag does not have: which option helps, and what the bag has."""
        self.proposals: dict[Role, str] = {}
        """For poses and load cell, if their topic is missing: the only one of their type that the bag has."""
        self._decoders: dict[Role, Callable[[bytes], Sample]] = {}
        self._check_topics(strict=strict, needs_wrench=needs_wrench)
        self.shift = self._sources[0].shift
        self.unreadable = 0
        self.fixed = tuple(dict.fromkeys(self._read_fixed(fixed_topic)))
        first, last = self._part(options)
        self.first = first
        self.last = last
        self.counts: Counter[Role] = Counter()
        """Of the messages that were read so far, by role."""
        self.time = self.first
        """Receive time of the last one [ns]."""

    def _part(self, options: ReplayOptions) -> tuple[int, int]:
        """`first` and `last`. Raises InputError if no message can lie between them."""
        start = options.start or 0.0
        end = options.end
        begins = self._sources[0].first
        ends = max(source.last for source in self._sources)
        first = begins + round(start * 1e9)
        last = ends if end is None else min(ends, begins + round(end * 1e9))
        if first > last:
            until = "its end" if end is None else f"{end:g} s"
            lasts = f"lasts {(ends - begins) * 1e-9:.3f} s"
            raise InputError(
                f"bag '{self.bag}' {lasts}; it has nothing from {start:g} s to {until}"
            )
        return first, last

    def _read_fixed(self, topic: str) -> Iterator[TransformSample]:
        """The fixed transforms of the whole bag."""
        for source in self._sources:
            if (topic, *TYPES["tf_static"]) in source.types:
                decode = decoder("tf_static", ros1=source.ros1)
                with suppress(Exception):  # damage, which `_stream` reports
                    for _, _, data in source.read([topic], source.first, source.last):
                        yield from self._decoded(topic, decode, data) or ()  # type: ignore[misc]

    def _decoded(
        self, topic: str, decode: Callable[[bytes], Sample], data: bytes
    ) -> Sample | None:
        """The sample of a message; None for one that cannot be decoded, which is counted."""
        try:
            return decode(data)
        except UNREADABLE as error:
            if not self.unreadable:
                why = unreadable_because(error)
                self._faults.append(f"a message on {topic} cannot be decoded ({why})")
            self.unreadable += 1
            return None

    @property
    def damage(self) -> str | None:
        """What is wrong with the bag, and what was used; None for an intact one. Complete after the loop."""
        if not self._faults:
            return None
        duration = (self.time - self.first) * 1e-9
        part = f"{sum(self.counts.values())} messages were used, up to {duration:.3f} s after the start"
        return f"{'; '.join(self._faults)}; {part}"

    def __iter__(self) -> Iterator[Sample]:
        """The samples in order, after the fixed transforms of the whole bag."""
        if self.fixed:
            yield self.fixed
        for time, rank, _, data in self._in_order():
            role = _RANK[rank]
            sample = self._decoded(self.topics[role], self._decoders[role], data)
            if sample is not None:
                self.time = time
                self.counts[role] += 1
                yield sample

    def _in_order(self) -> Iterator[tuple[int, int, int, Any]]:
        rank = {topic: _RANK.index(role) for role, topic in self.topics.items()}
        queue: list[tuple[int, int, int, Any]] = []
        for number, (time, topic, data) in enumerate(self._messages(rank)):
            queue.append((time, rank[topic], number, data))
            if len(queue) >= _SORTED_COUNT and number % _SORTED_COUNT == 0:
                queue.sort()  # almost sorted: faster than a heap
                ready = bisect_left(queue, (queue[-1][0] - _MAX_DISORDER_NS,))
                yield from queue[:ready]
                del queue[:ready]
        queue.sort()
        yield from queue

    def _messages(self, topics: Collection[str]) -> Messages:
        """The messages of all files, merged by time."""
        streams = [self._stream(source, topics) for source in self._sources]
        return (message for message in heapq.merge(*streams, key=itemgetter(0)) if message[1])

    def _stream(self, source: Source, topics: Collection[str]) -> Messages:
        """The messages of a file up to its damage, after one without topic: a file is read when its time has come."""
        yield source.first, "", b""
        try:
            yield from source.read(topics, self.first, self.last)
        except Exception as error:  # parsers raise anything on damage
            self._faults.append(fault_of(source.name, error))

    def _check_topics(self, *, strict: bool, needs_wrench: bool) -> None:
        """Find the decoder of each role. Raises InputError, as `opened_recording` says."""
        types_by_topic: dict[str, list[str]] = {}
        for topic, msgtype in sorted({pair for source in self._sources for pair in source.types}):
            types_by_topic.setdefault(topic, []).append(msgtype)
        for role, topic in list(self.topics.items()):
            types = types_by_topic.get(topic, [])
            candidates = _candidates(role, types_by_topic)
            remap = f"--remap {TOPICS[role]}:={next(iter(candidates), 'TOPIC')}"
            there = f"it has {_listed(types_by_topic)}"
            remedy = f"use {_INSTEAD.get(role, '')}{remap}; {there}"
            if len(types) == 1 and types[0] in TYPES[role]:
                ros1 = self._sources[0].ros1
                self._decoders[role] = decoder(role, ros1=ros1, kind=types[0])
            elif types and not strict:
                self.mistyped[role] = f"{topic} {_is_not(role, types)}"
                del self.topics[role]
            elif types:
                raise InputError(
                    f"bag '{self.bag}': {role} topic '{topic}' {_is_not(role, types)} ({remedy})"
                )
            else:
                self.missing[role] = f"use {remap}; {there}"
                if role in _PROPOSED_ROLES and len(candidates) == 1:
                    self.proposals[role] = candidates[0]
                is_meant = role == "wrench" and (needs_wrench or bool(candidates))
                if strict and (is_meant or role not in _OPTIONAL):
                    raise InputError(self._without(role, topic, remedy))

    def _without(self, role: Role, topic: str, remedy: str) -> str:
        """A sentence on a role that the recording has no messages of."""
        if is_table(self.bag):
            return f"table '{self.bag}' has no {role}: add the columns {', '.join(MESSAGE_COLUMNS[role])}"
        return f"bag '{self.bag}' has no {role} topic '{topic}' ({remedy})"


def _is_not(role: Role, types: Collection[str]) -> str:
    """The end of a sentence on a topic of other types than those of its role."""
    sentence = f"is {' and '.join(types)}; it must be {' or '.join(TYPES[role])}"
    if any(" as " in kind for kind in types):  # of ROS 1, or JSON
        sentence += ", serialised by ROS 2 (cdr): convert the recording to a bag of ROS 2, as rosbags-convert does"
    return sentence


def _candidates(role: Role, types_by_topic: Mapping[str, Sequence[str]]) -> list[str]:
    """The topics of a bag that may be that of a role by their types; what a node of this package publishes is none."""
    return [
        topic
        for topic, types in types_by_topic.items()
        if len(types) == 1
        and types[0] in TYPES[role]
        and topic.rpartition("/")[2] not in _OUTPUT_NAMES
    ]


def _listed(types_by_topic: Mapping[str, Sequence[str]]) -> str:
    """The topics of a bag with their types."""
    return ", ".join(f"{topic} ({' and '.join(types)})" for topic, types in types_by_topic.items())

"""Read rosbag2 (MCAP, SQLite) and ROS 1 bags as samples in the order of their receive times."""

import os
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, DataEnd, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2

from rft_ros.errors import InputError, file_errors, reason_of
from rft_ros.estimator import Sample, TransformSample
from rft_ros.estimator.messages import TYPES, Role, decoder

__all__ = ["Recording", "bag_name"]

_RANK: tuple[Role, ...] = ("surface", "wrench", "twist", "pose", "tf")

_INSTEAD: dict[Role, str] = {"pose": "pose_source: tf, or ", "twist": "twist_source: pose_difference, or "}
_REPAIRS = {".db3": "sqlite3 FILE .recover", ".bag": "rosbag reindex"}
_LATEST = 100_000_000  # greatest delay of a message in its file that is still sorted [ns], as in split bags
_TOGETHER = 256  # messages sorted at a time
_CHUNK_HEAD = 49  # bytes before the records of an uncompressed chunk (https://mcap.dev/spec)
_SUFFIXES = (".mcap", ".db3", ".bag")


def bag_name(bag: Path) -> str:
    """The bag's file name; bytes that are not UTF-8 are escaped, so that it can be printed and written."""
    return os.fsencode(bag.resolve().name).decode(errors="backslashreplace")


class _Part(NamedTuple):
    """A bag or one file of it: topics with types, number of messages, first and last time [ns].

    `messages`: time, topic and content of the messages on some topics between two times, up to any damage.
    """

    name: str
    topics: set[tuple[str, str]]
    size: int
    first: int
    last: int
    messages: Callable[[Collection[str], int, int], Iterator[tuple[int, str, bytes]]]


def _indexed(path: Path, opened: ExitStack) -> _Part:
    """What rosbags can open."""
    reader = Reader1(path) if _is_ros1(path) else Reader2(path)
    reader.open()
    opened.callback(reader.close)

    def messages(topics: Collection[str], start: int, stop: int) -> Iterator[tuple[int, str, bytes]]:
        if chosen := [c for c in reader.connections if c.topic in topics]:  # for rosbags, an empty list means all
            for connection, time, data in reader.messages(chosen, start, stop):
                yield time, connection.topic, data

    topics = {(c.topic, c.msgtype) for c in reader.connections}
    return _Part(path.name, topics, reader.message_count, reader.start_time, reader.end_time - 1, messages)


def _is_ros1(bag: Path) -> bool:
    return bag.suffix == ".bag" and bag.is_file()


def _damaged(file: Path) -> _Part:
    """An .mcap file that rosbags cannot open, record by record."""
    topics: set[tuple[str, str]] = set()
    count, first, last = 0, 2**63 - 1, 0
    with suppress(Exception):  # `messages` raises it again
        for time, topic, msgtype, _ in _messages(file):
            topics.add((topic, msgtype))
            count, first, last = count + 1, min(first, time), max(last, time)

    def messages(topics: Collection[str], start: int, stop: int) -> Iterator[tuple[int, str, bytes]]:
        found = _messages(file)
        return ((time, topic, data) for time, topic, _, data in found if topic in topics and start <= time < stop)

    return _Part(file.name, topics, count, first, last, messages)


def _messages(file: Path) -> Iterator[tuple[int, str, str, bytes]]:
    """Receive time [ns], topic, type and content of each message of an .mcap file up to the damage."""
    types: dict[int, str] = {}
    channels: dict[int, tuple[str, str]] = {}
    with file.open("rb") as stream:
        for record in _records(stream):
            if isinstance(record, Schema):
                types[record.id] = record.name
            elif isinstance(record, Channel):
                channels[record.id] = record.topic, types.get(record.schema_id, "unknown type")
            elif isinstance(record, Message):
                yield record.log_time, *channels[record.channel_id], record.data
            elif isinstance(record, DataEnd):
                return


def _records(stream: BinaryIO) -> Iterator[McapRecord]:
    """The records of an MCAP file, those in chunks too; of a cut one that is not compressed, those before the cut."""
    at = 0
    try:
        try:
            for record in StreamReader(stream, validate_crcs=True).records:
                yield record
                at = stream.tell()
        except EndOfFile:
            stream.seek(at)
            head = stream.read(_CHUNK_HEAD)
            if head[:1] != bytes([Opcode.CHUNK]) or any(head[37:41]):  # length of the compression's name
                raise
            yield from StreamReader(stream, skip_magic=True).records
    except EndOfFile:
        raise ValueError("the file ends inside a record") from None


class Recording:
    """The samples of one bag, for use in a `with` block and one `for` loop; memory does not grow with the bag.

    `bag`: a rosbag2 folder, or an .mcap, .db3 or ROS 1 .bag file. `topics`: topic of each role; only these are read.
    `start`, `end`: receive time since the bag's first message on any topic [s]. `optional`: roles whose topic may be
    missing. Order: receive time (the bag's log time); at equal times surface, wrench, twist, pose, tf; then the file's.

    Raises InputError for a missing topic, a topic of another type, and a path that is not a bag. A damaged bag is used
    up to the damage, which `damage` describes; of a file that is not MCAP nothing is used if rosbags cannot open it.
    """

    def __init__(
        self,
        bag: Path,
        topics: Mapping[Role, str],
        *,
        start: float | None = None,
        end: float | None = None,
        optional: Collection[Role] = frozenset[Role]({"wrench", "surface"}),
    ) -> None:
        self.bag = bag
        self.counts: Counter[Role] = Counter()
        self.fixed: tuple[TransformSample, ...] = ()  # of the whole bag, from /tf_static
        self.time = 0  # receive time of the last sample [ns]
        self._topics = dict(topics)
        self._offsets = (start, end)
        self._optional = optional
        self._parts: list[_Part] = []
        self._why = ""

    def __enter__(self) -> "Recording":
        with file_errors(f"bag '{self.bag}'", "read"), ExitStack() as opened:
            self._parts = sorted(self._open(opened), key=lambda part: part.first)
            if not sum(part.size for part in self._parts):
                raise InputError(f"bag '{self.bag}' has no messages" + (f" ({self._why})" if self._why else ""))
            self._check_topics()
            self.fixed = tuple(dict.fromkeys(self._read_fixed()))
            first, last = min(p.first for p in self._parts), max(p.last for p in self._parts)
            start, end = self._offsets
            self.first = self.time = first if start is None else first + round(start * 1e9)
            self.last = last if end is None else min(last, first + round(end * 1e9))
            if self.first > self.last:
                span = f"from {start or 0:g} s to {'its end' if end is None else f'{end:g} s'}"
                raise InputError(f"bag '{self.bag}' lasts {(last - first) * 1e-9:.3f} s; it has nothing {span}")
            self._opened = opened.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._opened.close()

    def _read_fixed(self) -> Iterator[TransformSample]:
        topic = self._topics.get("tf", "/tf") + "_static"
        decode = decoder("tf_static", ros1=_is_ros1(self.bag))
        for part in self._parts:
            if (topic, TYPES["tf_static"]) in part.topics:
                with suppress(Exception):  # damage: `_messages` finds and reports it
                    for _, _, data in part.messages({topic}, part.first, part.last + 1):
                        yield from decode(bytes(data))  # type: ignore[misc]

    @property
    def damage(self) -> str | None:
        """Where and why reading stopped early, and what was used; None for an intact bag. Complete after the loop."""
        if not self._why:
            return None
        used, seconds = sum(self.counts.values()), (self.time - self.first) * 1e-9
        return f"{self._why}; {used} messages were used, up to {seconds:.3f} s after the start"

    def __iter__(self) -> Iterator[Sample]:
        """The samples in order."""
        decode = [decoder(role, ros1=_is_ros1(self.bag)) for role in _RANK]
        for time, rank, _, data in self._in_order():
            try:
                sample = decode[rank](data)
            except Exception as error:
                self._why = f"a message on {self._topics[_RANK[rank]]} cannot be decoded ({error})"
                return
            self.time = time
            self.counts[_RANK[rank]] += 1
            yield sample

    def _in_order(self) -> Iterator[tuple[int, int, int, bytes]]:
        rank = {topic: _RANK.index(role) for role, topic in self._topics.items()}
        queue: list[tuple[int, int, int, bytes]] = []
        for number, (time, topic, data) in enumerate(self._messages(rank)):
            queue.append((time, rank[topic], number, data))
            if len(queue) >= _TOGETHER and number % _TOGETHER == 0:
                queue.sort()  # almost sorted: faster than a heap
                ready = bisect_left(queue, (queue[-1][0] - _LATEST,))
                yield from queue[:ready]
                del queue[:ready]
        queue.sort()
        yield from queue

    def _messages(self, topics: Collection[str]) -> Iterator[tuple[int, str, bytes]]:
        for part in self._parts:
            try:
                yield from part.messages(topics, self.first, self.last + 1)
            except Exception as error:  # rosbags' parsers raise anything on damage
                self._why = f"{part.name} is damaged: {reason_of(error)}"
                return

    def _open(self, opened: ExitStack) -> Iterator[_Part]:
        """The bag by rosbags; if that fails, file by file, a damaged .mcap file record by record."""
        bag = self.bag
        if not bag.exists():
            raise InputError(f"bag '{bag}' does not exist")
        if bag.is_file() and bag.suffix not in _SUFFIXES:
            suffixes = ", ".join(_SUFFIXES)
            raise InputError(f"'{bag}' is not a bag: give a rosbag2 folder or a file that ends in {suffixes}")
        files = [f for f in sorted(bag.iterdir()) if f.suffix in _SUFFIXES[:2]] if bag.is_dir() else [bag]
        described = not bag.is_dir() or (bag / "metadata.yaml").exists()
        if not files and not described:
            raise InputError(f"folder '{bag}' is not a bag: it has no metadata.yaml and no .mcap or .db3 file")
        try:
            yield _indexed(bag, opened)
            return
        except Exception as error:
            self._why = reason_of(error) if described else "metadata.yaml is missing"
        for file in files:
            try:
                yield _indexed(file, opened)
            except Exception as error:
                self._why = f"{file.name} is damaged: {reason_of(error)}"
                if file.suffix == ".mcap":
                    yield _damaged(file)
                else:
                    self._why += f"; try '{_REPAIRS[file.suffix]}'"

    def _check_topics(self) -> None:
        found: dict[str, list[str]] = {}
        for topic, msgtype in sorted({pair for part in self._parts for pair in part.topics}):
            found.setdefault(topic, []).append(msgtype)
        for role, topic in self._topics.items():
            wanted, types = TYPES[role], found.get(topic)
            if types and types != [wanted]:
                is_ = " and ".join(types)
                raise InputError(f"bag '{self.bag}': {role} topic '{topic}' is {is_}; it must be {wanted}")
            if types or role in self._optional:
                continue
            fits = next((t for t, types in found.items() if types == [wanted]), "TOPIC")
            advice = f"{_INSTEAD.get(role, '')}--remap {'/' if role == 'tf' else '~/'}{role}:={fits}"
            there = ", ".join(f"{topic} ({' and '.join(types)})" for topic, types in found.items())
            raise InputError(f"bag '{self.bag}' has no {role} topic '{topic}' (use {advice}); it has {there}")

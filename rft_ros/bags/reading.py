"""Read rosbag2 (MCAP, SQLite) and ROS 1 bags as samples in the order of their receive times."""

import os
import re
import sqlite3
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack, closing, suppress
from functools import partial
from pathlib import Path
from typing import BinaryIO
from urllib.parse import quote

from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2

from rft_ros.errors import InputError, file_errors, reason_of
from rft_ros.estimator import Sample, Stamped, TransformSample
from rft_ros.estimator.messages import TYPES, Role, decoder

__all__ = ["Recording", "bag_name"]

_RANK: tuple[Role, ...] = ("surface", "wrench", "twist", "pose", "tf")

_LATEST = 100_000_000
"""Greatest delay of a message in its file that is still sorted [ns]; split and damaged bags have such delays."""

_TOGETHER = 256  # messages sorted at a time
_CHUNK_HEAD = 49  # bytes before the records of an uncompressed chunk (https://mcap.dev/spec)
_SUFFIXES = (".mcap", ".db3", ".bag")


def bag_name(bag: Path) -> str:
    """The bag's file name; bytes that are not UTF-8 are escaped, so that it can be printed and written."""
    return os.fsencode(bag.resolve().name).decode(errors="backslashreplace")


class _Indexed:
    """A bag or one file of it that rosbags can open: its topics with types, message count, first and last time [ns]."""

    def __init__(self, path: Path) -> None:
        self.name = path.name
        self._reader = Reader1(path) if path.suffix == ".bag" and path.is_file() else Reader2(path)
        self._reader.open()
        self.topics = {(c.topic, c.msgtype) for c in self._reader.connections}
        self.count = self._reader.message_count
        self.first = self._reader.start_time
        self.last = self._reader.end_time - 1

    def messages(self, topics: Collection[str], start: int, stop: int) -> Iterator[tuple[int, str, bytes]]:
        connections = [c for c in self._reader.connections if c.topic in topics]
        if connections:  # for rosbags, an empty list means all
            for connection, time, data in self._reader.messages(connections, start, stop):
                yield time, connection.topic, data

    def close(self) -> None:
        self._reader.close()


class _Damaged:
    """One .mcap or .db3 file that rosbags cannot open, read from its start to the damage; as `_Indexed`."""

    def __init__(self, file: Path) -> None:
        self.name = file.name
        self._all = partial(_sqlite3 if file.suffix == ".db3" else _mcap, file)
        self.topics: set[tuple[str, str]] = set()
        self.count, self.first, self.last = 0, 2**63 - 1, 0
        with suppress(Exception):  # `messages` raises it again
            for time, topic, msgtype, _ in self._all():
                self.topics.add((topic, msgtype))
                self.count += 1
                self.first, self.last = min(self.first, time), max(self.last, time)

    def messages(self, topics: Collection[str], start: int, stop: int) -> Iterator[tuple[int, str, bytes]]:
        for time, topic, _, data in self._all():
            if topic in topics and start <= time < stop:
                yield time, topic, data

    def close(self) -> None:
        """Do nothing: no file stays open."""


def _mcap(file: Path) -> Iterator[tuple[int, str, str, bytes]]:
    """Receive time [ns], topic, type and content of each message up to the damage."""
    types: dict[int, str] = {}
    channels: dict[int, tuple[str, str]] = {}
    with file.open("rb") as stream:
        for record in _records(stream):
            if isinstance(record, Schema):
                types[record.id] = record.name
            elif isinstance(record, Channel):
                kind, encoding = types.get(record.schema_id, "unknown type"), record.message_encoding
                channels[record.id] = record.topic, kind if encoding == "cdr" else f"{kind} as {encoding}"
            elif isinstance(record, Message):
                yield record.log_time, *channels[record.channel_id], record.data
            elif isinstance(record, DataEnd):
                return


def _records(stream: BinaryIO) -> Iterator[McapRecord]:
    """The records of an MCAP file, those in chunks too; of a cut one that is not compressed, those before the cut."""
    at = stream.tell()
    try:
        try:
            for record in StreamReader(stream, emit_chunks=True).records:
                yield from breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else (record,)
                at = stream.tell()
        except EndOfFile:
            stream.seek(at)
            head = stream.read(_CHUNK_HEAD)
            if head[:1] != bytes([Opcode.CHUNK]) or any(head[37:41]):  # length of the compression's name
                raise
            yield from StreamReader(stream, skip_magic=True).records
    except EndOfFile:
        raise ValueError("the file ends inside a record") from None


def _sqlite3(file: Path) -> Iterator[tuple[int, str, str, bytes]]:
    """As `_mcap`, a message at a time."""
    with closing(sqlite3.connect(f"file:{quote(str(file))}?immutable=1", uri=True)) as database:
        # otherwise sqlite refuses a file that is shorter than its header says
        database.execute("PRAGMA writable_schema = ON")
        topics = {key: (name, msgtype) for key, name, msgtype in database.execute("SELECT id, name, type FROM topics")}
        for key, time, data in database.execute("SELECT topic_id, timestamp, data FROM messages NOT INDEXED"):
            yield time, *topics[key], data


class Recording:
    """The samples of one bag, for use in a `with` block and one `for` loop.

    Memory does not grow with the bag, except for a ROS 1 bag's index, which rosbags keeps.

    `bag`: a rosbag2 folder, or an .mcap, .db3 or ROS 1 .bag file. `topics`: topic of each role; only these are read.
    `start`, `end`: receive time since the bag's first message on any topic [s]. `optional`: roles whose topic may be
    missing.

    Order: receive time (the bag's log time); at equal times surface, wrench, twist, pose, tf; then the order in the
    file.

    Raises InputError for a missing topic, a topic of another type, a path that is not a bag, and a ROS 1
    bag without index. A damaged bag is used up to the damage, which `damage` describes.
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
        self.fixed: tuple[TransformSample, ...] = ()
        """The fixed transforms of the whole bag, from /tf_static."""
        self.time = 0
        """Receive time of the last sample [ns]."""
        self._topics = dict(topics)
        self._offsets = (start, end)
        self._optional = optional
        self._parts: list[_Indexed | _Damaged] = []
        self._why = ""

    def __enter__(self) -> "Recording":
        with file_errors(f"bag '{self.bag}'", "read"), ExitStack() as on_failure:
            on_failure.callback(self._close)
            self._open()
            if not sum(part.count for part in self._parts):
                raise InputError(f"bag '{self.bag}' has no messages" + (f" ({self._why})" if self._why else ""))
            self._check_topics()
            self.fixed = self._read_fixed()
            self._set_span()
            on_failure.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    def _read_fixed(self) -> tuple[TransformSample, ...]:
        topic = self._topics.get("tf", "/tf") + "_static"
        decode = decoder("tf_static", ros1=self._ros1())
        found: list[TransformSample] = []
        for part in self._parts:
            if (topic, TYPES["tf_static"]) in part.topics:
                with suppress(Exception):  # damage: `_messages` finds and reports it
                    for _, _, data in part.messages({topic}, part.first, part.last + 1):
                        sample = decode(bytes(data))
                        assert not isinstance(sample, Stamped)
                        found += sample
        return tuple(dict.fromkeys(found))

    def _ros1(self) -> bool:
        return self.bag.suffix == ".bag" and self.bag.is_file()

    def _set_span(self) -> None:
        first, last = min(p.first for p in self._parts), max(p.last for p in self._parts)
        start, end = self._offsets
        self.first = self.time = first if start is None else first + round(start * 1e9)
        self.last = last if end is None else min(last, first + round(end * 1e9))
        if self.first > self.last:
            span = f"from {start or 0:g} s to {'its end' if end is None else f'{end:g} s'}"
            raise InputError(f"bag '{self.bag}' lasts {(last - first) * 1e-9:.3f} s; it has nothing {span}")

    @property
    def damage(self) -> str | None:
        """Where and why reading stopped early, and what was used; None for an intact bag. Complete after the loop."""
        if not self._why:
            return None
        used, seconds = sum(self.counts.values()), (self.time - self.first) * 1e-9
        return f"{self._why}; {used} messages were used, up to {seconds:.3f} s after the start"

    def __iter__(self) -> Iterator[Sample]:
        """The samples in order."""
        decode: list[Callable[[bytes], Sample]] = [decoder(role, ros1=self._ros1()) for role in _RANK]
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

    def _open(self) -> None:
        """Open the bag with rosbags; if that fails, file by file, and a damaged file record by record."""
        bag = self.bag
        if not bag.exists():
            raise InputError(f"bag '{bag}' does not exist")
        if bag.is_file() and bag.suffix not in _SUFFIXES:
            raise InputError(
                f"'{bag}' is not a bag: give a rosbag2 folder or a file that ends in {', '.join(_SUFFIXES)}"
            )
        files = sorted((f for f in bag.iterdir() if f.suffix in _SUFFIXES[:2]), key=_natural) if bag.is_dir() else [bag]
        if not files and not (bag / "metadata.yaml").exists():
            raise InputError(f"folder '{bag}' is not a bag: it has no metadata.yaml and no .mcap or .db3 file")
        try:
            self._parts = [_Indexed(bag)]
        except Exception as error:
            self._why = reason_of(error)
        if self._why and bag.is_dir() and not (bag / "metadata.yaml").exists():
            self._why = "metadata.yaml is missing"
        for file in files if self._why else []:
            try:
                self._parts.append(_Indexed(file))
            except Exception as error:
                if file.suffix == ".bag":
                    raise InputError(f"bag '{bag}' cannot be read ({reason_of(error)}); try 'rosbag reindex'") from None
                self._why = f"{file.name} is damaged: {reason_of(error)}"
                self._parts.append(_Damaged(file))
                return

    def _close(self) -> None:
        for part in self._parts:
            part.close()
        self._parts = []

    def _check_topics(self) -> None:
        found: dict[str, set[str]] = {}
        for topic, msgtype in sorted(t for part in self._parts for t in part.topics):
            found.setdefault(topic, set()).add(msgtype)
        there = ", ".join(f"{topic} ({' and '.join(sorted(types))})" for topic, types in found.items())
        for role, topic in self._topics.items():
            wanted = TYPES[role]
            if topic not in found:
                fits = next((t for t, types in found.items() if types == {wanted}), "TOPIC")
                advice = f"--remap {'/' if role == 'tf' else '~/'}{role}:={fits}"
                if role == "pose" and TYPES["tf"] in found.get("/tf", ()):
                    advice = f"pose_source: tf, or {advice}"
                if role == "twist":
                    advice = f"twist_source: pose_difference, or {advice}"
                if role not in self._optional:
                    raise InputError(f"bag '{self.bag}' has no {role} topic '{topic}' (use {advice}); it has {there}")
            elif found[topic] != {wanted}:
                is_ = " and ".join(sorted(found[topic]))
                raise InputError(f"bag '{self.bag}': {role} topic '{topic}' is {is_}; it must be {wanted}")


def _natural(file: Path) -> list[str]:
    """Sort key: numbers in a name count by value, so that part 10 of a split bag comes after part 9."""
    return [part.zfill(20) if part.isdigit() else part for part in re.split(r"(\d+)", file.name)]

"""Read rosbag2 (MCAP, SQLite) and ROS 1 bags as samples in the order of their receive times."""

import os
from bisect import bisect_left
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from struct import Struct
from tempfile import TemporaryDirectory
from typing import BinaryIO

from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2

from rft_ros.bags.limits import MOST_BYTES, LimitedPath, LimitError, limited_rosbags, unpacked
from rft_ros.errors import InputError, file_errors, reason_of
from rft_ros.estimator import Sample, TransformSample
from rft_ros.files import checked_file, resolved
from rft_ros.messages import TOPICS, TYPES, UNREADABLE, Role, decoder

__all__ = ["Recording", "bag_name"]

_Reader = Reader1 | Reader2

_RANK: tuple[Role, ...] = ("surface", "wrench", "twist", "pose", "tf")

_INSTEAD: dict[Role, str] = {"pose": "pose_source: tf, or ", "twist": "twist_source: pose_difference, or "}
_REPAIRS = {".db3": "sqlite3 FILE .recover", ".bag": "rosbag reindex"}
_LATEST = 100_000_000  # ns; messages that lie up to this late in their file are put in order, as in split bags
_TOGETHER = 256  # messages sorted at a time
_CHUNK_HEAD = Struct("<BQQQQII8x")
"""The bytes before the records of an uncompressed chunk (https://mcap.dev/spec): opcode, length, start and end time,
uncompressed size, CRC, length of the name of the compression, which is 0, and length of the records.
"""
_SUFFIXES = (".mcap", ".db3", ".bag")
_MOST_METADATA = 2**24  # bytes


def bag_name(bag: Path) -> str:
    """The bag's file name; bytes that are not UTF-8 are escaped, so that it can be printed and written."""
    return os.fsencode(resolved(bag).name).decode(errors="backslashreplace")


def _is_ros1(bag: Path) -> bool:
    return bag.suffix == ".bag" and bag.is_file()


def _opened(path: Path, opened: ExitStack) -> _Reader:
    limited = LimitedPath(path)
    reader = Reader1(limited) if _is_ros1(path) else Reader2(limited)
    reader.open()
    opened.callback(reader.close)
    return reader


def _recover(file: Path, copy: Path, topics: Collection[str]) -> bool:
    """Copy an .mcap file up to its damage: all messages on `topics`, and the first one on any other topic.

    Returns whether the copy is complete. It is if the file is intact, but not of ROS 2 or without an index. Damage
    raises no error. A chunk or a record that is too large raises LimitError, after what comes before it is copied.
    """
    names, channels, complete = {0: "unknown type"}, dict[int, tuple[int, str]](), False
    limit: LimitError | None = None
    met = set[str]()  # topics so far; the first message of all is copied, since the bag's times count from it
    with LimitedPath(file).open("rb") as damaged, copy.open("wb") as whole:
        writer = Writer(whole, compression=CompressionType.NONE)
        writer.start("ros2")
        try:
            for r in _records(damaged):
                if isinstance(r, Schema):
                    names[r.id] = r.name
                elif isinstance(r, Channel) and r.id not in channels:  # each chunk has them again
                    name, encoding = names[r.schema_id], r.message_encoding
                    # without its definition: rosbags refuses a file with any that is not of ROS 2
                    schema = writer.register_schema(name if encoding == "cdr" else f"{name} as {encoding}", "", b"")
                    channels[r.id] = writer.register_channel(r.topic, "cdr", schema), r.topic
                elif isinstance(r, Message):
                    channel, topic = channels[r.channel_id]
                    if topic in topics or topic not in met:
                        met.add(topic)
                        writer.add_message(channel, r.log_time, r.data, r.publish_time)
                elif isinstance(r, DataEnd):
                    complete = True
                    break
        except LimitError as error:
            limit = error
        except Exception:
            pass
        writer.finish()  # type: ignore[no-untyped-call]
    if limit:
        raise limit
    return complete


def _records(stream: BinaryIO) -> Iterator[McapRecord]:
    """The records of an MCAP file, also those in chunks and in an uncompressed last chunk that is cut short."""
    at = 0
    try:
        for record in StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=MOST_BYTES).records:
            if isinstance(record, Chunk):
                content = unpacked(record.data, record.compression, record.uncompressed_size)
                yield from breakup_chunk(replace(record, compression="", data=content), validate_crc=True)
            else:
                yield record
            at = stream.tell()
    except EndOfFile:
        stream.seek(at)
        head = stream.read(_CHUNK_HEAD.size)
        if len(head) < _CHUNK_HEAD.size:
            return
        opcode, _, _, _, _, _, length_of_compression = _CHUNK_HEAD.unpack(head)
        if opcode == Opcode.CHUNK and length_of_compression == 0:
            yield from StreamReader(stream, skip_magic=True, record_size_limit=MOST_BYTES).records


class Recording:
    """The samples of one bag, for use in a `with` block and one `for` loop; memory does not grow with the bag.

    `topics`: topic of each role; only these are read. `start`, `end`: receive time since the bag's first message on any
    topic [s]. `optional`: roles whose topic may be missing. Order: receive time (the bag's log time); at equal times
    surface, wrench, twist, pose, tf; then the file's.

    Raises InputError for a missing topic, one of another type, and a path that is not a bag. A damaged bag is used up
    to the damage, which `damage` describes; messages that cannot be decoded are counted in `unreadable`.
    """

    def __init__(
        self,
        bag: Path,
        topics: Mapping[Role, str],
        *,
        start: float | None = None,
        end: float | None = None,
        optional: Collection[Role] = frozenset[Role]({"wrench", "surface"}),
        refuse_types: bool = True,
    ) -> None:
        self.bag = bag
        self.mistyped: dict[Role, str] = {}  # without `refuse_types`: a sentence on each topic of another type
        self.counts: Counter[Role] = Counter()
        self.fixed: tuple[TransformSample, ...] = ()  # of the whole bag, from /tf_static
        self.time = 0  # receive time of the last sample [ns]
        self.unreadable = 0
        self._topics = dict(topics)
        self._offsets = (start, end)
        self._optional = optional
        self._refuse_types = refuse_types
        self._readers: list[_Reader] = []
        self._why = ""

    def __enter__(self) -> "Recording":
        with file_errors(f"bag '{self.bag}'", "read"), ExitStack() as opened:
            opened.enter_context(limited_rosbags())
            self._readers = sorted(self._open(opened), key=lambda reader: reader.start_time)
            if not sum(reader.message_count for reader in self._readers):
                raise InputError(f"bag '{self.bag}' has no messages" + (f" ({self._why})" if self._why else ""))
            self._check_topics()
            self.fixed = tuple(dict.fromkeys(self._read_fixed()))
            first, last = self._readers[0].start_time, max(reader.end_time for reader in self._readers) - 1
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
        topic, decode = self._topics.get("tf", "/tf") + "_static", decoder("tf_static", ros1=_is_ros1(self.bag))
        for reader in self._readers:
            chosen = [c for c in reader.connections if (c.topic, c.msgtype) == (topic, TYPES["tf_static"])]
            with suppress(Exception):  # damage, which `_messages` reports
                for _, _, data in reader.messages(chosen) if chosen else ():
                    try:
                        yield from decode(bytes(data))  # type: ignore[misc]
                    except UNREADABLE as error:
                        self._leave_out(topic, error)

    def _leave_out(self, topic: str, error: Exception) -> None:
        self._why = self._why or f"a message on {topic} cannot be decoded ({error})"
        self.unreadable += 1

    @property
    def damage(self) -> str | None:
        """What is wrong with the bag, and what was used; None for an intact one. Complete after the loop."""
        if not self._why:
            return None
        used, seconds = sum(self.counts.values()), (self.time - self.first) * 1e-9
        return f"{self._why}; {used} messages were used, up to {seconds:.3f} s after the start"

    def __iter__(self) -> Iterator[Sample]:
        """The samples in order, after the fixed transforms of the whole bag."""
        if self.fixed:
            yield self.fixed
        decode = [decoder(role, ros1=_is_ros1(self.bag)) for role in _RANK]
        for time, rank, _, data in self._in_order():
            try:
                sample = decode[rank](data)
            except UNREADABLE as error:
                self._leave_out(self._topics[_RANK[rank]], error)
                continue
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
        for reader in self._readers:
            chosen = [c for c in reader.connections if c.topic in topics]
            missing, damaged = sum(c.msgcount for c in chosen), f"{Path(str(reader.path)).name} is damaged"
            try:
                # rosbags reads all topics if it is given none
                for connection, time, data in reader.messages(chosen, self.first, self.last + 1) if chosen else ():
                    yield time, connection.topic, data
                    missing -= 1
            except Exception as error:  # rosbags' parsers raise anything on damage
                self._why = f"{damaged}: {reason_of(error)}"
                return
            if missing > 0 and self._offsets == (None, None):  # rosbags skips messages that it cannot find in a chunk
                self._why = f"{damaged}: {missing} of its messages are missing"

    def _open(self, opened: ExitStack) -> Iterator[_Reader]:
        """Open the bag by rosbags. If that fails, its files one by one, up to the damage of the first damaged one."""
        bag, described = self.bag, (self.bag / "metadata.yaml").exists()
        bag.stat()  # raises FileNotFoundError
        inside, suffixes = ([*bag.iterdir()], _SUFFIXES[:2]) if bag.is_dir() else ([bag], _SUFFIXES)
        for file in inside:
            named = bag.is_dir() or file.suffix in suffixes
            if named and file.exists() and not (file.is_file() or file.is_dir()):
                checked_file(file, "bag")  # raises: to read a pipe or a device may block
        if described and (bag / "metadata.yaml").stat().st_size > _MOST_METADATA:
            checked_file(bag / "metadata.yaml", "bag", limit=_MOST_METADATA)
        files = [file for file in inside if file.suffix in suffixes and file.is_file()]
        files.sort(key=lambda file: (len(file.name), file.name))  # part 10 of a split bag comes after part 9
        if not (files or described):
            known = ", ".join(_SUFFIXES)
            raise InputError(f"'{bag}' is not a bag: give a rosbag2 folder or a file that ends in {known}")
        if bag.is_dir():
            try:
                yield _opened(bag, opened)
                return
            except Exception as error:
                why = reason_of(error) if described else "it is missing"
                self._why = f"its files were read one by one, without metadata.yaml: {why}"
        for file in files:
            try:
                yield _opened(file, opened)
            except Exception as error:
                why = f"{file.name} is damaged: {reason_of(error)}"
                if file.suffix != ".mcap":
                    self._why = f"{why}; try '{_REPAIRS[file.suffix]}'"
                    return
                copy = Path(opened.enter_context(TemporaryDirectory())) / file.name
                complete = False
                try:
                    complete = _recover(file, copy, {*self._topics.values(), self._topics.get("tf", "/tf") + "_static"})
                except LimitError as limit:
                    why = f"{file.name} is damaged: {limit}"
                yield _opened(copy, opened)
                if not complete:
                    self._why = why
                    return

    def _check_topics(self) -> None:
        found: dict[str, list[str]] = {}
        for topic, msgtype in sorted({(c.topic, c.msgtype) for reader in self._readers for c in reader.connections}):
            found.setdefault(topic, []).append(msgtype)
        for role, topic in list(self._topics.items()):
            wanted, types = TYPES[role], found.get(topic, [])
            if types == [wanted] or (not types and role in self._optional):
                continue
            fault = f" has no {role} topic '{topic}'"
            if types:
                is_not = f"is {' and '.join(types)}; it must be {wanted}"
                if not self._refuse_types:
                    self.mistyped[role] = f"{topic} {is_not}"
                    del self._topics[role]
                    continue
                fault = f": {role} topic '{topic}' {is_not}"
            fits = next((t for t, types in found.items() if types == [wanted]), "TOPIC")
            advice = f"{_INSTEAD.get(role, '')}--remap {TOPICS[role]}:={fits}"
            there = ", ".join(f"{topic} ({' and '.join(types)})" for topic, types in found.items())
            raise InputError(f"bag '{self.bag}'{fault} (use {advice}); it has {there}")

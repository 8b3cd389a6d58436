"""The files of a bag as sources of messages: each is opened on its own, so that damage to one leaves the others intact.

A file compressed by zstd is unpacked, what SQLite left beside a .db3 file is merged into it, and an .mcap file that
rosbags cannot open is read record by record, up to its damage.
"""

import shutil
import sqlite3
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from struct import Struct
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO

from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2

from rft_ros.bags.limits import MOST_BYTES, LimitedPath, LimitError, unpack, unpacked
from rft_ros.errors import InputError, reason_of
from rft_ros.files import checked_file, read_yaml

__all__ = ["SUFFIXES", "Messages", "Source", "sources_of"]

SUFFIXES = (".mcap", ".db3", ".bag")
_PACKED = (".zstd", ".zst")
_ZSTD = b"\x28\xb5\x2f\xfd"
"""The first bytes of what zstd compressed; CDR begins otherwise."""
_REPAIRS = {".db3": "sqlite3 FILE .recover", ".bag": "rosbag reindex"}
_FOREVER = 2**63 - 2  # ns
_CHUNK_HEAD = Struct("<BQQQQII8x")
"""The bytes before the records of an uncompressed chunk (https://mcap.dev/spec): opcode, length, start and end time,
uncompressed size, CRC, length of the name of the compression, which is 0, and length of the records.
"""

Messages = Iterator[tuple[int, str, Any]]
"""Receive time [ns], topic, and a serialised message, or the sample itself."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Source:
    """A file with messages.

    `types`: the pairs of a topic and its type. `count`, `first`, `last`: number of messages on all topics, and receive
    times of the first and the last one [ns]. `read`: the messages on some topics, from one receive time to another,
    both included; raises an exception at damage, after what comes before it. `ros1`: whether it is a bag of ROS 1.
    """

    name: str
    types: Collection[tuple[str, str]]
    count: int
    first: int
    last: int
    read: Callable[[Collection[str], int, int], Messages]
    ros1: bool = False


def sources_of(bag: Path, opened: ExitStack) -> tuple[list[Source], list[str]]:
    """The sources of a bag that can be opened, until `opened` is closed; and a sentence on each fault.

    Raises InputError for a path that is not a bag.
    """
    files, faults = _files_of(bag)
    found = []
    for file in files:
        source, fault = _source(file, opened)
        found += [source] if source else []
        faults += [f"{file.name} is damaged: {fault}"] if fault else []
    return found, faults


def _files_of(bag: Path) -> tuple[list[Path], list[str]]:
    """The files of a bag: those that its metadata.yaml names, or else all in its folder; and what is wrong with it."""
    bag.stat()  # raises FileNotFoundError
    inside = [*bag.iterdir()] if bag.is_dir() else [bag]
    files = {file.name: file for file in inside if _kind(file) in SUFFIXES}
    about = bag / "metadata.yaml"
    for file in (*files.values(), about):
        if file.exists() and not (file.is_file() or file.is_dir()):
            checked_file(file, "bag")  # raises: to read a pipe or a device may block
    if not (files or about.exists()):
        known = ", ".join(SUFFIXES)
        raise InputError(f"'{bag}' is not a bag: give a rosbag2 folder, a file that ends in {known}, or a .csv table")
    if not bag.is_dir():
        return [bag], []
    try:
        names = read_yaml(about, "metadata")["rosbag2_bagfile_information"]["relative_file_paths"]
        described = [bag / Path(name).name for name in names]
    except (InputError, LookupError, TypeError) as error:
        why = reason_of(error) if about.exists() else "it is missing"
        plain = [f for f in files.values() if f.is_file() and f.name.removesuffix(f.suffix) not in files]
        return plain, [f"its files were read one by one, without metadata.yaml: {why}"]
    missing = [f"{file.name} is missing" for file in described if not file.is_file()]
    return [file for file in described if file.is_file()], missing


def _kind(file: Path) -> str:
    """The suffix of a file once it is unpacked."""
    return Path(file.stem).suffix if file.suffix in _PACKED else file.suffix


def _source(file: Path, opened: ExitStack) -> tuple[Source | None, str]:
    """Open a file. Returns its source, unless there is nothing to be read, and its fault, if any."""
    kind, name = _kind(file), file.name
    try:
        if file.suffix in _PACKED:
            copy = _scratch(opened) / file.stem
            unpack(file, copy)
            file = copy
        if kind == ".db3":
            file = _merged(file, opened)
        return _opened(file, name, opened), ""
    except Exception as error:  # parsers raise anything on damage
        fault = reason_of(error)
    if kind != ".mcap" or not file.name.endswith(kind):
        return None, f"{fault}; try '{_REPAIRS[kind]}'" if kind in _REPAIRS else fault
    return _recovered(file, name, fault)


def _scratch(opened: ExitStack) -> Path:
    return Path(opened.enter_context(TemporaryDirectory()))


def _merged(file: Path, opened: ExitStack) -> Path:
    """The file, or a copy with what a recorder that was killed left in the log or the journal beside it."""
    beside = [log for log in (Path(f"{file}-wal"), Path(f"{file}-journal")) if log.is_file() and log.stat().st_size]
    if not beside:
        return file
    folder = _scratch(opened)
    for part in (file, *beside):
        shutil.copyfile(part, folder / part.name)
    with suppress(sqlite3.Error), closing(sqlite3.connect(folder / file.name)) as database:
        database.execute("PRAGMA journal_mode = DELETE")  # rosbags opens files without their logs
    return folder / file.name


def _opened(file: Path, name: str, opened: ExitStack) -> Source:
    """Open a file by rosbags."""
    limited, ros1 = LimitedPath(file), file.suffix == ".bag"
    reader = Reader1(limited) if ros1 else Reader2(limited)
    reader.open()
    opened.callback(reader.close)
    first, last = reader.start_time, reader.end_time - 1
    if not (isinstance(first, int) and isinstance(last, int)):
        raise ValueError("it has times that are not whole numbers")
    last = last if last >= first else _FOREVER  # for SQLite any text is later than any number
    types = {
        (str(c.topic), _type(c.msgtype, getattr(c.ext, "serialization_format", "cdr"))) for c in reader.connections
    }

    def read(topics: Collection[str], begin: int, end: int) -> Messages:
        chosen = [c for c in reader.connections if c.topic in topics]
        missing = sum(c.msgcount for c in chosen)
        # rosbags reads all topics if it is given none
        for connection, time, data in reader.messages(chosen, begin, end + 1) if chosen else ():
            if not isinstance(time, int):
                continue
            missing -= 1
            if not isinstance(data, bytes):  # SQLite keeps anything in any column
                yield time, connection.topic, str(data).encode()
            elif data[:4] == _ZSTD:
                yield time, connection.topic, unpacked(data, "zstd", what="a message")
            else:
                yield time, connection.topic, data
        if missing > 0 and begin <= first and last <= end:  # rosbags skips what it cannot find in a chunk
            raise ValueError(f"{missing} of its messages are missing")

    return Source(name=name, types=types, count=reader.message_count, first=first, last=last, read=read, ros1=ros1)


def _type(name: str, encoding: str) -> str:
    return name if encoding in ("cdr", "") else f"{name} as {encoding}"


def _recovered(file: Path, name: str, fault: str) -> tuple[Source | None, str]:
    """The messages of an .mcap file up to its damage. It may be intact, but not of ROS 2 or without an index."""
    types = dict[str, str]()
    count, first, last = 0, _FOREVER, 0
    try:
        for topic, kind, message in _messages(file):
            types[topic], count = kind, count + 1
            first, last = min(first, message.log_time), max(last, message.log_time)
        fault = ""
    except LimitError as limit:
        fault = str(limit)
    except Exception:
        pass  # the reason why it could not be opened says more

    def read(topics: Collection[str], begin: int, end: int) -> Messages:
        with suppress(Exception):
            for topic, _, message in _messages(file):
                if topic in topics and begin <= message.log_time <= end:
                    yield message.log_time, topic, message.data

    found = Source(name=name, types=[*types.items()], count=count, first=first, last=last, read=read)
    return found if count else None, fault


def _messages(file: Path) -> Iterator[tuple[str, str, Message]]:
    """Topic, type and message of each message of an .mcap file. Raises an exception at damage."""
    names, channels = {0: "unknown type"}, dict[int, tuple[str, str]]()
    with LimitedPath(file).open("rb") as stream:
        for record in _records(stream):
            if isinstance(record, Schema):
                names[record.id] = record.name
            elif isinstance(record, Channel):
                channels[record.id] = record.topic, _type(names[record.schema_id], record.message_encoding)
            elif isinstance(record, Message):
                yield *channels[record.channel_id], record
            elif isinstance(record, DataEnd):
                return
    raise EndOfFile


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

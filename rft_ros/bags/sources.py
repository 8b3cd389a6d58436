"""The files of a bag as sources of messages: each is opened on its own, so that damage to one leaves the others intact.

A file compressed by zstd is unpacked. A file without a readable index is left out, and any other is read up to its
damage. Tools that repair a bag are named, not imitated.
"""

import io
import shutil
import sqlite3
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path, PosixPath
from tempfile import TemporaryDirectory
from typing import Any

import zstandard
from mcap.exceptions import McapError
from mcap.reader import make_reader
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import ReaderError as ReaderError1
from rosbags.rosbag2 import Reader as Reader2
from rosbags.rosbag2 import ReaderError as ReaderError2

from rft_ros.bags.writing import read_metadata
from rft_ros.errors import InputError, reason_of
from rft_ros.files import checked_file

_REPAIRS = {".mcap": "mcap recover", ".db3": "sqlite3 FILE .recover", ".bag": "rosbag reindex"}
_PACKED_SUFFIXES = (".zstd", ".zst")
_ZSTD = b"\x28\xb5\x2f\xfd"
"""The first bytes of what zstd compressed; CDR begins otherwise."""

_MAX_LINE_BYTES = 20  # a bag of ROS 1 has one line, its first

Messages = Iterator[tuple[int, str, bytes]]
"""Receive time [ns], topic, and a serialised message."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Source:
    """A file with messages.

    `types`: the pairs of a topic and its type. `count`, `first`, `last`: number of messages on all topics, and receive
    times of the first and the last one [ns]. `read`: the messages on some topics, from one receive time to another,
    both included; raises an exception at damage, after what comes before it. `ros1`: whether it is a bag of ROS 1.
    `shift`: how much later the stamps are than the times in a table [ns].
    """

    name: str
    types: Collection[tuple[str, str]]
    count: int
    first: int
    last: int
    read: Callable[[Collection[str], int, int], Messages]
    ros1: bool = False
    shift: int = 0


class DamagedError(Exception):
    """A file that cannot be intact; says why."""


# others, such as that of struct for a length of 2**63, speak of Python
_IN_WORDS = (
    DamagedError,
    McapError,
    OSError,
    ReaderError1,
    ReaderError2,
    sqlite3.Error,
    zstandard.ZstdError,
)
_MALFORMED = "a length or number in it is impossible, or it ends early"


def fault_of(name: str, error: Exception) -> str:
    """A sentence on a damaged file: what stopped its parser, and the tool that repairs it."""
    is_sentence = isinstance(error, _IN_WORDS) and str(error)
    reason = reason_of(error) if is_sentence else _MALFORMED
    return f"{name} is damaged: {reason}; try '{_REPAIRS[_kind(Path(name))]}'"


def sources_of(bag: Path, stack: ExitStack) -> tuple[list[Source], list[str]]:
    """The sources of a bag that can be opened, until `stack` is closed; and a sentence on each fault.

    Raises InputError for a path that is not a bag.
    """
    files, faults = _files_of(bag)
    sources = []
    for file in files:
        try:
            sources.append(_opened(file, stack))
        except InputError as error:
            faults.append(str(error))
        except Exception as error:  # parsers raise anything on damage
            faults.append(fault_of(file.name, error))
    return sources, faults


def _files_of(bag: Path) -> tuple[list[Path], list[str]]:
    """The files of a bag: those that its metadata.yaml names, or else all in its folder; and what is wrong with it."""
    bag.stat()  # raises FileNotFoundError
    if bag.is_dir():
        try:
            names = read_metadata(bag)["relative_file_paths"]
            return [bag / Path(name).name for name in names], []
        except (InputError, LookupError, TypeError) as error:
            fault = "its files were read one by one, without a metadata.yaml that can be used"
            faults = [f"{fault} ({reason_of(error)}); 'ros2 bag reindex' writes it"]
            files = sorted(file for file in bag.iterdir() if _kind(file) in _REPAIRS)
    else:
        faults = []
        files = [bag] if _kind(bag) in _REPAIRS else []
    if not files:
        suffixes = ", ".join(_REPAIRS)
        raise InputError(
            f"'{bag}' is not a bag: give a rosbag2 folder, a file that ends in {suffixes}, or a .csv table"
        )
    return files, faults


def _kind(file: Path) -> str:
    """The suffix of a file once it is unpacked."""
    return Path(file.stem).suffix if file.suffix in _PACKED_SUFFIXES else file.suffix


def _opened(file: Path, stack: ExitStack) -> Source:
    """Open a file. Raises any exception at damage, and InputError for what is no file."""
    intact = _unpacked(checked_file(file, "bag file", limit=None), stack)
    journals = [
        log
        for log in (f"{file.name}-wal", f"{file.name}-journal")
        if (file.parent / log).is_file()
    ]
    if journals:
        raise InputError(
            f"{file.name} was not closed by its recorder: {journals[0]} has a part of it; "
            f"'sqlite3 {file.name} .schema' merges it"
        )
    try:
        return _by_rosbags(file.name, intact, stack)
    except Exception:
        if intact.suffix != ".mcap":
            raise
    return _by_index(file.name, intact, stack)


def _by_index(name: str, file: Path, stack: ExitStack) -> Source:
    """An .mcap file of another recorder than that of ROS 2: rosbags refuses other profiles and schemas."""
    stream = stack.enter_context(_Bounded(file).open())
    reader = make_reader(stream, validate_crcs=True)
    summary = reader.get_summary()
    if summary is None or summary.statistics is None:
        raise DamagedError("it has no index")
    types = set()
    for channel in summary.channels.values():
        schema = summary.schemas.get(channel.schema_id)
        kind = schema.name if schema else "unknown type"
        types.add((channel.topic, _type(kind, channel.message_encoding)))

    def read(topics: Collection[str], begin: int, end: int) -> Messages:
        for _, channel, message in reader.iter_messages(topics):
            if begin <= message.log_time <= end:
                yield message.log_time, channel.topic, message.data

    return Source(
        name=name,
        types=types,
        count=summary.statistics.message_count,
        first=summary.statistics.message_start_time,
        last=summary.statistics.message_end_time,
        read=read,
    )


def _by_rosbags(name: str, file: Path, stack: ExitStack) -> Source:
    ros1 = file.suffix == ".bag"
    reader = Reader1(_Bounded(file)) if ros1 else Reader2(_Bounded(file))
    reader.open()
    stack.callback(reader.close)
    first = int(reader.start_time)
    last = int(reader.end_time) - 1
    if reader.message_count and last < first:
        raise DamagedError("its last message is older than its first")
    types = set()
    for connection in reader.connections:
        encoding = getattr(connection.ext, "serialization_format", "cdr")
        types.add((str(connection.topic), _type(connection.msgtype, encoding)))

    def read(topics: Collection[str], begin: int, end: int) -> Messages:
        connections = [
            connection for connection in reader.connections if connection.topic in topics
        ]
        if not connections:  # of which rosbags would read all
            return
        for connection, time, content in reader.messages(connections, begin, end + 1):
            data = bytes(content)  # SQLite keeps anything in any column
            if data[:4] == _ZSTD:
                data = zstandard.ZstdDecompressor().decompressobj().decompress(data)
            yield int(time), connection.topic, data

    return Source(
        name=name,
        types=types,
        count=reader.message_count,
        first=first,
        last=last,
        read=read,
        ros1=ros1,
    )


class _Bounded(PosixPath):
    """A path whose file is opened as a `_Stream`."""

    def open(self, *_: Any, **__: Any) -> Any:
        return _Stream(self)


class _Stream(io.BufferedReader):
    """A file that gives no more than it has: rosbags would allocate any length that a damaged record announces."""

    def __init__(self, file: Path) -> None:
        super().__init__(io.FileIO(file))
        self._size = file.stat().st_size

    def read(self, size: int | None = -1, /) -> bytes:
        return super().read(-1 if size is None else min(size, self._size))

    def readline(self, _: int | None = -1, /) -> bytes:
        return super().readline(_MAX_LINE_BYTES)


def _unpacked(file: Path, stack: ExitStack) -> Path:
    """The file, or an unpacked copy."""
    if file.suffix not in _PACKED_SUFFIXES:
        return file
    copy = Path(stack.enter_context(TemporaryDirectory())) / file.stem
    with file.open("rb") as packed_file, copy.open("wb") as out:
        stream = zstandard.ZstdDecompressor().stream_reader(packed_file, read_across_frames=True)
        shutil.copyfileobj(stream, out)
    return copy


def _type(name: str, encoding: str) -> str:
    return name if encoding in ("cdr", "") else f"{name} as {encoding}"

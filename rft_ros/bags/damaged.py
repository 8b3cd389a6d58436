"""Truncated or corrupt MCAP and SQLite files, which rosbags cannot open: read from the start up to the damage."""

import mmap
import sqlite3
import struct
import sys
from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path
from urllib.parse import quote
from zlib import crc32

import lz4.frame  # type: ignore[import-untyped]

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

__all__ = ["DamagedFile"]

_Message = tuple[int, str, str, bytes]  # receive time [ns], topic, type, serialised message

_CUT = "the file ends inside a record"


class DamagedFile:
    """One .mcap or .db3 file, read record by record; a first pass finds its topics, message count and times."""

    def __init__(self, file: Path) -> None:
        self.name = file.name
        self._file = file
        self.topics: set[tuple[str, str]] = set()
        self.count = 0
        self.first = 2**63 - 1
        self.last = 0
        try:
            for time, topic, msgtype, _ in self._all():
                self.topics.add((topic, msgtype))
                self.count += 1
                self.first, self.last = min(self.first, time), max(self.last, time)
        except ValueError:  # `messages` raises it again
            pass

    def messages(self, topics: Collection[str], start: int, stop: int) -> Iterator[tuple[int, str, bytes]]:
        """Receive time in [start, stop) [ns], topic and content, in the file's order; ValueError at the damage."""
        for time, topic, _, data in self._all():
            if topic in topics and start <= time < stop:
                yield time, topic, data

    def close(self) -> None:
        """Do nothing: no file stays open."""

    def _all(self) -> Iterator[_Message]:
        try:
            if self._file.suffix == ".db3":
                yield from _sqlite3(self._file)
                return
            with self._file.open("rb") as stream:
                data = memoryview(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))
            if bytes(data[:8]) != b"\x89MCAP0\r\n":
                raise ValueError("it does not start with the MCAP signature")
            yield from _mcap_records(data[8:], {}, {})
        except (struct.error, LookupError) as error:
            raise ValueError(f"a record is malformed ({error})") from None
        except (zstd.ZstdError, RuntimeError, OSError, EOFError, sqlite3.Error) as error:
            raise ValueError(str(error)) from None


def _mcap_records(
    data: memoryview, schemas: dict[int, str], channels: dict[int, tuple[str, str]]
) -> Iterator[_Message]:
    """The messages of a file or chunk (https://mcap.dev/spec); fills `schemas` and `channels` by id."""
    at = 0
    while at < len(data):
        op, length = struct.unpack_from("<BQ", data, at) if len(data) - at >= 9 else (0, len(data))
        body = data[at + 9 : at + 9 + length]
        if op == 0x06:
            yield from _mcap_records(_mcap_chunk(body), schemas, channels)
        if len(body) < length:
            raise ValueError(_CUT)
        if op == 0x03:
            key, size = struct.unpack_from("<HI", body)
            schemas[key] = str(body[6 : 6 + size], "utf-8")
        elif op == 0x04:
            key, schema, size = struct.unpack_from("<HHI", body)
            (encoding,) = struct.unpack_from("<I", body, 8 + size)
            encoded = str(body[12 + size : 12 + size + encoding], "utf-8")
            msgtype = schemas.get(schema, "unknown type")
            channels[key] = str(body[8 : 8 + size], "utf-8"), msgtype if encoded == "cdr" else f"{msgtype} as {encoded}"
        elif op == 0x05:
            key, _, time = struct.unpack_from("<HIQ", body)
            yield time, *channels[key], bytes(body[22:])
        elif op in (0x02, 0x0F):  # footer, end of data: an index follows
            return
        at += 9 + length


def _mcap_chunk(body: memoryview) -> memoryview:
    """A chunk's records, decompressed; of a truncated chunk those before the cut."""
    if len(body) < 40:
        raise ValueError(_CUT)
    _, _, size, crc, length = struct.unpack_from("<QQQII", body)
    compression = str(body[32 : 32 + length], "utf-8")
    packed = body[40 + length :]
    if compression == "zstd":
        packed = memoryview(zstd.ZstdDecompressor().decompress(packed))
    elif compression == "lz4":
        packed = memoryview(lz4.frame.LZ4FrameDecompressor().decompress(packed))
    elif compression:
        raise ValueError(f"its chunks are compressed with '{compression}'")
    if crc and len(packed) == size and crc32(packed) != crc:
        raise ValueError("a chunk has the wrong checksum")
    return packed


def _sqlite3(file: Path) -> Iterator[_Message]:
    with closing(sqlite3.connect(f"file:{quote(str(file))}?immutable=1", uri=True)) as database:
        # otherwise sqlite refuses a file that is shorter than its header says
        database.execute("PRAGMA writable_schema = ON")
        topics = {key: (name, msgtype) for key, name, msgtype in database.execute("SELECT id, name, type FROM topics")}
        for key, time, data in database.execute("SELECT topic_id, timestamp, data FROM messages NOT INDEXED"):
            yield time, *topics[key], data

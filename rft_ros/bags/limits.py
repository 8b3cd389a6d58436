"""Limits on reading bags. rosbags and mcap allocate the lengths that a damaged file gives, and unpack to any size.

With the import of this module the readers of rosbags unpack no more than the limits, in the whole process.
"""

import io
from bz2 import BZ2Decompressor
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import zstandard
from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]
from rosbags.rosbag1 import reader as rosbag1
from rosbags.rosbag2 import storage_mcap

__all__ = ["MOST_BYTES", "LimitError", "LimitedPath", "unpack", "unpacked"]

MOST_BYTES = 256 * 2**20
"""Greatest size of a record or a chunk. Recorders write chunks of up to some MiB."""

_LONGEST_LINE = 2**12
_DENSEST = 100
"""Greatest size of an unpacked file over that of the packed one. Recordings are packed to a tenth at best."""


class LimitError(ValueError):
    """A record or chunk is over the limit, or damaged. The message is the rest of a sentence about the file."""


class LimitedPath(type(Path())):  # type: ignore[misc]
    """A path whose binary file reads at most `MOST_BYTES` at once, for readers that do not check a damaged length."""

    def open(self, mode: str = "r", *arguments: Any, **options: Any) -> Any:
        """As `Path.open`."""
        return _LimitedFile(io.FileIO(self)) if mode == "rb" else super().open(mode, *arguments, **options)


class _LimitedFile(io.BufferedReader):
    """Raises LimitError where a read would be longer than the limit."""

    def read(self, size: int | None = -1, /) -> bytes:
        most = MOST_BYTES + 1
        data = super().read(most if size is None or size < 0 else min(size, most))
        if len(data) > MOST_BYTES:
            raise LimitError(f"a record has more than the limit of {MOST_BYTES / 2**20:.0f} MiB")
        if size == 1 and data == b"\0":  # the type of an MCAP record; gigabytes of zeros would be read as empty records
            raise LimitError("a record has the type 0, as in a part that is filled with zeros")
        return data

    def readline(self, size: int | None = -1, /) -> bytes:  # noqa: ARG002 - only the first line is read so
        return super().readline(_LONGEST_LINE)


def unpacked(data: bytes, compression: str, size: int | None = None, *, what: str = "a chunk") -> bytes:
    """The content of a chunk, or of `what`, compressed by lz4, bz2, zstd or none ("").

    Raises LimitError if the content is over the limit, or if its length is not `size`. No more than the limit is
    unpacked, whatever length the chunk gives.
    """
    most = (MOST_BYTES if size is None else min(size, MOST_BYTES)) + 1
    if compression == "lz4":
        content = LZ4FrameDecompressor().decompress(data, max_length=most)
    elif compression == "bz2":
        content = BZ2Decompressor().decompress(data, max_length=most)
    elif compression == "zstd":
        with zstandard.ZstdDecompressor().stream_reader(io.BytesIO(data), read_across_frames=True) as stream:
            content = stream.read(most)
    elif compression in ("", "none"):
        content = data
    else:
        raise LimitError(f"{what} is compressed by '{compression[:40]}'; record it with zstd, lz4 or none")
    larger = max(len(content), size or 0)
    if larger > MOST_BYTES:
        limit = f"the limit is {MOST_BYTES / 2**20:.0f} MiB; record with smaller chunks"
        raise LimitError(f"{what} unpacks to {larger / 2**20:.0f} MiB or more; {limit}")
    if size is not None and len(content) != size:
        raise LimitError(f"{what} does not have the {size:,} bytes that it declares")
    return bytes(content)


def unpack(file: Path, copy: Path) -> None:
    """Unpack a file compressed by zstd, up to its damage. Raises LimitError where it is too large."""
    most = max(MOST_BYTES, _DENSEST * file.stat().st_size)
    with file.open("rb") as packed, copy.open("wb") as out, suppress(zstandard.ZstdError):
        stream = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
        while content := stream.read(2**20):
            out.write(content)
            if out.tell() > most:
                raise LimitError(
                    f"a compressed file unpacks to {most / 2**20:.0f} MiB or more, over {_DENSEST} times its size;"
                    " unpack it by 'unzstd' if it is right"
                )


def _limited(compression: str) -> Callable[..., bytes]:
    return lambda data, size=None: unpacked(data, compression, size)


# rosbags has no option for a limit, but takes the decompressor of every chunk from these two tables.
for _names, _kinds in ((storage_mcap.DECOMPRESSORS, ("lz4", "zstd")), (rosbag1.decompressors, ("lz4", "bz2"))):
    for _kind in _kinds:
        if _kind not in _names:
            raise RuntimeError(f"rosbags has no decompressor '{_kind}' any more, by which its memory is limited")
        _names[_kind] = _limited(_kind)

"""Bags that unpack to far more than their size on disk."""

import struct
from pathlib import Path

import zstandard


def chunk_bomb(
    file: Path,
    *,
    size: int = 900 * 2**20,
    says: int | None = None,
    compression: str = "zstd",
    streamed: bool = False,
) -> None:
    """An MCAP file with one chunk that unpacks to `size` bytes and says `says`, without an index."""
    compressor = zstandard.ZstdCompressor(level=1).compressobj(size=-1 if streamed else size)
    data = b"".join(compressor.compress(bytes(2**20)) for _ in range(size // 2**20)) + compressor.flush()
    name = compression.encode()
    head = struct.pack("<QQQI", 1, 2, says or size, 0) + struct.pack("<I", len(name)) + name
    chunk = head + struct.pack("<Q", len(data)) + data
    magic = b"\x89MCAP0\r\n"
    records = [
        (1, struct.pack("<I4sI", 4, b"ros2", 0)),
        (6, chunk),
        (15, struct.pack("<I", 0)),
        (2, struct.pack("<QQI", 0, 0, 0)),
    ]
    file.write_bytes(magic + b"".join(struct.pack("<BQ", op, len(r)) + r for op, r in records) + magic)

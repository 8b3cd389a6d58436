"""Writes files whole or not at all, and recognises damaged ones by a checksum in front of their content."""

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["replacing", "with_checksum", "without_checksum"]

_CHECKSUM = hashlib.sha256
_LENGTH = _CHECKSUM().digest_size


@contextmanager
def replacing(file: Path) -> Iterator[Path]:
    """Yield a path beside `file`, to be written; at the end of the block this new file takes the place of `file`.

    No process ever reads half a file. After an exception `file` stays as it was. Makes the folder. The part is created
    anew and follows no link, also in a folder that others may write. Raises OSError.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_name(f".{file.stem}.{os.getpid()}.part{file.suffix}")
    part.unlink(missing_ok=True)  # of a process that was killed
    os.close(os.open(part, os.O_CREAT | os.O_EXCL | os.O_WRONLY | getattr(os, "O_NOFOLLOW", 0), 0o666))
    try:
        yield part
        part.replace(file)
    finally:
        part.unlink(missing_ok=True)


def with_checksum(content: bytes) -> bytes:
    """The content of a file, with its checksum in front."""
    return _CHECKSUM(content).digest() + content


def without_checksum(data: bytes) -> bytes | None:
    """The content of a file that `with_checksum` made; None if it is damaged."""
    content = data[_LENGTH:]
    return content if _CHECKSUM(content).digest() == data[:_LENGTH] else None

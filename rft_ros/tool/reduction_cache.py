"""Keeps the plates of reduced tools on disk, since the reduction of 40,000 plates takes three seconds of CPU.

A file's name is a checksum of everything that decides the reduction: the plates of the whole tool (and with them mesh,
scale, origin, rotation and rule), its hull, the tolerance, and the sources of reduction and physics. Files are written
whole or not at all, and a damaged one is not used. Where nothing can be written, tools are reduced each time.
"""

import hashlib
import json
import os
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.files import read_file
from rft_ros.rft import Plates
from rft_ros.tool import reduce
from rft_ros.whole_file import replacing, with_checksum, without_checksum

__all__ = ["cache_folder", "reduced_once"]

_MOST_BYTES = 64 * 2**20  # of all files; the least recently used are removed first

Reduced = tuple[Plates, str]


def cache_folder() -> Path:
    """Where reduced tools are kept: ``rft_ros/reduced`` in $XDG_CACHE_HOME, or in ~/.cache."""
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111 - as in `expanded`
    return Path(base) / "rft_ros" / "reduced"


def reduced_once(plates: Plates, corners: NDArray[np.float64], tolerance: float) -> Reduced:
    """The result of `reduced_for_any_motion`, read from the cache if it is there; every bit is the same."""
    file = cache_folder() / f"{_key(plates, corners, tolerance)}.plates"
    found = _read(file, plates)
    if found is None:
        found = reduce.reduced_for_any_motion(plates, corners, tolerance)
        _write(file, plates, found)
    return found


def _key(plates: Plates, corners: NDArray[np.float64], tolerance: float) -> str:
    arrays = plates.rows, np.ascontiguousarray(corners), np.array([tolerance])
    parts = [part for array in arrays for part in (str(array.shape).encode(), array.tobytes())]
    return _digest(_sources(), *parts).hex()[:32]


@cache
def _sources() -> bytes:
    """Checksum of the code that decides how a tool is reduced."""
    files = [Path(reduce.__file__), *sorted(Path(reduce.__file__).parents[1].joinpath("rft").rglob("*.py"))]
    return _digest(np.__version__.encode(), *(file.read_bytes() for file in files))


def _digest(*parts: bytes) -> bytes:
    return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts)).digest()


def _read(file: Path, whole: Plates) -> Reduced | None:
    """The reduction of the plates `whole` in a file; None if there is no file, or a damaged one."""
    try:
        content = without_checksum(read_file(file, "reduced tool", limit=_MOST_BYTES))
        if content is None:
            return None
        head, _, numbers = content.partition(b"\n")
        about = json.loads(head)
        plates = whole
        if about["reduced"]:
            plates = Plates.of_rows(np.frombuffer(numbers, dtype="<f8").reshape(len(whole.rows), -1))
    except (InputError, ValueError, KeyError, TypeError):
        return None
    with suppress(OSError):
        os.utime(file)  # `_make_room` removes the least recently used
    return plates, about["reduction"]


def _write(file: Path, whole: Plates, found: Reduced) -> None:
    few, reduction = found
    numbers = few.rows.astype("<f8").tobytes() if few is not whole else b""
    content = json.dumps({"reduced": few is not whole, "reduction": reduction}).encode() + b"\n" + numbers
    if len(content) > _MOST_BYTES // 4:
        return
    with suppress(OSError):
        with replacing(file) as part:
            part.write_bytes(with_checksum(content))
        _make_room(file.parent)


def _make_room(folder: Path) -> None:
    """Remove the least recently used files until the rest is small enough; other processes may do so meanwhile."""
    found = []
    for file in folder.iterdir():
        with suppress(OSError):
            status = file.stat()
            found.append((status.st_mtime, status.st_size, file))
    size = sum(bytes_of for _, bytes_of, _ in found)
    for _, bytes_of, file in sorted(found):
        if size <= _MOST_BYTES:
            return
        with suppress(OSError):
            file.unlink(missing_ok=True)
        size -= bytes_of

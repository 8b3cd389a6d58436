"""Keeps the plates of reduced tools on disk, since the reduction of 40,000 plates takes three seconds of CPU.

A file's name is a checksum of everything that decides the reduction: the plates of the whole tool (and with them mesh,
scale, origin, rotation and rule), its hull, the tolerance, and the sources of reduction and physics. Files are written
whole or not at all, and a damaged one is not used. Where nothing can be written, tools are reduced each time.
"""

import os
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.files import read_arrays, replacing
from rft_ros.rft import Plates
from rft_ros.rft.kernel.compilation import digest, sources
from rft_ros.tool import reduce

_MAX_FILE_COUNT = 128  # of at most half a megabyte each; the least recently used are removed first


def cache_folder() -> Path:
    """Where reduced tools are kept: ``rft_ros/reduced`` in $XDG_CACHE_HOME, or in ~/.cache."""
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111 - as in `expanded`
    return Path(base) / "rft_ros" / "reduced"


def reduced_once(
    plates: Plates, corners: NDArray[np.float64], tolerance: float
) -> tuple[Plates, str]:
    """The result of `reduced_for_any_motion`, read from the cache if it is there; every bit is the same."""
    numbers = (
        f"{sources(Path(__file__).resolve())} {np.__version__}"
        f" {plates.rows.shape} {corners.shape} {tolerance!r}".encode()
    )
    key = digest(numbers, plates.rows.tobytes(), corners.tobytes())
    file = cache_folder() / f"{key}.npz"
    with suppress(InputError, ValueError):  # no such file, or a damaged one
        rows, sentence = read_arrays(file, "reduced tool", ("rows", "sentence"))
        with suppress(OSError):
            os.utime(file)  # it is the most recently used one now
        cached_plates = Plates.of_rows(rows) if rows.size else plates
        return cached_plates, str(sentence)
    reduced_plates, reduction = reduce.reduced_for_any_motion(plates, corners, tolerance)
    with suppress(OSError):
        rows = reduced_plates.rows if reduced_plates is not plates else np.empty(0)
        with replacing(file) as part, part.open("wb") as stream:
            np.savez(stream, rows=rows, sentence=np.array(reduction))
        cached_files = sorted(file.parent.glob("*.npz"), key=lambda one: one.stat().st_mtime)
        for old in cached_files[:-_MAX_FILE_COUNT]:
            old.unlink(missing_ok=True)
    return reduced_plates, reduction

"""A replay's numbers, row by row, on disk: statistics and figures are made of them when all is known."""

import math
import struct
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.phases import Phase
from rft_ros.estimator import Estimate, NoEstimate, Wrench

__all__ = ["PHASES", "ROW", "Trace", "packed"]

PHASES = tuple(Phase)
"""What a row's `phase` counts from 0; -1: none."""

ROW = np.dtype(
    [
        ("stamp", "<i8"),
        ("phase", "<i8"),
        ("depth", "<f8"),
        ("predicted", "<f8", 6),
        ("compensated", "<f8", 6),
        ("quality_flags", "<i8"),
        ("state", "<f8", 13),
    ]
)
"""A placed pose: stamp [ns], phase, depth [m], wrenches in the sensor frame [N, N m], NaN where there is none, an or of
`QualityFlag`, state (columns `rft_ros.rft.STATE`; its velocity counts only with an estimate)."""

_LAYOUT = struct.Struct("<d12dq")
_HEAD = struct.Struct("<qq")
_CODE = {phase: code for code, phase in enumerate(PHASES)} | {None: -1}
_NONE: Wrench = (math.nan,) * 6
_BLOCK = 4096


def packed(depth: float, answer: Estimate | NoEstimate) -> bytes:
    """Depth, wrenches and quality_flags as they lie in a `ROW`."""
    if isinstance(answer, NoEstimate):
        return _LAYOUT.pack(depth, *_NONE, *_NONE, 0)
    return _LAYOUT.pack(depth, *answer.predicted, *(answer.compensated or _NONE), answer.quality_flags)


class Trace:
    """A file of rows that nobody else sees and that is gone with the `with` block; memory does not grow with it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._rows = 0

    def __enter__(self) -> "Trace":
        self._file = tempfile.TemporaryFile(dir=self._folder)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def __len__(self) -> int:
        return self._rows

    def add(self, stamp: int, phase: Phase | None, numbers: bytes, state: bytes) -> None:
        """Append a row; `numbers` as `packed`, `state` as float64."""
        self._rows += 1
        self._file.write(_HEAD.pack(stamp, _CODE[phase]) + numbers + state)

    def blocks(self, rows: int = _BLOCK) -> Iterator[NDArray[np.void]]:
        """All rows in order, `rows` of them at a time, as `ROW` arrays."""
        self._file.seek(0)
        while data := self._file.read(rows * ROW.itemsize):
            yield np.frombuffer(data, ROW)

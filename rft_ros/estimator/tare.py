"""Tare: what the load cell reads while the tool hangs still in the air, averaged over the last seconds."""

from collections import deque

from rft_ros.errors import InputError
from rft_ros.estimator.samples import Wrench, WrenchSample

__all__ = ["Tare"]

_CAPACITY = 8192
_FEWEST = 10


class Tare:
    """The last load-cell samples, and when the tool was last seen moving, in the grains, or not seen at all."""

    def __init__(self) -> None:
        self._samples: deque[WrenchSample] = deque(maxlen=_CAPACITY)
        self._seen = False
        self._still = 0
        self._disturbed = 0
        self._disturbance = ""

    def push(self, sample: WrenchSample) -> None:
        """Keep a usable sample; an earlier stamp than the last one (time jump) starts afresh."""
        if self._samples and sample.stamp < self._samples[-1].stamp:
            self._samples.clear()
        self._samples.append(sample)

    def disturb(self, stamp: int, what: str) -> None:
        """Note that at `stamp` [ns] a tare would be wrong, and why."""
        self._seen, self._disturbed, self._disturbance = True, stamp, what

    def still(self, stamp: int) -> None:
        """Note that at `stamp` [ns] the tool hung still in the air."""
        self._seen, self._still = True, stamp
        if stamp < self._disturbed:  # time jump
            self._disturbed = 0

    def mean(self, window: float) -> Wrench:
        """Mean of the raw samples over the last `window` [s]; InputError says why a tare would be wrong now."""
        if not self._seen:
            raise InputError("tare refused: no pose with a known velocity has come yet")
        newest = self._samples[-1].stamp if self._samples else self._disturbed
        start = newest - round(window * 1e9)
        if self._disturbed > start:
            raise InputError(f"tare refused: within the last {window:g} s {self._disturbance}")
        if self._still <= start:
            raise InputError(f"tare refused: within the last {window:g} s no pose has shown the tool at rest")
        used = [s.wrench for s in self._samples if s.stamp > start]
        if len(used) < _FEWEST:
            raise InputError(
                f"tare refused: {len(used)} load-cell samples in the last {window:g} s; it needs {_FEWEST}"
            )
        n = len(used)
        fx, fy, fz, tx, ty, tz = (sum(column) / n for column in zip(*used, strict=True))
        return fx, fy, fz, tx, ty, tz

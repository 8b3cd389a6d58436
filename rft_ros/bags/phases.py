"""The phase of every moment: where the tool is and which way it goes, without flicker."""

from collections.abc import Iterator
from enum import Enum
from typing import Generic, NamedTuple, TypeVar

__all__ = ["Moment", "Phase", "Phases"]


class Phase(str, Enum):
    """What the tool does. Values are what users read.

    APPROACH: its lowest point is above the surface, but for WITHDRAWAL. PENETRATION: below it, and that point goes
    down. DWELL: below it, slower than `rest_speed`; RFT says nothing about rest. WITHDRAWAL: that point goes up, or has
    come out and has not gone down or sideways since. PLOUGHING: below the surface, in any other motion.
    """

    APPROACH = "approach"
    PENETRATION = "penetration"
    PLOUGHING = "ploughing"
    DWELL = "dwell"
    WITHDRAWAL = "withdrawal"

    def __str__(self) -> str:
        return self.value


class Moment(NamedTuple):
    """Where the tool's lowest point is and goes at a stamp [ns].

    `depth` [m], negative above the surface; `sinking`: its velocity downwards, `travel`: its speed, and `speed`: that
    of the tool's fastest point [m/s].
    """

    stamp: int
    depth: float
    sinking: float
    travel: float
    speed: float


_HOLD = 100_000_000
"""A new phase counts from its first moment, once it has lasted this long [ns]."""

_WAITING = 4096
"""Moments that may wait for a phase to be settled, however their stamps lie."""

_STEEP, _STILL_STEEP = 0.1, 0.05
"""Sine of the least slope on which the tool goes down or up; the second holds for the phase that it is in."""

_STILL_AT_REST = 1.5
"""At rest already, a tool stays so up to this many times `rest_speed`."""

_Item = TypeVar("_Item")
_Settled = tuple[_Item, Phase | None]


class Phases(Generic[_Item]):
    """Tells the phase of moments that come in one by one; an item of the caller's goes through with each.

    A moment is given back with its phase when that is settled, at most 0.1 s later, and in the order of the moments.
    """

    def __init__(self, rest_speed: float) -> None:
        self._rest_speed = rest_speed
        self._phase: Phase | None = None
        self._candidate: Phase | None = None
        self._since = 0
        self._newest = 0
        self._waiting: list[tuple[_Item, bool]] = []

    def push(self, item: _Item, moment: Moment | None) -> list[_Settled[_Item]]:
        """Take a moment, None where the motion is not known; the items whose phase is settled by it, None for those."""
        if moment is None:
            if not self._waiting:
                return [(item, None)]
            self._waiting.append((item, False))
            return list(self._settle(self._candidate)) if len(self._waiting) >= _WAITING else []
        settled: list[_Settled[_Item]] = []
        if moment.stamp < self._newest:  # a time jump: another run begins
            settled += self.finish()
            self._phase = None
        self._newest = moment.stamp
        seen = self._seen(moment)
        if self._phase is None:
            self._phase = seen
        if seen is self._phase:
            if self._waiting:  # it was noise
                settled += self._settle(seen)
            settled.append((item, seen))
            return settled
        if seen is not self._candidate or not self._waiting:
            settled += self._settle(self._phase)
            self._candidate, self._since = seen, moment.stamp
        self._waiting.append((item, True))
        if moment.stamp - self._since >= _HOLD or len(self._waiting) >= _WAITING:
            settled += self._settle(seen)
        return settled

    def finish(self) -> list[_Settled[_Item]]:
        """The items that still wait."""
        return list(self._settle(self._candidate))

    def _settle(self, phase: Phase | None) -> Iterator[_Settled[_Item]]:
        waiting, self._waiting = self._waiting, []
        if waiting:
            self._phase = phase
        for item, known in waiting:
            yield item, phase if known else None

    def _seen(self, moment: Moment) -> Phase:
        """The phase by this moment alone, and by the present one where that has been left by a hair."""
        now = self._phase
        rest, travel = self._rest_speed, moment.travel
        down = moment.sinking >= max(rest, travel * (_STILL_STEEP if now is Phase.PENETRATION else _STEEP))
        up = -moment.sinking >= max(rest, travel * (_STILL_STEEP if now is Phase.WITHDRAWAL else _STEEP))
        if moment.depth <= 0.0:
            if now is None or now is Phase.APPROACH or down:
                return Phase.APPROACH
            still = moment.speed < rest * _STILL_AT_REST and now is Phase.WITHDRAWAL
            return Phase.WITHDRAWAL if up or still else Phase.APPROACH
        if moment.speed < rest * (_STILL_AT_REST if now is Phase.DWELL else 1.0):
            return Phase.DWELL
        if down:
            return Phase.PENETRATION
        return Phase.WITHDRAWAL if up else Phase.PLOUGHING

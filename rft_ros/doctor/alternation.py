"""Two publishers on one topic, by their messages: they jump to and fro between two courses."""

import math
from collections.abc import Sequence

from rft_ros.messages import Role

MIN_JUMPS: dict[Role, tuple[float, str]] = {
    "pose": (1e-3, "m"),
    "twist": (5e-3, "m/s and rad/s"),
    "wrench": (1.0, "N and N m"),
}
"""The least jump of the messages of a role, with its unit: resolution and noise of drivers are smaller."""

_MIN_SHARES: dict[Role, float] = {"pose": 0.1, "twist": 0.3, "wrench": 0.3}
# of the messages that come back: readings that vibrate near half of their rate come back, too, for a while
_BACK = 0.2  # of a jump: so near to the message before the last one, it came back
_MIN_RETURNS = 20


class Alternation:
    """Counts the messages of a role that come back to the one before the last."""

    def __init__(self, role: Role) -> None:
        min_jump, unit = MIN_JUMPS[role]
        self.unit = unit
        self._min_jump = min_jump
        self._min_share = _MIN_SHARES[role]
        self._last: Sequence[float] | None = None
        self._before_last: Sequence[float] | None = None
        self._count = 0
        self._returns = 0
        self._path = 0.0

    def add(self, numbers: Sequence[float]) -> None:
        """Add the numbers of the next message."""
        self._count += 1
        last = self._last
        before_last = self._before_last
        self._before_last = last
        self._last = numbers
        if last is None or before_last is None:
            return
        jump = math.dist(numbers, last)
        if jump > self._min_jump and math.dist(numbers, before_last) < _BACK * jump:
            self._returns += 1
            self._path += jump

    @property
    def is_found(self) -> bool:
        """Whether two publishers send in turn."""
        return self._returns >= max(_MIN_RETURNS, self._min_share * self._count)

    @property
    def jump(self) -> float:
        """The mean jump, in `unit`."""
        return self._path / max(self._returns, 1)

"""When messages arrived by the clock, for what stamps cannot say: that none come any more."""

import math
from time import perf_counter

POLL_PERIOD = 0.05
"""Time between two calls of `Arrivals.count_quiet_time` [s]."""


class Arrivals:
    """Follows the arrival of the messages of each role.

    `quiet_time`: how long neither poses nor load-cell samples have come [s]. It counts polls and not the clock: after a
    stall of this process one poll has passed, and the messages that came meanwhile still wait in their queues.
    """

    def __init__(self) -> None:
        self._times: dict[str, float] = {}  # by role, of its last message, of `perf_counter` [s]
        self.quiet_time = 0.0

    def add(self, role: str) -> None:
        """Add a message of a role that has arrived now."""
        self._times[role] = perf_counter()
        if role in ("pose", "wrench"):  # after the other roles nothing is published
            self.quiet_time = 0.0

    def silence(self, role: str) -> float:
        """Time since the last message of a role [s]; infinite before the first one."""
        return perf_counter() - self._times.get(role, -math.inf)

    def count_quiet_time(self) -> None:
        """Add one period without poses and load-cell samples."""
        self.quiet_time += POLL_PERIOD

"""Hypotheses on stamps against the times of arrival: clocks that differ or step, and messages that were delayed."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rft_ros.diagnosis.evidence import Finding

__all__ = ["Arrivals", "age_of", "clock_findings", "delayed"]

_SOONEST = 0.02  # quantile of the ages at arrival: the age due to clocks and drivers alone, without delays on the way
_LEAST_SPAN = 1_500_000_000  # ns on both sides of a step of the clock: a busy machine stands still for less


@dataclass(frozen=True, slots=True)
class Arrivals:
    """n messages of one sender on a topic: times of arrival and stamps [ns], shape [n], in the order of arrival."""

    topic: str
    arrival: NDArray[np.int64]
    stamp: NDArray[np.int64]

    @property
    def ages(self) -> NDArray[np.float64]:
        """Ages at arrival [s], of the messages that have a stamp."""
        return np.asarray(1e-9 * (self.arrival - self.stamp)[self.stamp > 0], dtype=np.float64)


def age_of(ages: NDArray[np.float64]) -> float:
    """The age [s] of messages that were not delayed on their way: the difference of the clocks."""
    return float(np.quantile(ages, _SOONEST)) if len(ages) else 0.0


def delayed(ages: NDArray[np.float64], limit: float) -> bool:
    """Whether messages were delayed on their way by more than a limit [s]. `ages`: at arrival [s], shape [n].

    A wrong clock or a slow driver makes all messages old. A busy machine delays only some of them.
    """
    return len(ages) > 0 and float(np.median(ages) - age_of(ages)) > limit


def clock_findings(arrivals: Arrivals, *, limit: float, live: bool) -> Iterator[Finding]:
    """A step of a clock, or delays of single messages, by more than `limit` [s]. `live`: not from a recording."""
    ages, topic = arrivals.ages, arrivals.topic
    parts = [ages]
    if (row := _step(arrivals, limit)) is not None:
        parts = [ages[:row], ages[row:]]
        step = age_of(parts[0]) - age_of(parts[1])
        after = 1e-9 * (arrivals.arrival[arrivals.stamp > 0][row] - arrivals.arrival[0])
        clock = "this machine's clock" if live else "the recorder's clock"
        said = f"the stamps on {topic} step by {step:+.3g} s against {clock}, {after:.1f} s after the start"
        advice = "keep the clocks in step (NTP, PTP) from before the start"
        advice += "" if live else ", or use the part before or after it with --start or --end"
        yield Finding(False, f"clock: {said}; {advice}")
    if any(delayed(part, limit) for part in parts):
        least, most = 1e3 * ages.min(), 1e3 * ages.max()
        if live:
            said = f"messages on {topic} arrive {least:.0f} to {most:.0f} ms after their stamps"
            busy = "this machine is too busy to judge, or the driver sends in bursts"
            yield Finding(False, f"machine: {said}: {busy}; end other work, and run again")
        else:
            said = f"messages on {topic} were recorded {least:.0f} to {most:.0f} ms after their stamps"
            cause = "the recorder or the network was behind, or the driver sends in bursts"
            yield Finding(False, f"recording: {said}: {cause}; record again, on a machine with less work")


def _step(arrivals: Arrivals, limit: float) -> int | None:
    """The stamped message before which the clock stepped by more than `limit` [s], also by the soonest messages."""
    ages, arrival = arrivals.ages, arrivals.arrival[arrivals.stamp > 0]
    if len(ages) < 2:
        return None
    row = int(np.abs(np.diff(ages)).argmax()) + 1
    spans = arrival[row - 1] - arrival[0], arrival[-1] - arrival[row]
    if min(spans) < _LEAST_SPAN or abs(age_of(ages[:row]) - age_of(ages[row:])) <= limit:
        return None
    return row

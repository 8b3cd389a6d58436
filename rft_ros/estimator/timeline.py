"""Timelines: the samples of one input in the order of their stamps, and what lies between two of them."""

import math
from collections import deque
from collections.abc import Sequence
from enum import Enum
from typing import TypeVar

from rft_ros.estimator.samples import TransformSample, TwistSample, WrenchSample
from rft_ros.rft.frames import Quaternion

_NEW_RUN_NS = 1_000_000_000
"""A stamp that goes back by this much [ns] or more starts a new run (a bag played in a loop)."""

PATIENCE_NS = 1_000_000_000
"""How long [ns], by the stamps of other inputs, an estimate waits for a load-cell sample, or a pose for a transform.

A sender may be late by less than this, for example because its process stalls.
"""


def patience(max_age: int) -> int:
    """How much later [ns] the stamp of another input is when nothing waits for a reading any more.

    `max_age`: the greatest time between two samples that are used together [ns].
    """
    return max(max_age, PATIENCE_NS)


class Succession(Enum):
    """How a stamp follows the last one of the same input."""

    NEXT = "it is later"
    REPEATED = "it is the same"
    LATE = "it is earlier by less than `_NEW_RUN_NS`: the sample comes out of order"
    NEW_RUN = "it is earlier by `_NEW_RUN_NS` or more: the sample is the first one of a new run"


# names of the module: an attribute of an Enum takes 0.1 us to look up
NEXT, REPEATED, LATE, NEW_RUN = Succession


def succession(stamp: int, *, after: int) -> Succession:
    """How a stamp follows the last one of its input, `after`; both [ns]."""
    lateness = after - stamp
    if lateness < 0:
        return NEXT
    if lateness >= _NEW_RUN_NS:
        return NEW_RUN
    return LATE if lateness else REPEATED


S = TypeVar("S", TransformSample, TwistSample, WrenchSample)


class Timeline(deque[S]):
    """The last samples of one input, `maxlen` at most, in the order of their stamps."""

    @property
    def last(self) -> S | None:
        """The sample with the latest stamp."""
        return self[-1] if self else None

    def follows(self, stamp: int) -> Succession:
        """How a stamp [ns] follows the last one."""
        return succession(stamp, after=self[-1].stamp) if self else NEXT

    def start_run(self, stamp: int) -> None:
        """Drop the samples if they belong to the run before the one that starts at `stamp` [ns]."""
        if self.follows(stamp) is NEW_RUN:
            self.clear()

    def around(self, stamp: float) -> tuple[S | None, S | None, float]:
        """The last sample at or before a stamp [ns], the first one after it, and the share of the way between them.

        None where there is no such sample; then the share is 0.
        """
        after = None
        for sample in reversed(self):
            if sample.stamp <= stamp:
                if after is None:
                    return sample, None, 0.0
                return sample, after, (stamp - sample.stamp) / (after.stamp - sample.stamp)
            after = sample
        return None, after, 0.0


def interpolated(a: Sequence[float], b: Sequence[float], share: float) -> tuple[float, ...]:
    """The numbers at a share of the way from one to the other."""
    return tuple([p + share * (q - p) for p, q in zip(a, b, strict=True)])


def slerp(a: Quaternion, b: Quaternion, share: float) -> Quaternion:
    """The attitude at a share of the way from one to the other, at a constant rate of turn; unit quaternions."""
    cosine = sum(p * q for p, q in zip(a, b, strict=True))
    angle = math.acos(min(1.0, abs(cosine)))
    first = 1.0 - share
    second = share
    sine = math.sin(angle)
    if sine > 1e-6:
        first = math.sin(first * angle) / sine
        second = math.sin(share * angle) / sine
    second = math.copysign(second, cosine)  # q and -q are one attitude
    i, j, k, w = (first * p + second * q for p, q in zip(a, b, strict=True))
    norm = math.hypot(i, j, k, w)
    return i / norm, j / norm, k / norm, w / norm

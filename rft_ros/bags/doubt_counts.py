"""How many estimates of a replay are doubtful, and how far they can be trusted."""

from collections import Counter

import numpy as np

from rft_ros.bags.trace import Trace
from rft_ros.estimator.doubts import Trust, doubts_named, trust

__all__ = ["ALL_DOUBTS", "counted_doubts"]

ALL_DOUBTS = doubts_named(-1)
"""The name of every `Doubt`."""


def counted_doubts(trace: Trace) -> tuple[dict[str, int], dict[str, int]]:
    """Estimates by the name of each doubt, and by trust; every name and every `Trust` is there."""
    sets: Counter[int] = Counter()
    for block in trace.blocks():
        answered = ~np.isnan(block["predicted"][:, 0])
        found, counts = np.unique(block["doubts"][answered], return_counts=True)
        sets.update(dict(zip(found.tolist(), counts.tolist(), strict=True)))
    by_doubt = dict.fromkeys(ALL_DOUBTS, 0)
    by_trust = {level.value: 0 for level in Trust}
    for doubts, count in sets.items():
        by_trust[trust(doubts).value] += count
        for name in doubts_named(doubts):
            by_doubt[name] += count
    return by_doubt, by_trust

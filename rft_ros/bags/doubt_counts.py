"""How many estimates of a replay are doubtful, and how far they can be trusted."""

from collections import Counter

import numpy as np

from rft_ros.bags.estimates import Trace
from rft_ros.estimator.quality import Trust, flag_names, trust

__all__ = ["ALL_FLAGS", "counted_flags"]

ALL_FLAGS = flag_names(-1)
"""The name of every `QualityFlag`."""


def counted_flags(trace: Trace) -> tuple[dict[str, int], dict[str, int]]:
    """Estimates by the name of each flag, and by trust; every name and every `Trust` is there."""
    sets: Counter[int] = Counter()
    for block in trace.blocks():
        answered = ~np.isnan(block["predicted"][:, 0])
        found, counts = np.unique(block["quality_flags"][answered], return_counts=True)
        sets.update(dict(zip(found.tolist(), counts.tolist(), strict=True)))
    by_doubt = dict.fromkeys(ALL_FLAGS, 0)
    by_trust = {level.value: 0 for level in Trust}
    for quality_flags, count in sets.items():
        by_trust[trust(quality_flags).value] += count
        for name in flag_names(quality_flags):
            by_doubt[name] += count
    return by_doubt, by_trust

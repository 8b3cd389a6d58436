"""The phase of every pose: where the tool's lowest point is and how it moves."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["PHASES", "phases_of"]

_Array = NDArray[np.float64]
_Numbers = NDArray[np.int64]

PHASES = ("approach", "penetration", "ploughing", "dwell", "withdrawal")
"""The phases, which docs/replay.md defines, by their number in a row."""

_AROUND = 100_000_000  # ns before and after a moment in which its phase must prevail
_STEEP = 0.1  # least share of the tool's speed that counts as down or up


def phases_of(stamps: _Numbers, depth: _Array, sinking: _Array, speed: _Array, rest_speed: float) -> _Numbers:
    """Number in `PHASES` of the phase that prevails within 0.1 s of each of n moments; all shapes [n].

    `stamps` [ns]: one that goes back begins another run. `depth` of the lowest point [m], negative above the surface;
    `sinking`: its downward velocity; `speed` of the tool's fastest plate, `rest_speed` [m/s].
    """
    steep = np.maximum(rest_speed, _STEEP * speed)
    cases = {  # the first that holds
        "withdrawal": -sinking >= steep,
        "approach": depth <= 0.0,
        "dwell": speed < rest_speed,
        "penetration": sinking >= steep,
    }
    seen = np.select([*cases.values()], [*map(PHASES.index, cases)], PHASES.index("ploughing"))
    phases = np.empty(len(stamps), dtype=np.int64)
    for run in np.split(np.arange(len(stamps)), np.flatnonzero(np.diff(stamps) < 0) + 1):
        at, was = stamps[run], seen[run]
        first, after = np.searchsorted(at, at - _AROUND), np.searchsorted(at, at + _AROUND, side="right")
        sums = [np.append(0, np.cumsum(was == code)) for code in range(len(PHASES))]
        phases[run] = np.argmax([total[after] - total[first] for total in sums], axis=0)
    return phases

"""The phase of every pose: where the tool's lowest point is and how it moves, without flicker."""

from collections.abc import Iterable
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft.frames import rotation

__all__ = ["PHASES", "Phase", "lowest_points", "phases_of"]

_Array = NDArray[np.float64]

_HOLD = 100_000_000  # shortest phase [ns]; it counts from its first moment
_STEEP, _STILL_STEEP = 0.1, 0.05  # sine of the least slope that counts as down or up; within that phase
_STILL_AT_REST = 1.5  # a tool at rest counts as at rest up to this many times `rest_speed`


class Phase(str, Enum):
    """What the tool does; users read the values.

    APPROACH: its lowest point is above the surface, except in WITHDRAWAL. PENETRATION: below it, and that point moves
    down. DWELL: below it, slower than `rest_speed`. WITHDRAWAL: that point moves up, or has left the grains and has not
    moved down or sideways since. PLOUGHING: below the surface, any other motion.
    """

    APPROACH = "approach"
    PENETRATION = "penetration"
    PLOUGHING = "ploughing"
    DWELL = "dwell"
    WITHDRAWAL = "withdrawal"

    __str__ = str.__str__


PHASES = tuple(Phase)
"""The phases by their number in a row."""


def lowest_points(corners: _Array, states: _Array) -> tuple[_Array, _Array]:
    """World z [m] of the lowest of a tool's corners, shape [n], and its velocity [m/s], shape [n, 3], at n states.

    `corners`: in the tool frame [m], shape [m, 3]. `states`: shape [n, 13], columns `rft_ros.rft.STATE`.
    """
    axes = np.array(rotation(*states[:, 3:7].T)).T.reshape(-1, 3, 3)
    lowest = corners[(axes[:, 2] @ corners.T).argmin(axis=1)]
    arm = np.einsum("nij,nj->ni", axes, lowest)
    return states[:, 2] + arm[:, 2], states[:, 7:10] + np.cross(states[:, 10:13], arm)


def phases_of(moments: Iterable[tuple[int, float, float, float, float]], rest_speed: float) -> list[Phase]:
    """The phase of each moment, none shorter than 0.1 s but at the ends; a stamp that goes back begins another run.

    Moments: stamp [ns], depth of the lowest point [m], negative above the surface, its downward velocity and speed, and
    the greatest speed of the tool's plates [m/s].
    """
    found: list[Phase] = []
    now: Phase | None = None
    candidate: Phase | None = None
    begin = since = newest = 0  # first moment of the candidate, its stamp; stamp of the last moment

    def settle() -> None:
        if candidate:
            found[begin:] = [candidate] * (len(found) - begin)

    for stamp, depth, sinking, travel, speed in moments:
        if stamp < newest:
            settle()
            now = candidate = None
        newest = stamp
        seen = _phase(now, depth, sinking, travel, speed, rest_speed)
        now = now or seen
        found.append(now)
        if seen is now:
            candidate = None
        elif seen is not candidate:
            candidate, begin, since = seen, len(found) - 1, stamp
        elif stamp - since >= _HOLD:
            settle()
            now, candidate = seen, None
    settle()
    return found


def _phase(now: Phase | None, depth: float, sinking: float, travel: float, speed: float, rest: float) -> Phase:
    """The phase at a moment, without the hold time; thresholds favour the current phase."""
    down = sinking >= max(rest, travel * (_STILL_STEEP if now is Phase.PENETRATION else _STEEP))
    up = -sinking >= max(rest, travel * (_STILL_STEEP if now is Phase.WITHDRAWAL else _STEEP))
    if depth <= 0.0:
        if now is None or now is Phase.APPROACH or down:
            return Phase.APPROACH
        still = now is Phase.WITHDRAWAL and speed < rest * _STILL_AT_REST
        return Phase.WITHDRAWAL if up or still else Phase.APPROACH
    if speed < rest * (_STILL_AT_REST if now is Phase.DWELL else 1.0):
        return Phase.DWELL
    if down:
        return Phase.PENETRATION
    return Phase.WITHDRAWAL if up else Phase.PLOUGHING

"""The phase of every pose: where the tool's lowest point is and how it moves, without flicker."""

import math
from collections.abc import Iterable
from enum import Enum

from rft_ros.rft.compilation import compiled
from rft_ros.rft.frames import from_frame, rotation

__all__ = ["PHASES", "Phase", "lowest_points", "phases_of"]

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


@compiled
def lowest_points(corners, states, out):  # type: ignore[no-untyped-def]
    """Write world z [m] of the lowest of `corners` and its velocity [m/s] at each of n states to `out`, shape [n, 4].

    `corners`: in the tool frame [m], shape [m, 3]. `states`: shape [n, 13], columns `rft_ros.rft.STATE`.
    """
    for k in range(len(states)):
        state = states[k]
        axes = rotation(state[3], state[4], state[5], state[6])
        x = y = z = math.inf
        for corner in corners:
            cx, cy, cz = from_frame(axes, corner[0], corner[1], corner[2])
            if cz < z:
                x, y, z = cx, cy, cz
        wx, wy, wz = state[10], state[11], state[12]
        out[k, 0], out[k, 1] = state[2] + z, state[7] + wy * z - wz * y
        out[k, 2], out[k, 3] = state[8] + wz * x - wx * z, state[9] + wx * y - wy * x


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

"""The wake of a tool: the grains that it has passed, which are looser."""

import math

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import POSITION, QUATERNION, rotation_matrix
from rft_ros.tool import Tool

__all__ = ["Wake"]

_KEPT = 512  # places of the path
_BENT = 0.85  # distance over path length; a straighter path does not return to itself
_STEP = 0.125  # widths of the tool between two places


class Wake:
    """The path of the tool's centre since it entered the grains, and whether the tool returns to it.

    On a straight path the distance from an earlier place equals the path length since. The tool passes the same grains
    again where, two or more widths of path later, the distance is below `_BENT` times that length and below two widths
    of the tool. This finds a root tip's helix of 20 mm pitch, where the measured forces deviate, but not one of 40 mm
    (Treers et al. 2021, V-B).
    """

    def __init__(self, tool: Tool) -> None:
        columns = tool.corners.T  # one by one: numpy takes 6 ms for 170,000 rows of three
        low, high = np.array([c.min() for c in columns]), np.array([c.max() for c in columns])
        self._centre, self._width = 0.5 * (low + high), float(np.median(high - low))
        self._places, self._lengths = np.zeros((_KEPT, 3)), np.zeros(_KEPT)  # length of the path up to each place [m]
        self.clear()

    def clear(self) -> None:
        """Clear the path. The tool has left the grains, which fill its traces."""
        self._count, self._length = 0, 0.0
        self.is_crossed = False
        """Whether the tool crosses its earlier path."""

    def extend(self, state: NDArray[np.float64]) -> None:
        """Add the next state, shape [13]."""
        place = state[POSITION] + rotation_matrix(state[QUATERNION]) @ self._centre
        if self._count:
            step = math.dist(place, self._places[(self._count - 1) % _KEPT])
            if step < _STEP * self._width:
                return
            self._length += step
        self._places[self._count % _KEPT] = place
        self._lengths[self._count % _KEPT] = self._length
        self._count += 1
        since = self._length - self._lengths[: self._count]
        apart = np.linalg.norm(self._places[: self._count] - place, axis=1)
        near = (since >= 2.0 * self._width) & (apart < 2.0 * self._width) & (apart < _BENT * since)
        self.is_crossed = bool(near.any())

"""What the load cell reads in the air. A tared cell reads nothing there; a greater reading is an offset."""

import math

from rft_ros.estimator.samples import Vector

__all__ = ["OFFSET_SENTENCE", "AirReading", "is_offset"]

_READINGS = 64  # averaged at most; half as many are enough to judge the mean
_LEAST = 0.2  # N: a smaller mean is noise, or a small error of the tool's weight
_SHARE = 0.1  # of the force in the grains: a smaller mean matters little beside it

OFFSET_SENTENCE = "the load cell reads a force in the air: call ~/tare there, or check sensor.bias and sensor.mass"
"""What an offset says to a user."""


def is_offset(load: float, greatest: float, *, share: float = _SHARE) -> bool:
    """Whether a mean force `load` in the air [N] is an offset of the load cell.

    `greatest`: the greatest force in the grains [N]. A load below `share` of it is no offset.
    """
    return load > max(_LEAST, share * greatest)


class AirReading:
    """The mean of the last compensated forces in the air, and whether it is an offset."""

    def __init__(self) -> None:
        self._greatest = 0.0  # predicted force in the grains so far [N]
        self.forget()

    def forget(self) -> None:
        """Drop the readings in the air: the load cell was tared, or has other settings."""
        self._mean, self._count = (0.0, 0.0, 0.0), 0
        self.load = 0.0
        """Magnitude of the mean [N]; 0 before there are enough readings."""
        self.is_offset = False
        """Whether the load cell reads a force in the air."""

    def start_run(self) -> None:
        """Start with another tool, or another run of samples."""
        self._greatest = 0.0
        self.forget()

    def add_in_grains(self, predicted: float) -> None:
        """Add a predicted force in the grains [N]."""
        if predicted > self._greatest:
            self._greatest = predicted
            self.is_offset = is_offset(self.load, predicted)

    def add_in_air(self, measured: Vector) -> None:
        """Add a compensated force in the air [N], world axes."""
        self._count = n = min(self._count + 1, _READINGS)
        (x, y, z), (a, b, c) = self._mean, measured
        self._mean = x, y, z = x + (a - x) / n, y + (b - y) / n, z + (c - z) / n
        if 2 * n >= _READINGS:
            self.load = math.sqrt(x * x + y * y + z * z)
            self.is_offset = is_offset(self.load, self._greatest)

    def issues(self) -> list[str]:
        """`OFFSET_SENTENCE` if the load cell reads a force in the air; otherwise nothing."""
        return [OFFSET_SENTENCE] if self.is_offset else []

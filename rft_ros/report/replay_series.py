"""A replay's numbers over time, as its charts need them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rft_ros.report.charts import Span

__all__ = ["FlaggedRows", "ReplaySeries"]

_Numbers = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlaggedRows:
    """A flag's `name`, the `trust` that it leaves ("CAUTION" or "NO"), and the `rows` that have it, shape [n]."""

    name: str
    trust: str
    rows: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReplaySeries:
    """A replay, thinned out to what a chart can show: a row for each pose that is drawn.

    `time` [s] from the first pose; `depth` of the tool's lowest point [m]; `phase`: index into `phases`, -1 for none;
    `measured` (less bias and tool weight), `predicted`: wrench on the tool in sensor axes [N, N m], shape [n, 6], NaN
    where there is none; `deviation`: standard deviation of each component of the predicted force and torque, shape
    [n, 2]. `quality_flags`: those that occur. `vertical`: the sensor axis nearest to vertical, and where it points
    ("up" or "down").
    """

    time: _Numbers
    depth: _Numbers
    phase: NDArray[np.int64]
    phases: tuple[str, ...]
    measured: _Numbers
    predicted: _Numbers
    deviation: _Numbers
    quality_flags: tuple[FlaggedRows, ...]
    vertical: tuple[str, str]

    def spans(self) -> tuple[Span, ...]:
        """Stretches of one phase."""
        return tuple(
            Span(self.phases[self.phase[row]], begin, end)
            for row, begin, end in self.stretches(self.phase)
            if self.phase[row] >= 0
        )

    def stretches(self, values: "NDArray[np.int64] | NDArray[np.bool_]") -> list[tuple[int, float, float]]:
        """Where the value of a row stays the same: its first row, and its times [s] up to the next's begin.

        `values`: shape [n], a value for each row.
        """
        if not len(values):
            return []
        differs = (values[1:] != values[:-1]) | (np.diff(self.time) < 0.0)
        changes = (np.flatnonzero(differs) + 1).tolist()
        time = self.time.tolist()
        return [
            (a, time[a], max(time[a], time[b]))
            for a, b in zip([0, *changes], [*changes, len(time) - 1], strict=True)
        ]  # fmt: skip

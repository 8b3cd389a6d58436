"""What a replay came to: counts, and root mean square and peak of each axis."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator import Estimate
from rft_ros.estimator.messages import Role
from rft_ros.estimator.parameters import Value

__all__ = ["AXES", "Axis", "Spread", "Summary", "WrenchStatistics"]

AXES = ("fx", "fy", "fz", "tx", "ty", "tz")

_BLOCK = 4096
_NONE = (math.nan,) * 6


@dataclass(frozen=True, slots=True)
class Spread:
    """Root mean square and greatest magnitude of one axis, [N] or [N m]; None where there are no values."""

    rms: float | None
    peak: float | None


@dataclass(frozen=True, slots=True)
class Axis:
    """One axis of the wrench in the sensor frame: measured (compensated), predicted, and the difference."""

    measured: Spread
    predicted: Spread
    residual: Spread

    def spreads(self) -> tuple[Spread, Spread, Spread]:
        """The three, in this order."""
        return self.measured, self.predicted, self.residual


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """What summary.json holds, and how long the replay took, which it does not.

    `topics`: the topic read for each role. `messages`: how many of each role came in. `estimates`: poses with a
    prediction. `withheld`: poses and other samples that were not used, and estimates without residual, by reason.
    `duration`: receive time covered [s]. `damage`: where and why reading stopped early. `wrench`: by axis, over all
    estimates. `penetration`: the forces over the `penetration_estimates` in which the tool was in the grains and went
    down. `seconds`: wall time of the replay, without its figure.
    """

    bag: str
    topics: dict[Role, str]
    parameters: dict[str, Value]
    bias: Sequence[float]
    messages: dict[Role, int]
    estimates: int
    withheld: dict[str, int]
    duration: float
    damage: str | None
    wrench: dict[str, Axis]
    penetration: dict[str, Axis]
    penetration_estimates: int
    seconds: float = field(compare=False)

    @property
    def real_time_factor(self) -> float:
        """Recorded time over wall time."""
        return self.duration / self.seconds

    def lines(self) -> list[str]:
        """What a user wants to know first: counts, and the size of forces and residuals."""
        poses = self.messages["pose"]
        text = [f"{self.bag}: {self.estimates} estimates of {poses} poses, {self.real_time_factor:.0f} times real time"]
        text += [f"  not used or unanswered: {reason} {n}" for reason, n in self.withheld.items()]
        if self.damage:
            text.append(f"  reading stopped early: {self.damage}")
        heads = [f"{part:>19}" for part in ("measured", "predicted", "residual")]
        text.append(f"  {'RMS / peak':<18}" + "".join(heads))
        for title, axes in (("whole", self.wrench), ("penetration", self.penetration)):
            for name, axis in axes.items():
                unit = "N" if name.startswith("f") else "N m"
                cells = [f"{s.rms:8.3f} /{s.peak:8.3f}" if s.rms is not None else "-" for s in axis.spreads()]
                text.append(f"  {f'{title} {name} [{unit}]':<18}" + "".join(f"{cell:>19}" for cell in cells))
        return text

    def json(self) -> str:
        """The text of summary.json: the same for the same bag and parameters."""
        content = asdict(self)
        del content["seconds"]
        return json.dumps(content, indent=2, allow_nan=False) + "\n"


class WrenchStatistics:
    """Sums over any number of estimates, in blocks, so that nothing grows."""

    def __init__(self) -> None:
        self.estimates = 0
        self._rows: list[tuple[float, ...]] = []
        self._count = np.zeros(18, dtype=np.int64)
        self._squares = np.zeros(18)
        self._peaks = np.zeros(18)

    def add(self, estimate: Estimate) -> None:
        """Take an estimate in."""
        self.estimates += 1
        self._rows.append((estimate.compensated or _NONE) + estimate.predicted + (estimate.residual or _NONE))
        if len(self._rows) == _BLOCK:
            self._reduce()

    def axes(self, names: Sequence[str] = AXES) -> dict[str, Axis]:
        """The statistics of the axes named."""
        self._reduce()
        rms = np.sqrt(self._squares / np.maximum(self._count, 1))
        spreads = [
            Spread(float(r), float(p)) if n else Spread(None, None)
            for n, r, p in zip(self._count, rms, self._peaks, strict=True)
        ]
        columns = [AXES.index(name) for name in names]
        return {AXES[i]: Axis(spreads[i], spreads[i + 6], spreads[i + 12]) for i in columns}

    def _reduce(self) -> None:
        if self._rows:
            rows: NDArray[np.float64] = np.abs(np.array(self._rows))
            self._rows.clear()
            self._count += (~np.isnan(rows)).sum(axis=0)
            self._squares += np.nansum(rows * rows, axis=0)
            self._peaks = np.fmax(self._peaks, np.fmax.reduce(rows))

"""The rows of a replay: lines of estimates.csv, and a scratch file of the numbers for statistics and figures."""

import math
import struct
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.phases import Phase
from rft_ros.estimator import Estimate, Measurement, NoEstimate, Wrench
from rft_ros.estimator.learning import Belief
from rft_ros.estimator.quality import flag_names

__all__ = ["AXES", "COLUMNS", "LEARNED_COLUMNS", "PHASES", "ROW", "Trace", "csv_row", "learned_numbers"]

AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
"""Components of a wrench: force [N], torque [N m]."""

COLUMNS = (
    "t",
    "depth",
    "speed",
    *(f"{kind}_{axis}" for kind in ("predicted", "compensated", "residual", "sigma") for axis in AXES),
    "reason",
    "generation",
    "phase",
    "quality_flags",
)
"""Header stamp [s]; depth of the tool's lowest point below the surface [m], negative above it; upper bound on the
plates' speeds [m/s]; wrenches in the sensor frame [N], [N m], and one standard deviation of the predicted; or the
reason for no estimate; generation of the model; `Phase`, empty where the pose or its velocity is unknown; names of
`QualityFlag`s, joined by +."""

_BELIEF = ("vertical_strength", "horizontal_strength", "turn", "surface")

LEARNED_COLUMNS = (*_BELIEF, *(f"{name}_error" for name in _BELIEF), "surprise")
"""Further columns where the medium is learned, as `Belief` has them: turn [rad], surface [m]; their errors."""

_SIX = ",%.9g" * 6
_FULL = "%d.%09d,%.9g,%.9g" + 4 * _SIX + ",,%d%s\n"
_WITHOUT_WRENCH = "%d.%09d,%.9g,%.9g" + _SIX + 12 * "," + _SIX + ",,%d%s\n"


def learned_numbers(b: Belief) -> tuple[float, ...]:
    """The numbers of `LEARNED_COLUMNS`."""
    return tuple(getattr(b, name) for name in LEARNED_COLUMNS)


def csv_row(
    depth: float | None,
    answer: Estimate | NoEstimate,
    measurement: Measurement | None,
    phase: Phase | None,
    learned: tuple[float, ...] = (),
) -> str:
    """One line of estimates.csv; `measurement`: the estimate's, None without one; `learned`: `learned_numbers`."""
    end = "".join(f",{number:.9g}" for number in learned)
    seconds, nanoseconds = divmod(answer.stamp, 1_000_000_000)
    if isinstance(answer, NoEstimate):
        place = "" if depth is None else f"{depth:.9g}"
        return f"{seconds}.{nanoseconds:09d},{place}{26 * ','}{answer.reason.value},{_end(phase, 0)}{end}\n"
    head = (seconds, nanoseconds, depth, answer.speed, *answer.predicted)
    tail = (answer.generation, _end(phase, answer.quality_flags) + end)
    if measurement is None or measurement.compensated is None or measurement.residual is None:
        return _WITHOUT_WRENCH % (*head, *answer.sigma, *tail)
    return _FULL % (*head, *measurement.compensated, *measurement.residual, *answer.sigma, *tail)


@cache
def _end(phase: Phase | None, quality_flags: int) -> str:
    return f",{phase.value if phase else ''},{'+'.join(flag_names(quality_flags))}"


PHASES = tuple(Phase)
"""The phases by their number in a row."""

ROW = np.dtype(
    [
        ("stamp", "<i8"),
        ("phase", "<i8"),
        ("quality_flags", "<i8"),
        ("depth", "<f8"),
        ("predicted", "<f8", 6),
        ("compensated", "<f8", 6),
        ("sigma", "<f8", 6),
        ("learned", "<f8", len(LEARNED_COLUMNS)),
        ("state", "<f8", 13),
    ]
)
"""A pose with a known depth: stamp [ns]; phase, an index into `PHASES` or -1; combined `QualityFlag`s; depth [m];
wrenches in the sensor frame and the standard deviation of the predicted one [N, N m], NaN if missing;
`learned_numbers`, NaN without learning; the estimator's state (columns `rft_ros.rft.STATE`)."""

_LAYOUT = struct.Struct("<3q28d")
_CODE = {phase: code for code, phase in enumerate(PHASES)} | {None: -1}
_NONE: Wrench = (math.nan,) * 6
_NOT_LEARNED = (math.nan,) * len(LEARNED_COLUMNS)


class Trace:
    """A scratch file of rows, which keeps memory constant; deleted at the end of the `with` block."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._rows = 0

    def __enter__(self) -> "Trace":
        self._file = tempfile.TemporaryFile(dir=self._folder)
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def add(
        self,
        depth: float,
        answer: Estimate | NoEstimate,
        measurement: Measurement | None,
        phase: Phase | None,
        state: bytes,
        learned: tuple[float, ...] = (),
    ) -> None:
        """Append a row; `state`: 13 float64; `learned`: `learned_numbers`."""
        self._rows += 1
        predicted, compensated, sigma, quality_flags = _NONE, _NONE, _NONE, 0
        if isinstance(answer, Estimate):
            predicted, sigma, quality_flags = answer.predicted, answer.sigma, answer.quality_flags
            if measurement is not None and measurement.compensated is not None:
                compensated = measurement.compensated
        wrenches = (*predicted, *compensated, *sigma)
        numbers = _LAYOUT.pack(answer.stamp, _CODE[phase], quality_flags, depth, *wrenches, *(learned or _NOT_LEARNED))
        self._file.write(numbers + state)

    def rows(self) -> NDArray[np.void]:
        """All rows in order, shape [n], read from the file as they are used; columns and units: `ROW`."""
        self._file.flush()
        return np.memmap(self._file, ROW, "r") if self._rows else np.empty(0, ROW)

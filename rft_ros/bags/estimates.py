"""The rows of a replay, written to estimates.csv and a bag of wrenches."""

import math
from array import array
from collections import Counter
from collections.abc import Sequence
from decimal import Decimal
from functools import cache
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.writing import BagWriter
from rft_ros.estimator import Estimate, Estimator, NoEstimate, Reason, flag_names
from rft_ros.estimator.learning import Belief
from rft_ros.messages import TYPES, stamped_cdr
from rft_ros.rft import AXES, STATE

_Array = NDArray[np.float64]
_Numbers = NDArray[np.int64]

PHASES = ("approach", "penetration", "ploughing", "dwell", "withdrawal")
"""The phases, which docs/replay.md defines, by their number in a row."""

AIR_PHASE = PHASES[0]
"""The phase in which the tool is above the surface."""

_PHASE_RADIUS_NS = 100_000_000  # before and after a moment in which its phase must prevail
_STEEP_SHARE = 0.1  # least share of the tool's speed that counts as down or up


def phases_of(
    stamps: _Numbers, depth: _Array, sinking: _Array, speed: _Array, rest_speed: float
) -> _Numbers:
    """Number in `PHASES` of the phase that prevails within 0.1 s of each of n moments; all shapes [n].

    `stamps` [ns]: one that goes back begins another run. `depth` of the lowest point [m], negative above the surface;
    `sinking`: its downward velocity; `speed` of the tool's fastest plate, `rest_speed` [m/s].
    """
    steep = np.maximum(rest_speed, _STEEP_SHARE * speed)
    cases = {  # the first that holds
        "withdrawal": -sinking >= steep,
        "approach": depth <= 0.0,
        "dwell": speed < rest_speed,
        "penetration": sinking >= steep,
    }
    codes = np.select([*cases.values()], [*map(PHASES.index, cases)], PHASES.index("ploughing"))
    steps = np.diff(stamps, prepend=stamps[:1])
    time = np.cumsum(
        np.where(steps < 0, 2 * _PHASE_RADIUS_NS, steps)
    )  # runs are out of each other's reach
    first = np.searchsorted(time, time - _PHASE_RADIUS_NS)
    end = np.searchsorted(time, time + _PHASE_RADIUS_NS, side="right")
    counts = []
    for code in range(len(PHASES)):
        total = np.append(0, np.cumsum(codes == code))
        counts.append(total[end] - total[first])
    return np.asarray(np.argmax(counts, axis=0))


_KINDS = ("predicted", "compensated", "residual", "sigma")
_WRENCH_COLUMNS = tuple(f"{kind}_{axis}" for kind in _KINDS for axis in AXES)
COLUMNS = (
    "t",
    "depth",
    "speed",
    *_WRENCH_COLUMNS,
    "reason",
    "generation",
    "phase",
    "quality_flags",
)
"""Columns of estimates.csv, which docs/replay.md describes: [s], [m], [m/s], [N], [N m]; empty where unknown."""

LEARNED_COLUMNS = tuple(name for name in Belief._fields if name not in ("path", "excess"))
"""Further columns if the medium is learned, fields of `Belief`."""

ROW = np.dtype([
    ("stamp", "<i8"),
    ("reason", "<i8"),
    ("phase", "<i8"),
    ("quality_flags", "<i8"),
    ("depth", "<f8"),
    ("speed", "<f8"),
    *((kind, "<f8", len(AXES)) for kind in _KINDS),
    ("learned", [(name, "<f8") for name in LEARNED_COLUMNS]),
    ("state", "<f8", len(STATE)),
])  # fmt: skip
"""The row of a pose.

`stamp` [ns]. `reason`: number of the `Reason`, -1 for an estimate. `phase`: its number, -1 for none. `quality_flags`:
combined `QualityFlag`s. `state`: columns `rft_ros.rft.STATE`. The others: units of `COLUMNS`, NaN where missing.
"""

Rows = NDArray[np.void]
"""Rows of a replay, shape [n], of type `ROW`."""

ESTIMATE = -1
"""In place of the number of a reason, in the row of a pose with an estimate."""

_MISSING_PHASE = -1
_REASONS = tuple(Reason)
_REASONS_WITH_STATE = (
    ESTIMATE,
    _REASONS.index(Reason.AT_REST),
)  # answers at which state and depth are known
_NONE = (math.nan,) * len(AXES)
_NAMES = ROW.names or ()
_EMPTY = dict.fromkeys(_NAMES, math.nan)
_EMPTY |= {"reason": ESTIMATE, "phase": _MISSING_PHASE, "quality_flags": 0}


class ReplayTable:
    """An estimator and a row for each of its answers.

    The rows are in unnamed files in `folder` (None: the system's for temporary files) and not in RAM: an hour at 1 kHz
    makes 1.5 GB.
    """

    def __init__(self, estimator: Estimator, folder: Path | None = None) -> None:
        self.estimator = estimator
        self.issues: Counter[str] = Counter()
        """For each issue of the estimator, the number of answers at which it was present."""
        self._rows = TemporaryFile(dir=folder)  # noqa: SIM115
        self._row = np.empty(1, ROW)
        # of the estimates in order, which are measured later
        self._compensated = TemporaryFile(dir=folder)  # noqa: SIM115

    def add(self, answer: Estimate | NoEstimate) -> None:
        """Add the estimator's last answer."""
        estimator = self.estimator
        self.issues.update(estimator.issues())
        # one assignment of all fields takes a fifth of the time of one for each
        row: dict[str, object] = dict(_EMPTY)
        row["stamp"] = answer.stamp
        if isinstance(answer, Estimate):
            row["quality_flags"] = answer.quality_flags
            row["speed"] = answer.speed_bound
            row["predicted"] = answer.predicted
            row["sigma"] = answer.sigma
        else:
            row["reason"] = _REASONS.index(answer.reason)
        if row["reason"] in _REASONS_WITH_STATE:
            row["depth"] = estimator.surface.depth
        if estimator.learning:
            belief = estimator.learning.belief()
            row["learned"] = tuple([getattr(belief, name) for name in LEARNED_COLUMNS])
        row["state"] = estimator.state
        self._row[0] = tuple(row.values())
        self._rows.write(self._row.tobytes())
        self._add_measurements()

    def _add_measurements(self) -> None:
        for measurement in self.estimator.measurements():
            self._compensated.write(array("d", measurement.compensated or _NONE).tobytes())

    def rows(self) -> Rows:
        """The rows of all answers in order, shape [n], with measurements and phases, as a map of their file."""
        estimator = self.estimator
        estimator.finish()
        self._add_measurements()
        rows = _mapped(self._rows, ROW)
        wrenches = _mapped(self._compensated, np.dtype("<f8")).reshape(-1, len(AXES))
        rows["compensated"][rows["reason"] == ESTIMATE] = wrenches
        rows["residual"] = rows["compensated"] - rows["predicted"]
        moments = np.flatnonzero(np.isin(rows["reason"], _REASONS_WITH_STATE))
        height, sinking = estimator.model.tool.lowest_points(rows["state"][moments])
        if estimator.ground is None:
            rows["depth"][moments] = estimator.config.surface_height - height
        rows["phase"][moments] = phases_of(
            rows["stamp"][moments],
            depth=rows["depth"][moments],
            sinking=sinking,
            speed=np.nan_to_num(rows["speed"][moments]),
            rest_speed=estimator.config.inputs.rest_speed,
        )
        return rows


def _mapped(file: IO[bytes], kind: np.dtype[Any]) -> NDArray[Any]:
    """The content of a file as an array, which the system reads and writes as it is needed."""
    file.flush()
    if not file.tell():  # which cannot be mapped
        return np.empty(0, kind)
    return np.asarray(np.memmap(file, kind, "r+"))


def write_estimates(table: ReplayTable, rows: Rows, folder: Path, *, shift: int = 0) -> None:
    """Write ``estimates.csv`` (`COLUMNS`) and the bag ``estimates`` with the wrenches of a table's rows, shape [n].

    `shift`: how much later the stamps are than the times in the table that was replayed [ns].
    """
    learned_columns = LEARNED_COLUMNS if table.estimator.learning else ()
    generation = table.estimator.model.generation
    in_frame = stamped_cdr(table.estimator.wrench_frame)
    file = folder / "estimates.csv"
    with (
        BagWriter(folder / "estimates") as bag,
        file.open("w", encoding="utf-8", newline="\n") as out,
    ):
        out.write(",".join(COLUMNS + learned_columns) + "\n")
        for values in rows:
            row = dict(zip(_NAMES, values.tolist(), strict=True))
            stamp = row["stamp"]
            numbers = [row["depth"], row["speed"]]
            for kind in _KINDS:
                wrench = row[kind].tolist()
                numbers += wrench
                if not math.isnan(wrench[0]):
                    cdr = in_frame(stamp, wrench)
                    bag.write_raw(f"/rft/wrench_{kind}", TYPES["wrench"][0], stamp, cdr)
            is_estimate = row["reason"] == ESTIMATE
            cells = [
                f"{Decimal(stamp - shift).scaleb(-9):.9f}",
                _cells(numbers),
                "" if is_estimate else _REASONS[row["reason"]].value,
                str(generation) if is_estimate else "",
                "" if row["phase"] == _MISSING_PHASE else PHASES[row["phase"]],
                _flags(row["quality_flags"]),
            ]
            if learned_columns:
                cells.append(_cells(row["learned"]))
            out.write(",".join(cells) + "\n")


def _cells(numbers: Sequence[float]) -> str:
    """Cells of numbers; that of NaN is empty."""
    return (",".join(["%.9g"] * len(numbers)) % tuple(numbers)).replace("nan", "")


@cache
def _flags(quality_flags: int) -> str:
    return "+".join(flag_names(quality_flags))

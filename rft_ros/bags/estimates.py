"""The rows of a replay: kept in a scratch file while it runs, then written to estimates.csv and a bag of wrenches."""

import math
from collections import Counter
from functools import cache
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.writing import BagWriter
from rft_ros.estimator import Estimate, Estimator, NoEstimate, Reason, flag_names
from rft_ros.messages import TYPES, stamped_cdr
from rft_ros.rft import AXES, STATE

_Array = NDArray[np.float64]
_Numbers = NDArray[np.int64]

PHASES = ("approach", "penetration", "ploughing", "dwell", "withdrawal")
"""The phases, which docs/replay.md defines, by their number in a row."""

_AROUND = 100_000_000  # ns before and after a moment in which its phase must prevail
_STEEP = 0.1  # least share of the tool's speed that counts as down or up


def phases_of(
    stamps: _Numbers, depth: _Array, sinking: _Array, speed: _Array, rest_speed: float
) -> _Numbers:
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
    begins = np.flatnonzero(np.diff(stamps) < 0) + 1
    for run in np.split(np.arange(len(stamps)), begins):
        phases[run] = _prevailing(stamps[run], seen[run])
    return phases


def _prevailing(stamps: _Numbers, seen: _Numbers) -> _Numbers:
    """The phase that is seen most often around each moment of one run, shape [n]."""
    first = np.searchsorted(stamps, stamps - _AROUND)
    after = np.searchsorted(stamps, stamps + _AROUND, side="right")
    counts = []
    for code in range(len(PHASES)):
        total = np.append(0, np.cumsum(seen == code))
        counts.append(total[after] - total[first])
    prevailing: _Numbers = np.argmax(counts, axis=0)
    return prevailing


_KINDS = ("predicted", "compensated", "residual", "sigma")
_OF_WRENCHES = tuple(f"{kind}_{axis}" for kind in _KINDS for axis in AXES)
COLUMNS = ("t", "depth", "speed", *_OF_WRENCHES, "reason", "generation", "phase", "quality_flags")
"""Columns of estimates.csv, which docs/replay.md describes: [s], [m], [m/s], [N], [N m]; empty where unknown."""

_BELIEF = ("vertical_strength", "horizontal_strength", "turn", "surface")

LEARNED_COLUMNS = (*_BELIEF, *(f"{name}_error" for name in _BELIEF), "surprise")
"""Further columns if the medium is learned, fields of `Belief`: turn [rad], surface [m]; standard errors; surprise."""

ROW = np.dtype([
    ("stamp", "<i8"),
    ("reason", "<i8"),
    ("phase", "<i8"),
    ("quality_flags", "<i8"),
    ("depth", "<f8"),
    ("speed", "<f8"),
    ("predicted", "<f8", len(AXES)),
    ("sigma", "<f8", len(AXES)),
    ("compensated", "<f8", len(AXES)),
    ("learned", "<f8", len(LEARNED_COLUMNS)),
    ("state", "<f8", len(STATE)),
])  # fmt: skip
"""The row of a pose.

`stamp` [ns]. `reason`: number of the `Reason`, -1 for an estimate. `phase`: its number, -1 for none. `quality_flags`:
combined `QualityFlag`s. `state`: columns `rft_ros.rft.STATE`. The others: units of `COLUMNS`, NaN where missing.
"""

Rows = NDArray[np.void]
"""Rows of a replay, shape [n], of type `ROW`."""

_REASONS = tuple(Reason)
_ESTIMATE = -1  # in place of the number of a reason
_NO_PHASE = -1
_PLACED = (_ESTIMATE, _REASONS.index(Reason.AT_REST))  # answers at which state and depth are known
_NONE = (math.nan,) * len(AXES)
_EMPTY = np.array(
    (0, 0, _NO_PHASE, 0, math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, math.nan), ROW
)
_BLOCK = 512  # rows in memory at a time


class Run:
    """An estimator and a row for each of its answers. The rows are in unnamed files in `folder`, and not in memory."""

    def __init__(self, estimator: Estimator, folder: Path | None = None) -> None:
        self.estimator = estimator
        self.issues: Counter[str] = Counter()
        """For each issue of the estimator, the number of answers at which it was present."""
        self._answers = TemporaryFile(dir=folder)  # noqa: SIM115
        self._measured = TemporaryFile(dir=folder)  # noqa: SIM115

    def add(self, answer: Estimate | NoEstimate) -> None:
        """Add the estimator's last answer."""
        estimator = self.estimator
        self.issues.update(estimator.issues())
        row = _EMPTY.copy()
        row["stamp"] = answer.stamp
        if isinstance(answer, Estimate):
            row["reason"] = _ESTIMATE
            row["quality_flags"] = answer.quality_flags
            row["speed"] = answer.speed_bound
            row["predicted"] = answer.predicted
            row["sigma"] = answer.sigma
        else:
            row["reason"] = _REASONS.index(answer.reason)
        if row["reason"] in _PLACED:
            row["depth"] = estimator.surface.depth
        if estimator.learning:
            belief = estimator.learning.belief()
            row["learned"] = [getattr(belief, name) for name in LEARNED_COLUMNS]
        row["state"] = estimator.state
        self._answers.write(row.tobytes())
        self._write_measurements()

    def _write_measurements(self) -> None:
        for measurement in self.estimator.measurements():
            self._measured.write(np.array(measurement.compensated or _NONE, "<f8").tobytes())

    def rows(self) -> Rows:
        """The rows of all answers in order, shape [n], with measurements and phases, as a memory map of the file."""
        estimator = self.estimator
        estimator.finish()
        self._write_measurements()
        self._answers.flush()
        self._measured.flush()
        if not self._answers.tell():
            return np.empty(0, ROW)
        rows = np.memmap(self._answers, ROW, "r+")
        if self._measured.tell():
            rows["compensated"][rows["reason"] == _ESTIMATE] = np.memmap(
                self._measured, "<f8", "r"
            ).reshape(-1, 6)
        known = np.flatnonzero(np.isin(rows["reason"], _PLACED))
        sinking = np.empty(len(known))
        for start in range(0, len(known), _BLOCK):
            block = known[start : start + _BLOCK]
            height, sinking[start : start + _BLOCK] = estimator.model.tool.lowest_points(
                rows["state"][block]
            )
            if estimator.ground is None:
                rows["depth"][block] = estimator.settings.surface_height - height
        rows["phase"][known] = phases_of(
            rows["stamp"][known],
            depth=rows["depth"][known],
            sinking=sinking,
            speed=np.nan_to_num(rows["speed"][known]),
            rest_speed=estimator.settings.rest_speed,
        )
        return rows


def write_estimates(run: Run, rows: Rows, folder: Path, *, shift: int = 0) -> None:
    """Write ``estimates.csv`` (`COLUMNS`) and the bag ``estimates`` with the wrenches of a run's rows, shape [n].

    `shift`: how much later the stamps are than the times in the table that was replayed [ns].
    """
    learned = LEARNED_COLUMNS if run.estimator.learning else ()
    generation = run.estimator.model.generation
    in_frame = stamped_cdr(run.estimator.wrench_frame)
    file = folder / "estimates.csv"
    with (
        BagWriter(folder / "estimates") as bag,
        file.open("w", encoding="utf-8", newline="\n") as table,
    ):
        table.write(",".join(COLUMNS + learned) + "\n")
        for start in range(0, len(rows), _BLOCK):
            block = rows[start : start + _BLOCK]
            columns = {name: block[name].tolist() for name in _WRITTEN}
            columns["residual"] = (block["compensated"] - block["predicted"]).tolist()
            for values in zip(*columns.values(), strict=True):
                row = dict(zip(columns, values, strict=True))
                table.write(_line(row, generation=generation, learned=len(learned), shift=shift))
                for kind in _KINDS:
                    if not math.isnan(row[kind][0]):
                        cdr = in_frame(row["stamp"], row[kind])
                        bag.write_raw(f"/rft/wrench_{kind}", TYPES["wrench"][0], row["stamp"], cdr)


_WRITTEN = [name for name in ROW.names or () if name != "state"]


def _line(row: dict[str, Any], *, generation: int, learned: int, shift: int) -> str:
    """The line of a row in the table. `learned`: how many of its columns there are."""
    time = row["stamp"] - shift
    seconds, nanoseconds = divmod(abs(time), 1_000_000_000)
    numbers = [row["depth"], row["speed"]]
    for kind in _KINDS:
        numbers += row[kind]
    is_estimate = row["reason"] == _ESTIMATE
    cells = [
        f"{'-' if time < 0 else ''}{seconds}.{nanoseconds:09d}",
        *map(_cell, numbers),
        "" if is_estimate else _REASONS[row["reason"]].value,
        str(generation) if is_estimate else "",
        "" if row["phase"] == _NO_PHASE else PHASES[row["phase"]],
        _flags(row["quality_flags"]),
        *map(_cell, row["learned"][:learned]),
    ]
    return ",".join(cells) + "\n"


def _cell(number: float) -> str:
    return "" if math.isnan(number) else f"{number:.9g}"


@cache
def _flags(quality_flags: int) -> str:
    return "+".join(flag_names(quality_flags))

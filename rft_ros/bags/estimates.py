"""The rows of a replay: kept in a scratch file while it runs, then written to estimates.csv and a bag of wrenches."""

import math
import struct
from collections import Counter
from functools import cache
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.writing import BagWriter
from rft_ros.estimator import Estimate, Estimator, NoEstimate, Reason
from rft_ros.estimator.quality import flag_names
from rft_ros.messages import TYPES, stamped_cdr
from rft_ros.rft import AXES

__all__ = ["COLUMNS", "LEARNED_COLUMNS", "PHASES", "ROW", "Rows", "Run", "phases_of", "write_estimates"]

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


_KINDS = ("predicted", "compensated", "residual", "sigma")
_OF_WRENCHES = tuple(f"{kind}_{axis}" for kind in _KINDS for axis in AXES)
COLUMNS = ("t", "depth", "speed", *_OF_WRENCHES, "reason", "generation", "phase", "quality_flags")
"""Columns of estimates.csv, which docs/replay.md describes: [s], [m], [m/s], [N], [N m]; empty where unknown."""

_BELIEF = ("vertical_strength", "horizontal_strength", "turn", "surface")

LEARNED_COLUMNS = (*_BELIEF, *(f"{name}_error" for name in _BELIEF), "surprise")
"""Further columns if the medium is learned, fields of `Belief`: turn [rad], surface [m]; standard errors; surprise."""

ROW = np.dtype([
    *((name, "<i8") for name in ("stamp", "reason", "phase", "quality_flags")),
    *((name, "<f8") for name in ("depth", "speed")),
    *((name, "<f8", 6) for name in ("predicted", "sigma", "compensated")),
    ("learned", "<f8", len(LEARNED_COLUMNS)),
    ("state", "<f8", 13),
])  # fmt: skip
"""The row of a pose.

`stamp` [ns]. `reason`: number of the `Reason`, -1 for an estimate. `phase`: its number, -1 for none. `quality_flags`:
combined `QualityFlag`s. `state`: columns `rft_ros.rft.STATE`. The others: units of `COLUMNS`, NaN where missing.
"""

Rows = NDArray[np.void]
"""Rows of a replay, shape [n], of type `ROW`."""

_REASONS = tuple(Reason)
_ESTIMATE, _NO_PHASE = -1, -1  # in place of the number of a reason or a phase
_PLACED = (_ESTIMATE, _REASONS.index(Reason.AT_REST))  # answers at which state and depth are known
_HEAD, _WRENCH = struct.Struct("<4q29d"), struct.Struct("<6d")
_NONE = (math.nan,) * 6
_NOT_LEARNED = (math.nan,) * len(LEARNED_COLUMNS)
_BLOCK = 512  # rows in memory at a time
_NUMBERS = ",%.9g" * (2 + len(_OF_WRENCHES))


class Run:
    """An estimator and a row for each of its answers. The rows are in unnamed files in `folder`, and not in memory."""

    def __init__(self, estimator: Estimator, folder: Path | None = None) -> None:
        self.estimator = estimator
        self.issues: Counter[str] = Counter()
        """For each issue of the estimator, the number of answers at which it was present."""
        self._answers, self._measured = (TemporaryFile(dir=folder) for _ in range(2))  # noqa: SIM115

    def add(self, answer: Estimate | NoEstimate) -> None:
        """Add the estimator's last answer."""
        e, learned = self.estimator, _NOT_LEARNED
        if e.learning:
            belief = e.learning.belief()
            learned = tuple(getattr(belief, name) for name in LEARNED_COLUMNS)
        self.issues.update(e.issues())
        if isinstance(answer, Estimate):
            reason, flags, speed = _ESTIMATE, answer.quality_flags, answer.speed_bound
            predicted, sigma = answer.predicted, answer.sigma
        else:
            reason, flags, speed = _REASONS.index(answer.reason), 0, math.nan
            predicted = sigma = _NONE
        depth = e.surface.depth if reason in _PLACED else math.nan
        numbers = (depth, speed, *predicted, *sigma, *_NONE, *learned)  # in the order of `ROW`
        self._answers.write(_HEAD.pack(answer.stamp, reason, _NO_PHASE, flags, *numbers))
        self._answers.write(e.state.tobytes())
        self._write_measurements()

    def _write_measurements(self) -> None:
        for measurement in self.estimator.measurements():
            self._measured.write(_WRENCH.pack(*(measurement.compensated or _NONE)))

    def rows(self) -> Rows:
        """The rows of all answers in order, shape [n], with measurements and phases, as a memory map of the file."""
        e = self.estimator
        e.finish()
        self._write_measurements()
        for file in (self._answers, self._measured):
            file.flush()
        if not self._answers.tell():
            return np.empty(0, ROW)
        rows = np.memmap(self._answers, ROW, "r+")
        if self._measured.tell():
            rows["compensated"][rows["reason"] == _ESTIMATE] = np.memmap(self._measured, "<f8", "r").reshape(-1, 6)
        known = np.flatnonzero(np.isin(rows["reason"], _PLACED))
        sinking = np.empty(len(known))
        for start in range(0, len(known), _BLOCK):
            block = known[start : start + _BLOCK]
            height, sinking[start : start + _BLOCK] = e.model.tool.lowest_points(rows["state"][block])
            if e.ground is None:
                rows["depth"][block] = e.settings.surface_height - height
        stamps, depth, speed = (rows[name][known] for name in ("stamp", "depth", "speed"))
        rows["phase"][known] = phases_of(stamps, depth, sinking, np.nan_to_num(speed), e.settings.rest_speed)
        return rows


def write_estimates(run: Run, rows: Rows, folder: Path, *, shift: int = 0) -> None:
    """Write ``estimates.csv`` (`COLUMNS`) and the bag ``estimates`` with the wrenches of a run's rows, shape [n].

    `shift`: how much later the stamps are than the times in the table that was replayed [ns].
    """
    frame, generation = run.estimator.wrench_frame, run.estimator.model.generation
    learned, in_frame = LEARNED_COLUMNS if run.estimator.learning else (), stamped_cdr(frame)
    names = ("stamp", "reason", "phase", "quality_flags", "depth", "speed", "predicted", "compensated", "sigma")
    file = folder / "estimates.csv"
    with BagWriter(folder / "estimates") as bag, file.open("w", encoding="utf-8", newline="\n") as table:
        table.write(",".join(COLUMNS + learned) + "\n")
        for start in range(0, len(rows), _BLOCK):
            block = np.array(rows[start : start + _BLOCK])
            columns = [*(block[name] for name in names), block["compensated"] - block["predicted"], block["learned"]]
            for row in zip(*(column.tolist() for column in columns), strict=True):
                stamp, reason, phase, flags, depth, speed, predicted, compensated, sigma, residual, belief = row
                seconds, nanoseconds = divmod(abs(stamp - shift), 1_000_000_000)
                time = f"{'-' if stamp < shift else ''}{seconds}.{nanoseconds:09d}"
                numbers = _NUMBERS % (depth, speed, *predicted, *compensated, *residual, *sigma)
                answer = f",{generation}" if reason < 0 else f"{_REASONS[reason].value},"
                end = _end(phase, flags) + "".join(f",{number:.9g}" for number in belief[: len(learned)])
                table.write(f"{time}{numbers.replace('nan', '')},{answer}{end}\n")
                wrenches = {} if reason >= 0 else {"predicted": predicted, "sigma": sigma}
                if not math.isnan(compensated[0]):
                    wrenches |= {"compensated": compensated, "residual": residual}
                for kind, wrench in wrenches.items():
                    bag.write_raw(f"/rft/wrench_{kind}", TYPES["wrench"][0], stamp, in_frame(stamp, wrench))


@cache
def _end(phase: int, quality_flags: int) -> str:
    return f",{PHASES[phase] if phase >= 0 else ''},{'+'.join(flag_names(quality_flags))}"

"""Statistics of a replay: magnitudes of wrenches, overall, by phase and by depth; counts of quality flags."""

import itertools
import math
from collections import Counter
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.estimates import AXES, PHASES, Trace
from rft_ros.bags.phases import Phase
from rft_ros.estimator.quality import Trust, flag_names, trust

__all__ = ["Axis", "Group", "PhaseGroup", "Spread", "count_flags", "statistics"]

_NAMES = (*AXES, "force", "torque")
_LEAST_SHARE = 0.2
_MOST_BINS = 10
_IN_GRAINS = (Phase.PENETRATION, Phase.PLOUGHING, Phase.WITHDRAWAL)

_RATIOS = np.concatenate([[0.0], np.geomspace(1e-4, 1e4, 7370)])
"""Bins of relative errors, 0.25 % wide, so that the median takes constant memory."""

_Block = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Spread:
    """Root mean square, greatest magnitude and mean of one axis, [N] or [N m]; None without values."""

    rms: float | None
    peak: float | None
    mean: float | None


@dataclass(frozen=True, slots=True)
class Axis:
    """One axis of the wrench in the sensor frame: measured (compensated), predicted, and measured minus predicted.

    "force" and "torque" are magnitudes; their `residual` is the magnitude of the difference.
    """

    measured: Spread
    predicted: Spread
    residual: Spread


@dataclass(frozen=True, slots=True)
class Group:
    """Statistics of some estimates.

    `wrench`: by axis. `rms_over_peak`: RMS residual force over the group's greatest measured force.
    `median_relative_error`: median of residual over measured force (magnitudes), to 0.25 %, over estimates whose
    measured force exceeds 20 % of the replay's greatest. `within_sigma`, `within_two_sigma`: share of the measured
    force's components, in the grains, within one and two standard deviations of the prediction. None without values.
    """

    estimates: int
    wrench: dict[str, Axis]
    rms_over_peak: float | None
    median_relative_error: float | None
    within_sigma: float | None
    within_two_sigma: float | None


@dataclass(frozen=True, slots=True)
class PhaseGroup(Group):
    """Statistics of a phase. `poses`: with and without estimate. `depth_bins`: by names such as ``5-10mm``."""

    poses: int
    depth_bins: dict[str, Group]


_Group = TypeVar("_Group", bound=Group)


class _Sums:
    """Sums over blocks of estimates with the columns of `_columns`, shape [n, 27]."""

    def __init__(self) -> None:
        self.poses = 0
        self.estimates = 0
        self._count = np.zeros(24, dtype=np.int64)
        self._sum, self._squares, self._peaks = np.zeros(24), np.zeros(24), np.zeros(24)
        self._scores, self._within = 0, np.zeros(2, dtype=np.int64)
        self._ratios = np.zeros(len(_RATIOS) - 1, dtype=np.int64)

    def add(self, rows: _Block, least_force: float) -> None:
        self.estimates += len(rows)
        rows, scores = rows[:, :24], rows[:, 24:]  # see `_columns`
        known = ~np.isnan(rows)
        values = np.where(known, rows, 0.0)
        self._scores += int((~np.isnan(scores)).sum())
        self._within += [(scores < 1.0).sum(), (scores < 2.0).sum()]
        self._count += known.sum(axis=0)
        self._sum += values.sum(axis=0)
        self._squares += (values * values).sum(axis=0)
        self._peaks = np.maximum(self._peaks, np.abs(values).max(axis=0, initial=0.0))
        force, residual = rows[:, 6], rows[:, 22]  # magnitudes: of the measured force and of its residual
        big = force > least_force
        self._ratios += np.histogram(np.minimum(residual[big] / force[big], _RATIOS[-1]), _RATIOS)[0]

    def group(self, kind: type[_Group], **more: Any) -> _Group:
        """Statistics of all blocks, as a Group or, with `more` fields, a PhaseGroup."""
        n = np.maximum(self._count, 1)
        numbers = np.array([np.sqrt(self._squares / n), self._peaks, self._sum / n]).T.tolist()
        spreads = [Spread(*v) if c else Spread(None, None, None) for v, c in zip(numbers, self._count, strict=True)]
        axes = {name: Axis(spreads[i], spreads[i + 8], spreads[i + 16]) for i, name in enumerate(_NAMES)}
        rms, peak = axes["force"].residual.rms, axes["force"].measured.peak
        one, two = (self._within / self._scores).tolist() if self._scores else (None, None)
        ratio = rms / peak if rms is not None and peak else None
        return kind(self.estimates, axes, ratio, self._median(), one, two, **more)

    def _median(self) -> float | None:
        counts = np.cumsum(self._ratios)
        if not counts[-1]:
            return None
        middle = counts[-1] / 2.0
        k = int(np.searchsorted(counts, middle))
        into = (middle - (counts[k] - self._ratios[k])) / self._ratios[k]
        return float(_RATIOS[k] + into * (_RATIOS[k + 1] - _RATIOS[k]))


def _columns(block: NDArray[np.void]) -> _Block:
    """Measured, predicted, residual, eight columns each (`_NAMES`), then force residual over sigma, shape [n, 27].

    NaN if missing.
    """
    measured, predicted = block["compensated"], block["predicted"]
    parts = []
    for wrench in (measured, predicted, measured - predicted):
        parts += [wrench, *(np.linalg.norm(wrench[:, k : k + 3], axis=1)[:, None] for k in (0, 3))]
    in_grains = np.any(predicted[:, :3], axis=1, keepdims=True)
    scores = np.abs(measured - predicted)[:, :3] / block["sigma"][:, :3]
    return np.hstack([*parts, np.where(in_grains, scores, math.nan)])


def _bin_edges(deepest: float) -> _Block:
    """Edges [m] of at most ten bins from 0 to `deepest`, whose width is 1, 2 or 5 times a power of ten."""
    if not deepest > 0.0:
        return np.zeros(1)
    power = math.floor(math.log10(deepest / _MOST_BINS))
    exponents = range(power, power + 2)
    width = next(
        w for e in exponents for w in (10.0**e, 2 * 10.0**e, 5 * 10.0**e) if deepest / w <= _MOST_BINS * (1 + 1e-9)
    )
    return np.arange(math.ceil(deepest / width * (1 - 1e-9)) + 1, dtype=np.float64) * width


def statistics(trace: Trace) -> tuple[Group, dict[str, PhaseGroup]]:
    """Statistics of all estimates, and of each phase by name; of phases in the grains also by depth."""
    deepest = largest = 0.0
    for block in trace.blocks():
        force = np.linalg.norm(block["compensated"][:, :3], axis=1)
        largest = max(largest, float(np.fmax.reduce(force, initial=0.0)))
        answered = ~np.isnan(block["predicted"][:, 0])
        deepest = max(deepest, float(block["depth"][answered].max(initial=0.0)))
    edges = _bin_edges(deepest)
    least_force = _LEAST_SHARE * largest
    whole = _Sums()
    phases = {phase: _Sums() for phase in PHASES}
    bins = {phase: [_Sums() for _ in edges[1:]] for phase in _IN_GRAINS}
    for block in trace.blocks():
        rows = _columns(block)
        answered, depth = ~np.isnan(block["predicted"][:, 0]), block["depth"]
        in_bin = (np.digitize(depth, edges[1:-1]) == np.arange(len(edges) - 1)[:, None]) & (depth > 0.0)
        whole.add(rows[answered], least_force)
        for code, phase in enumerate(PHASES):
            in_phase = block["phase"] == code
            phases[phase].poses += int(in_phase.sum())
            phases[phase].add(rows[in_phase & answered], least_force)
            for k, sums in enumerate(bins.get(phase, ())):
                sums.add(rows[in_phase & answered & in_bin[k]], least_force)
    names = [f"{low:g}-{high:g}mm" for low, high in itertools.pairwise(1e3 * edges)]
    groups = {}
    for phase, sums in phases.items():
        by_depth = {n: b.group(Group) for n, b in zip(names, bins.get(phase, ()), strict=False) if b.estimates}
        groups[str(phase)] = sums.group(PhaseGroup, poses=sums.poses, depth_bins=by_depth)
    return whole.group(Group), groups


def count_flags(trace: Trace) -> tuple[dict[str, int], dict[str, int]]:
    """Number of estimates by the name of each `QualityFlag`, and by `Trust`; zeros included."""
    sets: Counter[int] = Counter()
    for block in trace.blocks():
        answered = ~np.isnan(block["predicted"][:, 0])
        found, counts = np.unique(block["quality_flags"][answered], return_counts=True)
        sets.update(dict(zip(found.tolist(), counts.tolist(), strict=True)))
    by_flag = dict.fromkeys(flag_names(-1), 0)  # -1: all flags
    by_trust = {level.value: 0 for level in Trust}
    for quality_flags, count in sets.items():
        by_trust[trust(quality_flags).value] += count
        for name in flag_names(quality_flags):
            by_flag[name] += count
    return by_flag, by_trust

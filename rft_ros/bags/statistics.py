"""Statistics of a replay: magnitudes of wrenches, overall, by phase and by depth; counts of quality flags."""

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.estimates import AXES, PHASES
from rft_ros.bags.phases import Phase
from rft_ros.estimator.quality import Trust, flag_names, trust

__all__ = ["Axis", "Group", "PhaseGroup", "Spread", "count_flags", "statistics"]

_NAMES = (*AXES, "force", "torque")
_LEAST_SHARE = 0.2
_MOST_BINS = 10
_IN_GRAINS = (Phase.PENETRATION, Phase.PLOUGHING, Phase.WITHDRAWAL)


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
    `median_relative_error`: median of residual over measured force (magnitudes) over estimates whose
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


def _spread(values: NDArray[np.float64]) -> Spread:
    known = values[~np.isnan(values)]
    if not len(known):
        return Spread(None, None, None)
    rms = math.sqrt(float(np.mean(known * known)))
    return Spread(rms, float(np.abs(known).max()), float(known.mean()))


def _fields(rows: NDArray[np.void], chosen: NDArray[np.bool_], least_force: float) -> dict[str, Any]:
    """The fields of a `Group` of the chosen rows; forces over `least_force` [N] have a relative error."""
    measured, predicted = rows["compensated"][chosen], rows["predicted"][chosen]
    wrenches = (measured, predicted, measured - predicted)
    columns = [[*w.T, *(np.linalg.norm(w[:, k : k + 3], axis=1) for k in (0, 3))] for w in wrenches]
    axes = {name: Axis(*map(_spread, parts)) for name, *parts in zip(_NAMES, *columns, strict=True)}
    rms, peak = axes["force"].residual.rms, axes["force"].measured.peak
    force, residual = columns[0][6], columns[2][6]
    big = force > least_force
    scores = np.abs(wrenches[2][:, :3]) / rows["sigma"][chosen][:, :3]
    scores = scores[np.any(predicted[:, :3], axis=1)]
    scores = scores[~np.isnan(scores)]
    return {
        "estimates": len(measured),
        "wrench": axes,
        "rms_over_peak": rms / peak if rms is not None and peak else None,
        "median_relative_error": float(np.median(residual[big] / force[big])) if big.any() else None,
        "within_sigma": float(np.mean(scores < 1.0)) if len(scores) else None,
        "within_two_sigma": float(np.mean(scores < 2.0)) if len(scores) else None,
    }


def _bin_edges(deepest: float) -> NDArray[np.float64]:
    """Edges [m] of at most ten bins from 0 to `deepest`, whose width is 1, 2 or 5 times a power of ten."""
    if not deepest > 0.0:
        return np.zeros(1)
    power = math.floor(math.log10(deepest / _MOST_BINS))
    exponents = range(power, power + 2)
    width = next(
        w for e in exponents for w in (10.0**e, 2 * 10.0**e, 5 * 10.0**e) if deepest / w <= _MOST_BINS * (1 + 1e-9)
    )
    return np.arange(math.ceil(deepest / width * (1 - 1e-9)) + 1, dtype=np.float64) * width


def statistics(rows: NDArray[np.void]) -> tuple[Group, dict[str, PhaseGroup]]:
    """Statistics of all estimates, and of each phase by name; of phases in the grains also by depth.

    `rows`: shape [n], columns `rft_ros.bags.estimates.ROW`.
    """
    answered, depth = ~np.isnan(rows["predicted"][:, 0]), rows["depth"]
    largest = float(np.fmax.reduce(np.linalg.norm(rows["compensated"][:, :3], axis=1), initial=0.0))
    edges = _bin_edges(float(depth[answered].max(initial=0.0)))
    in_bin = np.where(depth > 0.0, np.digitize(depth, edges[1:-1]), -1)
    groups = {}
    for code, phase in enumerate(PHASES):
        in_phase, by_depth = rows["phase"] == code, {}
        for k, (low, high) in enumerate(itertools.pairwise(1e3 * edges) if phase in _IN_GRAINS else ()):
            chosen = in_phase & answered & (in_bin == k)
            if chosen.any():
                by_depth[f"{low:g}-{high:g}mm"] = Group(**_fields(rows, chosen, _LEAST_SHARE * largest))
        own = _fields(rows, in_phase & answered, _LEAST_SHARE * largest)
        groups[str(phase)] = PhaseGroup(**own, poses=int(in_phase.sum()), depth_bins=by_depth)
    return Group(**_fields(rows, answered, _LEAST_SHARE * largest)), groups


def count_flags(rows: NDArray[np.void]) -> tuple[dict[str, int], dict[str, int]]:
    """Number of estimates by the name of each `QualityFlag`, and by `Trust`; zeros included."""
    by_flag = dict.fromkeys(flag_names(-1), 0)  # -1: all flags
    by_trust = {level.value: 0 for level in Trust}
    answered = ~np.isnan(rows["predicted"][:, 0])
    sets, counts = np.unique(rows["quality_flags"][answered], return_counts=True)
    for quality_flags, count in zip(sets.tolist(), counts.tolist(), strict=True):
        by_trust[trust(quality_flags).value] += count
        for name in flag_names(quality_flags):
            by_flag[name] += count
    return by_flag, by_trust

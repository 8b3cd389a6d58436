"""The summary of a replay: statistics overall, by phase and by depth, and limits on them."""

import itertools
import json
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.estimates import AIR_PHASE, PHASES, Rows
from rft_ros.errors import InputError, shown
from rft_ros.estimator import (
    OFFSET_SENTENCE,
    TOUCH_DEPTH_M,
    QualityFlag,
    Reason,
    Trust,
    begins_in_grains,
    trust,
)
from rft_ros.estimator.samples import DOCTOR_ON_FRAMES
from rft_ros.messages import Role
from rft_ros.parameters import Value
from rft_ros.parameters.sections import flat
from rft_ros.rft import AXES, FORCE, TORQUE
from rft_ros.yaml_file import read_yaml

_Array = NDArray[np.float64]

_COMPONENTS = (*AXES, "force", "torque")
_SIZE_OF_FORCE = _COMPONENTS.index("force")
_MIN_FORCE_SHARE = (
    0.2  # share of the recording's greatest force over which a force has a relative error
)
_MAX_BIN_COUNT = 10
_LARGE_ERROR_SHARE = 0.5  # a larger median error is likely due to the set-up


@dataclass(frozen=True)
class Group:
    """Statistics of some estimates; None without values.

    `wrench` has three levels of keys. First the axis in the sensor frame, or the magnitudes "force" and "torque". Then
    "measured" (compensated), "predicted" and "residual" (measured minus predicted; its magnitude is that of the
    difference). Then "rms", "peak" (greatest magnitude) and "mean" [N], [N m]. `rms_over_peak`: RMS residual force over
    the group's greatest measured force. `median_relative_error`: median of residual over measured force, where the
    measured force exceeds 20 % of the replay's greatest.
    `within_sigma`, `within_two_sigma`: share of the measured force's components, in the grains, within one and two
    standard deviations of the prediction.
    """

    estimates: int
    wrench: dict[str, dict[str, dict[str, float | None]]]
    rms_over_peak: float | None
    median_relative_error: float | None
    within_sigma: float | None
    within_two_sigma: float | None


@dataclass(frozen=True)
class PhaseGroup(Group):
    """Statistics of a phase. `poses`: their number, with and without an estimate. `depth_bins`: keys as ``5-10mm``."""

    poses: int
    depth_bins: dict[str, Group]


@dataclass(frozen=True, kw_only=True)
class Summary(Group):
    """The content of summary.json: the statistics of all estimates, and the inputs of the replay.

    `messages`: number read for each role. `reasons`, `quality_flags`, `trust`: how many samples, poses or estimates
    have each. `in_grains`: how many estimates have the tool below the surface; `flag_shares`: of these, the share with
    each quality flag. `unknown_frames`: for each reason a sentence on the frame_id. `duration`: receive time covered
    [s]. `learning`: the statistics without learning ("off") and with it ("apply"). No prediction uses its own
    load-cell sample.
    """

    bag: str
    topics: dict[Role, str]
    parameters: dict[str, Value]
    bias: Sequence[float]
    messages: dict[Role, int]
    reasons: dict[str, int]
    unknown_frames: dict[str, str]
    quality_flags: dict[str, int]
    trust: dict[str, int]
    in_grains: int
    flag_shares: dict[str, float]
    duration: float
    damage: str | None
    warnings: list[str]
    learning: dict[str, Group]
    phases: dict[str, PhaseGroup]

    @property
    def verdict(self) -> str:
        """How well the replay predicts, with the most serious warning: the sentence to read first."""
        if self.median_relative_error is None or self.rms_over_peak is None:
            errors = "No force was measured and predicted together"
        else:
            median = f"median error {100.0 * self.median_relative_error:.1f} % of the force"
            errors = f"Residual: {median}, RMS {100.0 * self.rms_over_peak:.1f} % of the peak"
        doubt = self.damage or next(iter(self.warnings), "")
        return f"{errors}; {doubt}" if doubt else errors

    def flag_rows(self) -> list[tuple[str, str]]:
        """Each quality flag that a pose in the grains has, with the share of these poses."""
        return [
            (name, f"{100.0 * share:.1f} %") for name, share in self.flag_shares.items() if share
        ]

    def lines(self) -> list[str]:
        """Lines for the terminal: verdict, counts, and the magnitudes of forces and residuals."""
        text = [
            f"{self.bag}: {self.verdict}",
            f"  {self.estimates} estimates of {self.messages['pose']} poses, {self.in_grains} in the grains",
        ]
        for reason, n in self.reasons.items():
            frame = ""
            if reason in self.unknown_frames:
                frame = f" ({self.unknown_frames[reason]}; {DOCTOR_ON_FRAMES})"
            text.append(f"  not used or unanswered: {reason} {n}{frame}")
        flags = ", ".join(f"{name} {share}" for name, share in self.flag_rows())
        if flags:
            trust_counts = ", ".join(f"{name} {n}" for name, n in self.trust.items())
            text.append(
                f"  quality flags, of the poses in the grains: {flags}; trust: {trust_counts}"
            )
        if self.damage:
            text.append(f"  damage: {self.damage}")
        text += [f"  warning: {sentence}" for sentence in self.warnings]
        rows = [("force on the tool", *METRIC_HEADS), *metric_rows(self)]
        return text + [
            f"  {title:<18}" + "".join(f"{cell:>11}" for cell in cells) for title, *cells in rows
        ]

    def json(self) -> str:
        """The text of summary.json; the same bag and parameters give the same text."""
        content = asdict(self)
        content |= {
            field.name: content.pop(field.name) for field in fields(Group)
        }  # statistics come last
        return json.dumps(content, indent=2, allow_nan=False) + "\n"


def summary_of(
    rows: Rows, *, issues: Counter[str], faults: Sequence[str] = (), **about: Any
) -> Summary:
    """The summary of rows, shape [n]. `about`: the other fields of `Summary`.

    `issues`: for each issue of the estimator, the number of poses at which it was present. `faults`: sentences on
    faults of the set-up.
    """
    whole, phases = statistics(rows)
    is_estimate = rows["reason"] < 0
    flags = rows["quality_flags"][is_estimate]
    in_grains = is_estimate & (rows["depth"] > 0.0)
    flags_in_grains = rows["quality_flags"][in_grains]
    shares = {
        flag.label: float(np.mean(flags_in_grains & flag > 0)) if len(flags_in_grains) else 0.0
        for flag in QualityFlag
        if flag
    }
    flag_counts = {flag.label: int(np.count_nonzero(flags & flag)) for flag in QualityFlag if flag}
    levels = Counter(map(trust, flags.tolist()))
    # a fault of the load cell's zero says more, and is judged on the whole recording
    warnings = [
        f"{issue} (at {n:,} poses)" for issue, n in issues.items() if issue != OFFSET_SENTENCE
    ]
    error = whole.median_relative_error
    if error is not None and error > _LARGE_ERROR_SHARE:
        doctor = "check the set-up with rft doctor FILE --bag BAG"
        warnings.append(f"the median error is {100.0 * error:.0f} %: {doctor}")
    impossible = flag_counts[QualityFlag.IMPOSSIBLE.label]
    first_depth = float(rows["depth"][np.argmax(is_estimate)]) if is_estimate.any() else 0.0
    if impossible:
        warnings.append(f"{QualityFlag.IMPOSSIBLE.sentence} (at {impossible:,} poses)")
    elif first_depth > TOUCH_DEPTH_M:
        warnings.append(begins_in_grains(first_depth))
    return Summary(
        **vars(whole),
        quality_flags=flag_counts,
        trust={level.value: levels[level] for level in Trust},
        in_grains=len(flags_in_grains),
        flag_shares=shares,
        warnings=[*warnings, *faults],
        phases=phases,
        **about,
    )


def statistics(rows: Rows) -> tuple[Group, dict[str, PhaseGroup]]:
    """Statistics of all estimates, and of each phase by name; a phase has them also by depth in the grains."""
    is_estimate = rows["reason"] < 0
    depth = rows["depth"]
    force = np.linalg.norm(rows["compensated"][:, FORCE], axis=1)
    least = _MIN_FORCE_SHARE * float(np.fmax.reduce(force, initial=0.0))
    edges = _bin_edges(float(depth[is_estimate].max(initial=0.0)))
    bin_of = np.where(depth > 0.0, np.digitize(depth, edges[1:-1]), -1)
    groups = {}
    for code, phase in enumerate(PHASES):
        in_phase = rows["phase"] == code
        is_counted = in_phase & is_estimate
        depth_bins = {}
        for k, (low, high) in enumerate(itertools.pairwise(1e3 * edges)):
            in_bin = is_counted & (bin_of == k)
            if in_bin.any():
                depth_bins[f"{low:g}-{high:g}mm"] = _group(rows, in_bin, least)
        group = vars(_group(rows, is_counted, least))
        groups[phase] = PhaseGroup(**group, poses=int(in_phase.sum()), depth_bins=depth_bins)
    return _group(rows, is_estimate, least), groups


def _group(rows: Rows, is_counted: NDArray[np.bool_], least_force: float) -> Group:
    """Statistics of the chosen rows, shape [n]. The relative error is taken of forces over `least_force` [N]."""
    wrenches = {
        "measured": _with_magnitudes(rows["compensated"][is_counted]),
        "predicted": _with_magnitudes(rows["predicted"][is_counted]),
        "residual": _with_magnitudes(rows["residual"][is_counted]),
    }
    wrench = {}
    for column, name in enumerate(_COMPONENTS):
        wrench[name] = {kind: _spread(values[:, column]) for kind, values in wrenches.items()}
    force = wrenches["measured"][:, _SIZE_OF_FORCE]
    big = force > least_force
    relative = wrenches["residual"][big, _SIZE_OF_FORCE] / force[big]
    in_grains = np.any(wrenches["predicted"][:, FORCE], axis=1)
    sigma = rows["sigma"][is_counted][in_grains, FORCE]
    scores = np.abs(wrenches["residual"][in_grains, FORCE]) / sigma
    numbers = scores[~np.isnan(scores)]
    rms = wrench["force"]["residual"]["rms"]
    peak = wrench["force"]["measured"]["peak"]
    return Group(
        estimates=int(is_counted.sum()),
        wrench=wrench,
        rms_over_peak=rms / peak if rms is not None and peak else None,
        median_relative_error=float(np.median(relative)) if len(relative) else None,
        within_sigma=float(np.mean(numbers < 1.0)) if len(numbers) else None,
        within_two_sigma=float(np.mean(numbers < 2.0)) if len(numbers) else None,
    )


def _with_magnitudes(wrenches: _Array) -> _Array:
    """The wrenches with the magnitudes of their forces and torques, columns `_COMPONENTS`; shape [n, 8]."""
    force = np.linalg.norm(wrenches[:, FORCE], axis=1)
    torque = np.linalg.norm(wrenches[:, TORQUE], axis=1)
    return np.column_stack([wrenches, force, torque])


def _spread(values: _Array) -> dict[str, float | None]:
    numbers = values[~np.isnan(values)]
    if not len(numbers):
        return {"rms": None, "peak": None, "mean": None}
    rms = math.sqrt(float(np.mean(numbers * numbers)))
    return {"rms": rms, "peak": float(np.abs(numbers).max()), "mean": float(numbers.mean())}


def _bin_edges(deepest: float) -> _Array:
    """Edges [m] of at most ten bins from 0 to `deepest`, whose width is 1, 2 or 5 times a power of ten."""
    if not deepest > 0.0:
        return np.zeros(1)
    edge = deepest * (1.0 - 1e-9)
    power = 10.0 ** math.floor(math.log10(edge / _MAX_BIN_COUNT))
    widths = [factor * power for factor in (1, 2, 5, 10)]
    width = next(width for width in widths if edge < _MAX_BIN_COUNT * width)
    return np.asarray(width * np.arange(math.ceil(edge / width) + 1))


METRIC_HEADS = (
    "estimates",
    "peak N",
    "RMS res. N",
    "peak res. N",
    "RMS/peak",
    "median err",
    "in 1 sigma",
    "in 2 sigma",
)
"""Columns of `metric_rows`, for the magnitude of the force and of its residual; `Group` defines them."""


def metric_rows(summary: Summary) -> list[tuple[str, ...]]:
    """Title and metrics of the whole replay, its phases in the grains, and the runs for comparison.

    The penetration has its depth bins below it. There is no force in the air whose error would say anything.
    """
    groups: dict[str, Group] = {"whole": summary}
    for name, phase in summary.phases.items():
        if phase.poses and name != AIR_PHASE:
            groups[name] = phase
        if name == "penetration":
            groups |= {f"  {depths}": group for depths, group in phase.depth_bins.items()}
    groups |= {f"learning {name}": group for name, group in summary.learning.items()}
    return [(title, *_metrics(group)) for title, group in groups.items()]


def _metrics(group: Group) -> Iterator[str]:
    yield str(group.estimates)
    residual = group.wrench["force"]["residual"]
    for force in (group.wrench["force"]["measured"]["peak"], residual["rms"], residual["peak"]):
        yield "-" if force is None else f"{force:.3f}"
    errors = (group.rms_over_peak, group.median_relative_error)
    for share in (*errors, group.within_sigma, group.within_two_sigma):
        yield "-" if share is None else f"{100.0 * share:.1f} %"


def read_limits(file: Path) -> dict[str, tuple[float, float]]:
    """Read limits of metrics: for each dotted path in summary.json the least and the greatest allowed value.

    The YAML file maps such paths to ``{min: NUMBER, max: NUMBER}``. Raises InputError for a malformed file.
    """
    tree = read_yaml(file, "limits file")
    if not isinstance(tree, dict) or not tree:
        raise InputError(
            f"limits file '{file}' has no metrics; write lines such as 'estimates: {{min: 1000}}'"
        )
    limits = {}
    for metric, value in tree.items():
        bounds = value if isinstance(value, dict) else {}
        low = bounds.get("min", -math.inf)
        high = bounds.get("max", math.inf)
        are_numbers = all(type(bound) in (int, float) for bound in (low, high))
        if not bounds or bounds.keys() - {"min", "max"} or not are_numbers or low > high:
            must = "it must be {min: NUMBER, max: NUMBER} or one of them, of finite numbers, min not above max"
            raise InputError(f"limits file '{file}': {metric} is {shown(value)}; {must}")
        limits[metric] = (low, high)
    return limits


def check(limits: dict[str, tuple[float, float]], summary: Summary) -> list[tuple[bool, str]]:
    """Whether each limit is kept, with a line of text on it. A metric without a value fails."""
    values = {f"reasons.{reason.value}": 0.0 for reason in Reason} | dict(flat(asdict(summary)))
    checks = []
    for metric, (low, high) in limits.items():
        value = values.get(metric)
        is_kept = False
        number = "no value"
        if isinstance(value, int | float):
            is_kept = low <= value <= high
            number = f"{value:.5g}"
        verdict = "ok    " if is_kept else "FAILED"
        checks.append((is_kept, f"  {verdict} {metric}: {number} (min {low:g}, max {high:g})"))
    return checks

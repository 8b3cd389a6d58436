"""The summary of a replay, and limits on its metrics for continuous integration."""

import json
import math
import re
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from rft_ros.bags.phases import Phase
from rft_ros.bags.statistics import Group, PhaseGroup
from rft_ros.errors import InputError, suggestion
from rft_ros.estimator import Reason
from rft_ros.estimator.messages import Role
from rft_ros.files import read_yaml
from rft_ros.parameters import Value, flat

__all__ = ["METRIC_HEADS", "Limit", "Summary", "check", "limit_lines", "metric_line", "metric_rows", "metrics"]
__all__ += ["read_limits", "warnings_of"]

_BIN = re.compile(r"\.depth_bins\.[\d.]+-[\d.]+mm\.")

_OFFSET, _OFFSET_SHARE = 0.2, 0.01  # N, and share of the recording's peak: a mean force in the air that is no noise
_WRONG = 0.5  # median error over which the set-up is the likely cause


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary(Group):
    """The content of summary.json: the statistics of all estimates and what led to them; and the wall time.

    `topics`: topic of each role. `messages`: number read for each role. `reasons`: number of samples not used and of
    estimates without residual, by reason. `unknown_frames`: by such a reason, a sentence on the unexpected frame_id.
    `quality_flags`: number of estimates by name of `QualityFlag`. `trust`: number of estimates by `Trust`. `duration`:
    receive time covered [s]. `damage`: where and why reading stopped early. `warnings`: what the numbers say about the
    set-up, and what learning found wrong, as sentences. `learning`: where the medium is learned, the error without
    learning ("off") and by lag. `phases`: statistics of each phase, by name. `seconds`: wall time of the replay,
    without its report.
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
    duration: float
    damage: str | None
    warnings: list[str]
    learning: dict[str, dict[str, float | None]]
    phases: dict[str, PhaseGroup]
    seconds: float = field(compare=False)

    @property
    def real_time_factor(self) -> float:
        """Recorded time over wall time."""
        return self.duration / self.seconds

    def lines(self) -> list[str]:
        """Lines for the terminal: counts, and the magnitudes of forces and residuals."""
        poses = self.messages["pose"]
        text = [f"{self.bag}: {self.estimates} estimates of {poses} poses, {self.real_time_factor:.0f} times real time"]
        for reason, n in self.reasons.items():
            frame = f" ({self.unknown_frames[reason]})" if reason in self.unknown_frames else ""
            text.append(f"  not used or unanswered: {reason} {n}{frame}")
        named = ", ".join(f"{name} {n}" for name, n in self.quality_flags.items() if n)
        if named:
            text.append(
                f"  quality flags: {named}; trust: " + ", ".join(f"{name} {n}" for name, n in self.trust.items())
            )
        text += [f"  reading stopped early: {self.damage}"] if self.damage else []
        text += [f"  warning: {sentence}" for sentence in self.warnings]
        for name, errors in self.learning.items():
            rms, median, one, two = ("-" if v is None else f"{100.0 * v:.1f} %" for v in errors.values())
            text.append(f"  learning {name}: RMS/peak {rms}, median err. {median}, within 1, 2 sigma {one}, {two}")
        for title, *cells in (("force on the tool", *METRIC_HEADS), *metric_rows(self)):
            text.append(metric_line(title, cells))
        return text

    def content(self) -> dict[str, Any]:
        """The content of summary.json; the same bag and parameters give the same content."""
        content = asdict(self)
        del content["seconds"]
        whole = {field.name: content.pop(field.name) for field in fields(Group)}
        return content | whole

    def json(self) -> str:
        """The text of summary.json."""
        return json.dumps(self.content(), indent=2, allow_nan=False) + "\n"


def warnings_of(whole: Group, phases: dict[str, PhaseGroup], issues: Counter[str]) -> list[str]:
    """Sentences on what is wrong with the set-up; `issues`: at how many poses learning had each sentence."""
    found = [f"{issue} (at {n:,} poses)" for issue, n in issues.items()]
    air = [phases[Phase.APPROACH].wrench[axis].measured.mean or 0.0 for axis in ("fx", "fy", "fz")]
    peak = whole.wrench["force"].measured.peak or 0.0
    if (load := math.hypot(*air)) > max(_OFFSET, _OFFSET_SHARE * peak):
        found.append(
            f"the load cell reads {load:.2f} N in the air: replay with --tare, or calibrate sensor.bias and sensor.mass"
        )
    if (error := whole.median_relative_error) is not None and error > _WRONG:
        found.append(f"the median error is {100.0 * error:.0f} %: check the set-up with rft doctor FILE --bag BAG")
    return found


METRIC_HEADS = ("estimates", "peak N", "RMS res. N", "peak res. N", "RMS/peak", "median err.")
"""Columns of `metric_rows`, for the magnitude of the force and of its residual."""


def metric_rows(summary: Summary) -> list[tuple[str, ...]]:
    """Title and metrics of the whole replay, of each phase that occurs, and of the depth bins of penetration."""
    rows = [("whole", *metrics(summary))]
    for name, phase in summary.phases.items():
        if phase.poses:
            rows.append((name, *metrics(phase)))
        if name == Phase.PENETRATION.value:
            rows += [(f"  {depths}", *metrics(group)) for depths, group in phase.depth_bins.items()]
    return rows


def metric_line(title: str, cells: Sequence[str], width: int = 18) -> str:
    """A line of a table in the terminal."""
    return f"  {title:<{width}}" + "".join(f"{cell:>12}" for cell in cells)


def metrics(group: Group) -> tuple[str, ...]:
    """The values for `METRIC_HEADS` of a group; "-" if missing."""
    force = group.wrench["force"]
    newtons = (force.measured.peak, force.residual.rms, force.residual.peak)
    ratios = (group.rms_over_peak, group.median_relative_error)
    return (
        str(group.estimates),
        *("-" if v is None else f"{v:.3f}" for v in newtons),
        *("-" if v is None else f"{100.0 * v:.1f} %" for v in ratios),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Limit:
    """Inclusive limits of a metric, given by its dotted path in summary.json."""

    metric: str
    min: float = -math.inf
    max: float = math.inf

    def allows(self, value: float | None) -> bool:
        """Whether the metric may have this value. A missing one (None) fails."""
        return value is not None and self.min <= value <= self.max


def read_limits(file: Path) -> list[Limit]:
    """Read a YAML mapping of metrics to ``{min: NUMBER, max: NUMBER}``, one or both. Raises InputError if malformed."""
    tree = read_yaml(file, "limits file")
    if not isinstance(tree, dict) or not tree:
        raise InputError(f"limits file '{file}' holds no metrics; write lines such as 'estimates: {{min: 1000}}'")
    return [_limit(file, str(metric), bounds) for metric, bounds in tree.items()]


def _limit(file: Path, metric: str, bounds: object) -> Limit:
    if not isinstance(bounds, dict) or not bounds or not bounds.keys() <= {"min", "max"}:
        raise InputError(f"limits file '{file}': {metric} is {bounds!r}; it must be {{min: NUMBER, max: NUMBER}}")
    for name, value in bounds.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= sys.float_info.max:
            raise InputError(f"limits file '{file}': {metric} {name} is {value!r}; it must be a finite number")
    limit = Limit(metric=metric, **bounds)
    if limit.min > limit.max:
        raise InputError(f"limits file '{file}': {metric} has min {limit.min:g} above max {limit.max:g}")
    return limit


def check(limits: list[Limit], summary: Summary) -> list[tuple[Limit, float | None]]:
    """Each limit with the summary's value, None for a depth not reached. InputError for any other unknown metric."""
    content = summary.content()
    for words in ("damage", "parameters"):
        del content[words]
    values = {name: value for name, value in flat(content) if value is None or isinstance(value, int | float)}
    values |= {f"reasons.{reason.value}": 0.0 for reason in Reason if reason.value not in summary.reasons}
    for limit in limits:
        if limit.metric not in values and _BIN.sub(".", limit.metric) not in values:
            near = suggestion(limit.metric, values)
            raise InputError(f"the replay of '{summary.bag}' has no metric '{limit.metric}'{near}")
    return [(limit, values.get(limit.metric)) for limit in limits]


def limit_lines(checks: list[tuple[Limit, float | None]]) -> list[str]:
    """A table: each limit with the value, and "ok" or "FAILED"."""
    width = max(len(limit.metric) for limit, _ in checks)
    text = [f"  {'metric':<{width}}{'value':>12}{'min':>10}{'max':>10}"]
    for limit, value in checks:
        shown = "-" if value is None else f"{value:.5g}"
        bounds = "".join(f"{'' if math.isinf(b) else f'{b:g}':>10}" for b in (limit.min, limit.max))
        text.append(f"  {limit.metric:<{width}}{shown:>12}{bounds}  {'ok' if limit.allows(value) else 'FAILED'}")
    return text

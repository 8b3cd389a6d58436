"""Limits on a replay's metrics, for continuous integration."""

import math
import re
import sys
from dataclasses import dataclass
from pathlib import Path

from rft_ros.bags.summary import Summary
from rft_ros.errors import InputError, suggestion
from rft_ros.estimator import Reason
from rft_ros.files import read_yaml
from rft_ros.parameters import flat

__all__ = ["Limit", "check", "limit_lines", "read_limits"]

_BIN = re.compile(r"\.depth_bins\.[\d.]+-[\d.]+mm\.")


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

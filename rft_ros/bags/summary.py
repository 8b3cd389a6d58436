"""The summary of a replay: what was read, what was answered, and the size of forces and residuals."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from rft_ros.bags.learning_errors import LearningError
from rft_ros.bags.phases import Phase
from rft_ros.bags.statistics import Axis, Group, PhaseGroup
from rft_ros.estimator.messages import Role
from rft_ros.estimator.parameters import Value

__all__ = ["METRIC_HEADS", "Summary", "metric_line", "metric_rows", "metrics"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """The content of summary.json, and the wall time.

    `topics`: the topic read for each role. `messages`: how many of each role came in. `estimates`: poses with a
    prediction. `reasons`: poses and other samples that were not used, and estimates without residual, by reason.
    `unknown_frames`: for such a reason, which frame_id is not what the parameters say, in a sentence.
    `quality_flags`: estimates by the name of each `QualityFlag`. `trust`: estimates by `Trust`.
    `duration`: receive time covered [s]. `damage`: where and why reading stopped early. `wrench`, `rms_over_peak`,
    `median_relative_error`, `within_sigma`, `within_two_sigma`: over all estimates, as in `Group`. `learning`: where
    the medium is learned, the error without learning ("off") and by lag. `phases`: the same as over all estimates, of
    each phase, by name. `seconds`: wall time of the replay, without its report.
    """

    bag: str
    topics: dict[Role, str]
    parameters: dict[str, Value]
    bias: Sequence[float]
    messages: dict[Role, int]
    estimates: int
    reasons: dict[str, int]
    unknown_frames: dict[str, str]
    quality_flags: dict[str, int]
    trust: dict[str, int]
    duration: float
    damage: str | None
    wrench: dict[str, Axis]
    rms_over_peak: float | None
    median_relative_error: float | None
    within_sigma: float | None
    within_two_sigma: float | None
    learning: dict[str, LearningError]
    phases: dict[str, PhaseGroup]
    seconds: float = field(compare=False)

    @property
    def real_time_factor(self) -> float:
        """Recorded time over wall time."""
        return self.duration / self.seconds

    @property
    def whole(self) -> Group:
        """The statistics over all estimates."""
        return Group(**{field.name: getattr(self, field.name) for field in fields(Group)})

    def lines(self) -> list[str]:
        """The summary for a terminal: counts, and the size of forces and residuals."""
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
        if self.damage:
            text.append(f"  reading stopped early: {self.damage}")
        for name, error in self.learning.items():
            shares = (error.rms_over_peak, error.median_relative_error, error.within_sigma, error.within_two_sigma)
            rms, median, one, two = ("-" if v is None else f"{100.0 * v:.1f} %" for v in shares)
            text.append(f"  learning {name}: RMS/peak {rms}, median err. {median}, within 1, 2 sigma {one}, {two}")
        for title, *cells in (("force on the tool", *METRIC_HEADS), *metric_rows(self)):
            text.append(metric_line(title, cells))
        return text

    def content(self) -> dict[str, Any]:
        """The content of summary.json: the same for the same bag and parameters."""
        content = asdict(self)
        del content["seconds"]
        return content

    def json(self) -> str:
        """The text of summary.json."""
        return json.dumps(self.content(), indent=2, allow_nan=False) + "\n"


METRIC_HEADS = ("estimates", "peak N", "RMS res. N", "peak res. N", "RMS/peak", "median err.")
"""Columns of `metric_rows`: of the force vector's magnitude, with its residual's RMS and peak [N]."""


def metric_rows(summary: Summary) -> list[tuple[str, ...]]:
    """Title and `METRIC_HEADS` of the whole, of each phase that occurs, and of penetration's depth bins."""
    return [(title, *metrics(group)) for title, group in _groups(summary)]


def metric_line(title: str, cells: Sequence[str], width: int = 18) -> str:
    """A line of a table in the terminal."""
    return f"  {title:<{width}}" + "".join(f"{cell:>12}" for cell in cells)


def _groups(summary: Summary) -> Iterator[tuple[str, Group]]:
    yield "whole", summary.whole
    for name, phase in summary.phases.items():
        if phase.poses:
            yield name, phase
        if name == Phase.PENETRATION.value:
            for depths, group in phase.depth_bins.items():
                yield f"  {depths}", group


def metrics(group: Group) -> tuple[str, ...]:
    """A group's `METRIC_HEADS`; "-" where there is no value."""
    force = group.wrench["force"]
    newtons = (force.measured.peak, force.residual.rms, force.residual.peak)
    ratios = (group.rms_over_peak, group.median_relative_error)
    return (
        str(group.estimates),
        *("-" if v is None else f"{v:.3f}" for v in newtons),
        *("-" if v is None else f"{100.0 * v:.1f} %" for v in ratios),
    )

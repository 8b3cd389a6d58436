"""Where the method fails: every figure of docs/where-it-fails.md with its numbers."""

from collections.abc import Callable

from studies import bad_meshes, concave_tools, force_jumps, sampling, validity_limits
from studies.result import StudyResult

__all__ = ["CASES", "study"]

CASES: tuple[Callable[[], StudyResult], ...] = (
    force_jumps.overview,
    force_jumps.level,
    force_jumps.along_itself,
    force_jumps.knife_edge,
    force_jumps.reversal,
    sampling.window,
    force_jumps.withdrawal,
    force_jumps.turning,
    force_jumps.surface,
    validity_limits.speed,
    validity_limits.wake,
    concave_tools.study,
    bad_meshes.study,
    sampling.time_step,
)
"""The cases in the order of the page."""


def study() -> tuple[StudyResult, ...]:
    """All cases."""
    return tuple(case() for case in CASES)

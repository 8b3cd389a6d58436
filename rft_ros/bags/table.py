"""estimates.csv: a row for each pose."""

from functools import cache

from rft_ros.bags.phases import Phase
from rft_ros.estimator import Estimate, NoEstimate
from rft_ros.estimator.quality import flag_names

__all__ = ["AXES", "COLUMNS", "ending", "row"]

AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
"""Components of a wrench: force [N], torque [N m]."""

COLUMNS = (
    "t",
    "depth",
    "speed",
    *(f"{kind}_{axis}" for kind in ("predicted", "compensated", "residual") for axis in AXES),
    "reason",
    "generation",
    "phase",
    "quality_flags",
)
"""Header stamp [s]; depth of the tool's lowest point below the surface [m], negative above it; speed of its fastest
plate [m/s]; wrenches in the sensor frame [N], [N m]; or the reason for none; which model answered; `Phase`, empty where
the pose or its velocity was not known; names of `QualityFlag`s, joined by +."""

_SIX = ",%.9g" * 6
_FULL = "%d.%09d,%.9g,%.9g" + 3 * _SIX + ",,%d"
_WITHOUT_WRENCH = "%d.%09d,%.9g,%.9g" + _SIX + 12 * "," + ",,%d"


def row(depth: float | None, answer: Estimate | NoEstimate) -> str:
    """A row as far as it is known at once: all before the phase."""
    seconds, nanoseconds = divmod(answer.stamp, 1_000_000_000)
    if isinstance(answer, NoEstimate):
        place = "" if depth is None else f"{depth:.9g}"
        return f"{seconds}.{nanoseconds:09d},{place}{20 * ','}{answer.reason.value},"
    head = (seconds, nanoseconds, depth, answer.speed, *answer.predicted)
    if answer.compensated is None or answer.residual is None:
        return _WITHOUT_WRENCH % (*head, answer.generation)
    return _FULL % (*head, *answer.compensated, *answer.residual, answer.generation)


@cache
def ending(phase: Phase | None, quality_flags: int) -> str:
    """The rest of a row, and the end of its line; `quality_flags`: an or of `QualityFlag`."""
    return f",{phase.value if phase else ''},{'+'.join(flag_names(quality_flags))}\n"

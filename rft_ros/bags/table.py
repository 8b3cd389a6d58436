"""estimates.csv: a row for each pose."""

from rft_ros.bags.phases import Phase
from rft_ros.estimator import Estimate, Withheld

__all__ = ["AXES", "COLUMNS", "row", "with_phase"]

AXES = ("fx", "fy", "fz", "tx", "ty", "tz")

COLUMNS = (
    "t",
    "depth",
    "speed",
    *(f"{kind}_{axis}" for kind in ("predicted", "compensated", "residual") for axis in AXES),
    "reason",
    "generation",
    "phase",
)
"""Header stamp [s]; depth of the tool's lowest point below the surface [m], negative above it; speed of its fastest
plate [m/s]; wrenches in the sensor frame [N], [N m]; or the reason for none; which model answered; `Phase`, empty where
the pose or its velocity was not known."""

_SIX = ",%.9g" * 6
_FULL = "%d.%09d,%.9g,%.9g" + 3 * _SIX + ",,%d"
_WITHOUT_WRENCH = "%d.%09d,%.9g,%.9g" + _SIX + 12 * "," + ",,%d"


def row(depth: float | None, answer: Estimate | Withheld) -> str:
    """A row as far as it is known at once: all but the phase."""
    seconds, nanoseconds = divmod(answer.stamp, 1_000_000_000)
    if isinstance(answer, Withheld):
        place = "" if depth is None else f"{depth:.9g}"
        return f"{seconds}.{nanoseconds:09d},{place}{20 * ','}{answer.reason.value},"
    head = (seconds, nanoseconds, depth, answer.speed, *answer.predicted)
    if answer.compensated is None or answer.residual is None:
        return _WITHOUT_WRENCH % (*head, answer.generation)
    return _FULL % (*head, *answer.compensated, *answer.residual, answer.generation)


def with_phase(begun: str, phase: Phase | None) -> str:
    """The whole row, as a line."""
    return f"{begun},{phase.value if phase else ''}\n"

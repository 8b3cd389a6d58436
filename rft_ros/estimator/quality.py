"""What can be doubtful about an estimate, how far it can be trusted, and how much it scatters."""

import math
from enum import Enum, IntFlag

from rft_ros.estimator.samples import Wrench

__all__ = ["SCATTER", "QualityFlag", "Trust", "deviation", "flag_names", "sentences", "trust"]


class QualityFlag(IntFlag):
    """What is doubtful about an estimate; `docs/where-it-fails.md` has a figure for most."""

    NONE = 0
    FAST = 1
    """Over 2.5 cm/s, the fastest that the paper tested."""
    INERTIAL = 2
    """Over 20 cm/s: grains that are thrown push with more than their weight."""
    NEAR_REST = 4
    """So slow that noise decides the direction of motion."""
    WAKE = 8
    """The tool is where it has been: the grains there are looser."""
    CONCAVE = 16
    """Facets of the tool face each other; those in another's shadow count in full."""
    NEAR_FLAT = 32
    """Published rule: much of the wet area is so nearly horizontal that its e2 jumps."""
    KNIFE_EDGE = 64
    """Published rule: much of the wet area moves along itself, and rounding decides whether it leads."""
    DEEP = 128
    """Deeper than `medium.calibrated_depth`, by over 2 %."""


class Trust(str, Enum):
    """How far an estimate can be trusted."""

    OK = "OK"
    CAUTION = "CAUTION"
    NO = "NO"


_DISTRUST = QualityFlag.INERTIAL | QualityFlag.KNIFE_EDGE


def trust(quality_flags: int) -> Trust:
    """What quality_flags, an or of `QualityFlag`, leave of the trust."""
    if quality_flags & _DISTRUST:
        return Trust.NO
    return Trust.CAUTION if quality_flags else Trust.OK


_SENTENCES = {
    QualityFlag.FAST: "faster than the 0.025 m/s that the model was measured at",
    QualityFlag.INERTIAL: "faster than 0.2 m/s, where inertia matters",
    QualityFlag.NEAR_REST: "so slow that noise decides the direction",
    QualityFlag.WAKE: "in its own wake, where grains are looser",
    QualityFlag.CONCAVE: "a hollow tool, whose shadowed facets count in full",
    QualityFlag.NEAR_FLAT: "nearly horizontal faces: the published rule jumps there (integration: refined does not)",
    QualityFlag.KNIFE_EDGE: "faces moving along themselves: the published rule jumps there (integration: refined does not)",  # noqa: E501
    QualityFlag.DEEP: "deeper than the calibration",
}


def flag_names(quality_flags: int) -> list[str]:
    """The names of quality_flags, as users read them: ``fast``, ``wake``."""
    return [str(d.name).lower() for d in _SENTENCES if quality_flags & d]


def sentences(quality_flags: int) -> str:
    """Doubts in words."""
    return "; ".join(text for d, text in _SENTENCES.items() if quality_flags & d)


SCATTER = 0.15
"""Standard deviation of each component over the force's magnitude: root mean square over five simulated plates that
moved at various attitudes and directions. On bodies that were not used to set it, 64 % of the components lie within
(docs/accuracy.md)."""


def deviation(predicted: Wrench) -> tuple[float, float]:
    """Standard deviation of each component of a predicted force [N] and torque [N m]."""
    fx, fy, fz, tx, ty, tz = predicted
    return SCATTER * math.hypot(fx, fy, fz), SCATTER * math.hypot(tx, ty, tz)

"""Hypotheses about what is wrong with a cell's set-up, judged on arrays of what was sent, measured and predicted.

A cause comes before its effects in the table, and hides them.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

from rft_ros.diagnosis import delay, forces, poses
from rft_ros.diagnosis.evidence import Evidence, Finding, evidence_of

__all__ = ["HYPOTHESES", "SILENT", "Evidence", "Finding", "Hypothesis", "diagnose", "evidence_of"]


class Hypothesis(NamedTuple):
    """One cause of wrong numbers.

    `judge`: a pure function that yields a finding, or nothing where the evidence does not tell. `hides`: the hypotheses
    that cannot be judged if this one is true, since their evidence would be an effect of it.
    """

    name: str
    judge: Callable[[Evidence], Iterator[Finding]]
    hides: tuple[str, ...] = ()


_BEYOND_AXES = ("delay", "torque", "lever", "strength")
_OF_FORCES = ("saturation", "push", "axes", *_BEYOND_AXES)
_OF_LENGTHS = ("surface", "unseen surface", "zero", "unseen air", "motion", *_OF_FORCES)

HYPOTHESES = (
    Hypothesis("unit of poses", poses.unit_of_poses, hides=("noise", "repeats", *_OF_LENGTHS)),
    Hypothesis("size", poses.size_of_tool, hides=_OF_LENGTHS),
    Hypothesis("repeats", poses.repeated_poses, hides=("noise",)),
    Hypothesis("noise", poses.noise_of_poses, hides=("surface", *_OF_FORCES)),
    Hypothesis("motion", forces.zero_that_moves, hides=("surface", "zero", *_OF_FORCES)),
    Hypothesis("surface", poses.surface, hides=("zero", "unseen air", *_OF_FORCES)),
    Hypothesis("unseen surface", poses.unseen_surface),
    Hypothesis("mount", forces.mount, hides=("lever", "torque")),
    Hypothesis("zero", forces.zero),
    Hypothesis("unseen air", forces.unseen_air),
    Hypothesis("push", forces.push, hides=_OF_FORCES),
    Hypothesis("saturation", forces.saturation, hides=_BEYOND_AXES),
    Hypothesis("axes", forces.axes, hides=_BEYOND_AXES),
    Hypothesis("delay", delay.delay_of_load_cell),
    Hypothesis("lever", forces.lever, hides=("torque",)),
    Hypothesis("torque", forces.unit_of_torque),
    Hypothesis("strength", forces.strength),
)
"""Every hypothesis that the doctor, a calibration and a replay judge, in the order of their findings."""


SILENT = frozenset({"unit of poses", "repeats", "motion", "surface", "zero", "saturation", "delay", "lever", "torque"})
"""Causes of wrong numbers that the statistics and warnings of a replay or a calibration do not show by themselves."""


def diagnose(evidence: Evidence) -> Iterator[tuple[str, Finding]]:
    """The findings on a cell, each with the name of its hypothesis. One that a true one hides is not judged."""
    hidden = set[str]() if len(evidence.time) else {"zero", "push", *_OF_FORCES}
    for name, judge, hides in HYPOTHESES:
        if name not in hidden:
            for finding in judge(evidence):
                yield name, finding
                if not finding.ok:
                    hidden.update(hides)

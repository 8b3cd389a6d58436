"""Hypotheses about what is wrong with a cell's set-up, judged on arrays of what was sent, measured and predicted.

A cause comes before its effects in the table, and hides them.
"""

from collections.abc import Callable, Container, Iterator
from dataclasses import dataclass

from rft_ros.diagnosis import delay, forces, poses
from rft_ros.diagnosis.evidence import Evidence, Finding, evidence_of

__all__ = ["HYPOTHESES", "SILENT", "Evidence", "Finding", "Hypothesis", "diagnose", "evidence_of"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Hypothesis:
    """One cause of wrong numbers.

    `judge`: a pure function that yields a finding, or nothing where the evidence does not tell. `hides`: the hypotheses
    that cannot be judged if this one is true, since their evidence would be an effect of it.
    """

    name: str
    judge: Callable[[Evidence], Iterator[Finding]]
    hides: tuple[str, ...] = ()


_OF_FORCES = ("saturation", "push", "axes", "delay", "torque", "lever", "strength")

HYPOTHESES = (
    Hypothesis(
        name="unit of poses",
        judge=poses.unit_of_poses,
        hides=("noise", "repeats", "surface", "unseen surface", "zero", "unseen air", "motion", *_OF_FORCES),
    ),
    Hypothesis(
        name="size",
        judge=poses.size_of_tool,
        hides=("surface", "unseen surface", "zero", "unseen air", "motion", *_OF_FORCES),
    ),
    Hypothesis(name="repeats", judge=poses.repeated_poses, hides=("noise",)),
    Hypothesis(name="noise", judge=poses.noise_of_poses, hides=("surface", *_OF_FORCES)),
    Hypothesis(name="motion", judge=forces.zero_that_moves, hides=("surface", "zero", *_OF_FORCES)),
    Hypothesis(name="surface", judge=poses.surface, hides=("zero", "unseen air", *_OF_FORCES)),
    Hypothesis(name="unseen surface", judge=poses.unseen_surface),
    Hypothesis(name="mount", judge=forces.mount, hides=("lever", "torque")),
    Hypothesis(name="zero", judge=forces.zero),
    Hypothesis(name="unseen air", judge=forces.unseen_air),
    Hypothesis(name="push", judge=forces.push, hides=_OF_FORCES),
    Hypothesis(name="saturation", judge=forces.saturation, hides=("delay", "torque", "lever", "strength")),
    Hypothesis(name="axes", judge=forces.axes, hides=("delay", "torque", "lever", "strength")),
    Hypothesis(name="delay", judge=delay.delay_of_load_cell),
    Hypothesis(name="lever", judge=forces.lever, hides=("torque",)),
    Hypothesis(name="torque", judge=forces.unit_of_torque),
    Hypothesis(name="strength", judge=forces.strength),
)
"""Every hypothesis that the doctor, a calibration and a replay judge, in the order of their findings."""


SILENT = frozenset({"unit of poses", "repeats", "motion", "surface", "zero", "saturation", "delay", "lever", "torque"})
"""Causes of wrong numbers that the statistics and warnings of a replay or a calibration do not show by themselves."""


def diagnose(evidence: Evidence, *, told: Container[str] | None = None) -> list[Finding]:
    """The findings on a cell. A hypothesis that a true one hides is not judged.

    `told`: the names of the hypotheses whose findings are returned; all of them without it.
    """
    found, hidden = list[Finding](), set[str]() if len(evidence.time) else {"zero", "push", *_OF_FORCES}
    for hypothesis in HYPOTHESES:
        wanted = told is None or hypothesis.name in told
        if hypothesis.name not in hidden and (wanted or hypothesis.hides):
            own = list(hypothesis.judge(evidence))
            if wanted:
                found += own
            if not all(finding.ok for finding in own):
                hidden.update(hypothesis.hides)
    return found

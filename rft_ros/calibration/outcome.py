"""What a calibration is asked for and what it comes to: parameters, findings, refusals, notes."""

from dataclasses import dataclass, field

from rft_ros.calibration.alpha_y_fit import AlphaYFit, AlphaYModel
from rft_ros.calibration.findings import Finding, Refusal
from rft_ros.calibration.first_contact import Contact
from rft_ros.calibration.mobilization import TurnFit
from rft_ros.calibration.penetration import ZetaFit
from rft_ros.calibration.plate_runs import PlateRun
from rft_ros.calibration.sigmoids import Sigmoid
from rft_ros.estimator.parameters import Value

__all__ = ["PARTS", "Calibration", "Options"]

PARTS = ("sensor", "surface", "zeta", "mobilization", "alpha_y", "weights")
"""What can be fitted: bias, mass and centre of mass; surface height; ζ; λ; α_y; f1 and f23."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """What to fit: `parts`. `tare`: each bag's load cell is zeroed over so many first seconds. `alpha_y`: its model."""

    parts: tuple[str, ...] = PARTS
    tare: float | None = None
    alpha_y: AlphaYModel = "auto"


@dataclass(slots=True, kw_only=True)
class Calibration:
    """What came of it: `parameters` of the node that were told, findings, refusals, and notes on what one value hides.

    `zeta`, `alpha_y`, `contacts`, `turns`, `runs`, `weights`: the fits behind them, None or empty where refused.
    """

    parameters: dict[str, Value] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    refusals: list[Refusal] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    contacts: list[Contact] = field(default_factory=list)
    zeta: ZetaFit | None = None
    turns: list[TurnFit] = field(default_factory=list)
    alpha_y: AlphaYFit | None = None
    runs: list[PlateRun] = field(default_factory=list)
    weights: list[Sigmoid] = field(default_factory=list)

    def told(self, finding: Finding) -> None:
        """Add a finding, and its parameter's value."""
        self.findings.append(finding)
        if finding.parameter:
            several = len(finding.values) > 1
            self.parameters[finding.parameter] = finding.values if several else finding.values[0]

    def refused(self, name: str, why: object) -> None:
        """Add a refusal."""
        self.refusals.append(Refusal(name=name, why=str(why)))

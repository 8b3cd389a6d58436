"""One way to model: the rule, the law and its options, the tolerance of the tool, and the lag of learning."""

from dataclasses import dataclass

from rft_ros.rft import Integration, Law
from studies.paper import law

__all__ = [
    "CHOICES",
    "DEFAULT",
    "DENSITY",
    "PUBLISHED",
    "PUBLISHED_LINEAR",
    "REMEMBERED",
    "Choice",
]

DENSITY = 1465.0
"""Bulk density of the simulated beds [kg/m³]: 2,500 kg/m³ at a packing fraction of 0.586."""

_MEMORY = 0.003  # m, the default of node and replay
_LAG = 0.002  # m


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """A model. `tolerance` of the reduced tool (0: full), `mobilization_length` [m] (0: no memory).

    `lag`: path between a measured force and the first prediction that it may change [m]; 0: nothing is learned.
    `density` of the bed [kg/m³], 0: no inertia.
    """

    name: str
    integration: Integration = "refined"
    alpha_y: str = "constant"
    tolerance: float = 0.0
    mobilization_length: float = 0.0
    lag: float = 0.0
    law: str = "treers2021"
    density: float = 0.0

    def made(self, zeta: float) -> Law:
        """The law of this choice."""
        length = self.mobilization_length
        return law(
            self.alpha_y,
            zeta=zeta,
            name=self.law,
            density=self.density,
            mobilization_length=length,
        )


PUBLISHED = Choice(name="published", integration="centroid")
PUBLISHED_LINEAR = Choice(name="published, α_y linear", integration="centroid", alpha_y="linear")
REMEMBERED = Choice(name="refined, memory", alpha_y="linear", mobilization_length=_MEMORY)
DEFAULT = Choice(name="default", alpha_y="linear", mobilization_length=_MEMORY, tolerance=0.025)
"""The paper's two models, the default's model with the full tool, and the default."""

CHOICES = (
    PUBLISHED,
    PUBLISHED_LINEAR,
    Choice(name="refined"),
    Choice(name="refined, α_y linear", alpha_y="linear"),
    Choice(name="refined, memory 3 mm", mobilization_length=_MEMORY),
    Choice(name="refined, α_y linear, memory 3 mm", alpha_y="linear", mobilization_length=_MEMORY),
    DEFAULT,
    Choice(name="published, learned", integration="centroid", lag=_LAG),
    Choice(
        name="default, learned",
        alpha_y="linear",
        mobilization_length=_MEMORY,
        tolerance=0.025,
        lag=_LAG,
    ),
    Choice(
        name="refined, α_y linear, memory, inertia",
        alpha_y="linear",
        mobilization_length=_MEMORY,
        density=DENSITY,
    ),
    Choice(name="refined, agarwal2023", law="agarwal2023"),
    Choice(
        name="refined, agarwal2023, memory, inertia",
        law="agarwal2023",
        mobilization_length=_MEMORY,
        density=DENSITY,
    ),
)
"""The choices that the table of docs/speed-accuracy.md compares."""

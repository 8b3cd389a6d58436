"""The numbers of the grains that every law has, whatever its stresses: strength, inertia and memory."""

from dataclasses import dataclass

from rft_ros.rft.arguments import number
from rft_ros.rft.inertia import INERTIA

__all__ = ["Grains"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Grains:
    """What every law knows of the grains. Each field is the parameter ``medium.`` with its name.

    `zeta`: strength, no unit, relative to the reference medium. `density` of the bed [kg/m³] and `inertia`, κ of
    Eq. (11), no unit; density 0: the force does not depend on speed. `mobilization_length` [m]: λ of Eq. (10), for
    evaluations in time; 0: no memory. Raises ValueError that names a number out of range.
    """

    zeta: float = 1.0
    density: float = 0.0
    inertia: float = INERTIA
    mobilization_length: float = 0.0

    def __post_init__(self) -> None:
        number("medium.zeta", self.zeta, positive=True)
        number("medium.mobilization_length", self.mobilization_length, least=0.0)
        number("medium.density", self.density, least=0.0)
        number("medium.inertia", self.inertia, least=0.0)

    @property
    def inertial_density(self) -> float:
        """κ ρ of Eq. (11) [kg/m³]; 0: no inertia."""
        return self.density * self.inertia

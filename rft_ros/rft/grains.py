"""The numbers of the grains that every law has, whatever its stresses: strength, inertia and memory."""

from dataclasses import dataclass
from typing import NamedTuple

from rft_ros.rft.arguments import number
from rft_ros.rft.inertia import INERTIA

__all__ = ["IN_LAW", "LENGTH_OF_LAW", "WITHOUT_INERTIA", "WITH_INERTIA", "GranularLaw", "InLaw", "SpeedLimits"]


class InLaw(NamedTuple):
    """Where the numbers of a law are in its `packed` form, which the compiled loop takes.

    First `GranularLaw.shared`, in this order: `inertia` κ ρ [kg/m³], `stiffness` ζ or ξ [N/m³], and
    `mobilization_length` [m]. From `own` on the law's own numbers, at most nine, and from `alpha_y` on those of its
    model of α_y, at most four.
    """

    inertia: int
    stiffness: int
    mobilization_length: int
    own: int
    alpha_y: int


IN_LAW = InLaw(inertia=0, stiffness=1, mobilization_length=2, own=3, alpha_y=12)
LENGTH_OF_LAW = IN_LAW.alpha_y + 4
"""How many numbers the `packed` form has."""


class SpeedLimits(NamedTuple):
    """Speeds [m/s]: up to `checked` a law was compared with measurements or simulations, up to `inertial` it holds."""

    checked: float
    inertial: float


WITHOUT_INERTIA = SpeedLimits(checked=0.025, inertial=0.2)
"""Limits of a law without inertia. `checked` is the highest speed tested in the paper."""

WITH_INERTIA = SpeedLimits(checked=1.0, inertial=1.0)
"""Limits of a law with inertia: the speed of the fastest simulated run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GranularLaw:
    """Numbers of the grains that every law has. Each field is the parameter ``medium.`` with its name.

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

    def shared(self, stiffness: float) -> dict[str, float]:
        """The numbers of the grains that the compiled loop takes, in the order of `InLaw`; `stiffness`: the law's."""
        return {
            "inertia": self.inertial_density,
            "stiffness": stiffness,
            "mobilization_length": self.mobilization_length,
        }

    @property
    def inertial_density(self) -> float:
        """κ ρ of Eq. (11) [kg/m³]; 0: no inertia."""
        return self.density * self.inertia

    @property
    def has_inertia(self) -> bool:
        """Whether the force includes the grains' inertia, Eq. (11), and so depends on the speed."""
        return self.inertial_density > 0.0

    @property
    def has_memory(self) -> bool:
        """Whether the force has memory, Eq. (10), in evaluations in time."""
        return self.mobilization_length > 0.0

    @property
    def speed_limits(self) -> SpeedLimits:
        """The limits of the law, which are higher if it has the grains' inertia."""
        return WITH_INERTIA if self.has_inertia else WITHOUT_INERTIA

"""What all laws have in common: strength, inertia and memory of the grains, and the form for the compiled loop."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rft_ros.rft.arguments import number, numbers
from rft_ros.rft.kernel.compilation import inlined

__all__ = ["AGARWAL2023", "CONFINEMENT", "INERTIA", "IN_LAW", "LENGTH_OF_LAW", "NO_ALPHA_Y", "NO_TABLE", "TREERS2021"]
__all__ += ["WITHOUT_INERTIA", "WITH_INERTIA", "GranularLaw", "InLaw", "PackedLaw", "SpeedLimits", "inertia_force"]
__all__ += ["packed"]

INERTIA = 1.4
"""κ of an upright plate, chosen on simulated runs at 0.5 and 1 m/s; published for plates that are dragged: 1.1."""

CONFINEMENT = 2.0
"""Grains under a plate cannot yield upwards: κ grows by this times the square of the normal's downward part. Chosen on
one simulated run, a flat plate at 1 m/s; the square is an assumption."""


@inlined
def inertia_force(inertia, normal, velocity, area, per_scale2):
    """The force of the grains' inertia on a plate [N], world axes.

    `velocity`: scaled; `per_scale2`: the factor from its square to m²/s². `area`: submerged and leading [m²].
    """
    nx, ny, nz = normal
    ux, uy, uz = velocity
    lead, down = ux * nx + uy * ny + uz * nz, min(nz, 0.0)
    push = inertia * (1.0 + CONFINEMENT * down * down) * (lead * lead * per_scale2) * area
    return -push * nx, -push * ny, -push * nz


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


TREERS2021, AGARWAL2023 = 0, 1
"""The laws, for `PackedLaw.law`."""

NO_ALPHA_Y = -1
"""`PackedLaw.alpha_y` of a law that has no model of α_y."""

NO_TABLE = np.zeros((2, 2))
"""`PackedLaw.table` where a model has none."""


class PackedLaw(NamedTuple):
    """A law for the compiled loop.

    `law`: which, for example `TREERS2021`. `alpha_y`: the place of its model in `ALPHA_Y_MODELS`, or `NO_ALPHA_Y`.
    `numbers`: at the places of `InLaw`. `table`: the values of a model that has them.
    """

    law: int
    alpha_y: int
    numbers: NDArray[np.float64]
    table: NDArray[np.float64]


def packed(
    law: int, fields: Mapping[str, float], *, alpha_y: int = NO_ALPHA_Y, table: ArrayLike = NO_TABLE
) -> PackedLaw:
    """A law for the compiled loop, in arrays of the types that it takes, which no caller can change.

    `fields`: its numbers by name, in the order of `InLaw`. Raises ValueError or TypeError for what is not finite, or is
    no table.
    """
    values = np.array(numbers("alpha_y.values of the law", table, np.shape(table)[1:]))
    if set(map(type, fields.values())) != {float} or not all(map(isfinite, fields.values())):
        fields = {name: number(f"{name} of the law", value) for name, value in fields.items()}  # names a bad one
    given = np.zeros(LENGTH_OF_LAW)
    given[: len(fields)] = list(fields.values())
    if values.ndim != 2 or min(values.shape) < 2 or not np.isfinite(values).all():
        raise ValueError(f"a table of shape {values.shape} is not finite, or not [2, 2] or larger: use Table.sampled")
    given.flags.writeable = values.flags.writeable = False
    return PackedLaw(law, alpha_y, given, values)


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

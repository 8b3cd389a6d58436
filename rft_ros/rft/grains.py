"""What all laws have in common: strength, inertia and memory of the grains, and the form for the compiled loop."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rft_ros.rft.arguments import number, real_numbers
from rft_ros.rft.kernel.compilation import inlined

INERTIA = 1.4
"""κ of an upright plate, chosen on simulated runs at 0.5 and 1 m/s; published for plates that are dragged: 1.1."""

CONFINEMENT_FACTOR = 2.0
"""Grains under a plate cannot yield upwards: κ grows by this times the square of the normal's downward part. Chosen on
one simulated run, a flat plate at 1 m/s; the square is an assumption."""


@inlined
def inertia_force(inertia, normal, velocity, area, per_scale2):
    """The force of the grains' inertia on a plate [N], world axes.

    `velocity`: scaled; `per_scale2`: the factor from its square to m²/s². `area`: submerged and leading [m²].
    """
    nx, ny, nz = normal
    ux, uy, uz = velocity
    lead = ux * nx + uy * ny + uz * nz
    down = min(nz, 0.0)
    push = inertia * (1.0 + CONFINEMENT_FACTOR * down * down) * (lead * lead * per_scale2) * area
    return -push * nx, -push * ny, -push * nz


TREERS2021 = 0
AGARWAL2023 = 1
"""The laws, for `LAW`."""

MAX_OWN_COUNT = 12
"""Greatest number of numbers that only one law has."""


LAW = np.dtype(
    (
        np.record,
        [  # np.record: fields are attributes, also in Python
            ("law", np.int64),  # such as TREERS2021
            ("inertia", float),  # κ ρ [kg/m³]
            ("stiffness", float),  # ζ or ξ [N/m³]
            ("mobilization_length", float),  # λ [m]
            ("own", float, MAX_OWN_COUNT),  # a NamedTuple of the law, by `own_numbers`
            ("alpha_y_model", np.int64),  # its index in `ALPHA_Y_MODELS`
            ("alpha_y", float, 4),  # the numbers of that model
        ],
    )
)
"""The numbers of a law for the compiled loop. Those that a law does not have are 0."""


def own_numbers(kind: Any) -> Callable[[Any], Any]:
    """The function that reads a law's own numbers from a record of `LAW` as the law's NamedTuple `kind`."""
    count = len(kind._fields)

    @inlined
    def read(record):
        n = record.own
        numbers = (n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8], n[9], n[10], n[11])
        return kind(*numbers[:count])

    return read


NO_TABLE = np.zeros((2, 2))
"""`PackedLaw.table` where a model of α_y has none."""


class PackedLaw(NamedTuple):
    """A law for the compiled loop: `numbers`, one record of `LAW`, and the `table` of a model of α_y that has one."""

    numbers: NDArray[np.void]
    table: NDArray[np.float64]


def pack(
    law: int,
    shared_numbers: Mapping[str, float],
    law_numbers: Mapping[str, float],
    *,
    alpha_y: Mapping[str, float] | None = None,
    table: ArrayLike = NO_TABLE,
) -> PackedLaw:
    """A law for the compiled loop, in arrays of the types that it takes, which no caller can change.

    `shared_numbers`: by their names in `LAW`. `law_numbers`: those of this law alone. `alpha_y`: those of its
    model of α_y, at most four. Raises ValueError or TypeError for what is not finite, or is no table.
    """
    given = real_numbers("alpha_y.values of the law", table)
    values = np.array(given, dtype=np.float64, order="C")
    if values.ndim != 2 or min(values.shape) < 2 or not np.isfinite(values).all():
        raise ValueError(
            f"a table of shape {values.shape} is not finite, or not [2, 2] or larger: use Table.sampled"
        )
    record = np.zeros(1, LAW)
    record["law"] = law
    for name, value in shared_numbers.items():
        record[name] = number(f"{name} of the law", value)
    for index, (name, value) in enumerate(law_numbers.items()):
        record["own"][0, index] = number(f"{name} of the law", value)
    for index, (name, value) in enumerate((alpha_y or {}).items()):
        record["alpha_y"][0, index] = number(f"alpha_y.{name} of the law", value)
    record.flags.writeable = False
    values.flags.writeable = False
    return PackedLaw(record, values)


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
        """The numbers of the grains that the compiled loop takes, by their names in `LAW`; `stiffness`: the law's."""
        return {
            "inertia": self.inertial_density,
            "stiffness": stiffness,
            "mobilization_length": self.mobilization_length,
        }

    @property
    def stresses(self) -> dict[str, str]:
        """The names of the parts that its stresses are made of, if they have names."""
        return {}

    @property
    def doubts(self) -> tuple[str, ...]:
        """Sentences on why its numbers may be wrong."""
        return ()

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

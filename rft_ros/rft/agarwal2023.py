"""The law of Agarwal, Goldman, Kamrin, PNAS 120, e2214017120, 2023 ("3D-RFT"), Eq. (12).

Three polynomials of the directions of gravity, normal and motion give the traction per depth; the friction of the
tool's surface limits its tangential part. No direction is undefined, so horizontal plates need no special treatment.

Two coefficients differ between public codes. The table has those that two independent transcriptions share. c2 of
x2² x3 is 0.18519 (also seen: 0.18589; 0.08 % of a flat plate's force). c3 of x2 x3² is -0.02730 (also seen: -0.20770,
which gives a flat plate 21 % more force and lets the grains pull at 12 % of all leading directions in place of 3 %).
"""

from dataclasses import dataclass, field
from math import radians, sin, sqrt
from typing import ClassVar, NamedTuple

from rft_ros.rft.arguments import number
from rft_ros.rft.grains import AGARWAL2023, GranularLaw, PackedLaw, own_numbers, pack
from rft_ros.rft.kernel.compilation import inlined

# fmt: off
C1 = (
    0.00212, -0.02320, -0.20890, -0.43083, -0.00259, 0.48872, -0.00415, 0.07204, -0.02750, -0.08772,
    0.01992, -0.45961, 0.40799, -0.10107, -0.06576, 0.05664, -0.09269, 0.01892, 0.01033, 0.15120,
)
C2 = (
    -0.06796, -0.10941, 0.04725, -0.06914, -0.05835, -0.65880, -0.11985, -0.25739, -0.26834, 0.02692,
    -0.00736, 0.63758, 0.08997, 0.21069, 0.04748, 0.20406, 0.18519, 0.04934, 0.13527, -0.33207,
)
C3 = (
    -0.02634, -0.03436, 0.45256, 0.00835, 0.02553, -1.31290, -0.05532, 0.06790, -0.16404, 0.02287,
    0.02927, 0.95406, -0.00131, -0.11028, 0.01487, -0.02730, 0.10911, -0.04097, 0.07881, -0.27519,
)
# fmt: on
"""Coefficients of 1, x1, x2, x3, x1², x2², x3², x1 x2, x2 x3, x3 x1, x1³, x2³, x3³, x1 x2², x1² x2, x2 x3², x2² x3,
x1² x3, x1 x3², x1 x2 x3 in f1, f2, f3; no unit."""

FLAT_PRESS = -sum(C1 + C2 + C3)
"""Traction per depth of a flat plate pressed straight down, over ξ: with ξ = ζ · 1 N/cm³ / `FLAT_PRESS` its
force is the same by this law as by Li's generic coefficients, whose sum is 1 N/cm³."""

SURFACE_FRICTION = 0.3
"""Friction of the tool's surface in the simulated runs."""

_UPRIGHT = 1.0 / sin(radians(5.0))
_TINY = 1e-290


class Own(NamedTuple):
    """The numbers of this law alone, for the compiled loop."""

    surface_friction: float  # of Eq. (12), no unit


_numbers_of = own_numbers(Own)


@dataclass(frozen=True, slots=True, kw_only=True)
class Agarwal2023(GranularLaw):
    """The grains by this law.

    `zeta`: comparable to that of `Treers2021` (see `FLAT_PRESS`). `surface_friction` of the tool, no unit. The others:
    see `GranularLaw`. `packed`: for the loop. Raises ValueError that names a number out of range.
    """

    name: ClassVar[str] = "agarwal2023"

    surface_friction: float = SURFACE_FRICTION
    packed: PackedLaw = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        GranularLaw.__post_init__(self)
        friction = number("medium.surface_friction", self.surface_friction, least=0.0)
        law_numbers = Own(surface_friction=friction)._asdict()
        packed_law = pack(AGARWAL2023, self.shared(self.stiffness), law_numbers)
        object.__setattr__(self, "packed", packed_law)

    @property
    def stiffness(self) -> float:
        """ξ [N/m³]."""
        return self.zeta * (1e6 / FLAT_PRESS)


@inlined
def _even_and_odd(c, x1, x2, square):
    """The polynomial's parts even in x3, and odd in x3 divided by x3. `square`: x3²."""
    (
        one,
        c1,
        c2,
        c3,
        c11,
        c22,
        c33,
        c12,
        c23,
        c31,
        c111,
        c222,
        c333,
        c122,
        c112,
        c233,
        c223,
        c113,
        c133,
        c123,
    ) = c
    even = (
        (one + c1 * x1 + c2 * x2)
        + (c11 * x1 * x1 + c22 * x2 * x2 + c12 * x1 * x2)
        + (c111 * x1 + c112 * x2) * (x1 * x1)
        + (c222 * x2 + c122 * x1) * (x2 * x2)
        + (c33 + c233 * x2 + c133 * x1) * square
    )
    odd = (
        (c3 + c23 * x2 + c31 * x1) + (c223 * x2 + c123 * x1) * x2 + c113 * x1 * x1 + c333 * square
    )
    return even, odd


@inlined
def agarwal2023_traction(law, normal, velocity):
    """Traction per depth [N/m³], Eq. (12), world axes. `law`: its numbers. `velocity`: unit vector, or 0."""
    nx, ny, nz = normal
    vx, vy, vz = velocity
    # The published normal m = ±n never points up, so it changes sign at an upright plate, and the force by 10 to 20 %.
    # The terms that change sign with m are therefore multiplied by `side`, a ramp from -1 to 1 over 5° on either side.
    # The other terms do not depend on the sign.
    side = min(max(-nz * _UPRIGHT, -1.0), 1.0)
    x1, x2, x3 = -vz, abs(nz), nx * vx + ny * vy + nz * vz
    even1, odd1 = _even_and_odd(C1, x1, x2, x3 * x3)
    even2, odd2 = _even_and_odd(C2, x1, x2, x3 * x3)
    even3, odd3 = _even_and_odd(C3, x1, x2, x3 * x3)
    x3s = x3 * side
    f1, f2, f3 = side * even1 + x3 * odd1, even2 + x3s * odd2, even3 + x3s * odd3
    # traction f1 n + f2 v - f3 E3: normal to the plate, and along it
    normal_part = f1 + f2 * x3 - f3 * nz
    back = f1 - normal_part
    ax, ay, az = back * nx + f2 * vx, back * ny + f2 * vy, back * nz + f2 * vz - f3
    pressure = max(-normal_part, 0.0)  # grains do not pull
    friction = _numbers_of(law).surface_friction
    share = min(friction * pressure / sqrt(max(ax * ax + ay * ay + az * az, _TINY)), 1.0)
    stiffness = law.stiffness if vx * vx + vy * vy + vz * vz > 0.0 else 0.0
    return (
        stiffness * (share * ax - pressure * nx),
        stiffness * (share * ay - pressure * ny),
        stiffness * (share * az - pressure * nz),
    )

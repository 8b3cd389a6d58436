"""Traction per depth of plates, Eqs. (8) and (12), from their normals and velocities; this module chooses the law.

A law is a dataclass, `Treers2021` or `Agarwal2023`, of all that is known of the grains: their stresses, strength,
density and memory. `tractions` takes its `packed` form, and evaluates it for the plates of a chunk.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import MISSING, dataclass, field, fields
from math import radians, sin, sqrt
from typing import Any, ClassVar, NamedTuple

from rft_ros.rft.agarwal2023 import Agarwal2023, agarwal2023_traction
from rft_ros.rft.alpha_y import (
    PAPER_LINEAR,
    AlphaY,
    Constant,
    add_alpha_y,
    alpha_y_name,
    pack_treers2021,
)
from rft_ros.rft.grains import AGARWAL2023, GranularLaw, PackedLaw, own_numbers
from rft_ros.rft.kernel import chunk as layout
from rft_ros.rft.kernel.chunk import at, put, triple, wide_vectors
from rft_ros.rft.kernel.compilation import STEP, compiled, inlined
from rft_ros.rft.media import Medium

A1, A2, A3 = 0.440850096954369, 3.62263982880971, 1.60910808139526
B1, B2, B3 = 1.99392673405210, 1.61146827229181, 0.973746396532650
"""Coefficients of Eqs. (5) and (6), with all digits of the released code; no unit."""

_TANH_A3 = math.tanh(A3)
_ATANH_B3 = math.atanh(B3)
_F1_BRACKET = math.tanh(A2 - A3) + _TANH_A3  # the brackets of Eqs. (5) and (6) at 1
_F23_BRACKET = math.atanh(B2 - B3) + _ATANH_B3


@inlined
def f1_and_f23(u, w):
    """f1 of u and f23 of w, Eqs. (5) and (6), by rational functions; and 1 / w.

    u = abs(v1)/abs(v) and w = abs(v23)/abs(v), both in 0 to 1 and clamped above against rounding.
    """
    x = A2 * min(u, 1.0) - A3
    y = x * x
    # tanh on [-2.02, 2.02] is x p / q
    p = 0.9999999999999886 + y * (
        0.13302099960519095 + y * (0.003381084867620261 + y * 1.7142159321202105e-05)
    )
    q = 1.0 + y * (
        0.46635433293806744
        + y * (0.02549919584996656 + y * (0.0003045503448204258 + y * 4.6455496565101557e-07))
    )
    # atanh on [-B3, B3] is z m / n in s = 1 - z², so that every term is positive and nothing cancels
    z = B2 * min(w, 1.0) - B3
    s = 1.0 - z * z
    m = 12300803.010922123 + s * (
        9560971.1590504 + s * (2056962.9007124235 + s * 53230.14975437819)
    )
    m = 942294.1898347555 + s * (5548958.519711758 + s * m)
    m = 4.289115687171275 + s * (1132.1464818246257 + s * (58434.8494029061 + s * m))
    n = 10390843.33103938 + s * (
        11547977.837189073 + s * (4209592.087113166 + s * 331184.6682444988)
    )
    n = 23508.22782228692 + s * (473971.42322102754 + s * (3545352.247192668 + s * n))
    n = 1.0 + s * (360.39315043415434 + s * n)
    reciprocal = 1.0 / (q * n * max(w, 1e-290))  # one division for three
    per_qn = reciprocal * max(w, 1e-290)
    f1 = (1.0 / _F1_BRACKET) * (x * p * (n * per_qn) + _TANH_A3)
    f23 = (1.0 / _F23_BRACKET) * (z * m * (q * per_qn) + _ATANH_B3)
    return (f1 if u > 0.0 else 0.0), (f23 if w > 0.0 else 0.0), reciprocal * (q * n)


N_PER_CM3 = 1e6  # 1 N/cm³ in N/m³

FLAT = 1.0 - 1e-3
"""A plate with abs(n·E3) at or above this counts as horizontal: its e2 comes from the velocity (released code)."""

BLEND_TILT_DEG = 5.0
"""Tilt up to which the refined rule blends the tractions with e2 from the velocity and from the normal. The
released code switches at `FLAT`; the paper does not mention the case."""

_SIN_BLEND = sin(radians(BLEND_TILT_DEG))

_MAX_STRENGTH_RATIO = 1.5
"""With `PAPER_LINEAR`, a medium raises no doubt if its strength is within this factor of the generic medium's."""

_NUDGE_RATIO = 1e-5
"""Added to a unit velocity's x by the released code, so that a horizontal plate has an e2 in vertical motion."""


class ExpandedStresses(NamedTuple):
    """Eq. (4) with sin(±2β + γ) and cos(±2β + γ) expanded, so that no angle is computed [N/cm³]."""

    A00: float
    A10: float
    B11_plus_Bm11: float
    B11_minus_Bm11: float
    B01: float
    C01: float
    C11_plus_Cm11: float
    Cm11_minus_C11: float
    D10: float


_stresses_of = own_numbers(ExpandedStresses)


@dataclass(frozen=True, slots=True, kw_only=True)
class Treers2021(GranularLaw):
    """The grains by 3D RFT of Treers, Cao, Stuart 2021 on the 2D stresses of Li, Zhang, Goldman 2013: Eqs. (2) to (8).

    `medium`: the nine coefficients of Eq. (4). `alpha_y`: the model of Eq. (7). The others: see `GranularLaw`.
    `packed`: for the loop. Raises ValueError that names a number out of range, TypeError for what is not a medium or a
    model.
    """

    name: ClassVar[str] = "treers2021"

    medium: Medium
    alpha_y: AlphaY
    packed: PackedLaw = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        GranularLaw.__post_init__(self)
        m = self.medium
        if not isinstance(m, Medium):
            raise TypeError(f"medium is {m!r}; choose one of MEDIA or create a Medium")
        law_stresses = ExpandedStresses(
            A00=m.A00,
            A10=m.A10,
            B11_plus_Bm11=m.B11 + m.Bm11,
            B11_minus_Bm11=m.B11 - m.Bm11,
            B01=m.B01,
            C01=m.C01,
            C11_plus_Cm11=m.C11 + m.Cm11,
            Cm11_minus_C11=m.Cm11 - m.C11,
            D10=m.D10,
        )
        packed_law = pack_treers2021(
            self.alpha_y, self.shared(self.stiffness), law_stresses._asdict()
        )
        object.__setattr__(self, "packed", packed_law)

    @property
    def stiffness(self) -> float:
        """ζ in N/m³ per N/cm³."""
        return self.zeta * N_PER_CM3

    @property
    def stresses(self) -> dict[str, str]:
        """The names of the medium and of the model of α_y."""
        return {"medium": self.medium.name, "alpha_y": alpha_y_name(self.alpha_y)}

    @property
    def doubts(self) -> tuple[str, ...]:
        """Sentences on why its numbers may be wrong."""
        if isinstance(self.alpha_y, Constant) and self.alpha_y.value <= 0.0:
            value = (
                f"alpha_y.model constant is {self.alpha_y.value:.3g} N/cm³ for {self.medium.name}"
            )
            return (
                *self.medium.doubts,
                f"{value}, so that the force on a plate would point along its motion; "
                "use alpha_y.model linear or a table",
            )
        strength = self.medium.strength
        if (
            self.alpha_y != PAPER_LINEAR
            or _MAX_STRENGTH_RATIO > strength > 1.0 / _MAX_STRENGTH_RATIO
        ):
            return self.medium.doubts
        line = f"alpha_y.model linear is the line of the generic medium; the stresses of {self.medium.name} are"
        return (
            *self.medium.doubts,
            f"{line} {strength:.2g} times as strong: use alpha_y.model constant or a table",
        )


Law = Treers2021 | Agarwal2023
"""Any law."""

_LAWS: dict[str, type[Law]] = {law.name: law for law in (Treers2021, Agarwal2023)}
LAWS = tuple(_LAWS)
"""Names of the laws: values of the parameter `law`."""

_OPTIONAL = {
    name: tuple(f.name for f in fields(law) if f.init and f.default is not MISSING)
    for name, law in _LAWS.items()
}
LAW_NUMBERS = tuple(dict.fromkeys(itertools.chain(*_OPTIONAL.values())))
"""Names of the numbers that a law has: each is the parameter ``medium.`` with this name."""


def packed_law(law: Law) -> PackedLaw:
    """A law's `packed`. Raises TypeError for anything else."""
    if not isinstance(law, Law):
        raise TypeError(f"law is {law!r}; create a Treers2021 or an Agarwal2023")
    return law.packed


def treers2021(medium: Medium, alpha_y_model: AlphaY, **numbers: float) -> Treers2021:
    """The grains by this law. `numbers`, all optional, and errors: those of `Treers2021`."""
    return Treers2021(medium=medium, alpha_y=alpha_y_model, **numbers)


def law_named(name: str, medium: Medium, alpha_y_model: AlphaY, **numbers: float) -> Law:
    """The grains by the law that the parameter `law` names, one of `LAWS`.

    `numbers`: of `LAW_NUMBERS`, all optional. The law ignores what it has no use for. Raises ValueError for other names
    and for numbers out of range, TypeError for a number that no law has.
    """
    if name not in _LAWS:
        raise ValueError(f"law '{name}' is none of {', '.join(LAWS)}")
    unknown = [number for number in numbers if number not in LAW_NUMBERS]
    if unknown:
        raise TypeError(f"no law has a number '{unknown[0]}'; use {', '.join(LAW_NUMBERS)}")
    law_numbers = {number: value for number, value in numbers.items() if number in _OPTIONAL[name]}
    if name == Treers2021.name:
        return treers2021(medium, alpha_y_model, **law_numbers)
    make: Callable[..., Law] = _LAWS[name]
    return make(**law_numbers)


def described(law: Law) -> str:
    """The grains in words, such as "law treers2021, medium generic, alpha_y linear, zeta 0.33, memory 3 mm"."""
    parts = [
        f"law {law.name}",
        *(f"{what} {name}" for what, name in law.stresses.items()),
        f"zeta {law.zeta:g}",
    ]
    parts.append(f"memory {1e3 * law.mobilization_length:g} mm" if law.has_memory else "no memory")
    if law.has_inertia:
        parts.append(f"density {law.density:g} kg/m3")
    return ", ".join(parts)


MIN_RESISTANCE_SHARE = 0.08
"""Under the refined rule, at least this share of a traction is against the motion of its plate. With much less, the
springs of the memory, Eq. (10), would store more energy than the motion gives."""

_TINY = 1e-290  # avoids 1 / 0 where the reciprocal root multiplies zeros


@inlined
def orient(chunk, i, normal, velocity):
    """Store plate i's normal, velocity, e2 and β, Eqs. (2) and (3), for `tractions`; returns 1 / abs(velocity)."""
    nx, ny, nz = normal
    vx, vy, vz = velocity
    speed_squared = vx * vx + vy * vy + vz * vz
    horizontal = nx * nx + ny * ny
    speed = sqrt(max(speed_squared, _TINY))
    length = sqrt(max(horizontal, _TINY))
    reciprocal = 1.0 / (speed * length)  # one division for both
    per_speed = reciprocal * length
    per_length = reciprocal * speed
    put(chunk, layout.NORMAL, i, normal)
    put(chunk, layout.VELOCITY, i, (vx * per_speed, vy * per_speed, vz * per_speed))
    chunk[at(layout.SPEED, i)] = speed_squared * per_speed
    chunk[at(layout.E2_X, i)] = nx * per_length
    chunk[at(layout.E2_Y, i)] = ny * per_length
    chunk[at(layout.SIN_B, i)] = horizontal * per_length
    chunk[at(layout.COS_B, i)] = -nz
    return per_speed


@inlined
def _turn_flat_plates(chunk, n, flat_cosine):
    """Give plates with abs(n·E3) >= `flat_cosine` the velocity's horizontal direction as e2, where 2D RFT holds."""
    wide_vectors()
    for i in range(n):
        nx, ny, nz = triple(chunk, layout.NORMAL, i)
        vx, vy, _ = triple(chunk, layout.VELOCITY, i)
        vx += _NUDGE_RATIO
        vx = 1.0 if vx * vx + vy * vy == 0.0 else vx
        per_length = 1.0 / sqrt(vx * vx + vy * vy)
        vx, vy = vx * per_length, vy * per_length
        n2 = nx * vx + ny * vy
        # (n·e2, n·E3) is at least FLAT long, or counts little: the series of the reciprocal is accurate to 1e-14
        short = 1.0 - (n2 * n2 + nz * nz)
        per_n23 = 1.0 + short * (0.5 + short * (0.375 + short * (0.3125 + short * 0.2734375)))
        flat = abs(nz) >= flat_cosine
        chunk[at(layout.E2_X, i)] = vx if flat else chunk[at(layout.E2_X, i)]
        chunk[at(layout.E2_Y, i)] = vy if flat else chunk[at(layout.E2_Y, i)]
        chunk[at(layout.SIN_B, i)] = n2 * per_n23 if flat else chunk[at(layout.SIN_B, i)]
        chunk[at(layout.COS_B, i)] = -nz * per_n23 if flat else chunk[at(layout.COS_B, i)]


@inlined
def _stresses(c, stiffness, sin_b, cos_b, e2, velocity):
    """Eq. (8) without α_y: the traction along e2 and E3, the factor of α_y along e1, sin and cos of γ.

    `c`: `ExpandedStresses`. `stiffness`: ζ in N/m³ per N/cm³.
    """
    ex, ey = e2
    vx, vy, vz = velocity
    v1, v2 = vx * ey - vy * ex, vx * ex + vy * ey
    v23 = sqrt(v2 * v2 + vz * vz)
    f1, f23, per_v23 = f1_and_f23(abs(v1), v23)
    cos_g = v2 * per_v23
    sin_g = -vz * per_v23
    cos_2b = 1.0 - 2.0 * sin_b * sin_b
    sin_2b = 2.0 * sin_b * cos_b
    alpha_z = (
        c.A00
        + c.A10 * cos_2b
        + (c.B11_plus_Bm11 * cos_2b + c.B01) * sin_g
        + c.B11_minus_Bm11 * sin_2b * cos_g
    )
    alpha_x = (c.C01 + c.C11_plus_Cm11 * cos_2b) * cos_g + (
        c.Cm11_minus_C11 * sin_g + c.D10
    ) * sin_2b
    e1_factor = stiffness * f1
    e23_factor = stiffness * f23
    t2 = -e23_factor * alpha_x
    t3 = e23_factor * alpha_z
    return (t2 * ex, t2 * ey, t3), (-e1_factor if v1 > 0.0 else e1_factor), sin_g, cos_g


@inlined
def _treers2021(law, chunk, n, is_refined):
    wide_vectors()
    stresses = _stresses_of(law.numbers[0])
    stiffness = law.numbers[0].stiffness
    for i in range(n):
        sin_b = chunk[at(layout.SIN_B, i)]
        cos_b = chunk[at(layout.COS_B, i)]
        e2 = (chunk[at(layout.E2_X, i)], chunk[at(layout.E2_Y, i)])
        velocity = triple(chunk, layout.VELOCITY, i)
        t, e1_factor, sin_g, cos_g = _stresses(stresses, stiffness, sin_b, cos_b, e2, velocity)
        put(chunk, layout.TRACTION, i, t)
        chunk[at(layout.E1_FACTOR, i)] = e1_factor
        chunk[at(layout.SIN_G, i)] = sin_g
        chunk[at(layout.COS_G, i)] = cos_g
    add_alpha_y(law, chunk, n, is_refined)


@inlined
def _limited(chunk, n):
    """Limit the tractions: grains do not pull a plate, and they resist its motion by at least `MIN_RESISTANCE_SHARE`.

    Removes the part along the outward normal where it is positive, and then so much of the velocity's direction, or of
    its part in the plate's plane if the plate trails, that the rest is left against it.
    """
    wide_vectors()
    for i in range(n):
        nx, ny, nz = triple(chunk, layout.NORMAL, i)
        vx, vy, vz = triple(chunk, layout.VELOCITY, i)
        tx, ty, tz = triple(chunk, layout.TRACTION, i)
        pull = max(tx * nx + ty * ny + tz * nz, 0.0)
        away = min(vx * nx + vy * ny + vz * nz, 0.0)
        tx, ty, tz = tx - pull * nx, ty - pull * ny, tz - pull * nz
        vx, vy, vz = vx - away * nx, vy - away * ny, vz - away * nz
        least = MIN_RESISTANCE_SHARE * sqrt(tx * tx + ty * ty + tz * tz)
        push = max(tx * vx + ty * vy + tz * vz + least, 0.0)
        put(chunk, layout.TRACTION, i, (tx - push * vx, ty - push * vy, tz - push * vz))


def _tractions(law: Any, chunk: Any, n: Any, flat: bool, is_refined: bool) -> None:
    """Traction per depth of the n plates of a chunk that `orient` has stored. `law`: its `packed`.

    `flat`: whether plates may be near to horizontal; their tractions switch at `FLAT`, or by the refined rule are
    blended over `BLEND_TILT_DEG`. `is_refined`: with the limits of that rule: grains neither pull a plate nor push it
    in its direction of motion.
    """
    wide_vectors()
    numbers = law.numbers[0]
    if numbers.law == AGARWAL2023:
        for i in range(n):
            normal = triple(chunk, layout.NORMAL, i)
            velocity = triple(chunk, layout.VELOCITY, i)
            put(chunk, layout.TRACTION, i, agarwal2023_traction(numbers, normal, velocity))
        if is_refined:
            _limited(chunk, n)
        return
    blends = flat and is_refined
    for pass_index in range(2 if blends else 1):
        if pass_index == 1 or (flat and not blends):
            _turn_flat_plates(chunk, n, -1.0 if blends else FLAT)
        _treers2021(law, chunk, n, is_refined)
        if blends and pass_index == 0:
            for i in range(n):
                put(chunk, layout.STEEP_TRACTION, i, triple(chunk, layout.TRACTION, i))
    if blends:
        for i in range(n):
            nx, ny, _ = triple(chunk, layout.NORMAL, i)
            share = min(sqrt(nx * nx + ny * ny) * (1.0 / _SIN_BLEND), 1.0)
            ax, ay, az = triple(chunk, layout.TRACTION, i)
            bx, by, bz = triple(chunk, layout.STEEP_TRACTION, i)
            put(
                chunk,
                layout.TRACTION,
                i,
                (ax + share * (bx - ax), ay + share * (by - ay), az + share * (bz - az)),
            )
    if is_refined:
        _limited(chunk, n)


tractions = compiled(_tractions, **STEP)

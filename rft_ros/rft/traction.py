"""Traction per depth of one plate, Eqs. (8) and (12), from its normal and velocity; no other module knows a law's form.

A law is a NamedTuple of numbers and a function ``traction_per_depth(law, n, v, flatness) -> t``, in world axes with z
up. The loops over plates (`rft_ros.rft.kernel`) call only `traction_per_depth`. To add a law, write both and add one
line to `_FUNCTIONS`.
"""

from collections.abc import Callable
from math import radians, sin, sqrt
from typing import Any, NamedTuple

from numba import types
from numba.extending import overload

from rft_ros.rft.agarwal2023 import SURFACE_FRICTION, Agarwal2023, agarwal2023, agarwal2023_traction
from rft_ros.rft.alpha_y import AlphaY, alpha_y, checked_alpha_y
from rft_ros.rft.arguments import number
from rft_ros.rft.compilation import OPTIONS, inlined
from rft_ros.rft.inertia import INERTIA, inertial_density
from rft_ros.rft.media import Medium
from rft_ros.rft.velocity_weights import f1, f23

__all__ = [
    "BLENDED",
    "FLAT",
    "FLAT_BLEND",
    "LAWS",
    "NEVER_FLAT",
    "SWITCHED",
    "Law",
    "Treers2021",
    "checked_law",
    "law_named",
    "traction_per_depth",
    "treers2021",
]

N_PER_CM3 = 1e6  # 1 N/cm³ in N/m³

FLAT = 1.0 - 1e-3
"""A plate with abs(n·E3) at or above this counts as horizontal: its e2 comes from the velocity (released code)."""

FLAT_BLEND = 5.0
"""Tilt [deg] up to which the refined rule blends the tractions with e2 from the velocity and from the normal. The
released code switches at `FLAT`; the paper does not mention the case."""

_SIN_BLEND = sin(radians(FLAT_BLEND))

_NUDGE = 1e-5
"""Added to a unit velocity's x by the released code, so that a horizontal plate has an e2 in vertical motion."""


class Treers2021(NamedTuple):
    """3D RFT of Treers, Cao, Stuart 2021 on the 2D stresses of Li, Zhang, Goldman 2013: Eqs. (2) to (8).

    `stiffness`: ζ in N/m³ per N/cm³. The other numbers are sums and differences of Li's coefficients [N/cm³], from
    expanding sin(±2β + γ) and cos(±2β + γ), so that no angle is computed. `alpha_y`: the model of Eq. (7). `inertia`:
    λ ρ [kg/m³] of Eq. (11).
    """

    stiffness: float
    z_one: float
    z_cos2b: float
    z_cos2b_sing: float
    z_sin2b_cosg: float
    z_sing: float
    x_cosg: float
    x_cos2b_cosg: float
    x_sin2b_sing: float
    x_sin2b: float
    alpha_y: AlphaY
    inertia: float = 0.0


Law = Treers2021 | Agarwal2023
"""Any law. Its type selects the machine code."""


def treers2021(
    medium: Medium, alpha_y_model: AlphaY, *, zeta: float = 1.0, density: float = 0.0, inertia: float = INERTIA
) -> Treers2021:
    """The law, Eq. (8), for a medium scaled by `zeta` (no unit) with a model of α_y.

    `density` of the bed [kg/m³] and `inertia` λ: see `inertial_density`; 0: the force does not depend on speed. Raises
    ValueError unless `zeta` is a positive, finite number.
    """
    m = medium
    return Treers2021(
        stiffness=number("medium.zeta", zeta, positive=True) * N_PER_CM3,
        z_one=m.A00,
        z_cos2b=m.A10,
        z_cos2b_sing=m.B11 + m.Bm11,
        z_sin2b_cosg=m.B11 - m.Bm11,
        z_sing=m.B01,
        x_cosg=m.C01,
        x_cos2b_cosg=m.C11 + m.Cm11,
        x_sin2b_sing=m.Cm11 - m.C11,
        x_sin2b=m.D10,
        alpha_y=checked_alpha_y(alpha_y_model),
        inertia=inertial_density(density, inertia),
    )


def law_named(
    name: str,
    medium: Medium,
    alpha_y_model: AlphaY,
    *,
    zeta: float = 1.0,
    surface_friction: float = SURFACE_FRICTION,
    density: float = 0.0,
    inertia: float = INERTIA,
) -> Law:
    """The law named by the parameter `law`, one of `LAWS`; it ignores what it has no use for.

    Raises ValueError for other names and for numbers out of range.
    """
    if name == "agarwal2023":
        return agarwal2023(zeta=zeta, surface_friction=surface_friction, density=density, inertia=inertia)
    if name == "treers2021":
        return treers2021(medium, alpha_y_model, zeta=zeta, density=density, inertia=inertia)
    raise ValueError(f"law '{name}' is none of {', '.join(LAWS)}")


def checked_law(law: Law) -> Law:
    """The law with float64 fields: an integer field would compile another kernel.

    Raises TypeError for anything but a law, ValueError for fields that are not finite numbers.
    """
    if type(law) not in _FUNCTIONS:
        raise TypeError(f"law is {law!r}; create one with treers2021 or agarwal2023")
    fields: dict[str, Any] = {
        name: checked_alpha_y(v) if name == "alpha_y" else number(f"{name} of the law", v)
        for name, v in law._asdict().items()
    }
    return type(law)(**fields)


NEVER_FLAT, SWITCHED, BLENDED = 0, 1, 2
"""Near-horizontal plates: assume none, switch at `FLAT`, or blend over `FLAT_BLEND`."""

_TINY = 1e-290  # avoids 1 / 0 where the reciprocal root multiplies zeros


def _treers2021(law, nx, ny, nz, vx, vy, vz, flatness):  # type: ignore[no-untyped-def]
    per_speed = 1.0 / sqrt(max(vx * vx + vy * vy + vz * vz, _TINY))
    if flatness == NEVER_FLAT:
        return _with_direction(law, nx, ny, nz, vx, vy, vz, per_speed, nx, ny, False)
    # e2 of a horizontal plate: the velocity's horizontal direction (2D RFT holds)
    wx, wy = vx * per_speed + _NUDGE, vy * per_speed
    wx = 1.0 if wx * wx + wy * wy == 0.0 else wx
    if flatness == SWITCHED:
        flat = abs(nz) >= FLAT
        hx, hy = wx if flat else nx, wy if flat else ny
        return _with_direction(law, nx, ny, nz, vx, vy, vz, per_speed, hx, hy, flat)
    ax, ay, az = _with_direction(law, nx, ny, nz, vx, vy, vz, per_speed, wx, wy, True)
    bx, by, bz = _with_direction(law, nx, ny, nz, vx, vy, vz, per_speed, nx, ny, False)
    share = min(sqrt(nx * nx + ny * ny) * (1.0 / _SIN_BLEND), 1.0)
    return ax + share * (bx - ax), ay + share * (by - ay), az + share * (bz - az)


@inlined
def _with_direction(law, nx, ny, nz, vx, vy, vz, per_speed, hx, hy, flat):  # type: ignore[no-untyped-def]
    """Traction per depth with e2 along (hx, hy), e1 = e2 x E3. `flat`: the normal may lie outside the e2-E3 plane."""
    # The three roots are independent of each other: half of a plate's time is latency.
    hh = hx * hx + hy * hy
    per_h = 1.0 / sqrt(max(hh, _TINY))
    v1h = vx * hy - vy * hx
    v2h = vx * hx + vy * hy
    qq = v2h * v2h + vz * vz * hh  # (v23 h)²
    per_q = 1.0 / sqrt(max(qq, _TINY))

    # attack angle: β = atan2(n·E3, n·e2) + 90°. The length of (n·e2, n·E3) is 1, or at least FLAT for a flat plate:
    # four terms of the series of its reciprocal are accurate to 1e-14 and save a root and a division.
    n2 = (nx * hx + ny * hy) * per_h
    short = 1.0 - (n2 * n2 + nz * nz) if flat else 0.0
    per_n23 = 1.0 + short * (0.5 + short * (0.375 + short * (0.3125 + short * 0.2734375)))
    sin_b = n2 * per_n23
    cos_b = -nz * per_n23
    cos_2b = 1.0 - 2.0 * sin_b * sin_b
    sin_2b = 2.0 * sin_b * cos_b

    # intrusion angle: γ = -atan2(v23·E3, v23·e2)
    cos_g = v2h * per_q
    sin_g = -vz * (hh * per_h * per_q)

    alpha_z = (
        law.z_one
        + law.z_cos2b * cos_2b
        + (law.z_cos2b_sing * cos_2b + law.z_sing) * sin_g
        + law.z_sin2b_cosg * sin_2b * cos_g
    )
    alpha_x = (law.x_cosg + law.x_cos2b_cosg * cos_2b) * cos_g + (law.x_sin2b_sing * sin_g + law.x_sin2b) * sin_2b
    per_h_speed = per_h * per_speed
    along = (law.stiffness * per_h) * f1(abs(v1h) * per_h_speed)
    along *= alpha_y(law.alpha_y, sin_b, cos_b, sin_g, cos_g)
    t1 = -along if v1h > 0.0 else along  # v1 = 0 has f1 = 0
    weight = law.stiffness * f23(qq * per_q * per_h_speed)
    t2 = -(weight * per_h) * alpha_x
    return t1 * hy + t2 * hx, t2 * hy - t1 * hx, weight * alpha_z


_FUNCTIONS: dict[type, Callable[..., tuple[float, float, float]]] = {
    Treers2021: _treers2021,
    Agarwal2023: agarwal2023_traction,
}

LAWS = ("treers2021", "agarwal2023")
"""Names of the laws: values of the parameter `law`."""


def traction_per_depth(
    law: Law, nx: float, ny: float, nz: float, vx: float, vy: float, vz: float, flatness: int = SWITCHED
) -> tuple[float, float, float]:
    """Traction per depth on a leading plate [N/m³], Eq. (8) or (12), from its outward unit normal and velocity.

    World axes. Returns its x, y and z; times depth and area it is the force on the plate by the grains. Only the
    direction of the velocity counts; its length should be of order one. `flatness`: `NEVER_FLAT`, `SWITCHED` (the
    released code) or `BLENDED`; a constant in compiled code.
    """
    return _FUNCTIONS[type(law)](law, nx, ny, nz, vx, vy, vz, flatness)


@overload(traction_per_depth, jit_options={"forceinline": True, **OPTIONS})
def _compiled_traction(law, nx, ny, nz, vx, vy, vz, flatness):  # type: ignore[no-untyped-def]
    if isinstance(law, types.BaseNamedTuple):
        return _FUNCTIONS.get(law.instance_class)
    return None

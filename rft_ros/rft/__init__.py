"""The method: 3D granular Resistive Force Theory, with numpy and numba only.

After Treers, Cao, Stuart, IEEE RA-L 6(2), 2021, on the 2D stresses of Li, Zhang, Goldman, Science 339, 2013. The
equations are numbered here; "Eq. (n)" in this package means one of these, not one in the papers.

Conventions. Force ON the tool BY the grains; SI units; world axes with z up, E3 its unit vector; quaternions xyzw;
torque about the origin of the tool frame.

Motion of a plate. The tool's surface is cut into plate elements (`Plates`), each with centroid r [m], outward unit
normal n and area dA [m²]. A state (`STATE`, `checked_states`) places the tool frame and gives its twist v_o [m/s],
ω [rad/s]. With r and n in world axes a plate lies at the depth d and moves with v:

    d = surface_height - z,   v = v_o + ω × r                                                    Eq. (1)

An inclined surface takes surface_height + slope · (x, y) in place of surface_height; depth stays vertical.
It is loaded if it is below the surface, d > 0, and leads, v·n > 0; otherwise its force is 0.

Directions. The velocity splits into v1, along the plate's horizontal, and v23, in the vertical plane of its normal:

    e2 = n's horizontal projection at unit length,   e1 = e2 × E3
    v1 = (v·e1) e1,   v23 = v - v1                                                               Eq. (2)

Angles, as in 2D: attack β, 0 for a downward-facing plate and 90° for a vertical one; intrusion γ, positive downwards:

    β = atan2(n·E3, n·e2) + 90°,   γ = -atan2(v23·E3, v23·e2)                                    Eq. (3)

Stress per depth in the plane of e2 and E3 [N/cm³], nine coefficients for each `Medium` (`MEDIA`, `medium_named`):

    α_z = A00 + A10 cos 2β + B11 sin(2β+γ) + B01 sin γ + B-11 sin(-2β+γ)
    α_x = C11 cos(2β+γ) + C01 cos γ + C-11 cos(-2β+γ) + D10 sin 2β                               Eq. (4)

Weights of the velocity components; N1 and N23 are such that f1(1) = f23(1) = 1 (`velocity_weights.exact_f1`,
`exact_f23`):

    f1(u) = A1 [tanh(A2 u - A3) + tanh A3] / N1,        u = |v1| / |v|                           Eq. (5)
    f23(w) = B1 [atanh(B2 w - B3) + atanh B3] / N23,    w = |v23| / |v|                          Eq. (6)

Stress per depth along e1 [N/cm³], one of the models that `alpha_y_model` makes (`Constant`, `Linear`, `Table`):

    α_y = α_x(β = 0, γ = 0);   0.2035 - 0.0015 β[deg];   a table over β and γ                    Eq. (7)

Traction per depth [N/m³] of a plate that leads (`treers2021` makes the law, `traction_per_depth` evaluates it), with
the medium's scale factor ζ and 1 N/cm³ = 1e6 N/m³:

    t = ζ { -f1 α_y sign(v·e1) e1 + f23 (-α_x e2 + α_z E3) }                                     Eq. (8)

Wrench (`wrenches`; by plate, `plate_forces`), a superposition of independent plates:

    F = Σ t d dA  [N],   T = Σ r × t d dA  [N m]                                                 Eq. (9)

The normal of a horizontal plate defines no e2. Its e2 is the horizontal direction of the velocity, for which 3D RFT
reduces to 2D RFT.
`edge_share` returns how much of a tool is near v·n = 0.

Beyond the paper. `Plates.integration` "refined" integrates d over the wet part of each triangle and makes both switches
continuous (`Plates.from_triangles`). A result can include `SENSITIVITIES`: dF/dh, and the sums of r_j f_l. With a
`Memory`, `wrenches_in_time` replaces t in Eq. (9) by τ. While abs(τ) <= y, a radius that the plate keeps, τ
changes elastically with the plate's displacement D. Beyond, τ approaches t along the plate's path p over a mobilization
length λ. `memory` has the rule, and what it does where a plate retreats:

    dτ = -k dD  if |τ| <= y,   else  dτ/dp = (t - τ) / λ(d), y = |τ|,   λ(d) = λ (d / 30 mm)²   Eq. (10)

Fast motion. In a bed of density ρ the inertia of the grains loads a leading plate of area dA below the surface:

    dF = -κ (1 + 2 c²) ρ (v·n)² n dA,   c = max(-n·E3, 0)                                       Eq. (11)

A second law, of Agarwal, Goldman, Kamrin 2023 (`agarwal2023`), replaces Eqs. (2) to (8). With the unit velocity v,
m = n or -n so that m does not point up, and polynomials f1, f2, f3 of x1 = -v·E3, x2 = -m·E3, x3 = m·v:

    α = f1 m + f2 v - f3 E3 = -p n + s,   t = ξ { -p n + min(1, μ p / |s|) s }                  Eq. (12)

with the pressure p, 0 or more, and s along the plate.

Modules, in the order of the paper: `frames`, `media`, `velocity_weights`, `alpha_y`, `grains` with what all laws have
in common, `traction`, `plates`, `wrench`, `result` with the columns of a result, for Eq. (10) `memory` and
`memory_state`, for Eq. (11) `inertia`, for Eq. (12) `agarwal2023`. The package `kernel` makes them fast; `arguments`
checks inputs.

Example: the wrench of one downward-facing plate of 4 cm², 1 cm deep, pushed straight down at 1 cm/s.

>>> from rft_ros.rft import MEDIA, Plates, alpha_y_model, checked_states, treers2021, wrenches
>>> plates = Plates.from_arrays([[0, 0, 0]], [[0, 0, -1]], [4e-4])
>>> law = treers2021(MEDIA["generic"], alpha_y_model("constant", MEDIA["generic"]), zeta=0.33)
>>> state = checked_states([0, 0, -0.01, 0, 0, 0, 1, 0, 0, -0.01, 0, 0, 0])
>>> round(float(wrenches(plates, law, state)[0, 2]), 3)  # fz [N]
1.32
"""

from rft_ros.rft.agarwal2023 import SURFACE_FRICTION, Agarwal2023, agarwal2023
from rft_ros.rft.alpha_y import ALPHA_Y_MODELS, AlphaY, Constant, Linear, Table, alpha_y_model
from rft_ros.rft.frames import (
    ANGULAR_VELOCITY,
    POSE,
    POSITION,
    QUATERNION,
    STATE,
    TWIST,
    VELOCITY,
    checked_states,
    rotation_matrix,
    unit_quaternion,
)
from rft_ros.rft.grains import SpeedLimits
from rft_ros.rft.inertia import INERTIA
from rft_ros.rft.media import MEDIA, Medium, medium_named
from rft_ros.rft.memory_state import SLACK, Memory
from rft_ros.rft.plates import INTEGRATIONS, Integration, Plates
from rft_ros.rft.result import (
    AXES,
    BY_HEIGHT,
    COLUMNS,
    FORCE,
    MOMENTS,
    SENSITIVITIES,
    SUBMERGED_AREA,
    TORQUE,
    WRENCH,
)
from rft_ros.rft.traction import (
    LAW_NUMBERS,
    LAWS,
    Law,
    Treers2021,
    described,
    law_named,
    traction_per_depth,
    treers2021,
)
from rft_ros.rft.wrench import LEVEL, edge_share, plate_forces, wrenches, wrenches_in_time

__all__ = ["MEDIA", "Medium", "medium_named"]
__all__ += ["ALPHA_Y_MODELS", "AlphaY", "Constant", "Linear", "Table", "alpha_y_model"]
__all__ += [
    "INERTIA",
    "LAWS",
    "LAW_NUMBERS",
    "SURFACE_FRICTION",
    "Agarwal2023",
    "Law",
    "SpeedLimits",
    "Treers2021",
    "agarwal2023",
    "described",
    "law_named",
]
__all__ += ["traction_per_depth", "treers2021"]
__all__ += ["ANGULAR_VELOCITY", "POSE", "POSITION", "QUATERNION", "TWIST", "VELOCITY"]
__all__ += ["STATE", "checked_states", "rotation_matrix", "unit_quaternion"]
__all__ += ["INTEGRATIONS", "SLACK", "Integration", "Memory", "Plates"]
__all__ += ["AXES", "BY_HEIGHT", "FORCE", "MOMENTS", "SUBMERGED_AREA", "TORQUE", "WRENCH"]
__all__ += ["COLUMNS", "LEVEL", "SENSITIVITIES", "edge_share", "plate_forces", "wrenches", "wrenches_in_time"]

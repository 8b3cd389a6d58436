"""Inertia of the grains: a leading plate accelerates the grains ahead of it, Eq. (11).

The stress κ ρ v_n² acts against the plate's normal and does not grow with depth: dynamic RFT without its change of the
free surface (Agarwal, Karsai, Goldman, Kamrin, Science Advances 7, 2021). It acts at once, with memory as well.
"""

from rft_ros.rft.kernel.compilation import inlined

__all__ = ["CONFINEMENT", "INERTIA", "inertia_force"]

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

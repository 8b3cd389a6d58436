"""The traction of one plate by the package's loop, without compilation."""

import numpy as np

from rft_ros.rft import Law
from rft_ros.rft.kernel import chunk as layout
from rft_ros.rft.kernel.chunk import triple
from rft_ros.rft.traction import orient, packed_law, tractions


def traction_per_depth(
    law: Law, nx: float, ny: float, nz: float, vx: float, vy: float, vz: float, *, refined=False
) -> tuple[float, float, float]:
    """Traction per depth on a leading plate [N/m³], Eq. (8) or (12), from its outward unit normal and velocity.

    World axes. Times depth and area it is the force on the plate by the grains. Only the direction of the velocity
    counts; its length should be of order one. `refined`: by the refined rule.
    """
    chunk = np.zeros(layout.SIZE)
    orient(chunk, 0, (nx, ny, nz), (vx, vy, vz))
    tractions.py_func(packed_law(law), chunk, 1, True, refined)
    x, y, z = triple(chunk, layout.TRACTION, 0)
    return float(x), float(y), float(z)

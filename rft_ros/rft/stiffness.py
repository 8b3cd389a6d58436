"""The stiffness of the grains with memory, which an implicit step of a simulator takes: sums over plates.

The tangent of each plate is that of `rft_ros.rft.memory.advance`.
"""

import numpy as np

from rft_ros.rft.kernel import chunk as layout
from rft_ros.rft.kernel.chunk import at, triple, wide_vectors
from rft_ros.rft.kernel.compilation import inlined

STIFFNESS = np.dtype(
    (
        np.record,
        [(name, float) for name in ("k", "x", "y", "z", "xx", "yy", "zz", "xy", "xz", "yz")],
    )
)
"""Sums Σ k L [N/m], Σ k L x [N] and Σ k L x x [N m] over plates at x from the tool frame's origin, world axes.

L is the load of a plate [m³], and k its modulus [N/m⁴]: of Eq. (10a) in the elastic part of the last step; where the
plate yielded, the greater of |τ2| and |t' - τ1|, over λ(d).
"""

NO_STIFFNESS = np.zeros(0, STIFFNESS)
"""For evaluations that need none."""


@inlined
def clear_stiffness(total):
    """Set a record of `STIFFNESS` to zero."""
    total.k = 0.0
    total.x = 0.0
    total.y = 0.0
    total.z = 0.0
    total.xx = 0.0
    total.yy = 0.0
    total.zz = 0.0
    total.xy = 0.0
    total.xz = 0.0
    total.yz = 0.0


@inlined
def add_stiffness(chunk, n, total):
    """Add the sums of the n plates of a chunk to a record of `STIFFNESS`."""
    wide_vectors()
    k = kx = ky = kz = kxx = kyy = kzz = kxy = kxz = kyz = 0.0
    for i in range(n):
        x, y, z = triple(chunk, layout.POSITION, i)
        stiff = chunk[at(layout.TANGENT, i)]
        k += stiff
        kx += stiff * x
        ky += stiff * y
        kz += stiff * z
        kxx += stiff * x * x
        kyy += stiff * y * y
        kzz += stiff * z * z
        kxy += stiff * x * y
        kxz += stiff * x * z
        kyz += stiff * y * z
    total.k += k
    total.x += kx
    total.y += ky
    total.z += kz
    total.xx += kxx
    total.yy += kyy
    total.zz += kzz
    total.xy += kxy
    total.xz += kxz
    total.yz += kyz

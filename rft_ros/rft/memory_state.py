"""The state of a memory: the numbers of the plates, and the pose that they have followed to.

The displacement of a step is the way from that pose to the tool's, beyond a dead band. Nothing else decides how far the
plates have moved, whatever time it took.
"""

from dataclasses import KW_ONLY, dataclass, field
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft.arguments import number, whole_number
from rft_ros.rft.frames import from_frame, into_frame
from rft_ros.rft.kernel.compilation import inlined
from rft_ros.rft.plates import BLOCK, Plates

__all__ = ["BEGUN", "DEAD_BAND", "FAR", "GAP", "HEAD", "MOST_BODIES", "OF_BLOCK", "POSITION_BEFORE", "RADIUS", "SLACK"]
__all__ += ["K_X", "K_XX", "K_XY", "K_XZ", "K_Y", "K_YY", "K_YZ", "K_Z", "K_ZZ", "ROTATION_BEFORE", "TAU", "K"]
__all__ += ["TWIST_BEFORE", "Memory", "displacement", "moved_by"]

SLACK = 10e-6
"""`Memory.slack` [m] for measured poses: five standard deviations of encoders of 2 µm."""

MOST_BODIES = 1_000_000
"""The greatest number of bodies in one memory."""


K, K_X, K_Y, K_Z, K_XX, K_YY, K_ZZ, K_XY, K_XZ, K_YZ = range(10)
"""Where each sum of `Memory.stiffness` is in a row of `Memory.numbers`: Σ k L, Σ k L x (3) and Σ k L x x (6)."""

TWIST_BEFORE, BEGUN, DEAD_BAND, POSITION_BEFORE, ROTATION_BEFORE = 10, 16, 17, 18, 21
"""Where the rest of the head of a row begins: the last twist that was not zero, scaled to order one (6); 1 after the
first state; the dead band [m]; the pose that the plates have followed to, position [m] (3) and matrix by rows (9)."""

HEAD = ROTATION_BEFORE + 9
"""Numbers in the head of a row of `Memory.numbers`: there the states of the blocks begin."""

TAU, RADIUS, GAP, OF_BLOCK = 0, 3 * BLOCK, 4 * BLOCK, 5 * BLOCK
"""Where the rows of a block begin, counted from its first number: τ [N/m³], world axes, three rows; y [N/m³]; g [m].
The last is how many numbers a block has."""

FAR = 1e30
"""Bounds displacements [m], and its inverse the mobilization length, so that no product overflows."""

_TINY = 1e-60  # least squared speed and length that are divided by

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """The memory of the plates of one tool; ``Memory(plates)`` is empty.

    `slack` [m]: the dead band on the displacement, which filters the noise of poses. The plates follow the tool's pose
    at this distance. A simulator needs none. Of many `bodies` of these plates, state i is of body i.
    `numbers`: shape [bodies, m]. In each row the head, which begins with the sums of `stiffness`, and then block by
    block τ, y and g. Raises ValueError for a `slack` or a number of bodies that cannot be used.
    """

    plates: Plates
    _: KW_ONLY
    slack: float = 0.0
    bodies: int = 1
    numbers: Array = field(init=False)

    def __post_init__(self) -> None:
        blocks = self.plates.bounds.shape[1]
        bodies = whole_number("bodies", self.bodies, most=MOST_BODIES)
        number("slack", self.slack, least=0.0)
        object.__setattr__(self, "numbers", np.zeros((bodies, HEAD + blocks * OF_BLOCK)))
        self.slacks[:] = self.slack

    @property
    def slacks(self) -> Array:
        """The dead band of each body [m], shape [bodies]."""
        return self.numbers[:, DEAD_BAND]

    @property
    def stiffness(self) -> Array:
        """The sums Σ k L, Σ k L x (3) and Σ k L (xx, yy, zz, xy, xz, yz) at the last state, shape [bodies, 10].

        Over plates at x from the tool frame's origin [m], world axes, of load L [m³] and modulus k [N/m⁴]: of Eq. (10a)
        in the elastic part of the last step, and |t| / λ(d), or |τ| / λ(d) if that is greater, where the plate yielded.
        """
        return self.numbers[:, : K_YZ + 1]


@inlined
def _difference(a, b, k):
    return a[0] - b[k], a[1] - b[k + 1], a[2] - b[k + 2]


@inlined
def _times(s, v):
    return s * v[0], s * v[1], s * v[2]


@inlined
def _sum(s, v, t, w):
    return s * v[0] + t * w[0], s * v[1] + t * w[1], s * v[2] + t * w[2]


@inlined
def _bounded(x, y, z):
    return min(max(x, -FAR), FAR), min(max(y, -FAR), FAR), min(max(z, -FAR), FAR)


@inlined
def _in_world(axes, x, y, z):
    """The change of a rotation matrix, by rows, as the matrix that moves a place given in world axes."""
    return (*from_frame(axes, *x), *from_frame(axes, *y), *from_frame(axes, *z))


@inlined
def displacement(memory, state, axes, reach):
    """The displacement of the tool since the pose in memory. Moves that pose after the tool, at the dead band.

    Of the way from that pose to the tool, the part along the velocity counts beyond the dead band, and the part aside
    where it alone is beyond. So noise of the poses hardly changes the direction of a displacement.
    `memory`: a row of `Memory.numbers`, whose first state has no displacement. Returns origin [m] and matrix, world
    axes, and the same in tool axes: a point at x from the tool frame's origin moved by origin + matrix x.
    """
    one = memory[BEGUN]
    px, py, pz = _difference(state, memory, POSITION_BEFORE)
    shift = _times(one, _bounded(px, py, pz))
    x = _times(one, _difference(axes[:3], memory, ROTATION_BEFORE))  # rows of the change of the rotation matrix
    y = _times(one, _difference(axes[3:6], memory, ROTATION_BEFORE + 3))
    z = _times(one, _difference(axes[6:], memory, ROTATION_BEFORE + 6))
    change, dead_band = (*shift, *x, *y, *z), memory[DEAD_BAND]
    vx, vy, vz = _bounded(state[7], state[8], state[9])
    wx, wy, wz = _bounded(state[10], state[11], state[12])
    _, xy, xz, yx, _, yz, zx, zy, _ = _in_world(axes, x, y, z)
    size2 = 0.0
    for c in range(3):
        size2 += shift[c] * shift[c] + 0.5 * reach * reach * (x[c] * x[c] + y[c] * y[c] + z[c] * z[c])
    speed2 = vx * vx + vy * vy + vz * vz + reach * reach * (wx * wx + wy * wy + wz * wz)
    along = 0.5 * reach * reach * ((zy - yz) * wx + (xz - zx) * wy + (yx - xy) * wz)
    along += shift[0] * vx + shift[1] * vy + shift[2] * vz
    time = along / max(speed2, _TINY)
    aside = sqrt(max(size2 - along * time, 0.0))
    part = max(1.0 - dead_band / max(sqrt(size2), _TINY), 0.0)
    part_aside = max(1.0 - dead_band / max(aside, _TINY), 0.0) if speed2 > _TINY and dead_band > 0.0 else part
    time *= part - part_aside
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = axes[:3], axes[3:6], axes[6:]
    shift = _sum(part_aside, shift, time, (vx, vy, vz))
    x = _sum(part_aside, x, time, (wy * cx - wz * bx, wy * cy - wz * by, wy * cz - wz * bz))
    y = _sum(part_aside, y, time, (wz * ax - wx * cx, wz * ay - wx * cy, wz * az - wx * cz))
    z = _sum(part_aside, z, time, (wx * bx - wy * ax, wx * by - wy * ay, wx * bz - wy * az))
    memory[BEGUN] = 1.0
    for j, v in enumerate((state[0], state[1], state[2], *axes)):
        memory[POSITION_BEFORE + j] = v
    for j, v in enumerate((*shift, *x, *y, *z)):
        memory[POSITION_BEFORE + j] -= one * (change[j] - v)  # what the dead band leaves for later
    p, q, r = into_frame(axes, x[0], y[0], z[0]), into_frame(axes, x[1], y[1], z[1]), into_frame(axes, x[2], y[2], z[2])
    inner = p[0], q[0], r[0], p[1], q[1], r[1], p[2], q[2], r[2]
    return (shift, _in_world(axes, x, y, z)), (into_frame(axes, *shift), inner)


@inlined
def moved_by(motion, place):
    """The displacement of a place by a motion of `displacement`, both in world or in tool axes."""
    (dx, dy, dz), (xx, xy, xz, yx, yy, yz, zx, zy, zz) = motion
    x, y, z = place
    return dx + xx * x + xy * y + xz * z, dy + yx * x + yy * y + yz * z, dz + zx * x + zy * y + zz * z

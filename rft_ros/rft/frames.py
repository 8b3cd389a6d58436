"""Frames, states and wrenches: rotations by unit quaternions (xyzw), columns of arrays, and the check of states."""

import math
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rft_ros.rft.arguments import numbers
from rft_ros.rft.kernel.compilation import inlined

STATE = ("px", "py", "pz", "qx", "qy", "qz", "qw", "vx", "vy", "vz", "wx", "wy", "wz")
"""Columns of a state: tool frame in the world [m], quaternion xyzw, velocity of its origin [m/s], angular [rad/s]."""

POSITION = slice(0, 3)
QUATERNION = slice(3, 7)
VELOCITY = slice(7, 10)
ANGULAR_VELOCITY = slice(10, 13)
POSE = slice(0, 7)
TWIST = slice(7, 13)
"""The parts of a state, as slices of its columns."""

UNIT_NORM_TOLERANCE_RATIO = 0.01
"""Largest deviation of a quaternion's norm from 1 that is corrected as rounding."""


_Number = TypeVar("_Number", float, NDArray[np.float64])


@inlined
def rotation(qx, qy, qz, qw):
    """Rotation matrix of a unit quaternion, row by row: columns are the frame's axes in the outer frame."""
    xx, yy, zz = 2.0 * qx * qx, 2.0 * qy * qy, 2.0 * qz * qz
    xy, xz, yz = 2.0 * qx * qy, 2.0 * qx * qz, 2.0 * qy * qz
    wx, wy, wz = 2.0 * qw * qx, 2.0 * qw * qy, 2.0 * qw * qz
    return (
        1.0 - yy - zz,
        xy - wz,
        xz + wy,
        xy + wz,
        1.0 - xx - zz,
        yz - wx,
        xz - wy,
        yz + wx,
        1.0 - xx - yy,
    )


@inlined
def attitude(quaternion):
    """`rotation` of a quaternion in an array, shape [4]."""
    return rotation(quaternion[0], quaternion[1], quaternion[2], quaternion[3])


@inlined
def parts_of_state(state):
    """Position, quaternion, velocity and angular velocity of a state, shape [13]: views of it, for compiled loops."""
    return state[0:3], state[3:7], state[7:10], state[10:13]


@inlined
def from_frame(axes, x, y, z):
    """Rotate a vector from the axes of the frame with this rotation matrix (9 numbers, by rows) to outer axes."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = axes
    return xx * x + xy * y + xz * z, yx * x + yy * y + yz * z, zx * x + zy * y + zz * z


@inlined
def into_frame(axes, x, y, z):
    """Rotate a vector from outer axes to the axes of the frame with this rotation matrix (9 numbers, by rows)."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = axes
    return xx * x + yx * y + zx * z, xy * x + yy * y + zy * z, xz * x + yz * y + zz * z


def rotation_matrix(quaternion: ArrayLike) -> NDArray[np.float64]:
    """Rotation matrix, shape [3, 3], of a unit quaternion xyzw, shape [4]; columns: the frame's axes in outer axes."""
    qx, qy, qz, qw = numbers("quaternion", quaternion, rows=4).tolist()
    return np.array(rotation(qx, qy, qz, qw)).reshape(3, 3)


def rotation_matrices(quaternions: ArrayLike) -> NDArray[np.float64]:
    """`rotation_matrix` of each unit quaternion xyzw in a stack, shape [n, 4]; returns shape [n, 3, 3]; n may be 0.

    A recording may have no pose of some kind, and SciPy 1.11 cannot multiply or apply an empty stack of rotations.
    Raises ValueError for another shape.
    """
    qx, qy, qz, qw = numbers("quaternions", quaternions, (4,)).T
    return np.stack(rotation(qx, qy, qz, qw), axis=-1).reshape(-1, 3, 3)


def rotate_vectors(rotations: ArrayLike, vectors: ArrayLike) -> NDArray[np.float64]:
    """Each vector turned by its own rotation: shapes [n, 3, 3] and [n, 3]; returns shape [n, 3]; n may be 0.

    Raises ValueError for other shapes.
    """
    turns = numbers("rotations", rotations, (3, 3))
    return np.einsum("nij,nj->ni", turns, numbers("vectors", vectors, (3,), rows=len(turns)))


def quaternion_products(outer: ArrayLike, inner: ArrayLike) -> NDArray[np.float64]:
    """Unit quaternions xyzw, shape [n, 4], of turning by `inner` and then by `outer`.

    Each is one, shape [4], or a stack, [n, 4]; n may be 0. Raises ValueError for other shapes.
    """
    last = numbers("outer", outer, (4,))
    first = numbers("inner", inner, (4,))
    if 1 not in (len(last), len(first)) and len(last) != len(first):
        raise ValueError(
            f"inner has {len(first)} quaternions and outer has {len(last)}; give as many, or one"
        )
    x, y, z, w = last.T
    p, q, r, s = first.T
    return np.stack(_product(x, y, z, w, p, q, r, s), axis=-1)


def _product(
    x: _Number, y: _Number, z: _Number, w: _Number, p: _Number, q: _Number, r: _Number, s: _Number
) -> tuple[_Number, _Number, _Number, _Number]:
    """The quaternion of p, q, r, s (xyzw) followed by x, y, z, w: of numbers, or of arrays of one shape."""
    return (
        w * p + x * s + y * r - z * q,
        w * q - x * r + y * s + z * p,
        w * r + x * q - y * p + z * s,
        w * s - x * p - y * q - z * r,
    )


def unit_quaternion(
    qx: float, qy: float, qz: float, qw: float
) -> tuple[float, float, float, float] | None:
    """The quaternion made unit length, or None if its norm is NaN or differs from 1 by over the tolerance above."""
    norm = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    if not abs(norm - 1.0) <= UNIT_NORM_TOLERANCE_RATIO:
        return None
    return qx / norm, qy / norm, qz / norm, qw / norm


def checked_states(states: ArrayLike) -> NDArray[np.float64]:
    """States ready for the kernel, units as in `STATE`: float64, shape [n, 13], C-contiguous, finite, unit quaternions.

    Raises ValueError with the row (counted from 0) and column of the first value that cannot be used.
    """
    s = np.array(numbers("states", states, (len(STATE),)))
    finite = np.isfinite(s)
    if not finite.all():
        row, column = np.argwhere(~finite)[0]
        raise ValueError(
            f"row {row}: {STATE[column]} is {s[row, column]}; it must be a finite number"
        )
    with np.errstate(over="ignore"):
        norm = np.sqrt(np.square(s[:, QUATERNION]).sum(axis=1))  # half the time of numpy's norm
    if not abs(norm - 1.0).max(initial=0.0) <= UNIT_NORM_TOLERANCE_RATIO:
        row = np.argmax(abs(norm - 1.0) > UNIT_NORM_TOLERANCE_RATIO)
        raise ValueError(
            f"row {row}: the quaternion qx, qy, qz, qw has norm {norm[row]:g}; it must be 1"
        )
    s[:, QUATERNION] /= norm[:, None]
    return s


Vector = tuple[float, float, float]
"""x, y, z."""
Quaternion = tuple[float, float, float, float]
"""x, y, z, w."""
Wrench = tuple[float, float, float, float, float, float]
"""Force [N] and torque [N m]: fx, fy, fz, tx, ty, tz."""


class Placement(NamedTuple):
    """Pose of one frame in another: position [m], quaternion xyzw; by default the other one itself."""

    position: Vector = (0.0, 0.0, 0.0)
    quaternion: Quaternion = (0.0, 0.0, 0.0, 1.0)

    def rotate(self, v: Vector) -> Vector:
        """A vector in the inner frame's axes, in the outer frame's."""
        x, y, z, w = self.quaternion
        a, b, c = v
        p = 2.0 * (y * c - z * b)
        q = 2.0 * (z * a - x * c)
        r = 2.0 * (x * b - y * a)
        return a + w * p + y * r - z * q, b + w * q + z * p - x * r, c + w * r + x * q - y * p

    def wrench(self, inner: Wrench) -> Wrench:
        """A wrench [N], [N m] in the inner frame's axes about its origin, in the outer frame's about its own."""
        a, b, c = self.rotate(inner[:3])
        d, e, f = self.rotate(inner[3:])
        x, y, z = self.position
        return a, b, c, d + y * c - z * b, e + z * a - x * c, f + x * b - y * a

    def of(self, inner: "Placement") -> "Placement":
        """Composes two placements: `inner` is given in this frame; returns it in the outer frame."""
        a, b, c = self.rotate(inner.position)
        px, py, pz = self.position
        turned = _product(*self.quaternion, *inner.quaternion)
        return Placement((px + a, py + b, pz + c), turned)

    def inverse(self) -> "Placement":
        """The outer frame in the inner one."""
        x, y, z, w = self.quaternion
        back = Placement(quaternion=(-x, -y, -z, w))
        a, b, c = back.rotate(self.position)
        return Placement((-a, -b, -c), back.quaternion)

    def apart(self, other: "Placement") -> tuple[float, float]:
        """Distance [m] and angle [rad] to another placement in the same frame."""
        cosine = abs(sum(a * b for a, b in zip(self.quaternion, other.quaternion, strict=True)))
        return math.dist(self.position, other.position), 2.0 * math.acos(min(cosine, 1.0))

    def is_at(self, other: "Placement") -> bool:
        """Whether another placement in the same frame is the same one within 1 mm and 1 degree."""
        distance, angle = self.apart(other)
        return distance < 1e-3 and angle < math.radians(1.0)


AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
"""Components of a wrench: force [N], torque about the tool frame's origin [N m]."""

COLUMNS = (*AXES, "submerged_area")
"""Columns of a result: force [N], torque about the tool frame's origin [N m], area below the surface [m²]."""

FORCE = slice(0, 3)
TORQUE = slice(3, 6)
WRENCH = slice(0, 6)
SUBMERGED_AREA = 6
"""The parts of a result, as slices of its columns; the last is one column."""

SENSITIVITIES = ("dfx_dh", "dfy_dh", "dfz_dh", *(f"{r}_f{f}" for r in "xyz" for f in "xyz"))
"""Further columns: derivative of the force by the surface height [N/m], the sum of traction per depth times wet area;
and the sums over plates of r_j f_l [N m], r from the tool frame's origin, which make up the torque."""

WIDTH = len(COLUMNS) + len(SENSITIVITIES)
"""Number of columns of a result with sensitivities."""

BY_HEIGHT = slice(len(COLUMNS), len(COLUMNS) + 3)
"""The derivative of the force by the surface height in a result with sensitivities."""

MOMENTS = slice(BY_HEIGHT.stop, WIDTH)
"""The sums of r_j f_l in a result with sensitivities, row by row of r."""

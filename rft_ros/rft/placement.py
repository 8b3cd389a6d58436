"""Where one frame is in another, in plain Python for single vectors and wrenches; `frames` serves compiled loops."""

from typing import NamedTuple

__all__ = ["Placement", "Quaternion", "Vector", "Wrench"]

Vector = tuple[float, float, float]
"""x, y, z."""
Quaternion = tuple[float, float, float, float]
"""x, y, z, w."""
Wrench = tuple[float, float, float, float, float, float]
"""Force [N] and torque [N m]: fx, fy, fz, tx, ty, tz."""


class Placement(NamedTuple):
    """Pose of one frame in another: position [m], quaternion xyzw."""

    position: Vector
    quaternion: Quaternion

    def rotate(self, v: Vector) -> Vector:
        """A vector in the inner frame's axes, in the outer frame's."""
        x, y, z, w = self.quaternion
        a, b, c = v
        p, q, r = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
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
        x, y, z, w = self.quaternion
        p, q, r, s = inner.quaternion
        turned = (
            w * p + x * s + y * r - z * q,
            w * q - x * r + y * s + z * p,
            w * r + x * q - y * p + z * s,
            w * s - x * p - y * q - z * r,
        )
        return Placement((px + a, py + b, pz + c), turned)

    def inverse(self) -> "Placement":
        """The outer frame in the inner one."""
        x, y, z, w = self.quaternion
        back = Placement((0.0, 0.0, 0.0), (-x, -y, -z, w))
        a, b, c = back.rotate(self.position)
        return Placement((-a, -b, -c), back.quaternion)

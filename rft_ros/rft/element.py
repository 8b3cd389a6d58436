"""One plate at one state: where it is, which way it moves, and how much of it is below the surface and leads."""

from math import sqrt

from rft_ros.rft.compiled import inlined
from rft_ros.rft.frames import rotation
from rft_ros.rft.wet_part import wet_part

__all__ = ["element", "in_tool_axes", "motion", "seen_from_tool"]


@inlined
def motion(state, reach):  # type: ignore[no-untyped-def]
    """Rotation matrix (9 numbers, by rows) and twist (6 numbers) of a state, the twist scaled to order one; its scale.

    The law is rate-independent, so a common factor is free: it keeps squares of speeds from over- and underflow.
    """
    vx, vy, vz, wx, wy, wz = state[7], state[8], state[9], state[10], state[11], state[12]
    # The 1e-9 m bounds the scaled angular velocity of plates at the origin, which would be inf * 0.
    fastest = max(abs(vx), abs(vy), abs(vz), max(reach, 1e-9) * max(abs(wx), abs(wy), abs(wz)))
    s = 1.0 / fastest if fastest > 1e-290 else 0.0
    return rotation(state[3], state[4], state[5], state[6]), (vx * s, vy * s, vz * s, wx * s, wy * s, wz * s), s


@inlined
def in_tool_axes(axes, x, y, z):  # type: ignore[no-untyped-def]
    """A vector in world axes, in the axes of the tool that has this rotation matrix."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = axes
    return xx * x + yx * y + zx * z, xy * x + yy * y + zy * z, xz * x + yz * y + zz * z


@inlined
def _length(v):  # type: ignore[no-untyped-def]
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@inlined
def seen_from_tool(axes, twist, reach):  # type: ignore[no-untyped-def]
    """Linear and angular velocity in tool axes, a speed that no point exceeds, E3 in tool axes, and the reach again."""
    linear = in_tool_axes(axes, twist[0], twist[1], twist[2])
    angular = in_tool_axes(axes, twist[3], twist[4], twist[5])
    return linear, angular, _length(linear) + _length(angular) * reach, axes[6:], reach


@inlined
def element(rows, i, axes, twist, below, refined, careful):  # type: ignore[no-untyped-def]
    """One plate in world axes: where it is loaded, its normal and scaled velocity; load, share, and submerged area.

    The place is from the tool frame's origin. The load is depth integrated over the area below the surface [m³], the
    share is how much of the plate leads. `below`: depth of the tool frame's origin. `careful` False: the plate is all
    submerged. This and `refined` must be constants, or the loop does not become vector code.
    """
    xx, xy, xz, yx, yy, yz, zx, zy, zz = axes
    vx, vy, vz, wx, wy, wz = twist
    a, b, c = rows[0, i], rows[1, i], rows[2, i]
    area = rows[6, i]
    depth = below - (zx * a + zy * b + zz * c)
    load = depth * area
    if refined:
        # e0, e1 and -(e0 + e1) are the corners from the centroid
        e0x, e0y, e0z, e1x, e1y, e1z = rows[7, i], rows[8, i], rows[9, i], rows[10, i], rows[11, i], rows[12, i]
        h0 = zx * e0x + zy * e0y + zz * e0z
        h1 = zx * e1x + zy * e1y + zz * e1z
        if careful:
            p0, p1, p2, wet = wet_part(depth - h0, depth - h1, depth + h0 + h1)
            mean = p0 + p1 + p2
            load = mean * area
            area *= wet
            per_mean = 1.0 / mean if mean > 1e-290 else 0.0
            k0, k1 = (p0 - p2) * per_mean, (p1 - p2) * per_mean
        else:
            per_depth = -1.0 / (12.0 * depth)
            k0, k1 = per_depth * (2.0 * h0 + h1), per_depth * (h0 + 2.0 * h1)
        a, b, c = a + k0 * e0x + k1 * e1x, b + k0 * e0y + k1 * e1y, c + k0 * e0z + k1 * e1z
    elif careful:
        area = area if depth > 0.0 else 0.0
        load = depth * area
    x, y, z = xx * a + xy * b + xz * c, yx * a + yy * b + yz * c, zx * a + zy * b + zz * c
    a, b, c = rows[3, i], rows[4, i], rows[5, i]
    nx, ny, nz = xx * a + xy * b + xz * c, yx * a + yy * b + yz * c, zx * a + zy * b + zz * c
    ux, uy, uz = vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x
    lead = ux * nx + uy * ny + uz * nz
    if refined:
        per_speed = 1.0 / sqrt(max(ux * ux + uy * uy + uz * uz, 1e-290))
        # from 0 to 1 over the angles that the plate stands for; in abs, since selects would branch
        q = lead * per_speed * rows[13, i]
        share = 0.5 * (abs(q + 0.5) - abs(q - 0.5) + 1.0)
    else:
        share = 1.0 if lead > 0.0 else 0.0
    return (x, y, z), (nx, ny, nz), (ux, uy, uz), load, share, area

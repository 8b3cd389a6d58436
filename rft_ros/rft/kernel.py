"""The compiled loops: position and velocity of each plate, Eq. (1), its loaded part, and the sums of Eq. (9).

LLVM vectorises the loop over plates, so it uses selects instead of branches on data. Bounds on a whole block of plates
(dry, trailing, submerged, none horizontal) select a shorter loop.
"""

from math import cos, radians, sin, sqrt
from typing import Any

import numpy as np

from rft_ros.rft.compilation import OPTIONS, compiled, inlined
from rft_ros.rft.frames import from_frame, into_frame, rotation
from rft_ros.rft.inertia import inertia_force
from rft_ros.rft.memory import GAPS, LOADED, advance, displacement, forget, is_empty, open_gaps
from rft_ros.rft.plates import BLOCK, INTEGRATIONS, ROUNDING
from rft_ros.rft.traction import BLENDED, FLAT, FLAT_BLEND, NEVER_FLAT, SWITCHED, traction_per_depth

__all__ = ["EDGE_AREAS", "PLATE_FORCES", "SUMS"]

_SKIP_DRY, _SKIP_WET, _PLAIN, _CUT, _FLAT_OR_CUT, _FADING = range(6)
"""Kinds of blocks: dry (skipped); submerged and trailing (only its area counts); submerged without horizontal plates;
possibly cut by the surface; possibly with horizontal plates; submerged and trailing with tractions in memory. The
plates of blocks from `_PLAIN` on are evaluated one by one."""

_COLUMNS = 19  # of a result: `COLUMNS` and `SENSITIVITIES` of `rft_ros.rft.wrench`
_LEVEL = cos(radians(FLAT_BLEND))
_ALONG = sin(radians(1.0)) ** 2


@inlined
def _motion(state, reach):  # type: ignore[no-untyped-def]
    """Rotation matrix (9 numbers, by rows), twist (6 numbers, scaled to order one), that scale, and 1 / scale².

    The law is rate-independent, so the scale changes no force; it prevents over- and underflow of squared speeds. The
    inertia of the grains takes the speed back from the last number [m²/s²], bounded so that 0 times it stays 0.
    """
    vx, vy, vz, wx, wy, wz = state[7], state[8], state[9], state[10], state[11], state[12]
    # The 1e-9 m bounds the scaled angular velocity of plates at the origin, which would be inf * 0.
    fastest = max(abs(vx), abs(vy), abs(vz), max(reach, 1e-9) * max(abs(wx), abs(wy), abs(wz)))
    s = 1.0 / fastest if fastest > 1e-290 else 0.0
    squared = min(fastest * fastest, 1e30) if s > 0.0 else 0.0
    twist = vx * s, vy * s, vz * s, wx * s, wy * s, wz * s
    return rotation(state[3], state[4], state[5], state[6]), twist, s, squared


@inlined
def _length(v):  # type: ignore[no-untyped-def]
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@inlined
def _surface(height, slope, state, axes):  # type: ignore[no-untyped-def]
    """Depth of the tool frame's origin, and the vector that gives a point's height above it from tool axes.

    `slope`: dz/dx and dz/dy. Depth is vertical.
    """
    sx, sy = slope
    below = height + sx * state[0] + sy * state[1] - state[2]
    a, b, c = axes[6] - sx * axes[0] - sy * axes[3], axes[7] - sx * axes[1] - sy * axes[4], axes[8]
    return below, (a, b, c - sx * axes[2] - sy * axes[5])


@inlined
def _seen_from_tool(axes, twist, reach, rise):  # type: ignore[no-untyped-def]
    """Linear and angular velocity in tool axes, a bound on all points' speeds, E3 in tool axes, the reach, `rise`."""
    linear = into_frame(axes, twist[0], twist[1], twist[2])
    angular = into_frame(axes, twist[3], twist[4], twist[5])
    return linear, angular, _length(linear) + _length(angular) * reach, axes[6:], reach, rise


@inlined
def _middle(bounds, b, box, v):  # type: ignore[no-untyped-def]
    """Dot product of a vector and the middle of a block's box: 0 of the normals, 1 of r x n, 2 of the positions."""
    return v[0] * bounds[b, 6 * box] + v[1] * bounds[b, 6 * box + 1] + v[2] * bounds[b, 6 * box + 2]


@inlined
def _spread(bounds, b, box, v):  # type: ignore[no-untyped-def]
    """How far the dot product of a vector and any point in the box can lie from `_middle`."""
    return abs(v[0]) * bounds[b, 6 * box + 3] + abs(v[1]) * bounds[b, 6 * box + 4] + abs(v[2]) * bounds[b, 6 * box + 5]


@inlined
def _kind(bounds, b, seen, below, refined, past, active):  # type: ignore[no-untyped-def]
    """The kind of a block; where the bounds leave two, the one with the longer loop.

    `bounds`: from `Blocks`. `past`: as in `sums`; `active`: of the one body's memory.
    """
    linear, angular, fastest, up, reach, rise = seen
    depth, spread = below - _middle(bounds, b, 2, rise), _spread(bounds, b, 2, rise) + ROUNDING * (reach + abs(below))
    if depth + spread <= 0.0:
        return _SKIP_DRY
    wet = depth - spread > 0.0
    # v·n of a plate is linear · n + angular · (r x n)
    lead = _middle(bounds, b, 0, linear) + _spread(bounds, b, 0, linear)
    lead += _middle(bounds, b, 1, angular) + _spread(bounds, b, 1, angular)
    if wet and lead + (bounds[b, 19] + ROUNDING) * fastest <= 0.0:
        if past is not None:
            return _FADING if active[b] == LOADED else _SKIP_WET
        return _SKIP_WET
    tilt = abs(_middle(bounds, b, 0, up)) + _spread(bounds, b, 0, up) + ROUNDING
    if tilt >= (_LEVEL if refined else FLAT):
        return _FLAT_OR_CUT
    return _PLAIN if wet else _CUT


@inlined
def _wet_part(d0, d1, d2):  # type: ignore[no-untyped-def]
    """The submerged part of a triangle, from the depths of its corners.

    Returns the integrals of depth times each barycentric coordinate over that part, and its area, all divided by the
    whole area. The surface cuts off a triangle at the corner that is alone on its side; over it the integrals are
    known. With two corners below the surface, the part is the whole triangle minus the one cut off.
    """
    in0, in1, in2 = d0 > 0.0, d1 > 0.0, d2 > 0.0
    count = (1 if in0 else 0) + (1 if in1 else 0) + (1 if in2 else 0)
    one = count == 1
    cut = one or count == 2
    alone0, alone1 = in0 == one, in1 == one
    a = d0 if alone0 else (d1 if alone1 else d2)
    b = d1 if alone0 else (d2 if alone1 else d0)
    c = d2 if alone0 else (d0 if alone1 else d1)
    s = a / (a - b) if cut else 0.0
    t = a / (a - c) if cut else 0.0
    q = s * t * a * (1.0 / 12.0)
    q = q if one else -q
    p, of_b, of_c = (4.0 - s - t) * q, s * q, t * q
    whole = (d0 + d1 + d2) * (1.0 / 12.0) if count > 1 else 0.0
    part = 1.0 / 12.0 if count > 1 else 0.0
    p0 = whole + part * d0 + (p if alone0 else (of_c if alone1 else of_b))
    p1 = whole + part * d1 + (of_b if alone0 else (p if alone1 else of_c))
    p2 = whole + part * d2 + (of_c if alone0 else (of_b if alone1 else p))
    return p0, p1, p2, (s * t if one else (1.0 - s * t if count > 1 else 0.0))


@inlined
def _plate(rows, i, axes, twist, below, rise, refined, careful):  # type: ignore[no-untyped-def]
    """One plate in world axes, Eq. (1): centre of load, normal, scaled velocity, load, leading share, submerged area.

    The centre of load is relative to the tool frame's origin; the load is depth integrated over the area below the
    surface [m³]. `below`, `rise`: from `_surface`. `careful` False: the plate is fully submerged.
    `careful` and `refined` must be constants, or the loop is not vectorised.
    """
    vx, vy, vz, wx, wy, wz = twist
    zx, zy, zz = rise
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
            p0, p1, p2, wet = _wet_part(depth - h0, depth - h1, depth + h0 + h1)
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
    x, y, z = from_frame(axes, a, b, c)
    nx, ny, nz = from_frame(axes, rows[3, i], rows[4, i], rows[5, i])
    ux, uy, uz = vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x
    lead = ux * nx + uy * ny + uz * nz
    if refined:
        per_speed = 1.0 / sqrt(max(ux * ux + uy * uy + uz * uz, 1e-290))
        # exactly 0 for a trailing plate: rounding must not decide which memory fades
        share = min(max(lead * per_speed * rows[13, i] + 0.5, 0.0), 1.0)
    else:
        share = 1.0 if lead > 0.0 else 0.0
    return (x, y, z), (nx, ny, nz), (ux, uy, uz), load, share, area


@inlined
def _sums(rows, first, last, scene, refined, careful, flatness, step):  # type: ignore[no-untyped-def]
    """Sums over consecutive plates: force, torque, submerged area, dF/dh and the moments r_j f_l.

    `step`: None, or for plates with memory: their tractions, `displacement` in world axes, mobilization length [m];
    then also the sums of `Memory.stiffness`.
    """
    axes, twist, law, below, rise, slope = scene
    fx = fy = fz = submerged = 0.0
    hx = hy = hz = xx = xy = xz = yx = yy = yz = zx = zy = zz = 0.0
    k = kx = ky = kz = kxx = kyy = kzz = kxy = kxz = kyz = 0.0
    for i in range(first, last):
        plate = _plate(rows, i, axes, twist, below, rise, refined, careful)
        (x, y, z), normal, velocity, load, share, area = plate
        nx, ny, nz = normal
        ux, uy, uz = velocity
        loaded = area
        if step is None:
            ax, ay, az = traction_per_depth(law, nx, ny, nz, ux, uy, uz, flatness)
            load = load * share if refined else (load if share > 0.0 else 0.0)
            loaded = area * share
        else:
            tractions, shift, turn, length = step
            ex = shift[0] + turn[0] * x + turn[1] * y + turn[2] * z
            ey = shift[1] + turn[3] * x + turn[4] * y + turn[5] * z
            ez = shift[2] + turn[6] * x + turn[7] * y + turn[8] * z
            # half a step before
            depth = below - z + 0.5 * ez + slope[0] * (x - 0.5 * ex) + slope[1] * (y - 0.5 * ey)
            ax, ay, az = traction_per_depth(law, nx, ny, nz, ux, uy, uz, flatness)
            asked = ax * share, ay * share, az * share
            ax, ay, az, stiff = advance(tractions, i, normal, (ex, ey, ez), asked, share > 0.0, depth, length)
            if careful:
                ax, ay, az = (ax if load > 0.0 else 0.0), (ay if load > 0.0 else 0.0), (az if load > 0.0 else 0.0)
                stiff = stiff if load > 0.0 else 0.0
                for c in range(7):
                    tractions[c, i] = tractions[c, i] if load > 0.0 else 0.0
            stiff *= load
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
        dx, dy, dz = ax * load, ay * load, az * load
        fx += dx
        fy += dy
        fz += dz
        submerged += area
        hx += ax * loaded
        hy += ay * loaded
        hz += az * loaded
        xx += x * dx
        xy += x * dy
        xz += x * dz
        yx += y * dx
        yy += y * dy
        yz += y * dz
        zx += z * dx
        zy += z * dy
        zz += z * dz
    stiffness = k, kx, ky, kz, kxx, kyy, kzz, kxy, kxz, kyz
    return fx, fy, fz, yz - zy, zx - xz, xy - yx, submerged, hx, hy, hz, xx, xy, xz, yx, yy, yz, zx, zy, zz, *stiffness


@inlined
def _add_inertia(rows, first, last, scene, squared, refined, careful, out):  # type: ignore[no-untyped-def]
    """Add the inertia of the grains to the sums: a second pass, which most media do without."""
    axes, twist, law, below, rise, _ = scene
    fx = fy = fz = xx = xy = xz = yx = yy = yz = zx = zy = zz = 0.0
    for i in range(first, last):
        (x, y, z), normal, velocity, _, share, area = _plate(rows, i, axes, twist, below, rise, refined, careful)
        dx, dy, dz = inertia_force(law.inertia, normal, velocity, area * share, squared)
        fx += dx
        fy += dy
        fz += dz
        xx += x * dx
        xy += x * dy
        xz += x * dz
        yx += y * dx
        yy += y * dy
        yz += y * dz
        zx += z * dx
        zy += z * dy
        zz += z * dz
    part = fx, fy, fz, yz - zy, zx - xz, xy - yx, 0.0, 0.0, 0.0, 0.0, xx, xy, xz, yx, yy, yz, zx, zy, zz
    for c in range(_COLUMNS):
        out[c] += part[c]


def _sums_of_states(refined: bool) -> Any:
    """The loop over states for one integration rule."""
    flatness = BLENDED if refined else SWITCHED

    def sums(rows, bounds, reach, law, height, slope, states, past, out):  # type: ignore[no-untyped-def]
        """`past`: None, or with memory: durations, mobilization length, the memory's arrays."""
        for k in range(states.shape[0]):
            axes, twist, scale, squared = _motion(states[k], reach)
            below, rise = _surface(height, slope, states[k], axes)
            if past is None:
                step = None
                active: Any = None
                seen = _seen_from_tool(axes, twist, reach, rise)
            else:
                durations, length, all_tractions, all_active, motions, all_stiffness = past
                body = k if len(motions) > 1 else 0
                tractions, active, last, stiffness = (
                    all_tractions[body],
                    all_active[body],
                    motions[body],
                    all_stiffness[body],
                )
                for c in range(10):
                    stiffness[c] = 0.0
                if scale > 0.0:
                    for c in range(6):
                        last[c] = twist[c]
                twist = last[0], last[1], last[2], last[3], last[4], last[5]
                seen = _seen_from_tool(axes, twist, reach, rise)
                moved, shift, turn, turn_in_tool = displacement(last, states[k], axes, reach, durations[k] > 0.0)
                step = tractions, shift, turn, length
            for c in range(_COLUMNS):
                out[k, c] = 0.0
            # unsigned: numba adds code for negative indices otherwise
            b, blocks = np.uint64(0), np.uint64(bounds.shape[0])
            kind = _kind(bounds, b, seen, below, refined, past, active)
            while b < blocks:
                # with memory a submerged block joins a run of cut ones: starting a run costs more
                first, run, previous = b, kind, kind
                while b < blocks and (kind == run or (past is not None and kind == _PLAIN and previous == _CUT)):
                    previous = kind
                    if past is not None:  # a separate if, which numba drops where there is no memory
                        if kind == _SKIP_DRY and active[b]:
                            forget(tractions, b)
                            active[b] = 0
                        if kind == _SKIP_WET and moved:
                            open_gaps(tractions, rows, b, into_frame(axes, *shift), turn_in_tool)
                            active[b] = GAPS
                    out[k, 6] += bounds[b, 18] if kind == _SKIP_WET else 0.0
                    b += np.uint64(1)
                    if b < blocks:
                        kind = _kind(bounds, b, seen, below, refined, past, active)
                if run >= _PLAIN:
                    i, j = first * np.uint64(BLOCK), b * np.uint64(BLOCK)
                    scene = axes, twist, law, below, rise, slope
                    if run == _PLAIN:
                        part = _sums(rows, i, j, scene, refined, False, NEVER_FLAT, step)
                    elif run == _FLAT_OR_CUT:
                        part = _sums(rows, i, j, scene, refined, True, flatness, step)
                    else:
                        part = _sums(rows, i, j, scene, refined, True, NEVER_FLAT, step)
                    for c in range(_COLUMNS):
                        out[k, c] += part[c]
                    if law.inertia > 0.0 and run == _PLAIN:
                        _add_inertia(rows, i, j, scene, squared, refined, False, out[k])
                    elif law.inertia > 0.0:
                        _add_inertia(rows, i, j, scene, squared, refined, True, out[k])
                    if past is not None:
                        for c in range(10):
                            stiffness[c] += part[_COLUMNS + c]
                        for c in range(first, b):
                            active[c] = GAPS if run == _FADING and is_empty(tractions, c) else LOADED

    return _made(sums, refined)


def _forces_of_plates(refined: bool) -> Any:
    flatness = BLENDED if refined else SWITCHED

    def forces(rows, reach, law, height, slope, state, order, out):  # type: ignore[no-untyped-def]
        axes, twist, _, squared = _motion(state, reach)
        below, rise = _surface(height, slope, state, axes)
        for i in range(len(order)):
            _, normal, velocity, load, share, area = _plate(rows, i, axes, twist, below, rise, refined, True)
            nx, ny, nz = normal
            ux, uy, uz = velocity
            tx, ty, tz = traction_per_depth(law, nx, ny, nz, ux, uy, uz, flatness)
            load = load * share if refined else (load if share > 0.0 else 0.0)
            px, py, pz = inertia_force(law.inertia, normal, velocity, area * share, squared)
            out[order[i], 0], out[order[i], 1], out[order[i], 2] = tx * load + px, ty * load + py, tz * load + pz

    return _made(forces, refined)


def _made(function: Any, refined: bool) -> Any:
    # the name of its files in the cache
    function.__qualname__ = f"{function.__name__}_{'refined' if refined else 'centroid'}"
    return compiled(function, **OPTIONS)


def _edge_areas(rows, reach, surface_height, state):  # type: ignore[no-untyped-def]
    """Wet areas [m²]: moving nearly parallel to itself; total."""
    edge = wet = 0.0
    axes, twist, _, _ = _motion(state, reach)
    below = surface_height - state[2]
    vx, vy, vz = into_frame(axes, twist[0], twist[1], twist[2])
    wx, wy, wz = into_frame(axes, twist[3], twist[4], twist[5])
    zx, zy, zz = axes[6:]
    for i in range(rows.shape[1]):
        a, b, c, nx, ny, nz = rows[0, i], rows[1, i], rows[2, i], rows[3, i], rows[4, i], rows[5, i]
        area = rows[6, i] if below - (zx * a + zy * b + zz * c) > 0.0 else 0.0
        ux, uy, uz = vx + wy * c - wz * b, vy + wz * a - wx * c, vz + wx * b - wy * a
        lead = ux * nx + uy * ny + uz * nz
        wet += area
        edge += area if lead * lead < _ALONG * (ux * ux + uy * uy + uz * uz) else 0.0
    return edge, wet


SUMS = {rule: _sums_of_states(rule == "refined") for rule in INTEGRATIONS}
"""The loop over states by integration rule."""

PLATE_FORCES = {rule: _forces_of_plates(rule == "refined") for rule in INTEGRATIONS}
"""The loop over the plates of one state by integration rule."""

EDGE_AREAS = compiled(_edge_areas, **OPTIONS)
"""The loop of `wrench.edge_share`."""

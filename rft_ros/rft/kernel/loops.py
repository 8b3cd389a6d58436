"""The compiled loop: position and velocity of each plate, Eq. (1), its loaded part, and the sums of Eq. (9).

Bounds on a whole block of plates say which blocks are dry or trail, and are skipped. The others are evaluated chunk by
chunk in steps: geometry, tractions by the law, memory, sums. A step is a loop over plates that LLVM vectorises, so it
uses selects in place of branches on data. All laws, rules and options are in the one loop, which is compiled once.
"""

from math import cos, radians, sqrt

import numpy as np

from rft_ros.rft.displacement import as_motion, half_way_axes, in_tool_axes, twist_along
from rft_ros.rft.frames import (
    BY_HEIGHT,
    FORCE,
    MOMENTS,
    QUATERNION,
    SUBMERGED_AREA,
    TORQUE,
    WIDTH,
    attitude,
    from_frame,
    into_frame,
)
from rft_ros.rft.grains import inertia_force
from rft_ros.rft.kernel import chunk as row
from rft_ros.rft.kernel.chunk import at, new_chunk, put, triple, wide_vectors
from rft_ros.rft.kernel.compilation import OPTIONS, compiled, inlined
from rft_ros.rft.memory import add_memory, clear, follow_gap, is_elastic
from rft_ros.rft.plates import (
    AREA,
    BLOCK,
    BOUND_AREA,
    BOUND_MOMENT,
    BOUND_NORMAL,
    BOUND_PLACE,
    BOUND_SINE,
    CENTROID,
    FIRST_CORNER,
    HALF_ANGLE,
    NORMAL,
    ROUNDING,
    ROWS_OF_CENTROID,
    ROWS_OF_REFINED,
    SECOND_CORNER,
)
from rft_ros.rft.stiffness import add_stiffness, clear_stiffness
from rft_ros.rft.traction import FLAT, FLAT_BLEND, orient, tractions

_SKIP_DRY, _SKIP_WET, _PLAIN, _CUT, _FLAT_OR_CUT = range(5)
"""Kinds of blocks: dry (skipped); submerged and trailing (only its area counts); submerged without horizontal plates;
possibly cut by the surface; possibly with horizontal plates. The plates of blocks from `_PLAIN` on are evaluated one
by one. With memory, a trailing block whose plates still carry traction is `_PLAIN`: none of them leads, so their law
does not count."""

_FORCE, _TORQUE, _BY_HEIGHT, _MOMENTS = (
    row.TOTAL + part.start for part in (FORCE, TORQUE, BY_HEIGHT, MOMENTS)
)
_SUBMERGED = row.TOTAL + SUBMERGED_AREA
"""Where each part of a result begins in the chunk, which has the totals of the state in the order of a result."""

_CENTROID, _NORMAL, _FIRST_CORNER, _SECOND_CORNER = (
    BLOCK * part.start for part in (CENTROID, NORMAL, FIRST_CORNER, SECOND_CORNER)
)
_AREA = BLOCK * AREA
_HALF_ANGLE = BLOCK * HALF_ANGLE
"""Where the rows of a block begin in `Plates.blocks`, counted from the block's first number."""

_FORCES = 3  # columns of the forces of plates
_BLEND_COSINE = cos(radians(FLAT_BLEND))


@inlined
def _scaled(twist, reach):
    """A twist, scaled to order one, and that scale; 0 for no motion.

    The law is rate-independent, so the scale changes no force; it prevents over- and underflow of squared speeds.
    """
    vx, vy, vz, wx, wy, wz = twist
    # The 1e-9 m bounds the scaled angular velocity of plates at the origin, which would be inf * 0.
    fastest = max(abs(vx), abs(vy), abs(vz), max(reach, 1e-9) * max(abs(wx), abs(wy), abs(wz)))
    s = 1.0 / fastest if fastest > 1e-290 else 0.0
    return (vx * s, vy * s, vz * s, wx * s, wy * s, wz * s), s


@inlined
def _turning(twist, axes):
    """The matrix, by rows, from a place in tool axes to its velocity by turning, world axes."""
    _, _, _, wx, wy, wz = twist
    xx, xy, xz, yx, yy, yz, zx, zy, zz = axes
    return (
        wy * zx - wz * yx,
        wy * zy - wz * yy,
        wy * zz - wz * yz,
        wz * xx - wx * zx,
        wz * xy - wx * zy,
        wz * xz - wx * zz,
        wx * yx - wy * xx,
        wx * yy - wy * xy,
        wx * yz - wy * xz,
    )


@inlined
def _length(v):
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@inlined
def _surface(height, slope, state, axes):
    """Depth of the tool frame's origin, and the vector that gives a point's height above it from tool axes.

    `slope`: dz/dx and dz/dy. Depth is vertical.
    """
    sx, sy = slope
    below = height + sx * state[0] + sy * state[1] - state[2]
    a = axes[6] - sx * axes[0] - sy * axes[3]
    b = axes[7] - sx * axes[1] - sy * axes[4]
    c = axes[8]
    return below, (a, b, c - sx * axes[2] - sy * axes[5])


@inlined
def _range(bounds, b, box, v):
    """The range of v · x over the points x of a block's box: its middle and its half width.

    `box`: `BOUND_NORMAL`, `BOUND_MOMENT` (of r x n) or `BOUND_PLACE`.
    """
    middle = v[0] * bounds[box, b] + v[1] * bounds[box + 1, b] + v[2] * bounds[box + 2, b]
    return middle, abs(v[0]) * bounds[box + 3, b] + abs(v[1]) * bounds[box + 4, b] + abs(
        v[2]
    ) * bounds[box + 5, b]


@inlined
def _classify(chunk, bounds, first, last, scene, reach, flat_cosine):
    """Store the kinds of blocks; where the bounds allow two, the one that computes more.

    `bounds`: of `Plates`. `flat_cosine`: abs(n·E3) from which on a plate may be horizontal.
    """
    wide_vectors()
    _, half_way, twist, _, below, rise = scene
    linear = into_frame(half_way, *twist[:3])
    angular = into_frame(half_way, *twist[3:])
    fastest = _length(linear) + _length(angular) * reach
    margin = ROUNDING * (reach + abs(below))
    for b in range(first, last):
        height, spread = _range(bounds, b, BOUND_PLACE, rise)
        depth = below - height
        spread = spread + margin
        wet = depth - spread > 0.0
        # v·n of a plate is linear · n + angular · (r x n)
        along, more_along = _range(bounds, b, BOUND_NORMAL, linear)
        around, more_around = _range(bounds, b, BOUND_MOMENT, angular)
        trails = (
            along
            + more_along
            + around
            + more_around
            + (bounds[BOUND_SINE, b] + ROUNDING) * fastest
            <= 0.0
        )
        upwards, more_upwards = _range(bounds, b, BOUND_NORMAL, half_way[6:])
        tilt = abs(upwards) + more_upwards + ROUNDING
        kind = _FLAT_OR_CUT if tilt >= flat_cosine else (_PLAIN if wet else _CUT)
        kind = _SKIP_WET if wet & trails else kind
        chunk[at(row.KIND, b - first)] = _SKIP_DRY if depth + spread <= 0.0 else kind


@inlined
def _wet_part(d0, d1, d2):
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
    p = (4.0 - s - t) * q
    of_b = s * q
    of_c = t * q
    whole = (d0 + d1 + d2) * (1.0 / 12.0) if count > 1 else 0.0
    part = 1.0 / 12.0 if count > 1 else 0.0
    p0 = whole + part * d0 + (p if alone0 else (of_c if alone1 else of_b))
    p1 = whole + part * d1 + (of_b if alone0 else (p if alone1 else of_c))
    p2 = whole + part * d2 + (of_c if alone0 else (of_b if alone1 else p))
    return p0, p1, p2, (s * t if one else (1.0 - s * t if count > 1 else 0.0))


@inlined
def _centre_and_load(rows, first, i, below, rise, refined, cut):
    """A plate's centre of load [m], tool axes, its load [m³] and its area below the surface [m²].

    The load is the depth integrated over that area. `below`, `rise`: from `_surface`. `cut` False: the plate is fully
    submerged. `refined` and `cut` must be constants, or the loop is not vectorised.
    """
    zx, zy, zz = rise
    a, b, c = triple(rows, first + _CENTROID, i, BLOCK)
    area = rows[at(first + _AREA, i)]
    depth = below - (zx * a + zy * b + zz * c)
    if not refined:
        area = area if depth > 0.0 else 0.0
        return (a, b, c), depth * area, area
    # e0, e1 and -(e0 + e1) are the corners from the centroid
    e0x, e0y, e0z = triple(rows, first + _FIRST_CORNER, i, BLOCK)
    e1x, e1y, e1z = triple(rows, first + _SECOND_CORNER, i, BLOCK)
    h0 = zx * e0x + zy * e0y + zz * e0z
    h1 = zx * e1x + zy * e1y + zz * e1z
    if cut:
        p0, p1, p2, wet = _wet_part(depth - h0, depth - h1, depth + h0 + h1)
        mean = p0 + p1 + p2
        load = mean * area
        area *= wet
        per_mean = 1.0 / mean if mean > 1e-290 else 0.0
        k0, k1 = (p0 - p2) * per_mean, (p1 - p2) * per_mean
    else:
        load = depth * area
        per_depth = -1.0 / (12.0 * depth)
        k0, k1 = per_depth * (2.0 * h0 + h1), per_depth * (h0 + 2.0 * h1)
    return (a + k0 * e0x + k1 * e1x, b + k0 * e0y + k1 * e1y, c + k0 * e0z + k1 * e1z), load, area


@inlined
def _geometry(chunk, i0, rows, b, scene, has_memory, refined, cut):
    """Eq. (1) for block b, world axes, stored from plate `i0` of the chunk on; returns its area below the surface."""
    wide_vectors()
    axes, half_way, (vx, vy, vz, _, _, _), turning, below, rise = scene
    first = b * np.uint64((ROWS_OF_REFINED if refined else ROWS_OF_CENTROID) * BLOCK)
    submerged = 0.0
    for j in range(BLOCK):
        (a, b, c), load, area = _centre_and_load(rows, first, j, below, rise, refined, cut)
        normal = nx, ny, nz = from_frame(half_way, *triple(rows, first + _NORMAL, j, BLOCK))
        x, y, z = from_frame(axes, a, b, c)
        wx, wy, wz = from_frame(turning, a, b, c)
        ux, uy, uz = vx + wx, vy + wy, vz + wz
        lead = ux * nx + uy * ny + uz * nz
        i = at(i0, j)
        per_speed = orient(chunk, i, normal, (ux, uy, uz))
        if refined:
            share = min(max(lead * per_speed * rows[at(first + _HALF_ANGLE, j)] + 0.5, 0.0), 1.0)
        else:
            share = 1.0 if lead > 0.0 else 0.0
        put(chunk, row.PLACE, i, (x, y, z))
        submerged += area
        loaded = 1.0 if has_memory else share
        chunk[at(row.LOAD, i)] = load * loaded
        chunk[at(row.AREA, i)] = area * loaded
        chunk[at(row.SHARE, i)] = share
    return submerged


@inlined
def _follow_gaps(block, form, b, scene, motion):
    """Follow the gaps behind the plates of a submerged block that trails and is not elastic. `motion`: in tool axes."""
    rows, _, refined, _ = form
    _, _, _, _, below, rise = scene
    first = b * np.uint64((ROWS_OF_REFINED if refined else ROWS_OF_CENTROID) * BLOCK)
    for i in range(BLOCK):
        place, _, _ = _centre_and_load(rows, first, i, below, rise, refined, False)
        normal = triple(rows, first + _NORMAL, i, BLOCK)
        follow_gap(block, i, normal, place, motion)


@inlined
def _list(chunk, form, first, last, scene, has_memory, states_of_blocks, motion):
    """List the blocks of a window that are to be evaluated; returns how many are without, and with flat plates.

    The others are done here: of a block that is submerged and trails only the area counts, and its gaps are followed;
    a dry one loses its memory. `motion`: in tool axes.
    """
    _, bounds, _, _ = form
    one = np.uint64(1)
    steep_blocks = np.uint64(0)
    flat_blocks = np.uint64(0)
    for b in range(first, last):
        kind = chunk[at(row.KIND, b - first)]
        if has_memory and kind == _SKIP_WET and is_elastic(states_of_blocks[b]):
            kind = _PLAIN
            chunk[at(row.KIND, b - first)] = kind
        if kind == _FLAT_OR_CUT:
            chunk[at(row.FLAT_BLOCKS, flat_blocks)] = b
            flat_blocks += one
        elif kind >= _PLAIN:
            chunk[at(row.STEEP_BLOCKS, steep_blocks)] = b
            steep_blocks += one
        elif kind == _SKIP_WET:
            chunk[_SUBMERGED] += bounds[BOUND_AREA, b]
            if has_memory:
                _follow_gaps(states_of_blocks[b], form, b, scene, motion)
        elif has_memory:
            clear(states_of_blocks[b])
    return steep_blocks, flat_blocks


@inlined
def _geometry_of_blocks(chunk, numbers, count, form, first, scene, has_memory):
    """`_geometry` of the blocks of a chunk. `numbers`: where theirs begin. `first`: block of the window."""
    rows, _, refined, _ = form
    for j in range(count):
        block = np.uint64(chunk[at(numbers, j)])
        i0 = j * np.uint64(BLOCK)
        submerged = 0.0
        if not refined:
            submerged = _geometry(chunk, i0, rows, block, scene, has_memory, False, True)
        elif chunk[at(row.KIND, block - first)] == _PLAIN:
            submerged = _geometry(chunk, i0, rows, block, scene, has_memory, True, False)
        else:
            submerged = _geometry(chunk, i0, rows, block, scene, has_memory, True, True)
        chunk[_SUBMERGED] += submerged


@inlined
def _add_sums(chunk, n):
    """Add force, torque, dF/dh and the moments r_j f_l of a chunk to the totals."""
    wide_vectors()
    fx = fy = fz = hx = hy = hz = 0.0
    xx = xy = xz = yx = yy = yz = zx = zy = zz = 0.0
    for i in range(n):
        x, y, z = triple(chunk, row.PLACE, i)
        ax, ay, az = triple(chunk, row.TRACTION, i)
        load = chunk[at(row.LOAD, i)]
        area = chunk[at(row.AREA, i)]
        dx, dy, dz = ax * load, ay * load, az * load
        fx += dx
        fy += dy
        fz += dz
        hx += ax * area
        hy += ay * area
        hz += az * area
        xx += x * dx
        xy += x * dy
        xz += x * dz
        yx += y * dx
        yy += y * dy
        yz += y * dz
        zx += z * dx
        zy += z * dy
        zz += z * dz
    for c, value in enumerate((fx, fy, fz)):
        chunk[at(_FORCE, c)] += value
    for c, value in enumerate((yz - zy, zx - xz, xy - yx)):
        chunk[at(_TORQUE, c)] += value
    for c, value in enumerate((hx, hy, hz)):
        chunk[at(_BY_HEIGHT, c)] += value
    for c, value in enumerate((xx, xy, xz, yx, yy, yz, zx, zy, zz)):
        chunk[at(_MOMENTS, c)] += value


@inlined
def _inertia(chunk, n, inertia, per_scale2, has_memory):
    """Replace the tractions of a chunk by the forces of the grains' inertia, and their loads by one."""
    wide_vectors()
    for i in range(n):
        area = chunk[at(row.AREA, i)] * (chunk[at(row.SHARE, i)] if has_memory else 1.0)
        speed = chunk[at(row.SPEED, i)]
        normal = triple(chunk, row.NORMAL, i)
        direction = triple(chunk, row.VELOCITY, i)
        put(
            chunk,
            row.TRACTION,
            i,
            inertia_force(inertia, normal, direction, area, per_scale2 * speed * speed),
        )
        chunk[at(row.LOAD, i)] = 1.0
        chunk[at(row.AREA, i)] = 0.0


@inlined
def _add_forces(chunk, i0, b, out):
    for j in range(BLOCK):
        ax, ay, az = triple(chunk, row.TRACTION, at(i0, j))
        load = chunk[at(row.LOAD, at(i0, j))]
        plate = at(b * np.uint64(BLOCK), j)
        out[plate, 0] += ax * load
        out[plate, 1] += ay * load
        out[plate, 2] += az * load


def _sums(form, law, height, slope, states, past, out):
    """The sums for each state, `out` of shape [n, 7] or [n, 19], or the forces of plates at one state, shape [m, 3].

    `form`: of `Plates`. `law`: its `packed`. `past`: a `rft_ros.rft.memory.Past`.
    Forces are added to those in `out`, in the kernel's order. All steps are inlined, so that LLVM keeps what is the
    same for all blocks in registers.
    """
    wide_vectors()
    _, bounds, refined, reach = form
    has_memory = past.has_memory
    states_of_blocks = past.blocks
    has_stiffness = len(past.stiffness) > 0
    chunk = new_chunk()
    inertia = law.numbers[0].inertia
    flat_cosine = _BLEND_COSINE if refined else FLAT
    of_plates = out.shape[1] == _FORCES
    # unsigned: numba adds code for negative indices otherwise
    blocks = np.uint64(bounds.shape[1])
    for k in range(states.shape[0]):
        state = states[k]
        axes = attitude(state[QUATERNION])
        twist, scale = _scaled(
            (state[7], state[8], state[9], state[10], state[11], state[12]), reach
        )
        speed = 1.0 / scale if scale > 0.0 else 0.0
        # restores the speed for inertia; bounded, since 0 times infinity is NaN
        per_scale2 = min(speed * speed, 1e30)
        below, rise = _surface(height, slope, state, axes)
        half_way = axes
        motion = motion_in_tool = (0.0, 0.0, 0.0), axes  # not used, but of the type of a motion
        if has_memory:
            if has_stiffness:
                clear_stiffness(past.stiffness[0])
            motion = as_motion(past.displacements[k])
            half_way = half_way_axes(axes, motion)
            motion_in_tool = in_tool_axes(axes, half_way, motion)
            if scale == 0.0:
                twist, _ = _scaled(twist_along(motion), reach)
        scene = axes, half_way, twist, _turning(twist, half_way), below, rise
        for c in range(WIDTH):
            chunk[at(row.TOTAL, c)] = 0.0
        for first in range(np.uint64(0), blocks, np.uint64(row.WINDOW)):
            last = min(first + np.uint64(row.WINDOW), blocks)
            _classify(chunk, bounds, first, last, scene, reach, flat_cosine)
            steep_blocks, flat_blocks = _list(
                chunk, form, first, last, scene, has_memory, states_of_blocks, motion_in_tool
            )
            for flat in (False, True):
                listed = row.FLAT_BLOCKS if flat else row.STEEP_BLOCKS
                length = flat_blocks if flat else steep_blocks
                for begin in range(np.uint64(0), length, np.uint64(row.BLOCKS)):
                    count = min(np.uint64(row.BLOCKS), length - begin)
                    n = count * np.uint64(BLOCK)
                    numbers = at(listed, begin)
                    _geometry_of_blocks(chunk, numbers, count, form, first, scene, has_memory)
                    tractions(law, chunk, n, flat, refined)
                    if has_memory:
                        add_memory(
                            chunk,
                            numbers,
                            count,
                            states_of_blocks,
                            motion,
                            below,
                            slope,
                            law.numbers[0],
                        )
                        if has_stiffness:
                            add_stiffness(chunk, n, past.stiffness[0])
                    for inertial in range(2 if inertia > 0.0 else 1):
                        if inertial == 1:
                            _inertia(chunk, n, inertia, per_scale2, has_memory)
                        _add_sums(chunk, n)
                        if of_plates:
                            for j in range(count):
                                block = np.uint64(chunk[at(numbers, j)])
                                _add_forces(chunk, j * np.uint64(BLOCK), block, out)
        if not of_plates:
            for c in range(out.shape[1]):
                out[k, c] = chunk[at(row.TOTAL, c)]


sums = compiled(_sums, **OPTIONS)
"""The loop over states."""

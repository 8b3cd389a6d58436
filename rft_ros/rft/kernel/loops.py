"""The compiled loop: position and velocity of each plate, Eq. (1), its loaded part, and the sums of Eq. (9).

Bounds on a whole block of plates say which blocks are dry or trail, and are skipped. The others are evaluated chunk by
chunk in steps: geometry, tractions by the law, memory, sums. A step is a loop over plates that LLVM vectorises, so it
uses selects in place of branches on data. All laws, rules and options are in the one loop, which is compiled once.
"""

from math import cos, radians, sqrt
from typing import NamedTuple

import numpy as np

from rft_ros.rft.displacement import (
    NO_DISPLACEMENT,
    displacement_in,
    half_way_axes,
    in_tool_axes,
    shift_of,
    twist_along,
)
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
from rft_ros.rft.kernel import chunk as layout
from rft_ros.rft.kernel.chunk import at, new_chunk, put, triple, wide_vectors
from rft_ros.rft.kernel.compilation import OPTIONS, compiled, inlined
from rft_ros.rft.memory import add_memory, clear, follow_gap, is_elastic
from rft_ros.rft.plates import (
    AREA,
    BLOCK,
    BOUND_AREA,
    BOUND_MOMENT,
    BOUND_NORMAL,
    BOUND_POSITION,
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
from rft_ros.rft.traction import BLEND_TILT_DEG, FLAT, orient, tractions

_SKIP_DRY, _SKIP_WET, _PLAIN, _CUT, _FLAT_OR_CUT = range(5)
"""Kinds of blocks: dry (skipped); submerged and trailing (only its area counts); submerged without horizontal plates;
possibly cut by the surface; possibly with horizontal plates. The plates of blocks from `_PLAIN` on are evaluated one
by one. With memory, a trailing block whose plates still carry traction is `_PLAIN`: none of them leads, so their law
does not count."""

_FORCE, _TORQUE, _BY_HEIGHT, _MOMENTS = (
    layout.TOTAL + part.start for part in (FORCE, TORQUE, BY_HEIGHT, MOMENTS)
)
_WET_AREA = layout.TOTAL + SUBMERGED_AREA
"""Where each part of a result begins in the chunk, which has the totals of the state in the order of a result."""

_CENTROID, _NORMAL, _FIRST_CORNER, _SECOND_CORNER = (
    BLOCK * part.start for part in (CENTROID, NORMAL, FIRST_CORNER, SECOND_CORNER)
)
_AREA = BLOCK * AREA
_HALF_ANGLE = BLOCK * HALF_ANGLE
"""Where the rows of a block begin in `Plates.blocks`, counted from the block's first number."""

_BLEND_COSINE = cos(radians(BLEND_TILT_DEG))


class Twist(NamedTuple):
    """Velocity of the tool frame's origin, and angular velocity, world axes; scaled by one factor."""

    vx: float
    vy: float
    vz: float
    wx: float
    wy: float
    wz: float


class Scene(NamedTuple):
    """Where the tool is at a state, how it moves, and where the surface is: the same for all plates.

    Rotation matrices are nine numbers, by rows.
    """

    axes: tuple[float, ...]  # the tool's axes in the world
    half_way: tuple[float, ...]  # the same half a displacement before
    twist: Twist
    turning: tuple[float, ...]  # matrix from a position in tool axes to its velocity by turning
    depth: float  # of the tool frame's origin [m], vertical
    height_gradient: tuple[float, float, float]  # of the height above the surface, tool axes


@inlined
def _scaled(twist, reach):
    """A `Twist`, scaled to order one, and that scale; 0 for no motion.

    The law is rate-independent, so the scale changes no force; it prevents over- and underflow of squared speeds.
    """
    vx, vy, vz, wx, wy, wz = twist
    # The 1e-9 m bounds the scaled angular velocity of plates at the origin, which would be inf * 0.
    fastest = max(abs(vx), abs(vy), abs(vz), max(reach, 1e-9) * max(abs(wx), abs(wy), abs(wz)))
    s = 1.0 / fastest if fastest > 1e-290 else 0.0
    return Twist(vx=vx * s, vy=vy * s, vz=vz * s, wx=wx * s, wy=wy * s, wz=wz * s), s


@inlined
def _turning(twist, axes):
    """`Scene.turning` of a tool with these axes."""
    wx = twist.wx
    wy = twist.wy
    wz = twist.wz
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
    """`Scene.depth` and `Scene.height_gradient`. `slope`: dz/dx and dz/dy of the surface."""
    sx, sy = slope
    depth = height + sx * state[0] + sy * state[1] - state[2]
    a = axes[6] - sx * axes[0] - sy * axes[3]
    b = axes[7] - sx * axes[1] - sy * axes[4]
    c = axes[8]
    return depth, (a, b, c - sx * axes[2] - sy * axes[5])


@inlined
def _range(bounds, b, box, v):
    """The range of v · x over the points x of a block's box: its middle and its half width.

    `box`: `BOUND_NORMAL`, `BOUND_MOMENT` (of r x n) or `BOUND_POSITION`.
    """
    vx, vy, vz = v
    middle = vx * bounds[box, b] + vy * bounds[box + 1, b] + vz * bounds[box + 2, b]
    half_x = abs(vx) * bounds[box + 3, b]
    half_y = abs(vy) * bounds[box + 4, b]
    half_z = abs(vz) * bounds[box + 5, b]
    return middle, half_x + half_y + half_z


@inlined
def _classify(chunk, plates, first, last, scene, flat_cosine):
    """Store the kinds of the blocks `first` to `last`; where the bounds allow two, the one that computes more.

    `plates`: a `PackedPlates`. `flat_cosine`: abs(n·E3) from which on a plate may be horizontal.
    """
    wide_vectors()
    bounds = plates.bounds
    reach = plates.reach
    twist = scene.twist
    linear = into_frame(scene.half_way, twist.vx, twist.vy, twist.vz)
    angular = into_frame(scene.half_way, twist.wx, twist.wy, twist.wz)
    up = scene.half_way[6:]
    max_speed = _length(linear) + _length(angular) * reach
    margin = ROUNDING * (reach + abs(scene.depth))
    for b in range(first, last):
        height, height_range = _range(bounds, b, BOUND_POSITION, scene.height_gradient)
        depth = scene.depth - height
        depth_range = height_range + margin
        is_wet = depth - depth_range > 0.0
        is_dry = depth + depth_range <= 0.0
        # v·n of a plate is linear · n + angular · (r x n)
        lead, lead_range = _range(bounds, b, BOUND_NORMAL, linear)
        lead_by_turning, turning_range = _range(bounds, b, BOUND_MOMENT, angular)
        lead_by_half_angle = (bounds[BOUND_SINE, b] + ROUNDING) * max_speed
        trails = lead + lead_range + lead_by_turning + turning_range + lead_by_half_angle <= 0.0
        n_up, n_up_range = _range(bounds, b, BOUND_NORMAL, up)
        may_be_flat = abs(n_up) + n_up_range + ROUNDING >= flat_cosine
        kind = _FLAT_OR_CUT if may_be_flat else (_PLAIN if is_wet else _CUT)
        kind = _SKIP_WET if is_wet & trails else kind
        chunk[at(layout.BLOCK_KIND, b - first)] = _SKIP_DRY if is_dry else kind


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
    q_b = s * q
    q_c = t * q
    whole = (d0 + d1 + d2) * (1.0 / 12.0) if count > 1 else 0.0
    part = 1.0 / 12.0 if count > 1 else 0.0
    p0 = whole + part * d0 + (p if alone0 else (q_c if alone1 else q_b))
    p1 = whole + part * d1 + (q_b if alone0 else (p if alone1 else q_c))
    p2 = whole + part * d2 + (q_c if alone0 else (q_b if alone1 else p))
    return p0, p1, p2, (s * t if one else (1.0 - s * t if count > 1 else 0.0))


@inlined
def _first_number(plates, b):
    """Where the numbers of block b begin in the rows of a `PackedPlates`."""
    row_count = ROWS_OF_REFINED if plates.is_refined else ROWS_OF_CENTROID
    return b * np.uint64(row_count * BLOCK)


@inlined
def _centre_and_load(rows, first, i, scene, is_refined, is_cut):
    """A plate's centre of load [m], tool axes, its load [m³] and its area below the surface [m²].

    The load is the depth integrated over that area. `first`: of `_first_number`. `is_cut` False: the plate is fully
    submerged. `is_refined` and `is_cut` must be constants, or the loop is not vectorised.
    """
    zx, zy, zz = scene.height_gradient
    a, b, c = triple(rows, first + _CENTROID, i, BLOCK)
    area = rows[at(first + _AREA, i)]
    depth = scene.depth - (zx * a + zy * b + zz * c)
    if not is_refined:
        area = area if depth > 0.0 else 0.0
        return (a, b, c), depth * area, area
    # e0, e1 and -(e0 + e1) are the corners from the centroid
    e0x, e0y, e0z = triple(rows, first + _FIRST_CORNER, i, BLOCK)
    e1x, e1y, e1z = triple(rows, first + _SECOND_CORNER, i, BLOCK)
    h0 = zx * e0x + zy * e0y + zz * e0z
    h1 = zx * e1x + zy * e1y + zz * e1z
    if is_cut:
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
def _geometry(chunk, i0, plates, b, scene, has_memory, is_refined, is_cut):
    """Eq. (1) for block b, world axes, stored from plate `i0` of the chunk on; returns its area below the surface.

    `is_refined`, `is_cut`: as for `_centre_and_load`.
    """
    wide_vectors()
    rows = plates.rows
    twist = scene.twist
    first = b * np.uint64((ROWS_OF_REFINED if is_refined else ROWS_OF_CENTROID) * BLOCK)
    wet_area = 0.0
    for j in range(BLOCK):
        (cx, cy, cz), load, area = _centre_and_load(rows, first, j, scene, is_refined, is_cut)
        nx, ny, nz = normal = from_frame(scene.half_way, *triple(rows, first + _NORMAL, j, BLOCK))
        position = from_frame(scene.axes, cx, cy, cz)
        wx, wy, wz = from_frame(scene.turning, cx, cy, cz)
        ux, uy, uz = velocity = (twist.vx + wx, twist.vy + wy, twist.vz + wz)
        lead = ux * nx + uy * ny + uz * nz
        i = at(i0, j)
        per_speed = orient(chunk, i, normal, velocity)
        if is_refined:
            share = min(max(lead * per_speed * rows[at(first + _HALF_ANGLE, j)] + 0.5, 0.0), 1.0)
        else:
            share = 1.0 if lead > 0.0 else 0.0
        put(chunk, layout.POSITION, i, position)
        wet_area += area
        evaluated_share = 1.0 if has_memory else share
        chunk[at(layout.LOAD, i)] = load * evaluated_share
        chunk[at(layout.AREA, i)] = area * evaluated_share
        chunk[at(layout.SHARE, i)] = share
    return wet_area


@inlined
def _follow_gaps(block, plates, b, scene, displacement):
    """Follow the gaps behind the plates of block b, which is submerged, trails and is not elastic.

    `block`: of the memory. `displacement`: in tool axes.
    """
    first = _first_number(plates, b)
    for i in range(BLOCK):
        position, _, _ = _centre_and_load(plates.rows, first, i, scene, plates.is_refined, False)
        normal = triple(plates.rows, first + _NORMAL, i, BLOCK)
        follow_gap(block, i, normal, shift_of(displacement, position))


@inlined
def _list(chunk, plates, first, last, scene, has_memory, memory, displacement):
    """List the blocks of a window that are to be evaluated; returns how many are without, and with flat plates.

    The others are done here: of a block that is submerged and trails only the area counts, and its gaps are followed;
    a dry one loses its memory. `memory`: its blocks. `displacement`: in tool axes.
    """
    one = np.uint64(1)
    steep_count = np.uint64(0)
    flat_count = np.uint64(0)
    for b in range(first, last):
        kind = chunk[at(layout.BLOCK_KIND, b - first)]
        if has_memory and kind == _SKIP_WET and is_elastic(memory[b]):
            kind = _PLAIN
            chunk[at(layout.BLOCK_KIND, b - first)] = kind
        if kind == _FLAT_OR_CUT:
            chunk[at(layout.FLAT_BLOCKS, flat_count)] = b
            flat_count += one
        elif kind >= _PLAIN:
            chunk[at(layout.STEEP_BLOCKS, steep_count)] = b
            steep_count += one
        elif kind == _SKIP_WET:
            chunk[_WET_AREA] += plates.bounds[BOUND_AREA, b]
            if has_memory:
                _follow_gaps(memory[b], plates, b, scene, displacement)
        elif has_memory:
            clear(memory[b])
    return steep_count, flat_count


@inlined
def _geometry_of_blocks(chunk, numbers, count, plates, first, scene, has_memory):
    """`_geometry` of the blocks of a chunk. `numbers`: where theirs begin. `first`: block of the window."""
    for j in range(count):
        block = np.uint64(chunk[at(numbers, j)])
        i0 = j * np.uint64(BLOCK)
        wet_area = 0.0
        if not plates.is_refined:
            wet_area = _geometry(chunk, i0, plates, block, scene, has_memory, False, True)
        elif chunk[at(layout.BLOCK_KIND, block - first)] == _PLAIN:
            wet_area = _geometry(chunk, i0, plates, block, scene, has_memory, True, False)
        else:
            wet_area = _geometry(chunk, i0, plates, block, scene, has_memory, True, True)
        chunk[_WET_AREA] += wet_area


@inlined
def _add_sums(chunk, n):
    """Add force, torque, dF/dh and the moments r_j f_l of a chunk to the totals."""
    wide_vectors()
    fx = fy = fz = hx = hy = hz = 0.0
    xx = xy = xz = yx = yy = yz = zx = zy = zz = 0.0
    for i in range(n):
        x, y, z = triple(chunk, layout.POSITION, i)
        ax, ay, az = triple(chunk, layout.TRACTION, i)
        load = chunk[at(layout.LOAD, i)]
        area = chunk[at(layout.AREA, i)]
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
        area = chunk[at(layout.AREA, i)] * (chunk[at(layout.SHARE, i)] if has_memory else 1.0)
        speed = chunk[at(layout.SPEED, i)]
        normal = triple(chunk, layout.NORMAL, i)
        direction = triple(chunk, layout.VELOCITY, i)
        put(
            chunk,
            layout.TRACTION,
            i,
            inertia_force(inertia, normal, direction, area, per_scale2 * speed * speed),
        )
        chunk[at(layout.LOAD, i)] = 1.0
        chunk[at(layout.AREA, i)] = 0.0


@inlined
def _add_forces(chunk, i0, b, out):
    for j in range(BLOCK):
        ax, ay, az = triple(chunk, layout.TRACTION, at(i0, j))
        load = chunk[at(layout.LOAD, at(i0, j))]
        plate = at(b * np.uint64(BLOCK), j)
        out[plate, 0] += ax * load
        out[plate, 1] += ay * load
        out[plate, 2] += az * load


def _sums(plates, law, height, slope, states, past, out):
    """The sums for each state, `out` of shape [n, 7] or [n, 19], or the forces of plates at one state, shape [m, 3].

    `plates`: a `PackedPlates`. `law`: a `PackedLaw`. `past`: a `rft_ros.rft.memory.Past`.
    Forces are added to those in `out`, in the kernel's order. All steps are inlined, so that LLVM keeps what is the
    same for all blocks in registers.
    """
    wide_vectors()
    reach = plates.reach
    has_memory = past.has_memory
    memory = past.blocks
    has_stiffness = len(past.stiffness) > 0
    chunk = new_chunk()
    inertia = law.numbers[0].inertia
    flat_cosine = _BLEND_COSINE if plates.is_refined else FLAT
    sums_plates = out.shape[1] == 3
    # unsigned: numba adds code for negative indices otherwise
    block_count = np.uint64(plates.bounds.shape[1])
    for k in range(states.shape[0]):
        state = states[k]
        axes = attitude(state[QUATERNION])
        given_twist = Twist(
            vx=state[7], vy=state[8], vz=state[9], wx=state[10], wy=state[11], wz=state[12]
        )
        twist, scale = _scaled(given_twist, reach)
        speed = 1.0 / scale if scale > 0.0 else 0.0
        # restores the speed for inertia; bounded, since 0 times infinity is NaN
        per_scale2 = min(speed * speed, 1e30)
        depth, height_gradient = _surface(height, slope, state, axes)
        half_way = axes
        displacement = NO_DISPLACEMENT
        displacement_in_tool = NO_DISPLACEMENT
        if has_memory:
            if has_stiffness:
                clear_stiffness(past.stiffness[0])
            displacement = displacement_in(past.displacements[k])
            half_way = half_way_axes(axes, displacement)
            displacement_in_tool = in_tool_axes(axes, half_way, displacement)
            if scale == 0.0:
                twist, _ = _scaled(Twist(*twist_along(displacement)), reach)
        scene = Scene(
            axes=axes,
            half_way=half_way,
            twist=twist,
            turning=_turning(twist, half_way),
            depth=depth,
            height_gradient=height_gradient,
        )
        for c in range(WIDTH):
            chunk[at(layout.TOTAL, c)] = 0.0
        for first in range(np.uint64(0), block_count, np.uint64(layout.WINDOW)):
            last = min(first + np.uint64(layout.WINDOW), block_count)
            _classify(chunk, plates, first, last, scene, flat_cosine)
            steep_count, flat_count = _list(
                chunk, plates, first, last, scene, has_memory, memory, displacement_in_tool
            )
            for flat in (False, True):
                list_begin = layout.FLAT_BLOCKS if flat else layout.STEEP_BLOCKS
                length = flat_count if flat else steep_count
                for begin in range(np.uint64(0), length, np.uint64(layout.BLOCK_COUNT)):
                    count = min(np.uint64(layout.BLOCK_COUNT), length - begin)
                    n = count * np.uint64(BLOCK)
                    numbers = at(list_begin, begin)
                    _geometry_of_blocks(chunk, numbers, count, plates, first, scene, has_memory)
                    tractions(law, chunk, n, flat, plates.is_refined)
                    if has_memory:
                        add_memory(
                            chunk,
                            numbers,
                            count,
                            memory,
                            displacement,
                            depth,
                            slope,
                            law.numbers[0],
                        )
                        if has_stiffness:
                            add_stiffness(chunk, n, past.stiffness[0])
                    for inertial in range(2 if inertia > 0.0 else 1):
                        if inertial == 1:
                            _inertia(chunk, n, inertia, per_scale2, has_memory)
                        _add_sums(chunk, n)
                        if sums_plates:
                            for j in range(count):
                                block = np.uint64(chunk[at(numbers, j)])
                                _add_forces(chunk, j * np.uint64(BLOCK), block, out)
        if not sums_plates:
            for c in range(out.shape[1]):
                out[k, c] = chunk[at(layout.TOTAL, c)]


sums = compiled(_sums, **OPTIONS)
"""The loop over states."""

"""One implicit step of a body in grains: the wrench to hold over it, from the stiffness of the grains.

Near a state the grains' wrench is w = w_0 - B D, D the displacement over the step (backward Euler): with A the inverse
inertia of the body as its joints show it, and v_free the twist at the end of the step without the grains,

    w = (1 + h² B A)^-1 (w_0 - h B v_free)

Twists are linear then angular, at the body frame's origin, world axes; wrenches are force and torque about it.
"""

from math import cos, sin, sqrt

import numpy as np

from rft_ros.rft.compilation import compiled, inlined

__all__ = ["ANSWERS", "calm", "held", "measure", "move", "put", "stiffness_matrix"]

ANSWERS = 7, 6
"""Shape of what `calm` remembers of a body: twist and its change; held wrench and its change; the grains' wrench; sums
of the two regressions; their samples, inverse mass and inertia, share of the stiffness that the last step showed."""

_KEEPS, _EXPLAINED, _SAMPLES, _STIFF = 0.9, 0.8, 4.0, 0.05
"""Of `calm`: share of a sum that stays at each step; least explained variance, samples, and stiffness times inverse
mass times h², which is 4 where a held spring begins to throw an undamped body."""

_REBOUND = 0.1
"""Time [s] over which grains that push a body back give way: their elastic zone loses its energy, as grains do, and
does not ring. Chosen for the slowest elastic oscillation of bodies at rest, 20 Hz."""


@inlined
def _fill(sums, b):  # type: ignore[no-untyped-def]
    """B, shape [6, 6], from the ten sums of `Memory.stiffness`."""
    s, x, y, z = sums[0], sums[1], sums[2], sums[3]
    xx, yy, zz, xy, xz, yz = sums[4], sums[5], sums[6], sums[7], sums[8], sums[9]
    for i in range(6):
        for j in range(6):
            b[i, j] = 0.0
    b[0, 0] = b[1, 1] = b[2, 2] = s
    b[0, 4], b[0, 5], b[1, 3], b[1, 5], b[2, 3], b[2, 4] = z, -y, -z, x, y, -x
    b[4, 0], b[5, 0], b[3, 1], b[5, 1], b[3, 2], b[4, 2] = z, -y, -z, x, y, -x
    b[3, 3], b[4, 4], b[5, 5] = yy + zz, xx + zz, xx + yy
    b[3, 4], b[3, 5], b[4, 5] = -xy, -xz, -yz
    b[4, 3], b[5, 3], b[5, 4] = -xy, -xz, -yz


@compiled
def stiffness_matrix(sums, out):  # type: ignore[no-untyped-def]
    """Write B [N/m, N, N m] to `out`, shape [6, 6]: the wrench changes by -B times a small displacement."""
    _fill(sums, out)


@compiled
def measure(position, quaternion, jacobian, solved, velocity, acceleration, state, inverse, free):  # type: ignore[no-untyped-def]
    """Write a body's state, shape [13], its inverse inertia A, shape [6, 6], and its acceleration, shape [6].

    `quaternion`: wxyz. `jacobian`: shape [6, nv]; `solved`: M^-1 times it, same shape; `velocity`, `acceleration` of
    the joints, shape [nv]. Returns whether all of it is finite.
    """
    total = 0.0
    for i in range(3):
        state[i], state[3 + i] = position[i], quaternion[1 + i]
    state[6] = quaternion[0]
    for i in range(6):
        v = a = 0.0
        for k in range(velocity.shape[0]):
            v += jacobian[i, k] * velocity[k]
            a += jacobian[i, k] * acceleration[k]
        state[7 + i], free[i] = v, a
        total += a
        for j in range(6):
            s = 0.0
            for k in range(velocity.shape[0]):
                s += jacobian[i, k] * solved[j, k]
            inverse[i, j] = s
            total += s
    for i in range(13):
        total += state[i]
    return np.isfinite(total)


@inlined
def _solve(a, x):  # type: ignore[no-untyped-def]
    """Solve a x = x in place by elimination with pivots, shape [6, 6] and [6]."""
    for i in range(6):
        p = i
        for j in range(i + 1, 6):
            if abs(a[j, i]) > abs(a[p, i]):
                p = j
        for k in range(6):
            a[i, k], a[p, k] = a[p, k], a[i, k]
        x[i], x[p] = x[p], x[i]
        for j in range(i + 1, 6):
            f = a[j, i] / a[i, i]
            for k in range(i, 6):
                a[j, k] -= f * a[i, k]
            x[j] -= f * x[i]
    for i in range(5, -1, -1):
        for k in range(i + 1, 6):
            x[i] -= a[i, k] * x[k]
        x[i] /= a[i, i]


@compiled
def held(row, sums, inverse, twist, free, h, reach, wrench, after):  # type: ignore[no-untyped-def]
    """Write the wrench to hold over a step of h [s], shape [6], and the twist at its end, shape [6].

    `row`: of `wrenches_in_time` at the step's begin; `sums`: `Memory.stiffness`. `inverse`: A. `twist`: at the begin;
    `free`: acceleration without grains. Returns the longest path of a point within `reach` of the origin [m].
    """
    b, matrix = np.empty((6, 6)), np.empty((6, 6))
    _fill(sums, b)
    give = h
    while True:
        for i in range(6):
            s = 0.0
            for k in range(6):
                s += b[i, k] * (twist[k] + h * free[k])
            wrench[i] = row[i] - give * s
            for j in range(6):
                s = 0.0
                for k in range(6):
                    s += b[i, k] * inverse[k, j]
                matrix[i, j] = h * give * s + (1.0 if i == j else 0.0)
        _solve(matrix, wrench)
        power = 0.0
        for i in range(6):
            s = 0.0
            for k in range(6):
                s += inverse[i, k] * wrench[k]
            after[i] = twist[i] + h * (free[i] + s)
            power += after[i] * wrench[i]
        if power <= 0.0 or give > h:
            break
        give = h + _REBOUND
    linear = after[0] * after[0] + after[1] * after[1] + after[2] * after[2]
    angular = after[3] * after[3] + after[4] * after[4] + after[5] * after[5]
    return h * (sqrt(linear) + reach * sqrt(angular))


@compiled
def put(wrench, origin, center, applied):  # type: ignore[no-untyped-def]
    """Write a wrench about `origin` to `applied` as one about `center`, where MuJoCo applies it."""
    x, y, z = center[0] - origin[0], center[1] - origin[1], center[2] - origin[2]
    fx, fy, fz = wrench[0], wrench[1], wrench[2]
    applied[0], applied[1], applied[2] = fx, fy, fz
    applied[3] = wrench[3] - (y * fz - z * fy)
    applied[4] = wrench[4] - (z * fx - x * fz)
    applied[5] = wrench[5] - (x * fy - y * fx)


@compiled
def move(state, twist, h):  # type: ignore[no-untyped-def]
    """Move a state, shape [13], in place: it takes this twist for h [s]."""
    for i in range(3):
        state[i] += h * twist[i]
    for i in range(6):
        state[7 + i] = twist[i]
    x, y, z = 0.5 * h * twist[3], 0.5 * h * twist[4], 0.5 * h * twist[5]
    angle = sqrt(x * x + y * y + z * z)
    s, c = (sin(angle) / angle if angle > 1e-12 else 1.0), cos(angle)
    x, y, z = s * x, s * y, s * z
    qx, qy, qz, qw = state[3], state[4], state[5], state[6]
    state[3] = c * qx + x * qw + y * qz - z * qy
    state[4] = c * qy + y * qw + z * qx - x * qz
    state[5] = c * qz + z * qw + x * qy - y * qx
    state[6] = c * qw - x * qx - y * qy - z * qz


@compiled
def calm(rows, sums, states, h, reach, answers, out):  # type: ignore[no-untyped-def]
    """Write the wrenches on bodies to hold over h [s], shape [n, 6]: those of `rows`, until a body chatters under them.

    `answers`: shape [n, *ANSWERS]. The inverse mass and inertia, a scalar each, are the regression of the twist's
    second differences on the held wrench's changes. They count once they explain it. Then the wrench is `held`, with
    the acceleration without grains of the last step, and with the stiffness that the last step showed.
    """
    after, free, inverse, b = np.empty(6), np.empty(6), np.zeros((6, 6)), np.empty((6, 6))
    for n in range(len(rows)):
        row, twist, wrench, past = rows[n], states[n, 7:], out[n], answers[n]
        fits, known = past[5], past[6]
        for p in range(2):
            uu = uy = yy = ww = 0.0
            for i in range(3 * p, 3 * p + 3):
                u, y = h * past[3, i], twist[i] - past[0, i] - past[1, i]
                uu, uy, yy, ww = uu + u * u, uy + u * y, yy + y * y, ww + past[2, i] * past[2, i]
            for i, v in enumerate((uu, uy, yy)):
                fits[3 * p + i] = _KEEPS * fits[3 * p + i] + v
            known[p] = _KEEPS * known[p] + (1.0 if uu > (1e-3 * h) ** 2 * ww else 0.0)
            uu, uy, yy = fits[3 * p], fits[3 * p + 1], fits[3 * p + 2]
            stiff = sums[n, 0] if p == 0 else sums[n, 4] + sums[n, 5] + sums[n, 6]
            explains = uy > 0.0 and uy * uy > _EXPLAINED * uu * yy and known[p] > _SAMPLES
            if explains and h * h * stiff * uy > _STIFF * uu:
                known[2 + p] = uy / uu
        if known[2] > 0.0 or known[3] > 0.0:
            _fill(sums[n], b)
            met = asked = 0.0
            for i in range(6):
                moved = 0.5 * h * (twist[i] + past[0, i])
                met -= (row[i] - past[4, i]) * moved
                for j in range(6):
                    asked += moved * b[i, j] * 0.5 * h * (twist[j] + past[0, j])
                inverse[i, i] = known[2 + i // 3]
                free[i] = (twist[i] - past[0, i]) / h - inverse[i, i] * past[2, i]
            known[4] = max(min(met / asked, 1.0) if asked > 0.0 else 1.0, _KEEPS * known[4])
            held(row, known[4] * sums[n], inverse, twist, free, h, reach, wrench, after)
        else:
            wrench[:] = row[:6]
        for i in range(6):
            past[1, i], past[0, i] = twist[i] - past[0, i], twist[i]
            past[3, i], past[2, i] = wrench[i] - past[2, i], wrench[i]
            past[4, i] = row[i]

"""A step of a body in grains: the wrench to hold over it, from the stiffness of the grains and the body's inertia.

Near a state the grains' wrench is w = w_0 - B D, D the displacement over the step (backward Euler): with A the inverse
inertia of the body as its joints show it, and v_free the twist at the end of the step without the grains,

    w = (1 + h² B A)^-1 (w_0 - h B v_free)

Twists are linear then angular, at the body frame's origin, world axes; wrenches are force and torque about it.
"""

from math import sqrt

import numpy as np

from rft_ros.rft.compilation import compiled, inlined

__all__ = ["ANSWER", "calm", "held", "measure", "move", "put", "stiffness_matrix"]

ANSWER = np.dtype(
    [(name, np.float64, 6) for name in ("twist", "change", "wrench", "varied", "row")]
    + [(name, np.float64, 2) for name in ("uu", "uy", "yy", "samples", "inverse")]
    + [("share", np.float64)]
)
"""What `calm` remembers of a body. At the last step: its twist, the twist's change, the held wrench, that wrench's
change, the grains' own wrench. Of each half, linear and angular: the sums of a regression, their samples, and the
inverse mass [1/kg] or inertia [1/(kg m²)], 0 while unknown. The share of the stiffness that the last steps showed."""

_KEEPS, _EXPLAINED, _SAMPLES, _STIFF = 0.9, 0.8, 4.0, 0.05
"""Of `calm`: share of a sum that stays at each step; least explained variance, samples, and stiffness times inverse
mass times h², which is 4 where a held spring begins to throw an undamped body."""

_REBOUND = 0.1
"""Time [s] over which grains that push a body back give way: their elastic zone loses its energy, as grains do, and
does not ring. With 0.02 s a plate of 20 g gets back 1.4 % of its energy, with 0.1 s 0.6 %."""


@compiled
def stiffness_matrix(sums, b):
    """Write B [N/m, N, N m], shape [6, 6], of `Memory.stiffness`: the wrench changes by -B times a displacement."""
    s, x, y, z = sums[0], sums[1], sums[2], sums[3]
    xx, yy, zz, xy, xz, yz = sums[4], sums[5], sums[6], sums[7], sums[8], sums[9]
    b[:] = 0.0
    b[0, 0] = b[1, 1] = b[2, 2] = s
    b[0, 4], b[0, 5], b[1, 3], b[1, 5], b[2, 3], b[2, 4] = z, -y, -z, x, y, -x
    b[4, 0], b[5, 0], b[3, 1], b[5, 1], b[3, 2], b[4, 2] = z, -y, -z, x, y, -x
    b[3, 3], b[4, 4], b[5, 5] = yy + zz, xx + zz, xx + yy
    b[3, 4], b[3, 5], b[4, 5] = -xy, -xz, -yz
    b[4, 3], b[5, 3], b[5, 4] = -xy, -xz, -yz


@inlined
def _dot(a, b):
    s = 0.0
    for k in range(len(a)):
        s += a[k] * b[k]
    return s


@compiled
def measure(position, quaternion, jacobian, solved, velocity, acceleration, state, inverse, free):
    """Write a body's state, shape [13], its inverse inertia A, shape [6, 6], and its acceleration, shape [6].

    `quaternion`: wxyz. `jacobian`: shape [6, nv]; `solved`: M^-1 times it, same shape; `velocity`, `acceleration` of
    the joints, shape [nv]. Returns whether all of it is finite.
    """
    state[:3], state[3:6], state[6] = position, quaternion[1:], quaternion[0]
    total = state[:7].sum()
    for i in range(6):
        state[7 + i], free[i] = _dot(jacobian[i], velocity), _dot(jacobian[i], acceleration)
        total += state[7 + i] + free[i]
        for j in range(6):
            inverse[i, j] = _dot(jacobian[i], solved[j])
            total += inverse[i, j]
    return np.isfinite(total)


@inlined
def _solve(a, x):
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
def held(row, sums, inverse, twist, free, h, reach, wrench, after):
    """Write the wrench to hold over a step of h [s], shape [6], and the twist at its end, shape [6].

    `row`: of `wrenches_in_time` at the step's begin; `sums`: `Memory.stiffness`. `inverse`: A. `twist`: at the begin;
    `free`: acceleration without grains. Returns the longest path of a point within `reach` of the origin [m].
    """
    b, matrix = np.empty((6, 6)), np.empty((6, 6))
    stiffness_matrix(sums, b)
    ahead = twist + h * free
    for give in (h, h + _REBOUND):
        for i in range(6):
            wrench[i] = row[i] - give * _dot(b[i], ahead)
            for j in range(6):
                matrix[i, j] = h * give * _dot(b[i], inverse[j])
            matrix[i, i] += 1.0
        _solve(matrix, wrench)
        for i in range(6):
            after[i] = ahead[i] + h * _dot(inverse[i], wrench)
        if _dot(after, wrench) <= 0.0:
            break
    linear, angular = after[:3], after[3:]
    return h * (sqrt(_dot(linear, linear)) + reach * sqrt(_dot(angular, angular)))


@compiled
def put(wrench, origin, center, applied):
    """Write a wrench about `origin` to `applied` as one about `center`, where MuJoCo applies it."""
    x, y, z = center[0] - origin[0], center[1] - origin[1], center[2] - origin[2]
    fx, fy, fz = wrench[0], wrench[1], wrench[2]
    applied[0], applied[1], applied[2] = fx, fy, fz
    applied[3] = wrench[3] - (y * fz - z * fy)
    applied[4] = wrench[4] - (z * fx - x * fz)
    applied[5] = wrench[5] - (x * fy - y * fx)


@compiled
def move(state, twist, h):
    """Move a state, shape [13], in place: it takes this twist for h [s], in which it turns little."""
    state[:3] += h * twist[:3]
    state[7:] = twist
    a, b, c = 0.5 * h * twist[3], 0.5 * h * twist[4], 0.5 * h * twist[5]
    x, y, z, w = state[3], state[4], state[5], state[6]
    state[3] += a * w + b * z - c * y
    state[4] += b * w + c * x - a * z
    state[5] += c * w + a * y - b * x
    state[6] -= a * x + b * y + c * z
    state[3:7] /= sqrt(_dot(state[3:7], state[3:7]))


@inlined
def _learn(past, half, twist, stiff, h):
    """Take the last step into one half's regression of the twist's second difference on the held wrench's change.

    Its slope is the inverse mass or inertia. It counts once it explains what happens, if the half is so stiff that held
    wrenches throw the body, or if the other half is.
    """
    uu = uy = yy = square = 0.0
    for i in range(3 * half, 3 * half + 3):
        u, y = h * past.varied[i], twist[i] - past.twist[i] - past.change[i]
        uu, uy, yy, square = uu + u * u, uy + u * y, yy + y * y, square + past.wrench[i] ** 2
    past.samples[half] = _KEEPS * past.samples[half] + (1.0 if uu > (1e-3 * h) ** 2 * square else 0.0)
    past.uu[half] = uu = _KEEPS * past.uu[half] + uu
    past.uy[half] = uy = _KEEPS * past.uy[half] + uy
    past.yy[half] = yy = _KEEPS * past.yy[half] + yy
    explains = uy > 0.0 and uy * uy > _EXPLAINED * uu * yy and past.samples[half] > _SAMPLES
    if explains and (h * h * stiff * uy > _STIFF * uu or past.inverse[1 - half] > 0.0):
        past.inverse[half] = uy / uu


@inlined
def _share_shown(past, row, b, moved):
    """By how much the grains' wrench fell over the last displacement, as a share of what the stiffness b says."""
    met = asked = 0.0
    for i in range(6):
        met += (past.row[i] - row[i]) * moved[i]
        asked += moved[i] * _dot(b[i], moved)
    return min(met / asked, 1.0) if asked > 0.0 else 1.0


@compiled
def calm(rows, sums, states, h, reach, answers, out):
    """Write the wrenches on bodies to hold over h [s], shape [n, 6]: those of `rows`, until a body chatters under them.

    `answers`: of `ANSWER`, shape [n]. Once an inverse mass or inertia is known, the wrench is `held`, with the
    acceleration without grains that the body had over the last step.
    """
    after, free, inverse, b = np.empty(6), np.empty(6), np.zeros((6, 6)), np.empty((6, 6))
    for n in range(len(rows)):
        row, twist, wrench, past = rows[n, :6], states[n, 7:], out[n], answers[n]
        wrench[:] = row
        _learn(past, 0, twist, sums[n, 0], h)
        _learn(past, 1, twist, sums[n, 4] + sums[n, 5] + sums[n, 6], h)
        if past.inverse[0] > 0.0 or past.inverse[1] > 0.0:
            stiffness_matrix(sums[n], b)
            shown = _share_shown(past, row, b, 0.5 * h * (twist + past.twist))
            past.share = max(shown, _KEEPS * past.share)
            for i in range(6):
                inverse[i, i] = past.inverse[i // 3]
                free[i] = (twist[i] - past.twist[i]) / h - inverse[i, i] * past.wrench[i]
            held(row, past.share * sums[n], inverse, twist, free, h, reach, wrench, after)
            if not np.isfinite(wrench.sum()):  # steps or twists without measure
                wrench[:] = row
                past.inverse[:] = 0.0
        past.change[:] = twist - past.twist
        past.varied[:] = wrench - past.wrench
        past.twist[:], past.wrench[:], past.row[:] = twist, wrench, row

"""The implicit step of bodies in grains: backward Euler in the coordinates of their joints.

The unknown x is the acceleration that the simulator's integrator takes over a step of length h. With the Jacobian J of
the bodies, their twists V and states now, each body moves with

    V + h J x,   and is at the step's end at   D = h (V + h J x)   from where it is,

where the memory of the grains gives the wrenches w(x), the wrenches that act over the step. So

    M_i x = f + c(x) + J^T w(x)

with the inertia M_i of the joints as the integrator takes it, the forces f of all but grains and constraints, and
those of the constraints c. Newton's method has the matrix

    M_i + Jc^T D Jc P + h^2 J^T B J

B is the stiffness of the grains. Jc and D are the Jacobian and the stiffness of the active constraints, for which the
acceleration is P x (`rft_ros.simulation.mechanism`). The matrix is as sparse as M_i: joints on different branches of
the mechanism have no common entry, so `_eliminate` fills none in. Twists and wrenches of bodies are linear then
angular, force then torque, at the body frames' origins, world axes.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import body_memory
from rft_ros.rft.body_memory import memory_of
from rft_ros.rft.kernel.compilation import compiled, inlined
from rft_ros.simulation.beds import evaluate

Array = NDArray[np.float64]

MAX_EVALUATION_COUNT = 64
"""Most evaluations of Newton's method."""

AVERAGE_AFTER_COUNT = 8
"""Evaluations after which it takes the mean of a stiffness and those before, since with each alone it may go round in a
circle where plates lose and find contact."""

MAX_WRENCH_CHANGE_SHARE = 0.001
"""Relative change of the wrench at which the method has converged, after that change."""

MAX_LATE_WRENCH_CHANGE_SHARE = 0.01
"""The same after `AVERAGE_AFTER_COUNT`."""

MAX_RESIDUAL_SHARE = 0.5
"""Residual along a step of Newton's method, at its end over at its beginning, from which on the step is divided."""

MAX_DIVIDED_RESIDUAL_SHARE = 0.1
"""The residual down to which it is divided."""

MAX_GROWTH_OF_SHARE = 10.0
"""The greatest factor of the share of a step at once."""

STILL_PATH_SHARE = 1e-7
"""Change of the path of a point, in mobilization lengths, below which the wrench does not matter."""

NEAR_SURFACE_M = 1e-3
"""Distance from the surface, beside twice its path in the step, at which a body may reach it."""

ROUNDING_SHARE = 1e-12
"""Rounding of the inverse inertia that a user gives, over its greatest number."""

PIVOT_ROUNDING_SHARE = 1e-6
"""Rounding of the pivots of a scaled inverse inertia. A lower pivot than minus this is that of a negative mass."""

QUADRATIC_STATE = 1
CONE_STATE = 4
"""Of mjtConstraintState."""

SEARCH = np.dtype(
    [
        ("start_residual", np.float64),  # along Newton's step, at its beginning
        ("share", np.float64),  # of this step that is tried
        ("low_share", np.float64),  # shares between which the residual changes its sign
        ("high_share", np.float64),
        ("low_residual", np.float64),  # the residuals there
        ("high_residual", np.float64),
        ("least_residual", np.float64),  # the smallest `start_residual` so far
        ("path", np.float64),  # the longest of a point of a body in grains [m]
        ("evaluations", np.int64),
        ("is_divided", np.bool_),  # whether a share of the step is searched for
        ("has_ended", np.bool_),  # whether the method has converged
    ],
    align=True,
)
"""Where Newton's method is."""


class Joints(NamedTuple):
    """Bodies that may reach the grains, and their joints. `bodies`: their numbers in the beds, shape [m].

    `twists`: V, shape [m, 6]. `jacobian`: J, shape [m, 6, nv]. `inertia`: M_i. `force`: f, shape [nv].
    """

    bodies: NDArray[np.int64]
    twists: Array
    jacobian: Array
    inertia: Array
    force: Array


class Constraints(NamedTuple):
    """The rows of constraints: Jacobian Jc, state, D; and contacts with elliptic cones; at the last trial.

    `cones`: their first rows and dimensions, shape [2, n]; `cone_hessians`: shape [n, 36]. `force`: c, shape [nv].
    `response`: P, shape [nv, nv].
    """

    jacobian: Array
    state: NDArray[np.int32]
    stiffness: Array
    cones: NDArray[np.int32]
    cone_hessians: Array
    force: Array
    response: Array


class Trial(NamedTuple):
    """An iterate: x, where Newton's step began and the step, shape [nv]; the wrenches at the end, shape [m, 6].

    `best`: those to which the smallest step of the method led, its result. `stiffness`: B of each body, shape
    [m, 6, 6]. `progress`: where the method is, shape [1].
    """

    acceleration: Array
    start: Array
    change: Array
    wrench: Array
    best: Array
    stiffness: Array
    progress: NDArray[np.void]


@inlined
def no_constraints(nv: int) -> Constraints:
    """Those of joints that nothing else bears on."""
    return Constraints(
        jacobian=np.zeros((0, nv)),
        state=np.zeros(0, np.int32),
        stiffness=np.zeros(0),
        cones=np.zeros((2, 0), np.int32),
        cone_hessians=np.zeros((0, 36)),
        force=np.zeros(nv),
        response=np.eye(nv),
    )


@inlined
def new_trial(bodies, nv):
    """The first trial for that many bodies, at no acceleration."""
    return Trial(
        acceleration=np.zeros(nv),
        start=np.zeros(nv),
        change=np.zeros(nv),
        wrench=np.zeros((bodies, 6)),
        best=np.zeros((bodies, 6)),
        stiffness=np.zeros((bodies, 6, 6)),
        progress=np.zeros(1, SEARCH),
    )


@inlined
def _dot(a, b):
    """The sum of products of two vectors."""
    s = 0.0
    for k in range(len(a)):
        s += a[k] * b[k]
    return s


@inlined
def _copy(values, target):
    """Copy a vector. An assignment to a slice would compile numba's strings, for its error: 2 s each time."""
    for k in range(len(target)):
        target[k] = values[k]


@inlined
def _times(a, x):
    """The product of a matrix and a vector."""
    product = np.empty(len(a))
    for i in range(len(a)):
        product[i] = _dot(a[i], x)
    return product


@inlined
def _product(a, b, total):
    """Add the product of two matrices, in which many numbers may be zero."""
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            if a[i, k] != 0.0:
                for j in range(b.shape[1]):
                    total[i, j] += a[i, k] * b[k, j]


@inlined
def _eliminate(a, x):
    """Replace x by the solution of a y = x, from the last row on; a is overwritten too."""
    for i in range(len(a) - 1, -1, -1):
        for j in range(i):
            if a[j, i] != 0.0:
                f = a[j, i] / a[i, i]
                x[j] -= f * x[i]
                for k in range(i):
                    a[j, k] -= f * a[i, k]
    for i in range(len(a)):
        x[i] = (x[i] - _dot(a[i, :i], x[:i])) / a[i, i]


@compiled
def begin_step(beds, first_body, states, h):
    """Bring bodies from `first_body` on to these states, shape [n, 13], at which a step of h [s] begins.

    In the last step the wrenches took energy with the mean of the twists at its ends.
    """
    for k in range(len(states)):
        b = first_body + k
        motion = beds.motions[b]
        memory = memory_of(beds.memories, b)
        power = _dot(motion.wrench, memory.last[7:]) + _dot(motion.wrench, states[k, 7:])
        motion.energy -= 0.5 * motion.duration * power
        evaluate(beds, b, memory, states[k], motion.explicit.reshape(1, 6))
        motion.duration = h
        motion.is_near = _may_reach(motion, memory.last, beds.shapes[b].reach)


@inlined
def _may_reach(motion, state, reach):
    clearance = state[2] - motion.height - motion.slope_x * state[0] - motion.slope_y * state[1]
    steep = 1.0 + abs(motion.slope_x) + abs(motion.slope_y)
    path = 2.0 * motion.duration * _size(state[7:], reach)
    return not clearance > steep * (reach + NEAR_SURFACE_M + path)


@inlined
def _size(six, reach):
    """The size of the linear part of a twist, and `reach` times that of the angular part; so of a wrench."""
    return sqrt(_dot(six[:3], six[:3])) + reach * sqrt(_dot(six[3:], six[3:]))


@inlined
def _move(state, twist, h):
    """Move a state, shape [13], in place: it takes this twist for h [s], in which it turns little."""
    for k in range(3):
        state[k] += h * twist[k]
    _copy(twist, state[7:])
    a, b, c = 0.5 * h * twist[3:]
    x, y, z, w = state[3:7].copy()
    state[3] += a * w + b * z - c * y
    state[4] += b * w + c * x - a * z
    state[5] += c * w + a * y - b * x
    state[6] -= a * x + b * y + c * z
    norm = sqrt(_dot(state[3:7], state[3:7]))
    for k in range(3, 7):
        state[k] /= norm


@inlined
def _residual(joints, constraints, trial):
    """M_i x - f - c - J^T w, shape [nv]."""
    residual = _times(joints.inertia, trial.acceleration) - joints.force - constraints.force
    for k in range(len(trial.wrench)):
        for i in range(6):
            residual -= trial.wrench[k, i] * joints.jacobian[k, i]
    return residual


@inlined
def _add_constraints(matrix, constraints):
    """Add Jc^T D Jc P of the constraints that act, and of contacts that slide within elliptic cones."""
    jacobian = constraints.jacobian
    state = constraints.state
    weighted_rows = np.zeros_like(jacobian)
    for i in range(len(state)):
        if state[i] == QUADRATIC_STATE:
            _copy(constraints.stiffness[i] * jacobian[i], weighted_rows[i])
    for c in range(constraints.cones.shape[1]):
        first_row = constraints.cones[0, c]
        size = constraints.cones[1, c]
        if first_row >= 0 and state[first_row] == CONE_STATE:
            hessian = constraints.cone_hessians[c, : size * size].copy().reshape(size, size)
            _product(
                hessian,
                jacobian[first_row : first_row + size],
                weighted_rows[first_row : first_row + size],
            )
    weighted_by_p = np.zeros_like(jacobian)
    _product(weighted_rows, constraints.response, weighted_by_p)
    _product(jacobian.T, weighted_by_p, matrix)


@inlined
def _newton(joints, constraints, trial, residual, h):
    """Write Newton's step from a residual; returns how the wrenches change along it, shape [m, 6]."""
    matrix = joints.inertia.copy()
    stiff = np.zeros_like(joints.jacobian)
    for k in range(len(stiff)):
        _product(h * h * trial.stiffness[k], joints.jacobian[k], stiff[k])
        _product(joints.jacobian[k].T, stiff[k], matrix)
    if len(constraints.state):
        _add_constraints(matrix, constraints)
    _copy(-residual, trial.change)
    _eliminate(matrix, trial.change)
    wrench_change = np.empty_like(trial.wrench)
    for k in range(len(stiff)):
        _copy(-_times(stiff[k], trial.change), wrench_change[k])
    return wrench_change


@inlined
def _small(beds, joints, trial, change, close, h):
    """Whether Newton's step changes all wrenches by small shares of themselves, or hardly moves a body."""
    small = True
    for k, b in enumerate(joints.bodies):
        reach = beds.shapes[b].reach
        # where no plate touches the grains both are 0, which does not say what comes at the step's end
        if _size(change[k], 1.0 / reach) >= close * _size(trial.wrench[k], 1.0 / reach):
            displacement = h * h * _times(joints.jacobian[k], trial.change)
            small &= _size(displacement, reach) < STILL_PATH_SHARE * beds.length
    return small


@compiled
def search(beds, joints, constraints, h, trial):
    """Evaluate the grains where the step ends, and go on from there; returns whether the method has come to an end.

    A step of Newton's method is too long where the grains stiffen on the way, and too short where they release a body.
    Its length is then found by the rule of false position (Illinois) for the residual along it.
    """
    progress = trial.progress[0]
    state = np.empty(13)
    tangents = np.empty_like(trial.stiffness)
    progress.path = 0.0
    for k, b in enumerate(joints.bodies):
        memory = body_memory.copy(memory_of(beds.memories, b))
        twist = joints.twists[k] + h * _times(joints.jacobian[k], trial.acceleration)
        _copy(memory.last, state)
        _move(state, twist, h)
        evaluate(beds, b, memory, state, trial.wrench[k : k + 1])
        body_memory.stiffness(memory, tangents[k])
        if _size(trial.wrench[k], 1.0) > 0.0:
            progress.path = max(progress.path, h * _size(twist, beds.shapes[b].reach))
    residual = _residual(joints, constraints, trial)
    residual_along = -_dot(residual, trial.change)
    _bracket(progress, residual_along)
    max_share = MAX_DIVIDED_RESIDUAL_SHARE if progress.is_divided else MAX_RESIDUAL_SHARE
    if abs(residual_along) > max_share * progress.start_residual and progress.evaluations > 0:
        progress.is_divided = True
        progress.share = _next_share(progress, residual_along)
    else:
        is_late = progress.evaluations >= AVERAGE_AFTER_COUNT
        weight = 0.5 if is_late else 1.0
        for k in range(len(tangents)):
            for i, old in enumerate(trial.stiffness[k]):
                _copy(old + weight * (tangents[k, i] - old), old)
        _copy(trial.acceleration, trial.start)
        change = _newton(joints, constraints, trial, residual, h)
        progress.start_residual = -_dot(residual, trial.change)
        max_change = MAX_LATE_WRENCH_CHANGE_SHARE if is_late else MAX_WRENCH_CHANGE_SHARE
        progress.has_ended = _small(beds, joints, trial, change, max_change, h)
        if (
            progress.has_ended
            or progress.evaluations == 0
            or progress.start_residual < progress.least_residual
        ):
            progress.least_residual = progress.start_residual
            for k in range(len(change)):
                _copy(trial.wrench[k] + change[k], trial.best[k])
        _restart(progress)
    _copy(trial.start + progress.share * trial.change, trial.acceleration)
    progress.evaluations += 1
    return progress.has_ended or progress.evaluations == MAX_EVALUATION_COUNT


@inlined
def _bracket(progress, residual_along):
    """Keep the shares between which the residual along the step changes its sign."""
    if residual_along > 0.0:
        progress.low_share = progress.share
        progress.low_residual = residual_along
        progress.high_residual *= 0.5
    else:
        progress.high_share = progress.share
        progress.high_residual = residual_along
        progress.low_residual *= 0.5


@inlined
def _next_share(progress, residual_along):
    """The share of the step that is tried next."""
    if progress.high_share < np.inf:
        crossing = (
            progress.low_share * progress.high_residual
            - progress.high_share * progress.low_residual
        )
        return crossing / (progress.high_residual - progress.low_residual)
    fall = max(progress.start_residual - residual_along, ROUNDING_SHARE * progress.start_residual)
    return progress.share * min(progress.start_residual / fall, MAX_GROWTH_OF_SHARE)


@inlined
def _restart(progress):
    """Begin to search along a new step, of which the whole is tried first."""
    progress.is_divided = False
    progress.low_share = 0.0
    progress.low_residual = progress.start_residual
    progress.high_share = np.inf
    progress.high_residual = 0.0
    progress.share = 1.0


@inlined
def _regularized(inverse):
    """The matrix A, with a small number on its diagonal."""
    greatest = 0.0
    for number in inverse.ravel():
        greatest = max(greatest, abs(number))
    regular = inverse.copy()
    for k in range(6):
        regular[k, k] += ROUNDING_SHARE * greatest
    return regular


@compiled
def find_indefinite(matrices):
    """The first of inverse inertias A, shape [n, 6, 6], that a negative mass or inertia would have; -1: none is.

    A semidefinite one is a body that cannot move in some directions. Its symmetric part counts.
    """
    for n in range(len(matrices)):
        greatest = 0.0
        for number in matrices[n].ravel():
            greatest = max(greatest, abs(number))
        rounding = ROUNDING_SHARE * greatest
        scaled_matrix = np.zeros((6, 6))
        for i in range(6):
            if matrices[n, i, i] < -rounding:
                return n
        for i in range(6):
            for j in range(6):
                entry = 0.5 * (matrices[n, i, j] + matrices[n, j, i])
                size = sqrt(max(matrices[n, i, i], rounding) * max(matrices[n, j, j], rounding))
                scaled_matrix[i, j] = entry / size if size > 0.0 else 0.0
        for k in range(6):
            pivot = scaled_matrix[k, k]
            if pivot < -PIVOT_ROUNDING_SHARE:
                return n
            for i in range(k + 1, 6):
                share = scaled_matrix[i, k] / max(pivot, PIVOT_ROUNDING_SHARE)
                for j in range(k + 1, 6):
                    scaled_matrix[i, j] -= share * scaled_matrix[k, j]
    return -1


@compiled
def hold_each(beds, first_body, inverse, free, h):
    """Find the wrenches of bodies from `first_body` on that do not meet.

    `inverse`: A, shape [n, 6, 6]; `free`: acceleration, shape [n, 6]. The coordinates of each are the wrench itself, so
    that A is both its Jacobian and its inertia; a small number holds the directions in which A lets nothing move.
    Returns how many times Newton's method did not come to an end, and the longest path [m].
    """
    failures = 0
    longest = 0.0
    constraints = no_constraints(6)
    for k in range(len(inverse)):
        b = first_body + k
        motion = beds.motions[b]
        trial = new_trial(1, 6)
        if motion.is_near:
            joints = Joints(
                bodies=np.array([b]),
                twists=(beds.memories.last[b, 7:] + h * free[k]).reshape(1, 6),
                jacobian=inverse[k : k + 1],
                inertia=_regularized(inverse[k]),
                force=np.zeros(6),
            )
            _copy(motion.wrench, trial.acceleration)
            while not search(beds, joints, constraints, h, trial):
                pass
            if not trial.progress[0].has_ended:
                failures += 1
            longest = max(longest, trial.progress[0].path)
        _copy(trial.best[0], motion.wrench)
    return failures, longest

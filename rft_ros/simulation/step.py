"""The implicit step of bodies in grains: backward Euler in the coordinates of their joints.

The unknown x is the acceleration that the simulator's integrator takes over a step of length h. With the Jacobian J of
the bodies, their twists V and states now, each body moves with

    V + h J x,   and is at the step's end at   D = h (V + h J x)   from where it is,

where the memory of the grains gives the wrenches w(x), the wrenches that act over the step. So

    M_i x = f + c(x) + J^T w(x)

with the inertia M_i of the joints as the integrator takes it, the forces f of all but grains and constraints, and
those of the constraints c. Newton's method has the matrix

    M_i + Jc^T D Jc P + h^2 J^T B J

with the stiffness B of the grains, and of the constraints that act the Jacobian Jc and the stiffness D: they feel the
acceleration P x (`rft_ros.simulation.mechanism`). It has the sparsity of M_i, whose joints of one branch do not meet
those of another: `_eliminate` makes no new numbers there. Twists and wrenches of bodies are stacked: linear then
angular, force then torque, at the body frames' origins, world axes.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft.kernel.compilation import compiled, inlined
from rft_ros.rft.memory import STIFFNESS
from rft_ros.simulation.beds import evaluate, stiffness_matrix

Array = NDArray[np.float64]

_MOST = 64
"""Most evaluations of Newton's method."""

_WHOLE = 8
"""Evaluations after which it takes the mean of a stiffness and those before, since with each alone it may go round in a
circle where plates lose and find contact."""

_CLOSE = 0.001
"""Relative change of the wrench at which it ends, after that change; after `_WHOLE` evaluations `_LATE`."""

_LATE = 0.01

_OFF = 0.5
"""Residual along a step of Newton's method at its end, over that at its beginning: over it the length is wrong."""

_LEVEL = 0.1
"""The residual below which a length that was wrong is right again."""

_LONGER = 10.0
"""The greatest factor of the length at once."""

_STILL = 1e-7
"""Change of the path of a point, in mobilization lengths, below which the wrench does not matter."""

_NEAR = 1e-3
"""Distance from the surface [m], beside twice its path in the step, at which a body may reach it."""

_ROUNDING = 1e-12  # relative, of the inverse inertia that a user gives
_QUADRATIC = 1  # of mjtConstraintState
_CONE = 4

BODY = np.dtype([("wrench", np.float64, 6), ("energy", np.float64)])
"""State of a body: the wrench of the last step; the energy that the grains have taken [J]."""

_SEARCH = np.dtype(
    [
        (name, np.float64)
        for name in ("slope", "share", "low", "high", "at_low", "at_high", "least", "path")
    ]
    + [("turn", np.int64), ("within", np.bool_), ("found", np.bool_)],
    align=True,
)
"""Where Newton's method is.

`slope`: the residual along its step at the beginning. `share` of the step that is tried. `low`, `high`, `at_low`,
`at_high`: shares between which the residual changes its sign, and the residuals there. `least`: the smallest `slope`
so far. `path`: the longest of a point of a body in grains [m]. `turn`: number of evaluations. `within`: whether a step
is being divided. `found`: whether the method has come to an end.
"""


class Joints(NamedTuple):
    """Bodies that may reach the grains, and their joints. `bodies`: their numbers in the beds, shape [m].

    `states`: shape [n, 13] of all bodies. `twists`: V, shape [6 m]. `jacobian`: J, shape [6 m, nv]. `inertia`: M_i.
    `force`: f, shape [nv].
    """

    bodies: NDArray[np.int64]
    states: Array
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
    """An iterate: x, where Newton's step began and the step, shape [nv]; the wrenches at the end, shape [6 m].

    `best`: those to which the smallest step of the method led, its result. `stiffness`: B of each body, shape
    [m, 6, 6]. `at`: where the method is, shape [1].
    """

    acceleration: Array
    start: Array
    change: Array
    wrench: Array
    best: Array
    stiffness: Array
    at: NDArray[np.void]


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
        wrench=np.zeros(6 * bodies),
        best=np.zeros(6 * bodies),
        stiffness=np.zeros((bodies, 6, 6)),
        at=np.zeros(1, _SEARCH),
    )


@inlined
def _dot(a, b):
    """The sum of products of two vectors."""
    s = 0.0
    for k in range(len(a)):
        s += a[k] * b[k]
    return s


@inlined
def _product(a, b, out):
    """Add the product of two matrices, in which many numbers may be zero."""
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            if a[i, k] != 0.0:
                for j in range(b.shape[1]):
                    out[i, j] += a[i, k] * b[k, j]


@inlined
def _eliminate(a, x):
    """Solve a x = x in place for the columns of x, from the last row on; a is overwritten too."""
    for i in range(len(a) - 1, -1, -1):
        for j in range(i):
            if a[j, i] != 0.0:
                f = a[j, i] / a[i, i]
                for k in range(i):
                    a[j, k] -= f * a[i, k]
                for k in range(x.shape[1]):
                    x[j, k] -= f * x[i, k]
    for i in range(len(a)):
        for k in range(i):
            if a[i, k] != 0.0:
                for j in range(x.shape[1]):
                    x[i, j] -= a[i, k] * x[k, j]
        for j in range(x.shape[1]):
            x[i, j] /= a[i, i]


@compiled
def advance(beds, first, bodies, durations, given, states, rows, near):
    """Bring the memory of bodies from `first` on to `given` states, shape [n, 13]; write their rows, shape [n, 19].

    `bodies`: of `BODY`. `durations`: of the last step, in which the last wrenches took energy with the mean of the
    twists at its ends, and of the next [s]. `states`: the last states; takes a copy of `given`. `near`: takes whether
    each body may reach the surface within the next step.
    """
    for b in range(len(given)):
        wrench = bodies[b].wrench
        bodies[b].energy -= (
            0.5 * durations[0] * (_dot(wrench, states[b, 7:]) + _dot(wrench, given[b, 7:]))
        )
        memory = beds.memory[first + b : first + b + 1]
        stiffness = beds.stiffness[first + b : first + b + 1]
        evaluate(beds, first + b, memory, stiffness, states[b], given[b : b + 1], rows[b : b + 1])
        states[b] = given[b]
        near[b] = _may_reach(beds.bodies[first + b], states[b], durations[1])


@inlined
def _may_reach(bed, state, h):
    surface = bed.height + bed.slope_x * state[0] + bed.slope_y * state[1]
    steep = 1.0 + abs(bed.slope_x) + abs(bed.slope_y)
    return not state[2] - surface > steep * (
        bed.reach + _NEAR + 2.0 * h * _path(state[7:], bed.reach)
    )


@inlined
def _part(b):
    return slice(6 * b, 6 * b + 6)


@inlined
def _path(twist, reach):
    """Path per second of the fastest point within `reach` [m/s], at most."""
    return sqrt(_dot(twist[:3], twist[:3])) + reach * sqrt(_dot(twist[3:], twist[3:]))


@inlined
def _size(wrench, reach):
    return sqrt(_dot(wrench[:3], wrench[:3])) + sqrt(_dot(wrench[3:], wrench[3:])) / reach


@inlined
def _move(state, twist, h):
    """Move a state, shape [13], in place: it takes this twist for h [s], in which it turns little."""
    state[:3] += h * twist[:3]
    state[7:] = twist
    a, b, c = 0.5 * h * twist[3:]
    x, y, z, w = state[3:7].copy()
    state[3] += a * w + b * z - c * y
    state[4] += b * w + c * x - a * z
    state[5] += c * w + a * y - b * x
    state[6] -= a * x + b * y + c * z
    state[3:7] /= sqrt(_dot(state[3:7], state[3:7]))


@inlined
def _residual(joints, constraints, trial):
    """M_i x - f - c - J^T w, shape [nv]."""
    residual = np.empty(len(joints.force))
    for i in range(len(residual)):
        residual[i] = (
            _dot(joints.inertia[i], trial.acceleration) - joints.force[i] - constraints.force[i]
        )
    for i in range(len(trial.wrench)):
        for k in range(len(residual)):
            residual[k] -= joints.jacobian[i, k] * trial.wrench[i]
    return residual


@inlined
def _add_constraints(matrix, constraints):
    """Add Jc^T D Jc P of the constraints that act, and of contacts that slide within elliptic cones."""
    jacobian = constraints.jacobian
    state = constraints.state
    weighted = np.zeros_like(jacobian)
    for i in range(len(state)):
        if state[i] == _QUADRATIC:
            weighted[i] = constraints.stiffness[i] * jacobian[i]
    for c in range(constraints.cones.shape[1]):
        first = constraints.cones[0, c]
        size = constraints.cones[1, c]
        if first >= 0 and state[first] == _CONE:
            hessian = constraints.cone_hessians[c, : size * size].copy().reshape(size, size)
            _product(hessian, jacobian[first : first + size], weighted[first : first + size])
    weighted_by_p = np.zeros_like(jacobian)
    _product(weighted, constraints.response, weighted_by_p)
    _product(jacobian.T, weighted_by_p, matrix)


@inlined
def _newton(joints, constraints, trial, residual, h):
    """Write Newton's step from a residual; returns how the wrenches change along it, shape [6 m]."""
    matrix = joints.inertia.copy()
    stiff = np.zeros_like(joints.jacobian)
    for b in range(len(joints.bodies)):
        _product(trial.stiffness[b], joints.jacobian[_part(b)], stiff[_part(b)])
    stiff *= h * h
    _product(joints.jacobian.T, stiff, matrix)
    if len(constraints.state):
        _add_constraints(matrix, constraints)
    trial.change[:] = residual
    _eliminate(matrix, trial.change.reshape(-1, 1))
    trial.change[:] = -trial.change
    by_wrench = np.empty(len(stiff))
    for i in range(len(stiff)):
        by_wrench[i] = -_dot(stiff[i], trial.change)
    return by_wrench


@inlined
def _small(beds, joints, trial, change, close, h):
    """Whether Newton's step changes all wrenches by small shares of themselves, or hardly moves a body."""
    moved = np.empty(6)
    small = True
    for k, b in enumerate(joints.bodies):
        part = _part(k)
        reach = beds.bodies[b].reach
        # where no plate touches the grains both are 0, which does not say what comes at the step's end
        if _size(change[part], reach) >= close * _size(trial.wrench[part], reach):
            for i in range(6):
                moved[i] = h * h * _dot(joints.jacobian[6 * k + i], trial.change)
            small &= _path(moved, reach) < _STILL * beds.length
    return small


@compiled
def search(beds, joints, constraints, h, trial):
    """Evaluate the grains where the step ends, and go on from there; returns whether the method has come to an end.

    A step of Newton's method is too long where the grains stiffen on the way, and too short where they release a body.
    Its length is then found by the rule of false position (Illinois) for the residual along it.
    """
    at = trial.at[0]
    state = np.empty((1, 13))
    row = np.empty((1, 19))
    after = np.empty(6)
    stiffness = np.empty(1, STIFFNESS)
    tangents = np.empty_like(trial.stiffness)
    at.path = 0.0
    for k, b in enumerate(joints.bodies):
        part = _part(k)
        for i in range(6):
            after[i] = joints.twists[6 * k + i] + h * _dot(
                joints.jacobian[6 * k + i], trial.acceleration
            )
        state[0] = joints.states[b]
        _move(state[0], after, h)
        memory = beds.memory[b : b + 1].copy()
        evaluate(beds, b, memory, stiffness, joints.states[b], state, row)
        stiffness_matrix(stiffness[0], tangents[k])
        trial.wrench[part] = row[0, :6]
        if _size(row[0, :6], 1.0) > 0.0:
            at.path = max(at.path, h * _path(after, beds.bodies[b].reach))
    residual = _residual(joints, constraints, trial)
    along = -_dot(residual, trial.change)
    if along > 0.0:
        at.low = at.share
        at.at_low = along
        at.at_high *= 0.5
    else:
        at.high = at.share
        at.at_high = along
        at.at_low *= 0.5
    if abs(along) > (_LEVEL if at.within else _OFF) * at.slope and at.turn > 0:
        at.within = True
        if at.high < np.inf:
            at.share = (at.low * at.at_high - at.high * at.at_low) / (at.at_high - at.at_low)
        else:
            at.share *= min(at.slope / max(at.slope - along, _ROUNDING * at.slope), _LONGER)
    else:
        late = at.turn >= _WHOLE
        trial.stiffness[:] += (0.5 if late else 1.0) * (tangents - trial.stiffness)
        trial.start[:] = trial.acceleration
        change = _newton(joints, constraints, trial, residual, h)
        at.slope = -_dot(residual, trial.change)
        at.within = False
        at.found = _small(beds, joints, trial, change, _LATE if late else _CLOSE, h)
        if at.found or at.turn == 0 or at.slope < at.least:
            at.least = at.slope
            trial.best[:] = trial.wrench + change
        at.low = 0.0
        at.at_low = at.slope
        at.high = np.inf
        at.at_high = 0.0
        at.share = 1.0
    trial.acceleration[:] = trial.start + at.share * trial.change
    at.turn += 1
    return at.found or at.turn == _MOST


@compiled
def hold_each(beds, first, bodies, near, states, inverse, free, constraints, h, wrenches):
    """Write the wrenches of bodies from `first` on that do not meet, shape [n, 6].

    `bodies`: of `BODY`, with the last wrenches. `near`: from `advance`. `states`: of all bodies. `inverse`: A, shape
    [n, 6, 6]; `free`: acceleration, shape [n, 6]. The coordinates of each are the wrench itself, so that A is both its
    Jacobian and its inertia; a small number holds the directions in which A lets nothing move. `constraints`: none.
    Returns how many times Newton's method did not come to an end, and the longest path [m].
    """
    failed = 0
    longest = 0.0
    for k in range(len(wrenches)):
        wrenches[k] = 0.0
        if near[k]:
            b = first + k
            inertia = inverse[k].copy()
            for i in range(6):
                inertia[i, i] += _ROUNDING * np.abs(inverse[k]).max()
            joints = Joints(
                bodies=np.array([b]),
                states=states,
                twists=states[b, 7:] + h * free[k],
                jacobian=inverse[k].copy(),
                inertia=inertia,
                force=np.zeros(6),
            )
            trial = new_trial(1, 6)
            trial.acceleration[:] = bodies[k].wrench
            while not search(beds, joints, constraints, h, trial):
                pass
            wrenches[k] = trial.best
            if not trial.at[0].found:
                failed += 1
            longest = max(longest, trial.at[0].path)
    return failed, longest

"""Bodies of a MuJoCo model as the grains meet them: their twists, and how wrenches change these over a step.

MuJoCo's acceleration minimises a cost whose Hessian is H = M + Jc^T D Jc: M the inertia of the joints, Jc and D the
Jacobian and the stiffness of the constraints that act. Its integrators go on with the acceleration Mi^-1 M qacc, where
Mi = M + h (damping that they take implicitly). So wrenches w on bodies with the Jacobian J change the bodies' twists
over a step of h by h A w, with A = J Mi^-1 M H^-1 J^T.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.rft.kernel.compilation import compiled, inlined, machine_code

__all__ = ["Mechanism", "import_mujoco"]

Array = NDArray[np.float64]

_QUADRATIC, _CONE = 1, 4  # of mjtConstraintState
_NO_ROWS = np.zeros(0), np.zeros(0, np.int32), np.zeros(0), np.zeros((3, 0), np.int32)
_NO_CONES = np.zeros((2, 0), np.int32), np.zeros((0, 36))
_FASTEST = 1e9  # m/s and rad/s: beyond it squares of squares overflow


def import_mujoco() -> Any:
    """The module, or InputError with the command that installs it."""
    try:
        import mujoco  # type: ignore[import-untyped]
    except ImportError as error:
        raise InputError(f"rft_ros.simulation needs MuJoCo here ({error}); run pip install mujoco") from None
    return mujoco


class Mechanism:
    """The bodies with these ids in one model; arrays of n bodies are stacked as in `rft_ros.simulation.coupling`.

    `states`: shape [n, 13], columns and units of `rft_ros.rft.STATE`. `inverse`: A, shape [6 n, 6 n]; `ahead`: the
    twists at the end of the step without the wrenches, shape [6 n]. `jacobian`: J, shape [6 n, nv]; `moves`: row i is
    Mi^-1 M H^-1 of J's row i, by which a wrench changes the joints' velocities. `mass`, `damping`: M, and what h
    multiplies in Mi, shape [nv, nv]. World axes.
    """

    def __init__(self, model: Any, bodies: list[int]) -> None:
        self._mujoco, self.model, self._bodies = import_mujoco(), model, bodies
        n, nv = len(bodies), int(model.nv)
        self.states, self.inverse, self.ahead = np.zeros((n, 13)), np.zeros((6 * n, 6 * n)), np.zeros(6 * n)
        self.jacobian, self.moves = np.zeros((2, 6 * n, nv))
        self.mass, self.damping = np.zeros((2, nv, nv))
        self._parts = [
            (self.jacobian[6 * k : 6 * k + 3], self.jacobian[6 * k + 3 : 6 * k + 6], body)
            for k, body in enumerate(bodies)
        ]
        self._dofs = np.array([_dofs_of(model, body) for body in bodies])
        kinds, flags = self._mujoco.mjtIntegrator, self._mujoco.mjtDisableBit
        self._euler, self._rk4 = int(kinds.mjINT_EULER), int(kinds.mjINT_RK4)
        self._no_dampers = int(getattr(flags, "mjDSBL_DAMPER", getattr(flags, "mjDSBL_PASSIVE", 0)))
        self._no_implicit_dampers = self._no_dampers | int(flags.mjDSBL_EULERDAMP)
        self.data: Any = None
        self.bind(self._mujoco.MjData(model))
        self._respond: Any = machine_code(_respond, self._arguments(_NO_ROWS, _NO_CONES, 0.1, np.zeros(6 * n)))

    def bind(self, data: Any) -> None:
        """Take the arrays of `data`, which stay where they are. Raises ValueError if it is not of this model."""
        if not isinstance(data, self._mujoco.MjData) or data.model.signature != self.model.signature:
            raise ValueError("data is not of the model of these grains; make it with mujoco.MjData(model)")
        self.data = data
        self._dampers = self._actuators_and_tendons(data)
        self._moving = np.array(self._bodies), self._dofs, data.xpos, data.xquat, data.qvel, data.qacc

    def move(self) -> None:
        """Compute what depends on positions and velocities, without sensors."""
        self._mujoco.mj_fwdPosition(self.model, self.data)
        self._mujoco.mj_fwdVelocity(self.model, self.data)

    def accelerate(self) -> None:
        """Compute the accelerations under the forces that act now."""
        self._mujoco.mj_forwardSkip(self.model, self.data, 2, 1)

    def measure(self, held: Array, h: float) -> bool:
        """Take the motion, and the response over a step of h [s]; `held`: the wrenches that act now, shape [6 n].

        Returns whether all of it is finite, and not too fast to be squared.
        """
        mujoco, model, data = self._mujoco, self.model, self.data
        for linear, angular, body in self._parts:
            mujoco.mj_jacBody(model, data, linear, angular, body)
        _full_inertia(mujoco, model, data, self.mass)
        rows, cones = self._constraints() if data.nefc else (_NO_ROWS, _NO_CONES)
        fine: bool = self._respond(*self._arguments(rows, cones, h, held))
        return fine

    def _arguments(self, rows: Any, cones: Any, h: float, held: Array) -> tuple[Any, ...]:
        inertia = self.mass, self.damping, self.jacobian, self.moves
        return (
            self._moving,
            inertia,
            self._damps(),
            self._dampers,
            rows,
            cones,
            h,
            held,
            self.states,
            self.inverse,
            self.ahead,
        )

    def _constraints(self) -> tuple[Any, Any]:
        """The rows of constraints: Jacobian, state, stiffness, and begin, length and columns of a row if it is sparse.

        And the contacts with elliptic cones: their first rows and dimensions, and their Hessians.
        """
        mujoco, model, data = self._mujoco, self.model, self.data
        sparse = _NO_ROWS[3]
        if mujoco.mj_isSparse(model):
            sparse = np.zeros((3, max(data.nefc, data.nJ)), np.int32)
            sparse[0, : data.nefc], sparse[1, : data.nefc] = data.efc_J_rowadr, data.efc_J_rownnz
            sparse[2, : data.nJ] = data.efc_J_colind
        rows = data.efc_J.ravel(), data.efc_state, data.efc_D, sparse
        if model.opt.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL or not data.ncon:
            return rows, _NO_CONES
        jar = np.zeros(data.nefc)
        mujoco.mj_mulJacVec(model, data, jar, data.qacc)
        mujoco.mj_constraintUpdate(model, data, jar - data.efc_aref, None, 1)  # computes the cones' Hessians
        places = np.vstack([data.contact.efc_address, data.contact.dim]).astype(np.int32)
        # MuJoCo's array has other data of the contact between its rows
        return rows, (places, np.ascontiguousarray(data.contact.H))

    def _damps(self) -> int:
        """Whose damping the integrator takes implicitly: 0 none, 1 that of joints, 2 of actuators, 3 of tendons too."""
        option = self.model.opt
        integrator, off = option.integrator, option.disableflags
        if integrator == self._euler:
            return int(not off & self._no_implicit_dampers)
        return 0 if integrator == self._rk4 else 2 + (not off & self._no_dampers)

    def _actuators_and_tendons(self, data: Any) -> tuple[Any, ...]:
        """What their damping follows from, in arrays that stay where they are."""
        model, mujoco = self.model, self._mujoco
        layout = data if hasattr(data, "ten_J_rownnz") else model
        tendons = data.ten_J.ravel(), layout.ten_J_rownnz, layout.ten_J_rowadr, layout.ten_J_colind.ravel()
        moments = data.actuator_moment.ravel(), data.moment_rownnz, data.moment_rowadr, data.moment_colind.ravel()
        affine = np.array([mujoco.mjtBias.mjBIAS_AFFINE, mujoco.mjtGain.mjGAIN_AFFINE], dtype=np.int64)
        kinds = affine, model.actuator_biastype, model.actuator_gaintype, model.actuator_forcelimited.astype(np.bool_)
        numbers = model.actuator_biasprm, model.actuator_gainprm, model.actuator_forcerange
        moving = model.actuator_actadr, data.ctrl, data.act, data.actuator_force
        return model.dof_damping, (model.tendon_damping, *tendons), (kinds, numbers, moving, moments)


def _dofs_of(model: Any, body: int) -> tuple[int, int]:
    """The degrees of freedom from the first to the last that moves the body: begin and end, as of a slice."""
    moved = model.body_weldid[body]
    first = last = int(model.body_dofadr[moved] + model.body_dofnum[moved]) - 1
    while model.dof_parentid[first] >= 0:
        first = int(model.dof_parentid[first])
    return first, last + 1


def _full_inertia(mujoco: Any, model: Any, data: Any, mass: Array) -> None:
    if hasattr(data, "M"):
        mujoco.mj_fullM(model, data, mass)
    else:  # before MuJoCo 4
        mujoco.mj_fullM(model, mass, data.qM)


@inlined
def _dot(a, b):
    s = 0.0
    for k in range(len(a)):
        s += a[k] * b[k]
    return s


@inlined
def _factor(a, begins):
    """LU in place, without pivots, of a matrix that is symmetric and positive.

    `begins`: takes the column where each row begins. Those before it are zero, as between trees, and stay so.
    """
    for j in range(len(a)):
        begins[j] = j
        for k in range(j - 1, -1, -1):
            if a[j, k] != 0.0:
                begins[j] = k
    for j in range(len(a)):
        for i in range(begins[j], j):
            f = a[j, i] / a[i, i]
            a[j, i] = f
            for k in range(i + 1, len(a)):
                a[j, k] -= f * a[i, k]


@inlined
def _solve(lu, begins, x):
    """Solve in place for x, with the factors and the begins of `_factor`."""
    for i in range(len(lu)):
        for k in range(begins[i], i):
            x[i] -= lu[i, k] * x[k]
    for i in range(len(lu) - 1, -1, -1):
        x[i] /= lu[i, i]
        for k in range(begins[i], i):
            x[k] -= lu[k, i] * x[i]


@inlined
def _multiply(a, begins, x, out):
    """Write a x for a symmetric matrix, with the begins of its rows or of those of a matrix with fewer zeros."""
    for i in range(len(a)):
        out[i] = a[i, i] * x[i]
        for k in range(begins[i], i):
            out[i] += a[i, k] * x[k]
            out[k] += a[i, k] * x[i]


@inlined
def _add_constraints(hessian, rows, cones):
    """Add Jc^T D Jc of the constraints that act, and of contacts that slide within elliptic cones."""
    jacobian, state, stiffness, sparse = rows
    places, cone_hessians = cones
    nv = len(hessian)
    dense = np.zeros((6, nv))
    for i in range(len(state)):
        if state[i] == _QUADRATIC:
            _row(jacobian, sparse, i, dense[0])
            for j in range(nv):
                if dense[0, j] != 0.0:
                    for k in range(nv):
                        hessian[j, k] += stiffness[i] * dense[0, j] * dense[0, k]
    for c in range(places.shape[1]):
        first, size = places[0, c], places[1, c]
        if first >= 0 and state[first] == _CONE:
            for a in range(size):
                _row(jacobian, sparse, first + a, dense[a])
            for a in range(size):
                for b in range(size):
                    weight = cone_hessians[c, a * size + b]
                    for j in range(nv):
                        if dense[a, j] != 0.0:
                            for k in range(nv):
                                hessian[j, k] += weight * dense[a, j] * dense[b, k]


@inlined
def _row(jacobian, sparse, i, dense):
    nv = len(dense)
    if sparse.shape[1] == 0:
        dense[:] = jacobian[i * nv : (i + 1) * nv]
    else:
        dense[:] = 0.0
        for k in range(sparse[0, i], sparse[0, i] + sparse[1, i]):
            dense[sparse[2, k]] = jacobian[k]


@inlined
def _add_row(damping, weight, sparse, i):
    """Add the damping of a tendon or actuator whose Jacobian is row i."""
    values, counts, begins, columns = sparse
    for a in range(begins[i], begins[i] + counts[i]):
        for b in range(begins[i], begins[i] + counts[i]):
            damping[columns[a], columns[b]] += weight * values[a] * values[b]


@inlined
def _set_damping(damping, which, dampers):
    """Write the damping that the integrator takes implicitly; returns whether there is any. `which`: of `_damps`."""
    of_joints, tendons, (kinds, numbers, moving, moments) = dampers
    of_tendons, jacobians = tendons[0], tendons[1:]
    affine, bias_kinds, gain_kinds, limited = kinds
    biases, gains, ranges = numbers
    states, controls, activations, forces = moving
    damping[:] = 0.0
    found = False
    if which % 2 == 1:
        for i in range(len(of_joints)):
            damping[i, i] = of_joints[i]
            found |= of_joints[i] != 0.0
    if which == 3:
        for i in range(len(of_tendons)):
            if of_tendons[i] != 0.0:
                _add_row(damping, of_tendons[i], jacobians, i)
                found = True
    if which >= 2:
        for i in range(len(bias_kinds)):
            fall = -biases[i, 2] if bias_kinds[i] == affine[0] else 0.0
            if gain_kinds[i] == affine[1] and gains[i, 2] != 0.0:
                fall -= gains[i, 2] * (controls[i] if states[i] < 0 else activations[states[i]])
            at_limit = limited[i] and (forces[i] <= ranges[i, 0] or forces[i] >= ranges[i, 1])
            if fall != 0.0 and not at_limit:
                _add_row(damping, fall, moments, i)
                found = True
    return found


@compiled
def _respond(moving, inertia, which, dampers, rows, cones, h, held, states, inverse, ahead):
    """Write `Mechanism.states`, `inverse` and `ahead`; returns whether all of it is finite and not too fast."""
    ids, dofs, positions, quaternions, velocity, acceleration = moving
    mass, damping, jacobian, moves = inertia
    nv, size = len(mass), len(jacobian)
    fine = True
    for b in range(len(ids)):
        first, end = dofs[b]
        states[b, :3] = positions[ids[b]]
        w, x, y, z = quaternions[ids[b]]
        states[b, 3], states[b, 4], states[b, 5], states[b, 6] = x, y, z, w
        for i in range(6):
            states[b, 7 + i] = _dot(jacobian[6 * b + i, first:end], velocity[first:end])
    hessian, begins, damped_begins = mass.copy(), np.empty(nv, np.int64), np.empty(nv, np.int64)
    _add_constraints(hessian, rows, cones)
    _factor(hessian, begins)
    damped = _set_damping(damping, which, dampers)
    taken = acceleration.copy()
    implicit = mass
    if damped:
        implicit = mass + h * damping
        _factor(implicit, damped_begins)
        _multiply(mass, begins, acceleration, taken)
        _solve(implicit, damped_begins, taken)
    x = np.empty(nv)
    for j in range(size):
        moves[j] = jacobian[j]
        _solve(hessian, begins, moves[j])
        if damped:
            _multiply(mass, begins, moves[j], x)
            _solve(implicit, damped_begins, x)
            moves[j] = x
        for i in range(size):
            first, end = dofs[i // 6]
            inverse[i, j] = _dot(jacobian[i, first:end], moves[j, first:end])
            fine &= np.isfinite(inverse[i, j])
    for i in range(size):
        first, end = dofs[i // 6]
        twist = states[i // 6, 7 + i % 6]
        way = _dot(jacobian[i, first:end], taken[first:end])
        ahead[i] = twist + h * (way - _dot(inverse[i], held))
        fine &= abs(twist) + abs(ahead[i]) < _FASTEST
    return fine and np.isfinite(states.sum())

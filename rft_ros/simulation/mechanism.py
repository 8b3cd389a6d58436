"""Bodies of a MuJoCo model as the grains meet them: their twists, and how wrenches change these over a step.

MuJoCo's acceleration minimises a cost whose Hessian is H = M + Jc^T D Jc: M the inertia of the joints, Jc and D the
Jacobian and the stiffness of the constraints that act. Its integrators go on with the acceleration Mi^-1 M qacc, where
Mi = M + h (damping that they take implicitly). So wrenches w on bodies with the Jacobian J change the bodies' twists
over a step of h by h A w, with A = J Mi^-1 M H^-1 J^T.
"""

from math import pi, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.rft.kernel.compilation import compiled, inlined, machine_code
from rft_ros.simulation.algebra import dot, multiply, solve

__all__ = ["Mechanism", "import_mujoco"]

Array = NDArray[np.float64]

_QUADRATIC, _CONE = 1, 4  # of mjtConstraintState
_FASTEST = 1e9  # m/s and rad/s: beyond it squares of squares overflow
_TINY = 1e-290  # avoids 0 / 0

_IN_HESSIAN, _STIFFNESS, _DAMPING = range(3)
"""What is summed over forces or constraints. The last two are also the places in a bias or gain of MuJoCo's actuators
of what multiplies the length and the velocity."""


class _Constraints(NamedTuple):
    """The rows of constraints: Jacobian, state, stiffness D, and MuJoCo's `efc_KBIP`; and contacts with elliptic cones.

    `cones`: their first rows and dimensions, shape [2, n]; `cone_hessians`: shape [n, 36].
    """

    jacobian: Array
    state: NDArray[np.int32]
    stiffness: Array
    reference: Array
    cones: NDArray[np.int32]
    cone_hessians: Array


class _Forces(NamedTuple):
    """What the stiffness and the damping of joints, tendons and actuators follow from: views, and sparse Jacobians."""

    joint_stiffness: Array
    joint_of_dof: NDArray[np.int32]
    dof_damping: Array
    tendon_stiffness: Array
    tendon_damping: Array
    tendons: tuple[Any, ...]
    affine: NDArray[np.int64]
    bias_kinds: NDArray[np.int32]
    gain_kinds: NDArray[np.int32]
    biases: Array
    gains: Array
    limited: NDArray[np.bool_]
    ranges: Array
    activation: NDArray[np.int32]
    controls: Array
    activations: Array
    acting: Array
    moments: tuple[Any, ...]
    joint_limited: NDArray[np.bool_]
    joint_ranges: Array
    on_dofs: Array


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
    twists at the end of the step without the wrenches, shape [6 n]. `jacobian`: J, shape [6 n, nv]; `moves`: Mi^-1 M
    H^-1 J^T, by which wrenches change the joints' velocities, shape [nv, 6 n]. World axes.
    """

    def __init__(self, model: Any, bodies: list[int]) -> None:
        self._mujoco, self.model, self._bodies = import_mujoco(), model, bodies
        n, nv = len(bodies), int(model.nv)
        self.states, self.inverse, self.ahead = np.zeros((n, 13)), np.zeros((6 * n, 6 * n)), np.zeros(6 * n)
        self.jacobian, self.moves, self._mass = np.zeros((6 * n, nv)), np.zeros((nv, 6 * n)), np.zeros((nv, nv))
        self._parts = [
            (self.jacobian[6 * k : 6 * k + 3], self.jacobian[6 * k + 3 : 6 * k + 6], body)
            for k, body in enumerate(bodies)
        ]
        self._none = _Constraints(
            np.zeros((0, nv)), np.zeros(0, np.int32), np.zeros(0), np.zeros((0, 4)), np.zeros((2, 0), np.int32),
            np.zeros((0, 36)),
        )  # fmt: skip
        self._constraints = self._none
        kinds, flags = self._mujoco.mjtIntegrator, self._mujoco.mjtDisableBit
        self._euler, self._rk4 = int(kinds.mjINT_EULER), int(kinds.mjINT_RK4)
        self._no_dampers = int(getattr(flags, "mjDSBL_DAMPER", getattr(flags, "mjDSBL_PASSIVE", 0)))
        self._no_implicit_dampers = self._no_dampers | int(flags.mjDSBL_EULERDAMP)
        self.data: Any = None
        self.bind(self._mujoco.MjData(model))
        self._respond: Any = machine_code(_respond, self._arguments(np.zeros(6 * n), 0.1))
        self._resistance: Any = machine_code(_resistance, (self._inertia, self._forces, self._none, 0, np.zeros(6)))

    def bind(self, data: Any) -> None:
        """Take the arrays of `data`, which stay where they are. Raises ValueError if it is not of this model."""
        if not isinstance(data, self._mujoco.MjData) or _sizes(data.model) != _sizes(self.model):
            raise ValueError("data is not of the model of these grains; make it with mujoco.MjData(model)")
        self.data, self._forces = data, _forces(self._mujoco, self.model, data)
        self._moving = np.array(self._bodies), data.xpos, data.xquat, data.qvel, data.qacc
        self._inertia = self._mass, self.jacobian, self.moves

    def move(self) -> None:
        """Compute what depends on positions and velocities, without sensors."""
        self._mujoco.mj_fwdPosition(self.model, self.data)
        self._mujoco.mj_fwdVelocity(self.model, self.data)
        for linear, angular, body in self._parts:
            self._mujoco.mj_jacBody(self.model, self.data, linear, angular, body)
        _full_inertia(self._mujoco, self.model, self.data, self._mass)

    def accelerate(self) -> None:
        """Compute the accelerations under the forces that act now."""
        self._mujoco.mj_forwardSkip(self.model, self.data, 2, 1)

    def measure(self, held: Array, h: float) -> bool:
        """Take the motion, and the response over a step of h [s]; `held`: the wrenches that act now, shape [6 n].

        Returns whether all of it is finite, and not too fast to be squared.
        """
        self._constraints = self._active() if self.data.nefc else self._none
        fine: bool = self._respond(*self._arguments(held, h))
        return fine

    def _arguments(self, held: Array, h: float) -> tuple[Any, ...]:
        given = self._moving, self._inertia, self._forces, self._damps(), self._constraints
        return *given, held, h, self.states, self.inverse, self.ahead

    def _active(self) -> _Constraints:
        """The constraints at the accelerations of now."""
        mujoco, model, data = self._mujoco, self.model, self.data
        rows = data.efc_J.reshape(-1, model.nv) if not mujoco.mj_isSparse(model) else np.zeros((data.nefc, model.nv))
        if mujoco.mj_isSparse(model):
            mujoco.mju_sparse2dense(rows, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
        cones, hessians = self._none.cones, self._none.cone_hessians
        if model.opt.cone != mujoco.mjtCone.mjCONE_PYRAMIDAL and data.ncon:
            jar = np.zeros(data.nefc)
            mujoco.mj_mulJacVec(model, data, jar, data.qacc)
            mujoco.mj_constraintUpdate(model, data, jar - data.efc_aref, None, 1)  # computes the cones' Hessians
            cones = np.vstack([data.contact.efc_address, data.contact.dim]).astype(np.int32)
            # MuJoCo's array has other data of the contact between its rows
            hessians = np.ascontiguousarray(data.contact.H)
        return _Constraints(rows, data.efc_state, data.efc_D, data.efc_KBIP, cones, hessians)

    @property
    def holds_over_stages(self) -> bool:
        """Whether the integrator is RK4, which holds the wrenches over four stages."""
        return bool(self.model.opt.integrator == self._rk4)

    def _damps(self) -> int:
        """Whose damping the integrator takes implicitly: 0 none, 1 that of joints, 2 of actuators, 3 of tendons too."""
        option = self.model.opt
        integrator, off = option.integrator, option.disableflags
        if integrator == self._euler:
            return int(not off & self._no_implicit_dampers)
        return 0 if integrator == self._rk4 else 2 + (not off & self._no_dampers)

    def share_held(self, b: int, push: Array, stiffness: Array) -> float:
        """The share of the grains' elastic energy that other forces take up as they push body b back, shape [6].

        A spring takes up K / k of it, and a damper (pi / 2) C / sqrt(k m), where k is the `stiffness` of the grains,
        shape [6, 6], m the mass that they push, and K and C are those of all other forces against this motion.
        """
        own = slice(6 * b, 6 * b + 6)
        way = self.jacobian[own] @ self.moves[:, own] @ push
        mobility, elastic = float(push @ way), float(way @ stiffness @ way)
        if min(mobility, elastic) <= _TINY:
            return 0.0
        of_springs, of_dampers = self._resistance(self._inertia, self._forces, self._constraints, b, push)
        return float(of_springs / elastic + 0.5 * pi * of_dampers / sqrt(mobility * elastic))

    def loaded(self, b: int, push: Array, acting: Array, change: Array) -> tuple[float, float]:
        """The user's and the motors' forces along the push on body b, and the decrease of its load, as shares of it.

        Servos count as motors if there is a motor among the actuators. `acting`: the wrenches of the grains that act
        now, shape [6 n]. `change`: of the body's acceleration without the grains since the last step, shape [6].
        """
        data, own = self.data, slice(6 * b, 6 * b + 6)
        along = self.moves[:, own] @ push
        others = data.qfrc_smooth - data.qfrc_passive + data.qfrc_bias - self.jacobian.T @ acting
        if self.model.actuator_biasprm[:, _STIFFNESS].all():
            others = others - data.qfrc_actuator  # of servos, whose stiffness `share_held` knows
        square = max(float(push @ self.jacobian[own] @ along), _TINY)
        return abs(float(others @ along)) / square, float(push @ change) / square


def _sizes(model: Any) -> tuple[int, ...]:
    # a model that was pickled has no signature
    return model.signature, model.nq, model.nv, model.nu, model.nbody, model.ntendon


def _full_inertia(mujoco: Any, model: Any, data: Any, mass: Array) -> None:
    if hasattr(data, "M"):
        mujoco.mj_fullM(model, data, mass)
    else:  # before MuJoCo 4
        mujoco.mj_fullM(model, mass, data.qM)


def _forces(mujoco: Any, model: Any, data: Any) -> _Forces:
    layout = data if hasattr(data, "ten_J_rownnz") else model
    return _Forces(
        joint_stiffness=model.jnt_stiffness,
        joint_of_dof=model.dof_jntid,
        dof_damping=model.dof_damping,
        tendon_stiffness=model.tendon_stiffness,
        tendon_damping=model.tendon_damping,
        tendons=(data.ten_J.ravel(), layout.ten_J_rownnz, layout.ten_J_rowadr, layout.ten_J_colind.ravel()),
        affine=np.array([mujoco.mjtBias.mjBIAS_AFFINE, mujoco.mjtGain.mjGAIN_AFFINE], dtype=np.int64),
        bias_kinds=model.actuator_biastype,
        gain_kinds=model.actuator_gaintype,
        biases=model.actuator_biasprm,
        gains=model.actuator_gainprm,
        limited=model.actuator_forcelimited.astype(np.bool_),
        ranges=model.actuator_forcerange,
        activation=model.actuator_actadr,
        controls=data.ctrl,
        activations=data.act,
        acting=data.actuator_force,
        moments=(data.actuator_moment.ravel(), data.moment_rownnz, data.moment_rowadr, data.moment_colind.ravel()),
        joint_limited=model.jnt_actfrclimited.astype(np.bool_),
        joint_ranges=model.jnt_actfrcrange,
        on_dofs=data.qfrc_actuator,
    )


@inlined
def _add_constraints(matrix, what, constraints):
    """Add Jc^T D Jc of the constraints that act, and of contacts that slide within elliptic cones; or their stiffness.

    `what`: of `_IN_HESSIAN`, `_STIFFNESS` and `_DAMPING`.
    """
    jacobian, state, stiffness, reference, cones, cone_hessians = constraints
    for i in range(len(state)):
        if state[i] == _QUADRATIC:
            weight = stiffness[i] * (1.0 if what == _IN_HESSIAN else reference[i, what - 1])
            _add_product(matrix, weight, jacobian[i], jacobian[i])
    for c in range(cones.shape[1]):
        first, size = cones[0, c], cones[1, c]
        if first >= 0 and state[first] == _CONE:
            for a in range(size):
                weight = 1.0 if what == _IN_HESSIAN else reference[first + a, what - 1]
                for b in range(size):
                    of_both = weight * cone_hessians[c, a * size + b]
                    _add_product(matrix, of_both, jacobian[first + a], jacobian[first + b])


@inlined
def _add_product(matrix, weight, a, b):
    for j in range(len(a)):
        if a[j] != 0.0:
            for k in range(len(b)):
                matrix[j, k] += weight * a[j] * b[k]


@inlined
def _add_row(matrix, weight, sparse, i):
    """Add what a tendon or actuator adds whose Jacobian is row i; returns whether that is anything."""
    values, counts, begins, columns = sparse
    if weight != 0.0:
        for a in range(begins[i], begins[i] + counts[i]):
            for b in range(begins[i], begins[i] + counts[i]):
                matrix[columns[a], columns[b]] += weight * values[a] * values[b]
    return weight != 0.0


@inlined
def _add_forces(matrix, what, forces, which):
    """Add the stiffness or the damping of joints, tendons and actuators to zeros; returns whether there is any.

    Actuators at their limit have none, nor those on a joint whose sum of them is at its limit. `what`: `_STIFFNESS` or
    `_DAMPING`. `which`: of `Mechanism._damps`.
    """
    found = False
    if which >= 2:
        for i in range(len(forces.bias_kinds)):
            fall = -forces.biases[i, what] if forces.bias_kinds[i] == forces.affine[0] else 0.0
            if forces.gain_kinds[i] == forces.affine[1] and forces.gains[i, what] != 0.0:
                place = forces.activation[i]
                fall -= forces.gains[i, what] * (forces.controls[i] if place < 0 else forces.activations[place])
            if not (forces.limited[i] and _at_limit(forces.acting[i], forces.ranges[i])):
                found |= _add_row(matrix, fall, forces.moments, i)
        for i in range(len(matrix)):
            joint = forces.joint_of_dof[i]
            if found and forces.joint_limited[joint] and _at_limit(forces.on_dofs[i], forces.joint_ranges[joint]):
                matrix[i] = 0.0
    if which % 2 == 1:
        for i in range(len(matrix)):
            of_joint = forces.dof_damping[i] if what == _DAMPING else forces.joint_stiffness[forces.joint_of_dof[i]]
            matrix[i, i] += of_joint
            found |= of_joint != 0.0
    if which == 3:
        for i in range(len(forces.tendon_damping)):
            of_tendon = forces.tendon_damping[i] if what == _DAMPING else forces.tendon_stiffness[i]
            found |= _add_row(matrix, of_tendon, forces.tendons, i)
    return found


@inlined
def _at_limit(force, limits):
    return force <= limits[0] or force >= limits[1]


@compiled
def _respond(moving, inertia, forces, which, constraints, held, h, states, inverse, ahead):
    """Write `Mechanism.states`, `inverse` and `ahead`; returns whether all of it is finite and not too fast.

    `which`: of `Mechanism._damps`.
    """
    ids, positions, quaternions, velocity, acceleration = moving
    mass, jacobian, moves = inertia
    for b in range(len(ids)):
        states[b, :3] = positions[ids[b]]
        w, x, y, z = quaternions[ids[b]]
        states[b, 3], states[b, 4], states[b, 5], states[b, 6] = x, y, z, w
        for i in range(6):
            states[b, 7 + i] = dot(jacobian[6 * b + i], velocity)
    matrix, taken = mass.copy(), acceleration.copy().reshape(len(mass), 1)
    moves[:] = jacobian.T
    _add_constraints(matrix, _IN_HESSIAN, constraints)
    solve(matrix, moves)
    matrix[:] = 0.0
    if _add_forces(matrix, _DAMPING, forces, which):
        for i in range(len(mass)):
            for k in range(len(mass)):
                matrix[i, k] = mass[i, k] + h * matrix[i, k]
        both, rates = np.empty((2, len(mass), len(jacobian) + 1))
        both[:, :-1], both[:, -1:] = moves, taken
        multiply(mass, both, rates)
        solve(matrix, rates)
        moves[:], taken[:] = rates[:, :-1], rates[:, -1:]
    multiply(jacobian, moves, inverse)
    total = states.sum() + inverse.sum()
    for i in range(len(ahead)):
        twist = states[i // 6, 7 + i % 6]
        ahead[i] = twist + h * (dot(jacobian[i], taken[:, 0]) - dot(inverse[i], held))
        if not abs(twist) + abs(ahead[i]) < _FASTEST:
            return False
    return np.isfinite(total)


@compiled
def _resistance(inertia, forces, constraints, b, push):
    """Stiffness and damping of all other forces against the joints' accelerations by a push on body b, shape [6]."""
    _, _, moves = inertia
    along, found = np.empty(len(moves)), np.zeros(3)
    for j in range(len(moves)):
        along[j] = dot(moves[j, 6 * b : 6 * b + 6], push)
    for what in (_STIFFNESS, _DAMPING):
        matrix = np.zeros((len(moves), len(moves)))
        _add_forces(matrix, what, forces, 3)
        _add_constraints(matrix, what, constraints)
        for j in range(len(moves)):
            found[what] += along[j] * dot(matrix[j], along)
    return found[_STIFFNESS], found[_DAMPING]

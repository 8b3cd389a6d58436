"""Bodies of a MuJoCo model in the coordinates of its joints, for the implicit step of `rft_ros.simulation.step`.

MuJoCo finds the acceleration a at which M a equals the forces of all but constraints, and those of the constraints at
a; M is the inertia of the joints. Its integrators go on with x = M_i^-1 M a, where M_i = M + h (damping that they take
implicitly). So a = P x with P = M^-1 M_i.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.rft.kernel.compilation import compiled, machine_code
from rft_ros.simulation.step import Constraints, Joints, no_constraints

Array = NDArray[np.float64]

MAX_SPEED_M_S = 1e9
"""Also in rad/s: beyond it squares of squares overflow."""


def import_mujoco() -> Any:
    """The module, or InputError with the command that installs it."""
    try:
        import mujoco  # type: ignore[import-untyped]
    except ImportError as error:
        raise InputError(
            f"rft_ros.simulation needs MuJoCo here ({error}); run pip install mujoco"
        ) from None
    return mujoco


class Mechanism:
    """The bodies in one model with these `ids`. `states`: shape [n, 13], columns and units of `rft_ros.rft.STATE`."""

    def __init__(self, model: Any, bodies: list[int]) -> None:
        mujoco = import_mujoco()
        nv = int(model.nv)
        self._mujoco = mujoco
        self.model = model
        self.ids = np.array(bodies)
        self.states = np.zeros((len(bodies), 13))
        self._jacobian = np.zeros((len(bodies), 6, nv))
        self._mass = np.zeros((nv, nv))
        self.unconstrained = no_constraints(nv)
        self._response = self.unconstrained.response  # P
        self._integrators = mujoco.mjtIntegrator
        flags = mujoco.mjtDisableBit
        # by version
        dampers = getattr(flags, "mjDSBL_DAMPER", getattr(flags, "mjDSBL_PASSIVE", 0))
        self._undamped = int(dampers | flags.mjDSBL_EULERDAMP)
        self.data = mujoco.MjData(model)
        self._scratch = mujoco.MjData(model)
        mujoco.mj_forward(model, self.data)
        self._measure: Any = machine_code(_measure, (0.1, *self._motion()))

    def take(self, data: Any) -> None:
        """Go on with this data. Raises ValueError if it is not of this model."""
        if not isinstance(data, self._mujoco.MjData) or _sizes(data.model) != _sizes(self.model):
            raise ValueError(
                "data is not of the model of these grains; make it with mujoco.MjData(model)"
            )
        self.data = data

    def move(self) -> bool:
        """Compute what depends on positions and velocities, and the forces of all but the constraints.

        Returns whether all of it is finite, and not too fast to be squared.
        """
        mujoco = self._mujoco
        model = self.model
        data = self.data
        # not mj_forward: the user's callback for controls is called once a step, by mj_step
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        return bool(self._measure(model.opt.timestep, *self._motion()))

    def _motion(self) -> tuple[Any, ...]:
        """What `_measure` takes."""
        data = self.data
        roots = self.model.body_rootid
        poses = data.xpos, data.xquat, data.subtree_com
        return data.qvel, data.qacc_smooth, self.ids, roots, *poses, data.cvel, self.states

    def joints(self, bodies: NDArray[np.int64], h: float) -> Joints:
        """The bodies with these places among all, at a step of h [s]; in arrays that the next call overwrites."""
        mujoco = self._mujoco
        model = self.model
        data = self.data
        jacobian = self._jacobian[: len(bodies)]
        for k, place in enumerate(bodies):
            mujoco.mj_jacBody(model, data, jacobian[k, :3], jacobian[k, 3:], self.ids[place])
        if hasattr(data, "qM"):  # before MuJoCo 4
            mujoco.mj_fullM(model, self._mass, data.qM)
        else:
            mujoco.mj_fullM(model, data, self._mass)
        inertia = self._mass + h * self._damping()
        if data.nefc:
            self._response = np.asarray(np.linalg.solve(self._mass, inertia), dtype=np.float64)
        return Joints(
            bodies=bodies,
            twists=np.ascontiguousarray(self.states[bodies, 7:]),
            jacobian=jacobian,
            inertia=inertia,
            force=data.qfrc_smooth,
        )

    def _damping(self) -> Array | float:
        """The damping that the integrator takes implicitly, C, shape [nv, nv]."""
        model = self.model
        if self.holds_over_stages:
            return 0.0
        if model.opt.integrator == self._integrators.mjINT_EULER:
            return 0.0 if model.opt.disableflags & self._undamped else np.diag(model.dof_damping)
        # MuJoCo computes it on the way through a step
        self._mujoco.mj_copyData(self._scratch, model, self.data)
        self._mujoco.mj_implicit(model, self._scratch)
        layout = model if hasattr(model, "D_rownnz") else self._scratch
        return -self._dense(
            self._scratch.qDeriv, layout.D_rownnz, layout.D_rowadr, layout.D_colind
        )

    def constraints(self, acceleration: Array) -> Constraints:
        """The constraints at an acceleration x of the joints."""
        mujoco = self._mujoco
        model = self.model
        data = self.data
        if mujoco.mj_isSparse(model):
            rows = self._dense(data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
        else:
            rows = data.efc_J.reshape(-1, model.nv)
        mujoco.mj_constraintUpdate(
            model, data, rows @ (self._response @ acceleration) - data.efc_aref, None, 1
        )
        cones = self.unconstrained.cones
        hessians = self.unconstrained.cone_hessians
        if model.opt.cone != mujoco.mjtCone.mjCONE_PYRAMIDAL and data.ncon:
            cones = np.vstack([data.contact.efc_address, data.contact.dim]).astype(np.int32)
            # MuJoCo's array has other data of the contact between its rows
            hessians = np.ascontiguousarray(data.contact.H)
        return Constraints(
            jacobian=rows,
            state=data.efc_state,
            stiffness=data.efc_D,
            cones=cones,
            cone_hessians=hessians,
            force=data.qfrc_constraint,
            response=self._response,
        )

    @property
    def holds_over_stages(self) -> bool:
        """Whether the integrator is RK4, which holds the wrenches over four stages."""
        return bool(self.model.opt.integrator == self._integrators.mjINT_RK4)

    def _dense(self, values: Array, counts: Array, begins: Array, columns: Array) -> Array:
        """The rows of a sparse matrix of MuJoCo."""
        rows = np.zeros((len(counts), self.model.nv))
        if rows.size:
            self._mujoco.mju_sparse2dense(rows, values.ravel(), counts, begins, columns.ravel())
        return rows


def _sizes(model: Any) -> tuple[int, ...]:
    # a model that was pickled has no signature
    return model.signature, model.nq, model.nv, model.nu, model.nbody, model.ntendon


@compiled
def _measure(
    h, speeds, accelerations, ids, roots, positions, quaternions, centers, twists, states
):
    """Write `Mechanism.states`; returns whether all of it, and the joints' velocities, are finite and not too fast.

    `twists`: angular and linear, at the centre of mass of the body's whole tree.
    """
    for i in range(len(speeds)):
        if not abs(speeds[i]) + h * abs(accelerations[i]) < MAX_SPEED_M_S:
            return False
    for b, body in enumerate(ids):
        x, y, z = positions[body] - centers[roots[body]]
        wx, wy, wz, vx, vy, vz = twists[body]
        qw, qx, qy, qz = quaternions[body]
        px, py, pz = positions[body]
        quaternion = qx, qy, qz, qw
        velocity = vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x
        state = (px, py, pz, *quaternion, *velocity, wx, wy, wz)
        for k in range(13):
            states[b, k] = state[k]
            if not abs(state[k]) < MAX_SPEED_M_S:
                return False
    return True

"""A six-axis arm under joint impedance in MuJoCo, for `mujoco_press.py` and the study: six_axis_arm.xml."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rft_ros.errors import InputError
from rft_ros.files import read_file
from rft_ros.rft.arguments import number
from rft_ros.simulation.mechanism import import_mujoco
from rft_ros.tool import locate_mesh

__all__ = ["SixAxisArm"]

Array = NDArray[np.float64]

_START = (0.0, 0.4, 0.5, 0.0, -0.9, 0.0)  # near the bed, elbow up, tool down
_ROUNDS = 100
_CLOSE = 1e-9  # m and rad


class SixAxisArm:
    """The arm with a tool; `model` and `data` are MuJoCo's, the tool frame is the body ``tool``.

    `mesh`: a shipped mesh or a file in millimetres, in the tool frame, z up at the arm's rest. `stiffness`: factor of
    all joints' stiffnesses; 1 is about 10 kN/m at the tool. `timestep` [s].
    Raises InputError without MuJoCo, and ValueError that names what cannot be used.
    """

    def __init__(
        self, mesh: str = "plate", *, stiffness: float = 1.0, timestep: float = 0.001
    ) -> None:
        mujoco = import_mujoco()
        factor = number("stiffness", stiffness, positive=True)
        text = Path(__file__).with_suffix(".xml").read_text(encoding="utf-8")
        spec = mujoco.MjSpec.from_string(
            text, assets={"tool.stl": read_file(locate_mesh(mesh), "mesh file")}
        )
        for actuator in spec.actuators:
            actuator.gainprm[0] *= factor
            actuator.biasprm[1] *= factor
        self.model: Any = spec.compile()
        self.model.opt.timestep = number("timestep", timestep, positive=True)
        self.data: Any = mujoco.MjData(self.model)
        self._scratch = mujoco.MjData(self.model)
        self.body = int(self.model.body("tool").id)
        self._joints = np.array(_START)

    def joints(self, position: ArrayLike, quaternion: ArrayLike = (0.0, 0.0, 0.0, 1.0)) -> Array:
        """Joint angles [rad], shape [6], that bring the tool frame to a pose [m], xyzw, near those of the last call.

        Raises InputError for a pose that the arm does not reach.
        """
        mujoco = import_mujoco()
        model = self.model
        data = self._scratch
        goal = np.asarray(position, dtype=np.float64)
        turn = np.roll(np.asarray(quaternion, dtype=np.float64), 1)
        jacobian = np.zeros((6, 6))
        error = np.zeros(6)
        data.qpos[:] = self._joints
        for _ in range(_ROUNDS):
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            error[:3] = goal - data.xpos[self.body]
            mujoco.mju_subQuat(error[3:], turn, data.xquat[self.body])
            error[3:] = data.xmat[self.body].reshape(3, 3) @ error[3:]
            if np.abs(error).max() < _CLOSE:
                self._joints = data.qpos.copy()
                return self._joints.copy()
            mujoco.mj_jacBody(model, data, jacobian[:3], jacobian[3:], self.body)
            step = np.linalg.solve(jacobian.T @ jacobian + 1e-8 * np.eye(6), jacobian.T @ error)
            data.qpos += step * min(1.0, 0.5 / max(float(np.abs(step).max()), 1e-12))
        raise InputError(f"the arm does not reach the position {goal.tolist()} m")

    def start(self, position: ArrayLike, quaternion: ArrayLike = (0.0, 0.0, 0.0, 1.0)) -> None:
        """Place the arm at rest with its tool frame at a pose, and hold it there."""
        mujoco = import_mujoco()
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = self.data.ctrl[:] = self.joints(position, quaternion)
        mujoco.mj_forward(self.model, self.data)

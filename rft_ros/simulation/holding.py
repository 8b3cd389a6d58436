"""What holds a body of a MuJoCo model in place beside the grains: servos, springs, dampers, constraints.

The grains push a body back when its load decreases. A body that nothing holds would be thrown by their elastic energy.
A spring takes up a part of this energy, and so does a damper: K / k and (pi / 2) C / sqrt(k m) of it, where k is the
stiffness of the grains, m the mass that they push, and K and C are the stiffness and the damping of all other forces
against this motion. MuJoCo's own forward pass gives K and C, at places and velocities a little further along the push.
"""

from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from rft_ros.simulation.mechanism import Mechanism, import_mujoco

__all__ = ["Holding"]

Array = NDArray[np.float64]

_FURTHER, _FASTER = 1e-5, 1e-3
"""Path [m] and speed [m/s] of the body by which the places and the velocities are changed."""

_TINY = 1e-290  # avoids 0 / 0


class Holding:
    """What holds the bodies of a mechanism, at its last measured step."""

    def __init__(self, mechanism: Mechanism) -> None:
        self._mujoco, self._mechanism = import_mujoco(), mechanism
        self._whole = self._mujoco.mjtState.mjSTATE_INTEGRATION
        self._probe = self._mujoco.MjData(mechanism.model)
        self._state = np.zeros(self._mujoco.mj_stateSize(mechanism.model, self._whole))

    def share(self, b: int, push: Array, stiffness: Array, *, reach: float, h: float) -> float:
        """The share of the grains' elastic energy that other forces take up when a body is pushed back.

        `push`: the wrench of the grains on body b, shape [6]. `stiffness`: theirs, shape [6, 6]. `reach`: of the body
        [m]. `h`: the step [s].
        """
        mechanism, probe = self._mechanism, self._probe
        acceleration = self._along(b, push)
        way = self._jacobian(b) @ acceleration
        mobility, elastic = float(push @ way), float(way @ stiffness @ way)
        speed = float(np.linalg.norm(way[:3]) + reach * np.linalg.norm(way[3:]))
        if min(mobility, elastic, speed) <= _TINY:
            return 0.0
        # by how much a change of the joints' accelerations changes that of the body along the push, after the
        # integrator has damped it
        implicit = mechanism.mass + h * mechanism.damping
        measured = mechanism.mass @ np.linalg.solve(implicit.T, self._jacobian(b).T @ push)
        self._mujoco.mj_getState(mechanism.model, mechanism.data, self._state, self._whole)
        accelerations = []
        for further, faster in ((0.0, 0.0), (_FURTHER / speed, 0.0), (0.0, _FASTER / speed)):
            self._mujoco.mj_setState(mechanism.model, probe, self._state, self._whole)
            self._mujoco.mj_integratePos(mechanism.model, probe.qpos, acceleration, further)
            probe.qvel += faster * acceleration
            self._mujoco.mj_forwardSkip(mechanism.model, probe, 0, 1)
            accelerations.append(float(measured @ probe.qacc))
        here, there, moving = accelerations
        of_springs = (here - there) * speed / _FURTHER / elastic
        of_dampers = 0.5 * pi * (here - moving) * speed / _FASTER / sqrt(mobility * elastic)
        return of_springs + of_dampers

    def load(self, b: int, push: Array, acting: Array, coupled: np.void) -> tuple[float, float]:
        """Size of the actuators' and the user's forces along the push on body b, and their decrease in this step.

        Both as shares of the push. `acting`: the wrenches of the grains that act now, shape [6 n]. `coupled`: the
        body's state, of `COUPLED`.
        """
        data, acceleration = self._mechanism.data, self._along(b, push)
        others = data.qfrc_smooth - data.qfrc_passive + data.qfrc_bias - self._mechanism.jacobian.T @ acting
        square = max(float(push @ self._jacobian(b) @ acceleration), _TINY)
        decrease = float(push @ (coupled["free"] - coupled["last_free"]))
        return abs(float(others @ acceleration)) / square, decrease / square

    def _jacobian(self, b: int) -> Array:
        rows: Array = self._mechanism.jacobian[6 * b : 6 * b + 6]
        return rows

    def _along(self, b: int, push: Array) -> Array:
        """The joints' accelerations by the push, shape [nv]."""
        rows: Array = self._mechanism.moves[6 * b : 6 * b + 6]
        return push @ rows

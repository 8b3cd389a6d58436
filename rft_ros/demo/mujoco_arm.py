"""A six-axis MuJoCo arm that feels what the node predicts: the node in the loop, with config/mujoco_arm.yaml.

The arm waits for the answer to each pose, as a simulator can, and feels it for a tick. It takes the wrench along with
~/stiffness to where the tool is then, and is implicit with the stiffness. It presses, drags, goes back, and stays at
each.
"""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator import Wrench
from rft_ros.rft import rotation_matrix
from rft_ros.simulation.coupling import stiffness_matrix
from rft_ros.simulation.mujoco_grains import MujocoBody, import_mujoco
from rft_ros.simulation.six_axis_arm import SixAxisArm

Array = NDArray[np.float64]

_SENSOR = np.array([0.0, 0.0, 0.12])  # place of the load cell in the tool frame [m]; its axes are the tool's
_STOPS = np.array([(0.45, 0.0, 0.01), (0.45, 0.0, -0.02), (0.47, 0.0, -0.02), (0.46, 0.0, -0.02)])  # m
_SPEED, _PAUSE = 0.02, 2.0  # m/s; s in the air before the start, for a tare


def moments(
    answer: Callable[[Array], tuple[Wrench, Array] | None], *, rate: float = 500.0, stay: float = 2.0
) -> Iterator[tuple[float, Array, Wrench]]:
    """Time [s], state of the tool, shape [13], columns `rft_ros.rft.STATE`, and reading of the load cell.

    `answer`: what the node said of the last moment: the wrench on the tool in sensor axes, and the stiffness about the
    given origin, shape [10], as `Memory.stiffness` has it; None if that was lost. `rate`: [Hz]; `stay`: [s] at each
    place.
    """
    mujoco, steps = import_mujoco(), max(1, round(1000.0 / rate))
    arm = SixAxisArm(timestep=1.0 / (rate * steps))
    body = MujocoBody(arm.model, arm.body)
    paths = np.linalg.norm(np.diff(_STOPS, axis=0), axis=1) / _SPEED
    times = np.cumsum([0.0, _PAUSE, *(t for path in paths for t in (path, stay))])
    command = np.repeat(_STOPS, 2, axis=0)
    arm.start(_STOPS[0])
    wrench, sums, matrix = np.zeros(6), np.zeros(10), np.zeros((6, 6))
    for k in range(round(times[-1] * rate)):
        body.measure(arm.data)
        asked = body.state[0].copy()
        fx, fy, fz, tx, ty, tz = arm.data.sensordata[:6].tolist()
        yield k / rate, asked, (fx, fy, fz, tx, ty, tz)
        if (answered := answer(asked[:3])) is not None:
            axes = rotation_matrix(asked[3:7])
            force, torque = axes @ answered[0][:3], axes @ answered[0][3:]
            wrench = np.concatenate([force, torque + np.cross(axes @ _SENSOR, force)])
            sums, felt_at = answered[1], asked
            stiffness_matrix(sums, matrix)
        arm.data.ctrl[:] = arm.joints([np.interp(k / rate, times, axis) for axis in command.T])
        for _ in range(steps):
            body.measure(arm.data)
            moved = _displacement(felt_at, body.state[0]) if sums[0] > 0.0 else np.zeros(6)
            body.hold(wrench - matrix @ moved, sums, arm.model.opt.timestep, 0.1)
            mujoco.mj_step(arm.model, arm.data)


def _displacement(a: Array, b: Array) -> Array:
    """From one state to another [m, rad], shape [6], world axes."""
    turn = np.zeros(3)
    import_mujoco().mju_subQuat(turn, np.roll(b[3:7], 1), np.roll(a[3:7], 1))
    return np.concatenate([b[:3] - a[:3], rotation_matrix(a[3:7]) @ turn])

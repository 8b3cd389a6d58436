"""Steps of bodies in a simulator's grains: ``python -m bench.simulation`` prints what docs/in-the-loop.md says of them.

ζ 0.33, λ 3 mm. First the error of the force on an arm under a torque controller; then how many steps of tumbling boxes
do not converge; then the processor time of a step of 61 bodies.
"""

import time
from itertools import product
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import MEDIA, Law, alpha_y_model, treers2021
from rft_ros.simulation import GrainsBatch, MujocoGrains
from rft_ros.simulation.mechanism import import_mujoco

Array = NDArray[np.float64]

REFERENCE_STEP_S = 5e-5
STEPS_S = (2e-4, 5e-4, 1e-3, 2e-3)
GRAVITY_MPS2 = 9.81
DAMPING_RATIO = 0.7
LEGS = 12
LINKS = 5
LINKS_IN_GRAINS = 4


class Controller(NamedTuple):
    """Of an arm that moves up and down: stiffness [N/m], mass of the arm [kg]."""

    stiffness: float
    mass: float

    def force(self, time: float, height: float, speed: float) -> float:
        """Lower at 0.1 m/s to 50 mm, and hold: the motor's force [N]."""
        goal, goal_speed = (-0.1 * time, -0.1) if time < 0.5 else (-0.05, 0.0)
        damping = 2.0 * DAMPING_RATIO * sqrt(self.stiffness * self.mass)
        error = self.stiffness * (goal - height) + damping * (goal_speed - speed)
        return error + self.mass * GRAVITY_MPS2


CONTROLLERS = (
    Controller(2e3, 3.0),
    Controller(5e2, 3.0),
    Controller(2e3, 8.0),
    Controller(2e3, 0.5),
    Controller(1e4, 3.0),
)


def law() -> Law:
    medium = MEDIA["generic"]
    linear = alpha_y_model("linear", medium)
    return treers2021(medium, linear, zeta=0.33, mobilization_length=0.003)


def model_of(tree: str, step: float, more: str = "") -> Any:
    option = f'<option timestep="{step}" integrator="implicitfast"/>'
    text = f"<mujoco>{option}<worldbody>{tree}</worldbody>{more}</mujoco>"
    return import_mujoco().MjModel.from_xml_string(text)


def forces_on_arm(controller: Controller, step: float, *, explicit: bool) -> Array:
    """Upward force on a blade at a time every 2 ms [N]. `explicit`: of the memory, at the begin of each step."""
    mujoco = import_mujoco()
    blade = f'<geom type="box" size="0.025 0.004 0.06" mass="{controller.mass}"/>'
    slide = '<joint name="z" type="slide" axis="0 0 1"/>'
    tree = f'<body name="tool" pos="0 0 0.06">{slide}{blade}</body>'
    model = model_of(tree, step, '<actuator><motor joint="z"/></actuator>')
    data = mujoco.MjData(model)
    grains = MujocoGrains(model, body="tool", law=law())
    memory = GrainsBatch(grains.tool, law(), bodies=1)
    states = np.zeros((1, 13))
    states[0, 6] = 1.0  # qw: no rotation
    found = []
    for _ in range(round(0.7 / step)):
        height, speed = float(data.qpos[0]), float(data.qvel[0])
        data.ctrl[0] = controller.force(data.time, height, speed)
        if explicit:
            states[0, 2] = 0.06 + height
            states[0, 9] = speed
            data.xfrc_applied[1, 2] = memory.step(states, step)[0, 2]
        else:
            grains.apply(data)
        found.append(float(data.xfrc_applied[1, 2]))
        mujoco.mj_step(model, data)
    times = step * np.arange(1, len(found) + 1)
    return np.asarray(np.interp(np.arange(0.1, 0.7, 0.002), times, found))


def print_controllers() -> None:
    for controller in CONTROLLERS:
        reference = forces_on_arm(controller, REFERENCE_STEP_S, explicit=True)
        cells = []
        for step in STEPS_S:
            forces = forces_on_arm(controller, step, explicit=False)
            error = np.abs(forces - reference).max() / reference.max()
            cells.append(f"{100.0 * error:.1f} %")
        name = f"{1e-3 * controller.stiffness:g} kN/m, {controller.mass:g} kg"
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


def print_boxes() -> None:
    """Three boxes of 0.2 kg fall in for 2 s, each with 20 rad/s about one of its axes."""
    mujoco = import_mujoco()
    box = '<freejoint/><geom type="box" size="0.025 0.025 0.01" mass="0.2"/>'
    for step in (0.001, 0.002, 0.005):
        failures = 0
        count = 0
        for axis in range(3):
            model = model_of(f'<body name="box" pos="0 0 0.05">{box}</body>', step)
            data = mujoco.MjData(model)
            grains = MujocoGrains(model, body="box", law=law())
            data.qvel[3 + axis] = 20.0
            for _ in range(round(2.0 / step)):
                grains.apply(data)
                mujoco.mj_step(model, data)
            count += round(2.0 / step)
            failures += grains.failures
        plates = len(grains.tool.plates)
        print(f"boxes of {plates} plates, {1e3 * step:g} ms: {failures} of {count} steps fail")


def print_many_bodies() -> None:
    """A trunk stands on legs of five links, of which four are in the grains."""
    mujoco = import_mujoco()
    legs = ""
    for leg in range(LEGS):
        angle = 2.0 * np.pi * leg / LEGS
        place = f"{0.25 * np.cos(angle)} {0.25 * np.sin(angle)} 0.02"
        links = ""
        for link in reversed(range(LINKS)):
            geom = '<geom type="capsule" fromto="0 0 0 0 0 -0.04" size="0.012" mass="0.05" {}/>'
            joint = f'<joint axis="{link % 2} {1 - link % 2} 0" stiffness="20" damping="0.5"/>'
            at = place if link == 0 else "0 0 -0.05"
            geom = geom.format('contype="0" conaffinity="0"')
            links = f'<body name="{leg}_{link}" pos="{at}">{joint}{geom}{links}</body>'
        legs += links
    trunk = '<geom type="cylinder" size="0.25 0.02" mass="5" contype="0" conaffinity="0"/>'
    tree = f'<body name="trunk" pos="0 0 0.05"><freejoint/>{trunk}{legs}</body>'
    model = model_of(tree, 0.002)
    data = mujoco.MjData(model)
    names = [f"{leg}_{link}" for leg, link in product(range(LEGS), range(LINKS))]
    grains = MujocoGrains(model, bodies=["trunk", *names], law=law())
    times = []
    for _ in range(1500):
        start = time.process_time()
        grains.apply(data)
        mujoco.mj_step(model, data)
        times.append(time.process_time() - start)
    in_grains = int(np.any(grains.wrench != 0.0, axis=1).sum())
    plates = [len(tool.plates) for tool in grains.tools]
    print(
        f"{len(plates)} bodies, {model.nv} joints, {in_grains} in grains, plates {plates[0]} and {plates[1]}:"
        f" {1e3 * np.median(times):.2f} ms a step, {grains.failures} fail"
    )


def main() -> None:
    print_controllers()
    print_boxes()
    print_many_bodies()


if __name__ == "__main__":
    main()

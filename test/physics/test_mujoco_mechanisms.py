"""Mechanisms in grains: fingers, wheels, swinging tools, and blocks that slide off a plate."""

import mujoco_scenes as scenes
import numpy as np
import pytest

from rft_ros.simulation import Grains, MujocoGrains

mujoco = pytest.importorskip("mujoco", reason="needs MuJoCo: pip install 'rft_ros[mujoco]'")

QUIET = 'contype="0" conaffinity="0"'


class Motion:
    """Bodies that move in grains: the wrenches held and those of the memory at the same poses, energy and poses."""

    def __init__(self, tree, bodies, *, step=0.002, integrator="implicitfast", more="", zeta=0.33):
        self.model = mujoco.MjModel.from_xml_string(
            f'<mujoco><option timestep="{step}" integrator="{integrator}"/><worldbody>{tree}</worldbody>{more}</mujoco>'
        )
        self.data, self.step = mujoco.MjData(self.model), step
        self.grains = MujocoGrains(self.model, bodies=bodies, law=scenes.law(zeta))
        self.memories = [Grains(tool, scenes.law(zeta)) for tool in self.grains.tools]
        self.ids = [self.model.body(name).id for name in bodies]
        self.poses, self.energies = [], []

    def run(self, seconds, command=None):
        linear, angular = np.zeros((2, 3, self.model.nv))
        for _ in range(round(seconds / self.step)):
            if command is not None:
                command(self.data)
            self.grains.apply(self.data)
            self.energies.append(self.grains.energy.sum())
            self.remembered = []
            for body, memory in zip(self.ids, self.memories, strict=True):
                mujoco.mj_jacBody(self.model, self.data, linear, angular, body)
                twist = np.concatenate([linear @ self.data.qvel, angular @ self.data.qvel])
                pose = self.data.xpos[body], np.roll(self.data.xquat[body], -1)
                self.remembered.append(memory.step(*pose, twist, self.step)[:3])
            mujoco.mj_step(self.model, self.data)
            self.poses.append(self.data.qpos.copy())
        return self

    @property
    def creep(self):
        """In the last half second, in mm and mrad."""
        return 1e3 * np.ptp(self.poses[-round(0.5 / self.step) :], axis=0).max()

    @property
    def error(self):
        """Of the wrench that the bodies feel, over that of the memory."""
        force = np.array(self.remembered)
        return np.abs(self.grains.wrench[:, :3] - force).max() / np.abs(force).max()

    @property
    def drawn(self):
        """Greatest energy that came back from the grains, over all that they took."""
        taken = np.array(self.energies)
        return (np.maximum.accumulate(taken) - taken).max() / taken.max()


def test_two_fingers_close_on_grains_alike_and_feel_what_the_grains_remember():
    finger = (
        '<body name="{0}" pos="{1} 0 0"><joint name="{0}" type="slide" axis="{2} 0 0" damping="5"/>'
        '<geom type="box" size="0.006 0.015 0.03" pos="0 0 -0.03" mass="0.1"/></body>'
    )
    palm = f'<body pos="0 0 0.02">{finger.format("left", -0.04, 1)}{finger.format("right", 0.04, -1)}</body>'
    more = (
        '<equality><joint joint1="left" joint2="right"/></equality>'
        '<actuator><position joint="left" kp="3000" kv="30"/></actuator>'
    )
    motion = Motion(palm, ["left", "right"], more=more)
    motion.run(2.0, lambda data: data.ctrl.__setitem__(0, 0.03 * min(data.time, 1.0)))
    left, right = motion.grains.wrench[:, 0]
    assert left < -1.0
    assert right == pytest.approx(-left, rel=0.03)  # the plates are reduced within 2.5 %
    assert motion.error < 0.01
    assert motion.creep < 1e-3
    assert motion.drawn < 0.005


def test_a_rover_stands_level_drives_straight_and_takes_nothing_from_the_grains():
    wheel = (
        '<body name="{0}" pos="{1} {2} -0.03"><joint name="{0}" axis="0 1 0" damping="0.05" armature="0.001"/>'
        f'<geom type="cylinder" size="0.05 0.015" euler="90 0 0" mass="0.4" {QUIET}/></body>'
    )
    places = {"a": (0.12, 0.1), "b": (0.12, -0.1), "c": (-0.12, 0.1), "d": (-0.12, -0.1)}
    wheels = "".join(wheel.format(name, *place) for name, place in places.items())
    base = f'<geom type="box" size="0.15 0.08 0.03" mass="6" {QUIET}/>'
    servos = "".join(f'<velocity joint="{name}" kv="3"/>' for name in places)
    tree = f'<body pos="0 0 0.075"><freejoint/>{base}{wheels}</body>'
    motion = Motion(tree, list(places), more=f"<actuator>{servos}</actuator>", zeta=1.0).run(1.5)
    assert motion.error < 0.01
    assert motion.creep < 1e-3
    motion.run(
        1.0, lambda data: data.ctrl.__setitem__(slice(None), 3.0 * min(data.time - 1.5, 1.0))
    )
    x, y = motion.data.qpos[:2]
    assert x > 0.01
    assert abs(y) < 0.01 * x
    assert motion.drawn < 0.005


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_a_pendulum_that_swings_through_grains_stays_where_they_stop_it(integrator):
    rod = f'<geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.005" mass="0.1" {QUIET}/>'
    ball = f'<geom type="sphere" size="0.03" pos="0 0 -0.25" mass="0.5" {QUIET}/>'
    bob = f'<body name="bob" pos="0 0 0.25" euler="0 80 0"><joint axis="0 1 0" damping="0.001"/>{rod}{ball}</body>'
    motion = Motion(bob, ["bob"], integrator=integrator).run(2.5)
    assert motion.error < 0.01
    assert motion.creep < 1e-3
    assert motion.drawn < 0.005


@pytest.mark.parametrize("solver", ["PGS", "Newton"])
def test_a_block_slides_off_its_plate_under_elliptic_cones_with_any_solver(solver):
    found = []
    for cone in ("pyramidal", "elliptic"):
        scene = scenes.Scene(
            scenes.free_tool("plate", 0.3).replace(QUIET, 'condim="3"')
            + '<body pos="0.01 0 0.02"><freejoint/><geom type="box" size="0.02 0.02 0.01" mass="0.3"/></body>',
            0.002,
            "Euler",
            option=f'solver="{solver}" cone="{cone}"',
        )
        scene.data.qvel[6] = 0.4
        for _ in range(400):
            scene.advance()
        found.append(scene.data.qpos[:3])
    assert np.isfinite(found).all()
    assert found[1] == pytest.approx(found[0], abs=3e-3)

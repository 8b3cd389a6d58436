"""Bodies in grains beside contacts, welds, limits, servos, other bodies: they feel what the grains remember."""

import pickle

import mujoco_scenes as scenes
import numpy as np
import pytest

from rft_ros.errors import InputError
from rft_ros.simulation import MujocoGrains

mujoco = pytest.importorskip("mujoco", reason="needs MuJoCo: pip install 'rft_ros[mujoco]'")


@pytest.mark.parametrize(
    ("step", "integrator", "option"),
    [
        (0.002, "Euler", ""),
        (0.005, "implicitfast", 'cone="elliptic"'),
        (0.002, "implicit", 'cone="elliptic" jacobian="sparse"'),
        (0.002, "RK4", ""),
    ],
)
def test_a_block_on_a_plate_rests_as_deep_as_one_body(step, integrator, option):
    found, one = (
        scenes.block(step, integrator, option=option),
        scenes.block(step, integrator, as_one=True),
    )
    assert found["depth"] == pytest.approx(one["depth"], rel=0.05)
    assert found["creep"] < 1e-3
    assert found["felt over memory"] == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("kind", scenes.KINDS)
@pytest.mark.parametrize(("step", "integrator"), [(0.002, "Euler"), (0.005, "implicitfast")])
def test_a_tool_feels_what_the_grains_remember_whatever_else_bears_on_it(kind, step, integrator):
    found = scenes.pressed(kind, step, integrator)
    assert found["felt"] > 5.0
    assert found["felt over memory"] == pytest.approx(1.0, abs=0.01)
    assert found["scatter"] < 1e-3


@pytest.mark.parametrize(
    ("by", "speed", "stiffness", "step", "integrator"),
    [
        ("servo", 0.05, 2e5, 0.002, "Euler"),
        ("servo", 0.2, 2e4, 0.005, "Euler"),
        ("servo", 0.2, 2e5, 0.005, "implicitfast"),
        ("servo", 0.2, 2e6, 0.0005, "Euler"),
        ("weld", 0.2, 2e5, 0.002, "Euler"),
        ("force", 0.2, 2e5, 0.002, "Euler"),
    ],
)
def test_a_tool_that_is_lifted_feels_what_the_grains_remember(
    by, speed, stiffness, step, integrator
):
    found = scenes.lifted(speed, stiffness, step, integrator, by=by)
    assert found["error"] < (0.05 if step < 0.005 else 0.12)
    assert found["pull"] < found["memory's pull"] + 0.05


@pytest.mark.parametrize(
    ("mass", "step"),
    [(0.002, 0.001), (0.005, 0.002), (0.1, 0.015), (0.5, 0.005), (0.02, 0.016), (0.02, 0.02)],
)
def test_a_body_that_is_released_stays_where_it_was_pressed(mass, step):
    found = scenes.released(mass, step)
    assert found["rise"] < 1.0
    assert found["back"] < 0.5


def test_a_plate_slides_as_far_in_long_steps_as_in_short_ones():
    way = scenes.slid(0.0005, explicit=True)["way"]
    assert scenes.slid(0.002)["way"] == pytest.approx(way, rel=0.03)
    assert scenes.slid(0.005)["way"] == pytest.approx(way, rel=0.05)


@pytest.mark.parametrize(
    ("step", "integrator"),
    [
        (0.001, "Euler"),
        (0.002, "implicit"),
        (0.01, "implicitfast"),
    ],
)
def test_a_quadruped_with_stiff_knees_stands_still_and_takes_nothing_from_the_grains(
    step, integrator
):
    found = scenes.gait(step, integrator)
    assert found["creep"] < 1e-6
    assert found["back"] < 0.5


def test_steps_of_a_trotting_quadruped_converge_also_with_feet_in_the_air():
    found = scenes.gait(0.002, "implicitfast", trots=2.0, stands=1.0)
    assert found["failures"] < 0.005 * 3.0 / 0.002
    assert found["tilt"] < 5.0
    assert found["back"] < 0.1
    assert found["net back"] == pytest.approx(0.0, abs=1e-6)


def test_long_steps_of_rk4_are_told_once(caplog):
    for step, told in ((0.001, 0), (0.005, 1)):
        scene = scenes.Scene(scenes.free_tool("plate", 0.3), step, "RK4")
        for _ in range(3):
            scene.advance()
        assert len([r for r in caplog.records if "RK4" in r.getMessage()]) == told


def test_data_of_another_model_is_refused_also_where_both_were_pickled():
    ball = '<body><joint type="ball"/><geom size="0.01"/></body>'
    text = '<mujoco><worldbody>{}<body name="b"><freejoint/><geom size="0.02"/></body></worldbody></mujoco>'
    one, two = (
        pickle.loads(pickle.dumps(mujoco.MjModel.from_xml_string(text.format(more))))
        for more in ("", ball)
    )
    grains = MujocoGrains(one, body="b", law=scenes.law())
    with pytest.raises(ValueError, match="not of the model"):
        grains.apply(mujoco.MjData(two))


def test_many_presses_at_one_place_do_not_drift():
    found = scenes.presses(0.005, times=40)
    assert found["drift"] < 1e-3 * found["last"]


BOX = """
<mujoco><option timestep="0.002"/><worldbody>
<body name="box" pos="0 0 0.02"><freejoint/><geom type="box" size="0.025 0.025 0.01" mass="0.2"/></body>
<body name="ball" pos="0.3 0 0.03"><freejoint/><geom type="sphere" size="0.02" mass="0.1"/></body>
<body name="rod" pos="0.6 0 0.03" quat="0.7 0.7 0 0"><freejoint/><geom type="capsule" size="0.01 0.03" mass="0.1"/>
</body>
<body name="can" pos="0.9 0 0.03"><freejoint/><geom type="cylinder" size="0.02 0.02" mass="0.1"/></body>
<body name="egg" pos="1.2 0 0.03"><freejoint/><geom type="ellipsoid" size="0.02 0.03 0.015" mass="0.1"/></body>
</worldbody></mujoco>"""
NAMES = "box", "ball", "rod", "can", "egg"


@pytest.fixture(scope="module")
def five():
    model = mujoco.MjModel.from_xml_string(BOX)
    return model, MujocoGrains(model, bodies=NAMES, law=scenes.law())


def test_primitive_geoms_are_shapes_and_bodies_of_one_object_rest_as_each_alone(five):
    model, grains = five
    sizes = {
        "box": (0.05, 0.05, 0.02),
        "ball": (0.04,) * 3,
        "rod": (0.02, 0.02, 0.08),
        "can": (0.04,) * 3,
    }
    sizes["egg"] = (0.04, 0.06, 0.03)
    for name, tool in zip(NAMES, grains.tools, strict=True):
        assert np.ptp(tool.corners, axis=0) == pytest.approx(sizes[name], rel=0.02)
    data, single = mujoco.MjData(model), mujoco.MjData(model)
    alone = MujocoGrains(model, body="can", law=scenes.law())
    for _ in range(400):
        wrenches = grains.apply(data)
        alone.apply(single)
        mujoco.mj_step(model, data)
        mujoco.mj_step(model, single)
    assert wrenches.shape == (5, 6)
    assert wrenches[:, 2] == pytest.approx(9.81 * np.array([0.2, 0.1, 0.1, 0.1, 0.1]), rel=0.05)
    assert data.body("can").xpos == pytest.approx(single.body("can").xpos, abs=1e-4)
    assert (grains.energy > 0.0).all()
    assert grains.stiffness.shape == (5, 6, 6)
    forces = grains.tractions("egg") * grains.tools[4].plates.areas[:, None]
    assert forces.sum(axis=0)[2] == pytest.approx(wrenches[4, 2], rel=0.01)


def test_forces_of_the_user_act_beside_the_grains(five):
    model, grains = five
    grains.reset()
    data = mujoco.MjData(model)
    push = np.array([0.0, 0.0, -3.0, 0.0, 0.0, 0.0])
    data.xfrc_applied[1] = push  # once: it stays
    for k in range(500):
        data.xfrc_applied[2, :3] = (0.0, 0.0, -2.0)  # again and again
        if k == 250:
            data.xfrc_applied[3] = (0.0, 0.0, -1.0, 0.0, 0.0, 0.0)
        wrenches = grains.apply(data)
        mujoco.mj_step(model, data)
    assert wrenches[:, 2] == pytest.approx(
        [0.2 * 9.81 + 3, 0.1 * 9.81 + 2, 0.1 * 9.81 + 1, 0.981, 0.981], rel=0.05
    )
    data.xfrc_applied[:] = 0.0
    grains.apply(data)
    kept = grains.state()
    grains.apply(data)
    grains.restore(kept)
    grains.apply(data)
    assert np.abs(data.xfrc_applied[1:4, 2] - grains.wrench[:3, 2]).max() < 1e-9


def test_a_motion_without_bound_is_refused_and_nothing_is_written(five):
    model, grains = five
    grains.reset()
    for qvel, step in ((1e150, 0.002), (0.1, 1e9)):
        data = mujoco.MjData(model)
        data.qvel[2], model.opt.timestep = qvel, step
        with pytest.raises(ValueError, match="without bound"):
            grains.apply(data)
        assert np.isfinite(data.xfrc_applied).all()
        model.opt.timestep = 0.002


def test_a_step_that_does_not_hold_is_counted_and_told_once(five, caplog):
    model, grains = five
    grains.reset()
    data = mujoco.MjData(model)
    data.qvel[[2, 8]] = -30.0
    model.opt.timestep = 0.02
    for _ in range(3):
        grains.apply(data)
        mujoco.mj_step(model, data)
    model.opt.timestep = 0.002
    assert grains.failures > 0
    assert len([r for r in caplog.records if "shorter steps" in r.getMessage()]) == 1


def test_names_and_sizes_that_cannot_be_used_are_said():
    model = mujoco.MjModel.from_xml_string(BOX)
    for wrong, message in (
        ({}, "body="),
        ({"body": "box", "bodies": ["ball"]}, "bodies="),
        ({"bodies": ["box", "box"]}, "each of them once"),
        ({"bodies": []}, "at least one"),
        ({"body": "box", "mesh": "plate", "scale": 1.0}, "51 m long.*check scale"),
        ({"body": "box", "mesh": "plate", "scale": 1e-6}, "check scale"),
        ({"bodies": ["box", "ball"], "mesh": ["plate"]}, "1 files"),
        ({"body": "box", "zeta": 0.33}, "law=, or zeta="),
    ):
        with pytest.raises(InputError, match=message):
            MujocoGrains(model, law=scenes.law(), **wrong)

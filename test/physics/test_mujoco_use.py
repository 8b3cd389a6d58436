"""How MujocoGrains is used: which geoms are a body's shape, what else is ground, controllers, saved states, misuse."""

import copy
import logging

import numpy as np
import pytest
from mujoco_scenes import law

from bench.simulation import CONTROLLERS, REFERENCE_STEP_S, forces_on_arm
from rft_ros.errors import InputError
from rft_ros.simulation import GrainsBatch, MujocoGrains

mujoco = pytest.importorskip("mujoco", reason="needs MuJoCo: pip install 'rft_ros[mujoco]'")

BALL = '<body name="{0}" pos="{1} 0 0.05"><freejoint/><geom type="sphere" size="0.03" mass="0.1"/></body>'


def model_of(tree, *, step=0.002, integrator="implicitfast", more=""):
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{step}" integrator="{integrator}"/><worldbody>{tree}</worldbody>{more}</mujoco>'
    )


def extent(tool):
    return np.ptp(tool.corners, axis=0)


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_users_torque_controller_feels_the_force_of_explicit_short_steps(controller):
    reference = forces_on_arm(controller, REFERENCE_STEP_S, explicit=True)
    for step, limit in ((1e-3, 0.1), (2e-3, 0.15)):
        forces = forces_on_arm(controller, step, explicit=False)
        assert np.abs(forces - reference).max() < limit * reference.max()


def test_steps_without_the_grains_and_a_second_data_are_refused_with_the_remedy():
    model = model_of(BALL.format("b", 0.0))
    grains, data, other = (
        MujocoGrains(model, body="b", law=law()),
        mujoco.MjData(model),
        mujoco.MjData(model),
    )
    grains.apply(data)
    with pytest.raises(InputError, match=r"one MjData.*restore"):
        grains.apply(other)
    mujoco.mj_step(model, data, nstep=3)
    with pytest.raises(InputError, match=r"moved on by 3 steps.*before each mj_step.*frame_skip"):
        grains.apply(data)
    grains.reset()
    grains.apply(data)
    kept = grains.state()
    grains.restore(kept)
    grains.apply(other)


def test_only_the_start_is_a_new_start_and_another_time_back_names_restore():
    model = model_of(BALL.format("b", 0.0))
    everything = mujoco.mjtState.mjSTATE_INTEGRATION
    grains, data, saved = MujocoGrains(model, body="b", law=law()), mujoco.MjData(model), {}
    for k in range(400):
        if k in (0, 100, 399):
            saved[k] = np.zeros(mujoco.mj_stateSize(model, everything)), grains.state()
            mujoco.mj_getState(model, data, saved[k][0], everything)
            earlier = copy.copy(data)
        grains.apply(data)
        mujoco.mj_step(model, data)
    with pytest.raises(InputError, match=r"time went back from 0\.798 to 0\.2 s.*restore"):
        mujoco.mj_setState(model, data, saved[100][0], everything)
        grains.apply(data)
    mujoco.mj_setState(model, earlier, saved[100][0], everything)
    with pytest.raises(InputError, match=r"time went back.*restore"):
        grains.apply(earlier)
    rest = {}
    for k, restored in ((0, False), (100, True), (0, True)):
        mujoco.mj_setState(model, data, saved[k][0], everything)
        if restored:
            grains.restore(saved[k][1])
        for _ in range(400 - k):
            grains.apply(data)
            mujoco.mj_step(model, data)
        rest[k, restored] = data.qpos.tobytes()
    assert len(set(rest.values())) == 1


@pytest.mark.parametrize("change", ["geom_size", "geom_pos", "body_quat"])
def test_a_shape_that_changed_is_said_at_the_next_start_and_one_that_has_no_grains_may_change(
    change,
):
    toe = '<body pos="0.05 0 0"><geom type="sphere" size="0.02" mass="0.1"/></body>'
    tree = f'<body name="b"><freejoint/><geom size="0.02"/>{toe}</body><geom type="plane" size="1 1 1" pos="0 0 -1"/>'
    model = model_of(tree)
    data, grains = mujoco.MjData(model), MujocoGrains(model, body="b", law=law())
    model.geom_size[0] = 2.0
    grains.apply(data)
    grains.reset()
    getattr(model, change)[-1] += 0.01
    for start in (grains.reset, lambda: grains.apply(data)):
        with pytest.raises(InputError, match=r"geoms of a body.*make a new MujocoGrains"):
            start()


def test_a_copy_right_after_a_restore_has_no_force_of_its_own():
    model = model_of(BALL.format("b", 0.0))
    everything = mujoco.mjtState.mjSTATE_INTEGRATION
    grains, data, saved = MujocoGrains(model, body="b", law=law()), mujoco.MjData(model), None
    for k in range(400):
        if k == 200:
            kept, saved = grains.state(), np.zeros(mujoco.mj_stateSize(model, everything))
            mujoco.mj_getState(model, data, saved, everything)
            data.qvel[2] = 1.0
        grains.apply(data)
        mujoco.mj_step(model, data)
    mujoco.mj_setState(model, data, saved, everything)
    grains.restore(kept)
    for branch in (copy.deepcopy(grains), grains):
        one = mujoco.MjData(model)
        mujoco.mj_setState(model, one, saved, everything)
        if branch is grains:
            branch.restore(grains.state())
        for _ in range(300):
            branch.apply(one)
            mujoco.mj_step(model, one)
        assert branch.wrench[2] == pytest.approx(0.1 * 9.81, rel=1e-3)
        assert one.xfrc_applied[1, 2] == pytest.approx(0.1 * 9.81, rel=1e-3)


@pytest.mark.parametrize("step", [0.001, 0.01])
def test_the_energy_that_the_grains_took_is_what_a_fallen_body_lost(step):
    model = model_of(BALL.format("b", 0.0), step=step)
    data, grains = mujoco.MjData(model), MujocoGrains(model, body="b", law=law())
    for _ in range(round(1.0 / step)):
        grains.apply(data)
        mujoco.mj_step(model, data)
    assert grains.energy == pytest.approx(0.1 * 9.81 * (0.05 - data.qpos[2]), rel=1e-3)


def test_bodies_out_of_reach_change_nothing_and_are_in_no_counter():
    rod = '<joint axis="0 1 0"/><geom type="capsule" size="0.02" fromto="0 0 0 0.4 0 0"/>'
    model = model_of(f"{BALL.format('b', 0.0)}<body name='rod' pos='0.5 0 1.5'>{rod}</body>")
    heights = []
    for bodies in (["b"], ["b", "rod"]):
        data, grains = mujoco.MjData(model), MujocoGrains(model, bodies=bodies, law=law())
        data.qvel[6] = 30.0
        for _ in range(300):
            grains.apply(data)
            mujoco.mj_step(model, data)
        assert grains.failures == 0
        heights.append(data.qpos[2])
    assert heights[0] == heights[1]


def test_a_body_is_named_by_its_id_and_jointless_children_belong_to_it():
    toe = '<body {} pos="0.05 0 0"><geom type="sphere" size="0.02" mass="0.1"/></body>'
    foot = (
        f'<body pos="0 0 0.1"><freejoint/><geom type="sphere" size="0.02" mass="0.1"/>{toe}</body>'
    )
    model = model_of(foot.format(""))
    assert extent(MujocoGrains(model, body=1, law=law()).tool) == pytest.approx(
        [0.09, 0.04, 0.04], rel=0.02
    )
    apart = MujocoGrains(model_of(foot.format('name="toe"')), bodies=[1, "toe"], law=law()).tools
    assert [extent(tool)[0] for tool in apart] == pytest.approx([0.04, 0.04], rel=0.02)
    (toe,) = MujocoGrains(model_of(foot.format('name="toe"')), bodies="toe", law=law()).tools
    assert extent(toe) == pytest.approx(extent(apart[1]))
    for wrong in (0, 3, -1):
        with pytest.raises(InputError, match=f"body '{wrong}' is not in the model"):
            MujocoGrains(model, body=wrong, law=law())


def test_geoms_of_a_pair_collide():
    quiet = 'contype="0" conaffinity="0"'
    tree = (
        f'<geom name="floor" type="plane" size="1 1 1" {quiet}/><body name="b" pos="0 0 0.1"><freejoint/>'
        f'<geom name="foot" type="sphere" size="0.02" {quiet}/><geom type="sphere" size="0.05" {quiet}/></body>'
    )
    pair = '<contact><pair geom1="floor" geom2="foot"/></contact>'
    assert extent(MujocoGrains(model_of(tree, more=pair), body="b", law=law()).tool)[
        0
    ] == pytest.approx(0.04, rel=0.02)


def test_faces_within_another_geom_do_not_count_and_those_back_to_back_neither():
    half = '<geom type="box" size="0.02 0.02 0.02" pos="{} 0 0" mass="0.1"/>'
    body = '<body name="b"><freejoint/>{}</body>'

    def area(*places):
        model = model_of(body.format("".join(half.format(x) for x in places)))
        return MujocoGrains(model, body="b", law=law(), tolerance=0.0).tool.plates.area

    face = 0.04**2
    assert area(0.0) == pytest.approx(6.0 * face)
    assert area(-0.02, 0.02) == pytest.approx(10.0 * face)
    assert area(0.0, 0.0) == pytest.approx(6.0 * face)
    assert area(-0.01, 0.01) == pytest.approx(8.0 * face, rel=0.05)


@pytest.mark.parametrize(
    "shape",
    ['"box" size="0.02 0.02 0.02"', '"cylinder" size="0.02 0.03"', '"capsule" size="0.01 0.03"'],
)
def test_a_primitive_that_turns_feels_what_a_finer_one_does(shape):
    model = model_of(f'<body name="b"><freejoint/><geom type={shape}/></body>')
    fine, reduced = (
        MujocoGrains(model, body="b", law=law(), tolerance=t).tool for t in (0.0, 0.025)
    )
    assert len(reduced.plates) < 0.6 * len(fine.plates)
    forces = []
    for tool in (fine, reduced):
        grains, states, found = GrainsBatch(tool, law(), bodies=1), np.zeros((1, 13)), []
        for k in range(300):
            angle = 0.006 * k
            states[0] = (
                0.02 * angle,
                0,
                0,
                0,
                np.sin(angle / 2),
                0,
                np.cos(angle / 2),
                0.12,
                0,
                0,
                0,
                6,
                0,
            )
            found.append(grains.step(states, 0.001)[0, :3])
        forces.append(np.array(found))
    error = np.sqrt(((forces[0] - forces[1]) ** 2).sum(axis=1).mean())
    assert error < 0.05 * np.linalg.norm(forces[0], axis=1).max()


@pytest.mark.parametrize("cells", [2, 9])
def test_a_height_field_is_the_ground_where_mujoco_has_it(cells):
    slope = np.repeat(np.linspace(0, 1, cells), cells)
    values = " ".join(f"{z:g}" for z in slope)
    size = f'nrow="{cells}" ncol="{cells}" elevation="{values}" size="0.2 0.2 0.04 0.01"'
    tree = (
        '<geom name="hill" type="hfield" hfield="h" pos="0 0 0.01" contype="0" conaffinity="0"/>'
    )
    model = model_of(
        f"{tree}{BALL.format('b', 0.05)}", more=f'<asset><hfield name="h" {size}/></asset>'
    )
    data, grains = mujoco.MjData(model), MujocoGrains(model, body="b", law=law(), ground="hill")
    mujoco.mj_forward(model, data)
    forces = []
    for y in (-0.1, 0.03, 0.1):
        ray = mujoco.mj_ray(
            model,
            data,
            np.array([0.0, y, 1.0]),
            np.array([0.0, 0.0, -1.0]),
            None,
            1,
            -1,
            np.zeros(1, "i4"),
        )
        mujoco.mj_resetData(model, data)
        data.qpos[:3], data.qvel[2] = (0.0, y, 1.0 - ray + 0.01), -0.1
        for _ in range(3):
            grains.apply(data)
            mujoco.mj_step(model, data)
        forces.append(grains.wrench[2])
    assert forces[0] > 1.0
    assert forces == pytest.approx([forces[0]] * 3, rel=0.01)
    with pytest.raises(InputError, match="ground 'b' is not a geom of type hfield"):
        MujocoGrains(model, body="b", law=law(), ground="b")


def first_step(scene, *, more="", foot='name="foot"', **options):
    """One step of a foot of 50 mm that is 60 mm above the origin, over this scene."""
    cube = f'<geom {foot} type="box" size="0.025 0.025 0.025" mass="2"/>'
    field = '<asset><hfield name="bed" nrow="5" ncol="5" size="1 1 0.2 0.1"/></asset>'
    body = f'<body name="foot" pos="0 0 0.06"><freejoint/>{cube}</body>'
    model = model_of(scene + body, more=field + more)
    MujocoGrains(model, body="foot", law=law(), **options).apply(mujoco.MjData(model))


PLANE = '<geom name="floor" type="plane" size="0 0 1" pos="0 0 {}" {}/>'
FIELD = '<geom name="bed" type="hfield" hfield="bed" {}/>'
EXCLUDED = '<contact><exclude body1="world" body2="foot"/></contact>'
PAIR = '<contact><pair geom1="floor" geom2="foot"/></contact>'
NO_CONTACT = 'contype="0" conaffinity="0"'


@pytest.mark.parametrize(
    ("scene", "options"),
    [
        (PLANE.format(0.0, ""), {}),
        (PLANE.format(0.3, ""), {"surface_height": 0.2}),
        (PLANE.format(0.0, NO_CONTACT), {"more": PAIR}),
        (FIELD.format(""), {"ground": "bed"}),
    ],
)
def test_a_floor_that_carries_the_body_in_place_of_the_grains_is_refused(scene, options):
    with pytest.raises(InputError, match=r"geom '(floor|bed)'.*body 'foot'.*contype"):
        first_step(scene, **options)


@pytest.mark.parametrize(
    "scene",
    [
        '<geom name="table" type="box" size="1 1 0.1" pos="0 0 -0.1"/>',
        '<geom name="table" type="box" size="1 1 0.01" pos="0 0 0.02"/>',
        FIELD.format(""),
        '<geom name="ramp" type="plane" size="0 0 1" pos="0 0 0.01" euler="0 20 0"/>',
    ],
)
def test_a_rigid_geom_above_the_surface_below_the_body_is_logged(scene, caplog):
    with caplog.at_level(logging.WARNING, "rft_ros.simulation"):
        first_step(scene)
    (record,) = caplog.records
    assert "can collide with body 'foot'" in record.getMessage()


@pytest.mark.parametrize(
    ("scene", "options"),
    [
        (PLANE.format(-0.05, ""), {}),
        (PLANE.format(0.0, NO_CONTACT), {}),
        (PLANE.format(0.0, 'contype="2" conaffinity="4"'), {}),
        (PLANE.format(0.0, ""), {"more": EXCLUDED}),
        (FIELD.format(NO_CONTACT), {"ground": "bed"}),
        (FIELD.format('pos="0 0 -0.02"'), {}),
        ('<geom type="box" size="0.01 1 0.2" pos="0.1 0 0"/>', {}),
        ('<geom type="plane" size="0 0 1" pos="0.1 0 0" euler="0 -90 0"/>', {}),
        ('<body name="stone"><freejoint/><geom size="0.02" mass="1"/></body>', {}),
    ],
)
def test_a_bottom_a_wall_and_what_cannot_collide_are_no_fault(scene, options, caplog):
    with caplog.at_level(logging.WARNING, "rft_ros.simulation"):
        first_step(scene, **options)
    assert not caplog.records

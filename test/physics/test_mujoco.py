"""Bodies of MuJoCo in grains: they come to rest and lie still, whatever the step, the integrator and the scene."""

import copy
import pickle
import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from examples.six_axis_arm import SixAxisArm
from rft_ros.errors import InputError
from rft_ros.ground import HeightMap
from rft_ros.installation import share_directory
from rft_ros.rft import MEDIA, alpha_y_model, treers2021, wrenches
from rft_ros.simulation import MujocoGrains

mujoco = pytest.importorskip("mujoco", reason="needs MuJoCo: pip install 'rft_ros[mujoco]'")

MESHES = share_directory("rft_ros") / "meshes"
FLAT, TILTED = "1 0 0 0", "0.99 0.12 0.08 0"
GRAINS = {"zeta": 0.33, "mobilization_length": 0.003}
LAW = treers2021(MEDIA["generic"], alpha_y_model("linear", MEDIA["generic"]), zeta=0.33)


def falling(*bodies, timestep=0.001, integrator="Euler", more=""):
    """A model of free bodies (mesh, mass [kg], quaternion wxyz) side by side; `more`: attributes of the geoms."""
    names = dict.fromkeys(mesh for mesh, _, _ in bodies)
    meshes = "".join(
        f'<mesh name="{n}" file="{MESHES}/{n}.stl" scale="0.001 0.001 0.001"/>' for n in names
    )
    text = "".join(
        f'<body name="body_{k}" pos="{0.3 * k} 0 0.05" quat="{quaternion}"><freejoint/>'
        f'<geom type="mesh" mesh="{mesh}" mass="{mass}" contype="0" conaffinity="0" {more}/></body>'
        for k, (mesh, mass, quaternion) in enumerate(bodies)
    )
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{timestep}" integrator="{integrator}"/><asset>{meshes}</asset>'
        f"<worldbody>{text}</worldbody></mujoco>"
    )


def place(model, data, grains, height=0.01):
    """Bring the lowest point of each body to a height over the grains [m]."""
    mujoco.mj_kinematics(model, data)
    for k, one in enumerate(grains):
        data.qpos[7 * k + 2] = height - one.tool.lowest_point(data.xmat[k + 1].reshape(3, 3))


def run(model, data, grains, seconds):
    """Poses, shape [n, nq], and twists of the first body, shape [n, 6], after each step; its grains' work at each."""
    poses, twists, works = [], [], []
    for _ in range(round(seconds / model.opt.timestep)):
        for one in grains:
            one.apply(data)
        mujoco.mj_step(model, data)
        poses.append(data.qpos.copy())
        twists.append(twist_of(data))
        works.append(model.opt.timestep * (grains[0].wrench @ twists[-1]))
    return np.array(poses), np.array(twists), np.array(works)


def twist_of(data):
    """Of the first body, world axes."""
    return np.concatenate([data.qvel[:3], data.xmat[1].reshape(3, 3) @ data.qvel[3:6]])


def given_back(works):
    """Share of the energy that the grains took."""
    return -works[works > 0.0].sum() / works[works < 0.0].sum()


def scene(*bodies, height=0.01, **options):
    """Model, data, and the grains around each body, which is placed."""
    model = falling(*bodies, **options)
    data, grains = (
        mujoco.MjData(model),
        [MujocoGrains(model, body=f"body_{k}", **GRAINS) for k in range(len(bodies))],
    )
    place(model, data, grains, height)
    return model, data, grains


def dropped(mesh, mass, quaternion, timestep, seconds, **options):
    model, data, grains = scene((mesh, mass, quaternion), timestep=timestep, **options)
    start = data.qpos[2]
    return start - 0.01, *run(model, data, grains, seconds)


def turned(poses):
    """The angle of each pose from the first [degrees]."""
    return np.degrees(2.0 * np.arccos(np.clip(np.abs(poses[:, 3:7] @ poses[0, 3:7]), 0.0, 1.0)))


@pytest.mark.parametrize("draw", [2, 3, 9, 11, 14, 22, 25])
def test_a_body_of_any_mass_that_fell_in_at_any_step_lies_still_and_as_deep_as_at_half_the_step(
    draw,
):
    rng = np.random.default_rng(draw)
    mesh = rng.choice(["plate", "root_tip", "ellipsoid", "sphere"])
    mass, timestep = np.exp(rng.uniform(np.log([0.02, 0.001]), np.log([2.0, 0.016])))
    quaternion = rng.choice([FLAT, TILTED])
    surface, poses, twists, works = dropped(mesh, mass, quaternion, timestep, 5.0)
    late = slice(round(3.0 / timestep), None)
    assert np.ptp(poses[late, :3], axis=0).max() < 1e-8
    assert turned(poses[late]).max() < 1e-3
    assert np.abs(twists[late, :3]).max() < 1e-6
    assert given_back(works) < 0.01
    finer = dropped(mesh, mass, quaternion, 0.5 * timestep, 1.0)[1]
    assert surface - poses[round(1.0 / timestep) - 1, 2] == pytest.approx(
        surface - finer[-1, 2], rel=0.15
    )


@pytest.mark.parametrize("quaternion", [FLAT, TILTED])
def test_a_body_too_heavy_for_45_mm_is_held_where_the_law_says(quaternion):
    """One that falls in stops at about twice the depth at which it could be laid down."""
    model, data, grains = scene(("plate", 5.0, quaternion), timestep=0.005)
    pose = run(model, data, grains, 2.0)[0][-1]
    state = [*pose[:3], *np.roll(pose[3:], -1), 0.0, 0.0, -1.0, 0.0, 0.0, 0.0]
    assert pose[2] < -0.07
    assert 1.0 < wrenches(grains[0].tool.plates, LAW, state)[0, 2] / (5.0 * 9.81) < 3.0


def test_a_body_lies_still_on_a_map_with_slopes():
    x, y = (v.ravel() for v in np.mgrid[-40:40, -40:40] * 0.005 + 0.0025)
    hills = HeightMap.unknown(0.005).with_points(x, y, 0.5 * x + 0.003 * np.sin(100.0 * y))
    model = falling(("plate", 0.3, TILTED), timestep=0.002)
    data, grains = (
        mujoco.MjData(model),
        [MujocoGrains(model, body="body_0", ground=hills, **GRAINS)],
    )
    place(model, data, grains, 0.03)
    poses, twists, works = run(model, data, grains, 2.5)
    assert np.abs(poses[-500:, :3] - poses[-1, :3]).max() < 1e-8
    assert np.abs(twists[-500:]).max() < 1e-6
    assert given_back(works) < 0.01


def test_a_wheel_that_drives_up_a_slope_is_held_by_a_steady_force():
    """Where it touches the grains it hardly moves, and the little slip there has any direction."""
    x, y = (0.02 * np.mgrid[-10:40, -10:10] + 0.01).reshape(2, -1)
    slope = HeightMap.unknown(0.02).with_points(x, y, 0.14 * x)
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody>
        <body name="wheel" pos="0.1 0 0.13"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
        <joint name="axle" axis="0 1 0"/><geom type="cylinder" size="0.1 0.04" euler="90 0 0" mass="3"/></body>
        </worldbody><actuator><velocity joint="axle" kv="10"/></actuator></mujoco>"""
    )
    data, lifts = mujoco.MjData(model), []
    grains = MujocoGrains(model, body="wheel", zeta=0.6, ground=slope)
    data.ctrl[0] = 1.0
    while data.time < 2.0:
        lifts.append(grains.apply(data)[2])
        mujoco.mj_step(model, data)
    assert data.qpos[0] > 0.05
    assert np.array(lifts[500:]) == pytest.approx(3.0 * 9.81, rel=0.1)


def test_a_reset_of_the_data_is_a_new_bed_and_a_state_comes_back():
    model, data, grains = scene(("plate", 0.3, TILTED))
    first = run(model, data, grains, 0.3)[0]
    kept = pickle.dumps((grains[0].state(), data.time, data.qpos.copy(), data.qvel.copy()))
    branch = copy.deepcopy((model, data, grains))
    rest = run(model, data, grains, 0.1)[0]
    assert run(*branch, 0.1)[0].tobytes() == rest.tobytes()
    mujoco.mj_resetData(model, data)
    place(model, data, grains)
    assert run(model, data, grains, 0.3)[0].tobytes() == first.tobytes()
    state, data.time, data.qpos[:], data.qvel[:] = pickle.loads(kept)
    grains[0].restore(state)
    assert run(model, data, grains, 0.1)[0].tobytes() == rest.tobytes()


def test_the_wrench_acts_about_the_body_frame_whatever_its_centre_of_mass():
    # a mesh whose middle lies away from the body frame, and turned in it
    more = 'pos="0.02 0 0.01" quat="0.9 0.3 0 0.1"'
    model, data, (grains,) = scene(("root_tip", 0.3, TILTED), height=-0.02, more=more)
    data.qvel[2] = -0.1
    grains.apply(data)
    mujoco.mj_step(model, data)
    wrench = grains.apply(data)
    assert np.linalg.norm(wrench[3:]) > 1e-3
    want, got = np.zeros(6), np.zeros(6)
    mujoco.mj_applyFT(model, data, wrench[:3], wrench[3:], data.xpos[1], 1, want)
    applied = data.xfrc_applied[1]
    mujoco.mj_applyFT(model, data, applied[:3], applied[3:], data.xipos[1], 1, got)
    assert got == pytest.approx(want, abs=1e-12)


def test_the_mesh_of_the_body_is_the_mesh_of_its_file():
    model = falling(("root_tip", 0.3, FLAT))
    own, file = (
        MujocoGrains(model, body="body_0", tolerance=0.0, mesh=mesh, **GRAINS)
        for mesh in (None, "root_tip")
    )
    assert own.tool.plates.area == pytest.approx(file.tool.plates.area, rel=1e-5)
    assert own.tool.corners.min(axis=0) == pytest.approx(file.tool.corners.min(axis=0), abs=1e-6)


@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("mujoco_drop", ["--seconds", "1", "--timestep", "0.005"]),
        ("mujoco_press", ["--mesh", "sphere"]),
    ],
)
def test_the_examples_run_headless_and_hold_still(tmp_path, capsys, monkeypatch, name, more):
    folder = Path(__file__).resolve().parents[2] / "examples"
    monkeypatch.syspath_prepend(folder)
    main = runpy.run_path(str(folder / f"{name}.py"))["main"]
    main.__globals__["STAY"] = 0.8  # s, of the arm at each place
    assert main(["-o", str(tmp_path / "picture.png"), *more]) == 0
    assert (tmp_path / "picture.png").stat().st_size > 10_000
    printed = capsys.readouterr().out
    moved = [float(x) for x in re.findall(r"(?:moved|scatter) (\S+)", printed)]
    assert sum(x < (0.01 if name == "mujoco_drop" else 1e-3) for x in moved) >= 5, printed  # mm, N


def test_the_example_of_a_bucket_and_a_wheel_digs_and_drives(tmp_path, capsys):
    folder = Path(__file__).resolve().parents[2] / "examples"
    picture = tmp_path / "dig.png"
    assert runpy.run_path(str(folder / "dig.py"))["main"](["-o", str(picture)]) == 0
    assert picture.stat().st_size > 10_000
    force, x = map(
        float, re.search(r"bucket: (\S+) N.*x = (\S+) m", capsys.readouterr().out).groups()
    )
    assert 20.0 < force < 200.0
    assert 0.7 < x < 0.5 + 8.0 * 0.1  # on the slope, with some slip


def test_what_cannot_be_used_is_named(monkeypatch):
    model = falling(("plate", 0.3, FLAT))
    for name in ("tool", 3):
        with pytest.raises(InputError, match=f"body '{name}' is not in the model; it has body_0"):
            MujocoGrains(model, body=name, **GRAINS)
    with pytest.raises(ValueError, match="mobilization_length is 0"):
        MujocoGrains(model, body="body_0", mobilization_length=0.0)
    with pytest.raises(ValueError, match=r"alpha_y\.model 'table' needs"):
        MujocoGrains(model, body="body_0", alpha_y="table", **GRAINS)
    ball = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="ball"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
        "</worldbody></mujoco>"
    )
    with pytest.raises(
        InputError, match=r"body 'ball' has no geoms of .*; give its shape as mesh=FILE"
    ):
        MujocoGrains(ball, body="ball", **GRAINS)
    fixed = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="hand" mocap="true"><geom size="0.02"/></body></worldbody></mujoco>'
    )
    with pytest.raises(InputError, match="body 'hand' has no joint"):
        MujocoGrains(fixed, body="hand", mesh="plate", **GRAINS)
    model, data, (grains,) = scene(("plate", 0.3, FLAT))
    data.qvel[0] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        grains.apply(data)
    with pytest.raises(ValueError, match="data is not of the model"):
        grains.apply(mujoco.MjData(ball))
    with pytest.raises(ValueError, match="other bodies"):
        grains.restore(grains.wrench)
    for name, value in ("mesh", "/absent.stl"), ("stiffness", 0.0), ("timestep", -1.0):
        with pytest.raises(ValueError, match=f"{name}.*{value}"):
            SixAxisArm(**{name: value})
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InputError, match="run pip install mujoco"):
        MujocoGrains(model, body="body_0", **GRAINS)

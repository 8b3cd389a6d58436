"""Grains for a simulator: the kernel's wrench with memory, its stiffness, many bodies, states that come back."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
from scenes import GENERIC

from rft_ros.ground import HeightMap
from rft_ros.rft import Memory, alpha_y_model, checked_states, treers2021, wrenches_in_time
from rft_ros.simulation import Grains, GrainsBatch
from rft_ros.tool import load_tool
from studies.loop import EXPLICIT, held

LENGTH = 0.003
LAW = treers2021(GENERIC, alpha_y_model("linear", GENERIC), zeta=0.33, mobilization_length=LENGTH)


@pytest.fixture(scope="module")
def plate():
    return load_tool("plate", tolerance=0.025)


def pressed(n=120, depth=0.015, drag=0.005, turn=0.1):
    """States of a tool that goes down, then sideways while it turns; shape [n, 13], 10 ms apart."""
    s = np.linspace(0.0, 2.0, n)
    down, along = np.minimum(s, 1.0), np.maximum(s - 1.0, 0.0)
    states = np.zeros((n, 13))
    states[:, 2], states[:, 0] = 0.002 - depth * down, drag * along
    states[:, 5], states[:, 6] = np.sin(0.5 * turn * along), np.cos(0.5 * turn * along)
    states[:, 7:] = np.gradient(np.column_stack([states[:, :3], 0 * s, 0 * s, turn * along]), 0.01, axis=0)
    return states


def stepped(grains, states, dt=0.01):
    return np.array([grains.step(s[:3], s[3:7], s[7:], dt) for s in states])


@pytest.mark.parametrize("law", [LAW, replace(LAW, density=2000.0, inertia=1.0)], ids=["slow", "inertia"])
def test_a_step_gives_the_bytes_of_wrenches_in_time(plate, law):
    states = checked_states(pressed())
    durations, memory = np.full(len(states), 0.01), Memory(plate.plates)
    whole = wrenches_in_time(plate.plates, law, states, durations, memory)
    assert stepped(Grains(plate, law), states).tobytes() == whole[:, :6].tobytes()


def test_neither_the_layout_of_the_states_nor_the_type_of_the_step_counts(plate):
    felt = []
    for order, dt in (("C", 1.0), ("F", 1)):
        grains = GrainsBatch(plate, LAW, bodies=4)
        felt += [[grains.step(np.array(pressed()[k : k + 4], order=order), dt) for k in (30, 34)][-1]]
    assert felt[0].all(axis=0).any()
    assert felt[0].tobytes() == felt[1].tobytes()


def test_bodies_in_one_call_are_as_bodies_alone_over_any_number_of_threads(plate):
    paths = np.stack([pressed(depth=d, drag=g) for d, g in ((0.01, 0.0), (0.015, 0.004), (0.02, -0.004))])
    alone = [stepped(Grains(plate, LAW), path) for path in paths]
    for threads in (1, 2, 3):
        batch = GrainsBatch(plate, LAW, bodies=3, threads=threads)
        together = np.array([batch.step(states, 0.01) for states in paths.swapaxes(0, 1)])
        assert together.swapaxes(0, 1).tobytes() == np.array(alone).tobytes()


def test_threads_on_a_map_with_slopes_change_nothing(plate):
    x, y = (v.ravel() for v in np.mgrid[-40:40, -40:40] * 0.005 + 0.0025)
    hills = HeightMap.unknown(0.005).with_points(x, y, 0.01 * np.sin(20.0 * x) + 0.2 * y)
    path = np.repeat(pressed(n=60)[:, None], 64, axis=1)
    rng = np.random.default_rng(1)
    path[:, :, :2] += rng.uniform(-0.1, 0.1, (64, 2))
    yaw = rng.uniform(-3.0, 3.0, 64)  # or all bodies would have the same corners, in world axes
    path[:, :, 5], path[:, :, 6] = np.sin(0.5 * yaw), np.cos(0.5 * yaw)
    one, two = (GrainsBatch(plate, LAW, bodies=64, ground=hills, threads=threads) for threads in (1, 2))
    assert [two.step(s, 0.01).tobytes() for s in path] == [one.step(s, 0.01).tobytes() for s in path]


def test_the_stiffness_is_what_a_small_motion_changes(plate):
    grains = Grains(plate, LAW)
    states = np.vstack([pressed(), pressed()[-1:]])
    states[-1, :3] += [-2e-5, 0.0, 1e-5]  # off the yield surface, or loading would flow
    states[-1, 7:] = [-2e-3, 0.0, 1e-3, 0.0, 0.0, 0.0]
    before, state, stiffness = stepped(grains, states)[-1], grains.state(), grains.stiffness
    assert np.allclose(stiffness, stiffness.T)
    for axis, size in enumerate([1e-7] * 3 + [2e-6] * 3):
        step = np.zeros(6)
        step[axis] = size
        moved = states[-1].copy()
        moved[:3] += step[:3]
        x, y, z, w = moved[3:7]
        a, b, c = 0.5 * step[3:]
        moved[3:7] = x + w * a + b * z - c * y, y + w * b + c * x - a * z, z + w * c + a * y - b * x, w - c * z
        moved[3:7] /= np.linalg.norm(moved[3:7])
        grains.restore(state)
        grains.step(*np.split(states[-1], [3, 7]), 0.01)  # the pose from which it moves
        change = grains.step(*np.split(moved, [3, 7]), 0.01) - before
        # a plate that begins to lead adds to it, one that lets go takes from it
        assert 0.6 < -(change @ step) / (step @ stiffness @ step) < 1.6, axis


def test_a_state_comes_back_from_a_pickle_and_a_reset_bed_is_new(plate):
    states = pressed()
    grains = Grains(plate, LAW)
    first = stepped(grains, states[:80])
    kept = pickle.loads(pickle.dumps(grains.state()))
    branches = copy.deepcopy(grains), pickle.loads(pickle.dumps(grains)), Grains(plate, LAW)
    branches[2].restore(kept)
    rest = stepped(grains, states[80:])
    for other in branches:
        assert stepped(other, states[80:]).tobytes() == rest.tobytes()
    grains.reset()
    assert stepped(grains, states[:80]).tobytes() == first.tobytes()


def test_one_environment_is_reset_without_the_others(plate):
    states = pressed()[:80]
    batch = GrainsBatch(plate, LAW, bodies=2)
    for state in states:
        batch.step([state, state], 0.01)
    batch.reset([1])
    held, new = batch.step([states[-1], states[-1]], 0.01)
    assert held[2] > 1.0
    assert not new.any()
    kept = batch.state()
    batch.reset([])
    assert batch.state()["memory"].tobytes() == kept["memory"].tobytes()


def test_a_level_map_of_the_ground_is_a_surface_height(plate):
    ground = HeightMap(cell=0.005, corner=(-20.0, -20.0), heights=np.full((40, 40), 0.004, dtype=np.float32))
    states = pressed()
    raised = Grains(plate, LAW, surface_height=float(np.float32(0.004)))
    mapped = Grains(plate, LAW, ground=ground)
    assert np.allclose(stepped(mapped, states), stepped(raised, states), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"position": [0.0, 0.0, np.nan]}, "pz is nan"),
        ({"quaternion": [0.0, 0.0, 0.0, 2.0]}, "norm"),
        ({"twist": [0.0] * 5}, "twist has shape"),
        ({"dt": np.nan}, "dt is nan"),
    ],
)
def test_a_bad_step_is_refused_and_forgotten(plate, change, message):
    grains = Grains(plate, LAW)
    good = {"position": [0.0, 0.0, -0.01], "quaternion": [0, 0, 0, 1], "twist": [0, 0, -0.01, 0, 0, 0], "dt": 0.01}
    grains.step(**good)
    before = pickle.dumps(grains.state())
    with pytest.raises(ValueError, match=message):
        grains.step(**{**good, **change})
    assert pickle.dumps(grains.state()) == before


def test_bad_grains_are_refused(plate):
    with pytest.raises(ValueError, match="mobilization_length of the law is 0"):
        Grains(plate, replace(LAW, mobilization_length=0.0))
    with pytest.raises(TypeError, match="load_tool"):
        Grains("plate", LAW)
    with pytest.raises(TypeError, match="treers2021"):
        Grains(plate, GENERIC)
    for bodies in (0, 1.5, np.nan):
        with pytest.raises(ValueError, match=f"bodies is {bodies}"):
            GrainsBatch(plate, LAW, bodies=bodies)
    with pytest.raises(TypeError, match=r"ground is a str; read one with rft_ros\.ground\.read_height_map"):
        Grains(plate, LAW, ground="bed.csv")
    two, three = (GrainsBatch(plate, LAW, bodies=n) for n in (2, 3))
    with pytest.raises(ValueError, match="3 rows; there are 2 bodies"):
        two.step(pressed()[:3], 0.01)
    for state in (three.state(), None):
        with pytest.raises(ValueError, match="other bodies"):
            two.restore(state)


@pytest.mark.parametrize(
    ("mass", "stiffness", "hold"),
    [(2, 2e3, 0.001), (0.2, 500, 0.001), (0.2, 2e4, 0.001), (2, 2e4, 0.008), (2, 2e3, 0.008), (0.2, 500, 0.008)],
)
def test_an_impedance_arm_holds_still_and_gets_no_work(mass, stiffness, hold):
    """It presses 20 mm deep, drags 20 mm, goes back 10 mm, and stays at each."""
    found = held(mass, stiffness, hold, EXPLICIT)
    assert found["scatter"] < 0.001
    assert found["net"] < 0.0


def test_a_body_that_chatters_is_calmed_and_the_state_keeps_what_was_learned(plate):
    """A plate of 0.5 kg laid on the bed, free to fall, under wrenches held over 5 ms."""
    grains, mass, dt = Grains(plate, LAW), 0.5, 0.005
    x, v, states, held = np.array([0.0, 0.0, 0.0016]), np.zeros(3), [], []
    for k in range(400):
        if k == 200:
            kept = pickle.loads(pickle.dumps(grains.state()))
        states.append(np.array([*x, 0.0, 0.0, 0.0, 1.0, *v, 0.0, 0.0, 0.0]))
        held.append(grains.step(*np.split(states[-1], [3, 7]), dt))
        v = v + dt * (held[-1][:3] / mass - [0.0, 0.0, 9.81])
        x = x + dt * v
    assert np.abs(v).max() < 1e-9
    assert held[-1][2] == pytest.approx(9.81 * mass)
    grains.restore(kept)
    assert stepped(grains, states[200:], dt).tobytes() == np.array(held[200:]).tobytes()
    for step in (1e-300, 1e300):
        assert np.isfinite(grains.step(x, [0, 0, 0, 1], [0, 0, 1, 0, 0, 0], step)).all()


def test_a_sideways_load_below_the_drag_moves_nothing_and_one_above_yields_and_stops():
    """At a depth of 20 mm, where the drag is about 2.5 N."""
    below, above = (held(2.0, 2e3, 0.001, EXPLICIT, load=load) for load in (1.2, 12.0))
    assert below["creep"] < 5e-5
    assert above["yielded"] > 1e-3
    assert above["speed"] < 1e-6

"""Grains for a simulator: the kernel's wrench with memory, its stiffness, many bodies, states that come back."""

import copy
import pickle
import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes import GENERIC

from rft_ros.ground import HeightMap
from rft_ros.rft import (
    Memory,
    Plates,
    alpha_y_model,
    checked_states,
    rotation_matrix,
    treers2021,
    wrenches_in_time,
)
from rft_ros.simulation import Grains, GrainsBatch, free_body
from rft_ros.tool import load_tool

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
    states[:, 7:] = np.gradient(
        np.column_stack([states[:, :3], 0 * s, 0 * s, turn * along]), 0.01, axis=0
    )
    return states


def stepped(grains, states, dt=0.01):
    return np.array([grains.step(s[:3], s[3:7], s[7:], dt) for s in states])


@pytest.mark.parametrize(
    "law", [LAW, replace(LAW, density=2000.0, inertia=1.0)], ids=["slow", "inertia"]
)
def test_a_step_gives_the_bytes_of_wrenches_in_time(plate, law):
    states = checked_states(pressed())
    whole = wrenches_in_time(plate.plates, law, states, Memory(plate.plates))
    assert stepped(Grains(plate, law), states).tobytes() == whole[:, :6].tobytes()


def test_neither_the_layout_of_the_states_nor_the_type_of_the_step_counts(plate):
    felt = []
    for order, dt in (("C", 1.0), ("F", 1)):
        grains = GrainsBatch(plate, LAW, bodies=4)
        felt += [
            [grains.step(np.array(pressed()[k : k + 4], order=order), dt) for k in (30, 34)][-1]
        ]
    assert felt[0].all(axis=0).any()
    assert felt[0].tobytes() == felt[1].tobytes()


def test_threads_on_a_map_with_slopes_change_nothing(plate):
    x, y = (v.ravel() for v in np.mgrid[-40:40, -40:40] * 0.005 + 0.0025)
    hills = HeightMap.unknown(0.005).with_points(x, y, 0.01 * np.sin(20.0 * x) + 0.2 * y)
    path = np.repeat(pressed(n=60)[:, None], 64, axis=1)
    rng = np.random.default_rng(1)
    path[:, :, :2] += rng.uniform(-0.1, 0.1, (64, 2))
    yaw = rng.uniform(-3.0, 3.0, 64)  # or all bodies would have the same corners, in world axes
    path[:, :, 5], path[:, :, 6] = np.sin(0.5 * yaw), np.cos(0.5 * yaw)
    one, two = (
        GrainsBatch(plate, LAW, bodies=64, ground=hills, threads=threads) for threads in (1, 2)
    )
    assert [two.step(s, 0.01).tobytes() for s in path] == [
        one.step(s, 0.01).tobytes() for s in path
    ]


def test_the_stiffness_is_what_a_small_motion_changes(plate):
    grains = Grains(plate, LAW)
    states = np.vstack([pressed(), pressed()[-1:]])
    states[-1, :3] += [-2e-6, 0.0, 1e-6]  # off the yield surface, or loading would flow
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
        moved[3:7] = (
            x + w * a + b * z - c * y,
            y + w * b + c * x - a * z,
            z + w * c + a * y - b * x,
            w - c * z,
        )
        moved[3:7] /= np.linalg.norm(moved[3:7])
        grains.restore(state)
        grains.step(*np.split(states[-1], [3, 7]), 0.01)  # the pose from which it moves
        change = grains.step(*np.split(moved, [3, 7]), 0.01) - before
        # a plate that begins to lead adds to it, one that lets go takes from it: upwards half of it lets go
        assert 0.4 < -(change @ step) / (step @ stiffness @ step) < 1.6, axis


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


def turned_over(tool):
    """The same tool upside down: as many plates, in other places."""
    rows = tool.plates.rows.copy()
    for x in (0, 3, 7, 10):  # of the centroids, normals and corners
        rows[x + 1 : x + 3] *= -1.0
    return replace(tool, plates=Plates(rows))


def test_a_state_of_other_tools_or_of_another_law_is_refused_and_one_of_another_strength_is_taken(
    plate,
):
    states = pressed()
    grains, other_tool = Grains(plate, LAW), Grains(turned_over(plate), LAW)
    other_law = Grains(plate, replace(LAW, density=1500.0))
    strong = Grains(plate, LAW, strength=2.0)
    for one in (grains, other_tool, other_law, strong):
        stepped(one, states[:60])
    before = pickle.dumps(grains.state())
    for one, what in ((other_tool, "other tools"), (other_law, "another law")):
        with pytest.raises(ValueError, match=f"state is of grains with {what}"):
            grains.restore(one.state())
    assert pickle.dumps(grains.state()) == before
    grains.restore(strong.state())
    assert stepped(grains, states[60:]).tobytes() == stepped(strong, states[60:]).tobytes()


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
    good = {
        "position": [0.0, 0.0, -0.01],
        "quaternion": [0, 0, 0, 1],
        "twist": [0, 0, -0.01, 0, 0, 0],
        "dt": 0.01,
    }
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
    with pytest.raises(TypeError, match="law is Medium"):
        Grains(plate, GENERIC)
    for bodies in (0, 1.5, np.nan, 10**9):
        with pytest.raises(ValueError, match=f"bodies is {bodies}"):
            GrainsBatch(plate, LAW, bodies=bodies)
    with pytest.raises(
        TypeError, match=r"ground is a str; read one with rft_ros\.ground\.read_height_map"
    ):
        Grains(plate, LAW, ground="bed.csv")
    hills = HeightMap(cell=0.01, corner=(0.0, 0.0), heights=np.zeros((3, 3)))
    with pytest.raises(ValueError, match="surface_height is of level beds"):
        Grains(plate, LAW, ground=hills, surface_height=0.0)
    two, three = (GrainsBatch(plate, LAW, bodies=n) for n in (2, 3))
    for body in ([], [0, 1]):
        with pytest.raises(ValueError, match=r"body is .* one body"):
            two.tractions(body)
    with pytest.raises(ValueError, match="3 rows; there are 2 bodies"):
        two.step(pressed()[:3], 0.01)
    for state in (three.state(), None):
        with pytest.raises(ValueError, match="other bodies"):
            two.restore(state)


def held(mass, stiffness, hold, *, load=0.0):
    """A critically damped impedance arm presses 20 mm, drags 20 mm, goes back 10 mm, and stays at each for 1.5 s.

    It holds each wrench for a time [s], with an implicit step if this is over 1 ms. Greatest scatter over the holds'
    last 0.4 s over the force; net work of the grains over what they took; with `load` [N] sideways at the first hold
    for 4 s: how far it yields in 0.2 s [m], the creep since [m], the speed then [m/s].
    """
    grains = Grains(load_tool("plate", tolerance=0.025), LAW)
    dt, depth = 0.001, -0.0184
    goals = np.array([[0, 0, 0.003], [0, 0, depth], [0.02, 0, depth], [0.01, 0, depth]])[
        : 2 if load else 4
    ]
    rest = 5.0 if load else 1.5
    ways = np.linalg.norm(np.diff(goals, axis=0), axis=1) / 0.02
    times = np.cumsum([0.0, *(t for path in ways for t in (path, rest))])
    command = np.repeat(goals, [1] + [2] * (len(goals) - 1), axis=0)
    x, v, force, net, took = goals[0].copy(), np.zeros(3), np.zeros(3), 0.0, 0.0
    damping, rows = 2.0 * np.sqrt(mass * stiffness), []
    for k in range(int(times[-1] / dt)):
        goal = np.array([np.interp(k * dt, times, axis) for axis in command.T])
        push = np.array([load if k * dt > times[1] + 1.0 else 0.0, 0.0, 0.0])
        if k % round(hold / dt) == 0:
            known = {}
            if (
                hold > dt
            ):  # as the arm's own spring and damper show it over the time for which the force is held
                one = 1.0 / (mass + hold * damping + hold * hold * stiffness)
                free = one * (stiffness * (goal - x - hold * v) - damping * v + push)
                known = {
                    "inverse_inertia": np.diag([one] * 3 + [0.0] * 3),
                    "free_acceleration": [*free, 0, 0, 0],
                }
            force = grains.step(x, [0.0, 0, 0, 1], [*v, 0, 0, 0], hold, **known)[:3]
        free = v + dt / mass * (stiffness * (goal - x) + force + push)
        v = free / (1.0 + dt * damping / mass + dt * dt * stiffness / mass)
        x = x + dt * v
        work = float(force @ v) * dt
        net, took = net + work, took + max(-work, 0.0)
        rows.append([*force, *x])
    table, scatters = np.array(rows), []
    for end in times[2::2]:
        forces = table[int((end - 0.4) / dt) : int(end / dt), :3]
        scatters.append(
            np.linalg.norm(np.ptp(forces, axis=0)) / np.linalg.norm(forces.mean(axis=0))
        )
    before, after = (table[int((times[1] + wait) / dt), 3:] for wait in (1.0, 1.2))
    yielded, creep, speed = (np.linalg.norm(v) for v in (after - before, x - after, v))
    return {
        "scatter": max(scatters),
        "net": net / took,
        "yielded": yielded,
        "creep": creep,
        "speed": speed,
    }


@pytest.mark.parametrize(
    ("mass", "stiffness", "hold"),
    [(2, 2e3, 0.001), (0.2, 500, 0.008), (2, 2e4, 0.008)],
)
def test_an_impedance_arm_holds_still_and_gets_no_work(mass, stiffness, hold):
    """It presses 20 mm deep, drags 20 mm, goes back 10 mm, and stays at each."""
    found = held(mass, stiffness, hold)
    assert found["scatter"] < 0.001
    assert found["net"] < 0.0


def fallen(grains, mass, dt, seconds):
    """A body laid on the bed, free to move, by the loop of examples/numpy_loop.py; returns states, shape [n, 13]."""
    x, q, v, free = (
        np.array([0, 0, 0.0025]),
        np.array([0.06, 0.04, 0, 0.9974]),
        np.zeros(6),
        -9.81 * np.eye(6)[2],
    )
    states = []
    for _ in range(round(seconds / dt)):
        q = q / np.linalg.norm(q)
        states.append(np.concatenate([x, q, v]))
        response = free_body(mass, mass * np.diag([2.2e-4, 2.2e-4, 4.3e-4]), q)
        w = grains.step(x, q, v, dt, inverse_inertia=response, free_acceleration=free)
        v = v + dt * (free + response @ w)
        x = x + dt * v[:3]
        turn, (qx, qy, qz, qw) = 0.5 * dt * v[3:], q
        q = q + np.array([*(qw * turn + np.cross(turn, [qx, qy, qz])), -turn @ [qx, qy, qz]])
    return np.array(states)


@pytest.mark.parametrize(("mass", "dt"), [(0.02, 0.005), (5.0, 0.002)])
def test_a_free_body_whose_inertia_is_given_comes_to_rest_in_any_simulator(plate, mass, dt):
    grains = Grains(plate, LAW)
    states = fallen(grains, mass, dt, 2.5)
    assert np.abs(states[-round(0.5 / dt) :, :3] - states[-1, :3]).max() < 1e-6
    assert grains.wrench[2] == pytest.approx(9.81 * mass, rel=1e-3)
    assert grains.energy > 0.0


def test_the_inverse_inertia_of_a_free_body_is_about_the_origin_of_its_frame():
    mass, inertia, center = 2.0, np.diag([0.01, 0.02, 0.03]), np.array([0.1, -0.02, 0.05])
    quaternion = np.array([0.1, 0.2, -0.3, 0.927])
    quaternion /= np.linalg.norm(quaternion)
    axes = rotation_matrix(quaternion)
    wrench = np.array([1.0, 2.0, 3.0, 0.4, 0.5, 0.6])
    arm = axes @ center
    turn = np.linalg.solve(axes @ inertia @ axes.T, wrench[3:] - np.cross(arm, wrench[:3]))
    found = free_body(mass, inertia, quaternion, center) @ wrench
    assert found == pytest.approx(np.concatenate([wrench[:3] / mass - np.cross(turn, arm), turn]))


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"mass": np.nan}, "mass"),
        ({"mass": -1.0}, "mass"),
        ({"inertia": np.diag([0.01, np.nan, 0.01])}, "inertia"),
        ({"inertia": np.zeros((3, 3))}, "inertia"),
        ({"inertia": np.diag([0.01, -0.01, 0.01])}, "inertia"),
        ({"inertia": [[0.01, 0.005, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]]}, "inertia"),
        ({"quaternion": [0.0, 0.0, 0.0, 0.0]}, "quaternion"),
        ({"quaternion": [0.0, 0.0, np.nan, 1.0]}, "quaternion"),
        ({"center": [0.0, np.inf, 0.0]}, "center"),
    ],
)
def test_a_free_body_that_cannot_be_is_refused_by_the_name_of_its_number(change, name):
    good = {"mass": 1.0, "inertia": 0.01 * np.eye(3), "quaternion": [0, 0, 0, 1]}
    with pytest.raises(ValueError, match=f"^{name} "):
        free_body(**{**good, **change})


def indefinite(kind):
    """Inverse inertias of bodies with a negative mass, a negative moment, or moved without a cause."""
    inverse = free_body(1.0, 1e-4 * np.eye(3), [0, 0, 0, 1], [0.02, 0.0, 0.01])
    if kind == "mass":
        inverse[:3, :3] *= -1.0
    if kind == "moment":
        inverse[4, 4] *= -1.0
    if kind == "coupling":
        inverse[:3, 3:] *= 3.0
        inverse[3:, :3] *= 3.0
    return inverse


@pytest.mark.parametrize("kind", ["mass", "moment", "coupling"])
def test_a_step_refuses_an_inverse_inertia_that_is_not_positive_and_forgets_nothing(plate, kind):
    batch = GrainsBatch(plate, LAW, bodies=2)
    batch.step(pressed()[:2], 0.01)
    before = pickle.dumps(batch.state())
    good = free_body(1.0, 1e-4 * np.eye(3), [0, 0, 0, 1], [0.02, 0.0, 0.01])
    with pytest.raises(ValueError, match="inverse_inertia of body 1"):
        batch.step(
            pressed()[2:4],
            0.01,
            inverse_inertia=[good, indefinite(kind)],
            free_acceleration=np.zeros(6),
        )
    assert pickle.dumps(batch.state()) == before


def test_a_body_that_cannot_move_in_some_directions_is_stepped(plate):
    batch = GrainsBatch(plate, LAW, bodies=2)
    slide = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0])  # a joint that couples x and y
    for inverse in (np.zeros((6, 6)), np.outer(slide, slide)):
        batch.step(pressed()[50:52], 0.01, inverse_inertia=inverse, free_acceleration=np.zeros(6))
    assert batch.failures == 0


def test_bodies_of_a_batch_have_their_own_strength_height_and_inertia(plate):
    batch = GrainsBatch(
        plate, LAW, bodies=3, strength=[1.0, 0.5, 2.0], surface_height=[0.0, 0.001, 0.0]
    )
    path = pressed()[:70]
    raised = path.copy()
    raised[:, 2] += 0.001
    for k in range(len(path)):
        found = batch.step([path[k], raised[k], path[k]], 0.01)
    assert found[1] == pytest.approx(0.5 * found[0], rel=1e-9)
    assert found[2] == pytest.approx(2.0 * found[0], rel=1e-12)
    other = copy.deepcopy(batch)
    batch.reset([2], strength=0.5, surface_height=0.001)
    for k in range(len(path)):
        again = batch.step([path[k], path[k], raised[k]], 0.01)
    assert again[2] == pytest.approx(found[1], rel=1e-12)
    with pytest.raises(ValueError, match="strength has the value -1"):
        batch.reset([0], strength=-1.0)
    batch.restore(other.state())
    light, heavy = (free_body(mass, mass * 1e-4 * np.eye(3), [0, 0, 0, 1]) for mass in (0.1, 10.0))
    states, free = np.tile(path[-1], (3, 1)), np.array([0, 0, -9.81, 0, 0, 0])
    responses = np.array([light, heavy, heavy])
    found = batch.step(states, 0.01, inverse_inertia=responses, free_acceleration=free)
    assert abs(found[0, 2] - found[1, 2]) > 0.1


def test_tractions_are_the_wrench_plate_by_plate(plate):
    grains = Grains(plate, LAW)
    wrench = stepped(grains, pressed())[-1]
    before = pickle.dumps(grains.state())
    forces = grains.tractions() * plate.plates.areas[:, None]
    assert forces.sum(axis=0) == pytest.approx(wrench[:3], rel=0.01, abs=0.01)
    assert pickle.dumps(grains.state()) == before


def with_a_gap_of_nan(state):
    state["memory"]["gap"] = np.nan
    return state


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda batch: batch.reset([7]), r"bodies is \[7\]; give indices of the 2 bodies"),
        (lambda batch: batch.reset("a"), "bodies is 'a'; give indices"),
        (lambda batch: batch.reset([0.5]), "give indices"),
        (lambda batch: batch.reset([np.nan]), "give indices"),
        (lambda batch: batch.restore(with_a_gap_of_nan(batch.state())), "'memory'.*finite"),
        (
            lambda batch: batch.step(pressed()[:2], 0.01, inverse_inertia=np.eye(6)),
            "free_acceleration is missing",
        ),
        (
            lambda batch: batch.step(
                pressed()[:2], 0.01, inverse_inertia=np.eye(5), free_acceleration=0.0
            ),
            "inverse_inertia",
        ),
        (
            lambda batch: batch.step(
                pressed()[:2], 1e9, inverse_inertia=np.eye(6), free_acceleration=np.ones(6)
            ),
            "dt",
        ),
    ],
)
def test_what_bodies_of_a_batch_cannot_take_is_said(plate, call, message):
    batch = GrainsBatch(plate, LAW, bodies=2)
    before = pickle.dumps(batch.state())
    with pytest.raises(ValueError, match=message):
        call(batch)
    assert pickle.dumps(batch.state()) == before


def test_a_tool_that_leaves_the_map_meets_the_height_of_its_edge(plate):
    ground = HeightMap(
        cell=0.005, corner=(-20.0, -20.0), heights=np.full((40, 40), 0.004, dtype=np.float32)
    )
    raised, mapped = (
        Grains(plate, LAW, surface_height=float(np.float32(0.004))),
        Grains(plate, LAW, ground=ground),
    )
    states = pressed()
    states[60:, 0] += np.linspace(0.0, 1.0, 60)  # the map ends after 0.1 m
    assert np.allclose(stepped(mapped, states), stepped(raised, states), rtol=1e-6, atol=1e-6)


def test_a_sideways_load_below_the_drag_moves_nothing_and_one_above_yields_and_stops():
    """At a depth of 20 mm, where the drag is about 2.5 N."""
    below, above = (held(2.0, 2e3, 0.001, load=load) for load in (1.2, 12.0))
    assert below["creep"] < 2e-5
    assert above["yielded"] > 1e-3
    assert above["speed"] < 1e-6


def example(name):
    return runpy.run_path(str(Path(__file__).resolve().parents[2] / "examples" / f"{name}.py"))[
        "main"
    ]


def test_the_loop_of_ten_lines_comes_to_rest(capsys):
    assert example("numpy_loop")() == 0
    assert "force  4.905 N" in capsys.readouterr().out.splitlines()[-2]


def test_the_environments_of_the_example_are_the_same_again_over_any_number_of_threads(capsys):
    depths = []
    for threads in ("1", "2"):
        assert example("grains_batch")(["--seconds", "0.1", "--threads", threads]) == 0
        rate, depth = capsys.readouterr().out.splitlines()
        assert "steps of environments a second" in rate
        depths.append(depth)
    assert depths[0] == depths[1]

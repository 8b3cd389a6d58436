"""Forces under the refined rule do not jump, with memory or without: a search for jumps between random paths.

Between two paths lies a family of paths. The force at any of their states is a function of one number along the family.
Where it changes most the interval is divided, and divided again: at a jump the change stays, and elsewhere it vanishes.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import AGARWAL, CONSTANT, GENERIC, INERTIAL, LINEAR, facing, seeds, unit

from rft_ros.rft import (
    Memory,
    Plates,
    Table,
    checked_states,
    displacements_followed,
    rotation_matrix,
    treers2021,
    wrenches,
    wrenches_in_time,
)
from rft_ros.rft.memory import MODULUS_FACTOR, PlateState, advance

LENGTH = 0.003
SMALL = 1e-6
"""Of the peak of the force."""

BETA, GAMMA = np.radians(np.arange(-90.0, 271.0, 15.0)), np.radians(np.arange(-180.0, 181.0, 30.0))
TABLE = treers2021(
    GENERIC,
    Table.sampled(BETA, GAMMA, 0.1 + 0.02 * np.cos(BETA)[:, None] + 0.01 * np.sin(GAMMA)),
    zeta=1.0,
)
LAWS = {
    "linear": LINEAR,
    "constant": CONSTANT,
    "table": TABLE,
    "agarwal2023": AGARWAL,
    "inertia": INERTIAL,
}

STEPS = 25


def forces_along(plates, law, paths, slack=0.0):
    """Forces with memory [N], shape [paths, steps, 3], of states of shape [paths, steps, 13]."""
    law = replace(law, mobilization_length=LENGTH)
    forces = []
    for path in paths:
        states = checked_states(path)
        moved = displacements_followed(states, reach=plates.reach, dead_band=slack)
        forces.append(wrenches_in_time(plates, law, states, Memory(plates), displacements=moved))
    return np.array(forces)[:, :, :3]


def between(first, second, parts):
    """The paths at these parts of the way from one path to another."""
    parts = np.asarray(parts)[:, None, None]
    mixed = (1.0 - parts) * first + parts * second
    mixed[..., 3:7] = unit(mixed[..., 3:7])
    return mixed


def largest_jump(plates, law, first, second, slack=0.0):
    """Of the force between two paths, over its peak; 0 where nothing is loaded."""
    parts = np.linspace(0.0, 1.0, 17)
    forces = forces_along(plates, law, between(first, second, parts), slack)
    peak = np.linalg.norm(forces, axis=2).max()
    if peak == 0.0:
        return 0.0
    changes = np.linalg.norm(np.diff(forces, axis=0), axis=2)
    jumps = []
    for step in np.argsort(changes.max(axis=0))[-2:]:
        k = changes[:, step].argmax()
        low, high = parts[k], parts[k + 1]
        while high - low > 1e-13:
            finer = np.linspace(low, high, 9)
            found = forces_along(plates, law, between(first, second, finer)[:, : step + 1], slack)[
                :, step
            ]
            change = np.linalg.norm(np.diff(found, axis=0), axis=1)
            k = change.argmax()
            low, high = finer[k], finer[k + 1]
        jumps.append(change.max() / peak)
    return max(jumps)


def random_body(rng, n):
    corners = 1e-2 * rng.normal(size=(n, 3, 3)) + (
        rng.uniform(-0.03, 0.03, (n, 1, 3)) if n > 1 else 0.0
    )
    return Plates.from_triangles(corners, rng.choice([0.0175, 0.1, 0.5], n))


def submerged_path(rng, normal):
    """Strokes to and fro: along the normal of a plate, along the plate itself, and along other directions; rests."""
    states = np.zeros((STEPS, 13))
    turns = rng.normal(scale=0.05, size=(STEPS, 4)) if rng.random() < 0.5 else np.zeros((STEPS, 4))
    states[:, 3:7] = unit(unit(rng.normal(size=4)) + np.cumsum(turns, axis=0))
    across = rotation_matrix(states[0, 3:7]) @ normal
    ways = np.array(
        [across, unit(np.cross(across, rng.normal(size=3))), *unit(rng.normal(size=(2, 3)))]
    )
    strokes = (
        rng.choice([1.0, -1.0], STEPS)
        * 10.0 ** rng.uniform(-5.5, -2.3, STEPS)
        * (rng.random(STEPS) > 0.1)
    )
    moved = ways[rng.choice(4, STEPS, p=[0.4, 0.3, 0.15, 0.15])] * strokes[:, None]
    states[:, :3] = np.cumsum(moved, axis=0)
    states[:, 2] -= states[:, 2].max() + rng.uniform(0.06, 0.1)
    states[:, 7:10] = moved / 0.01
    return states


def nearby(rng, path):
    other = path.copy()
    other[:, :3] += 3e-4 * np.cumsum(rng.normal(size=(STEPS, 3)), axis=0)
    if rng.random() < 0.5:
        other[:, 3:7] = unit(
            other[:, 3:7] + np.cumsum(rng.normal(scale=0.01, size=(STEPS, 4)), axis=0)
        )
    speed = np.linalg.norm(path[:, 7:10], axis=1)[:, None]
    other[:, 7:10] += 0.1 * rng.normal(size=(STEPS, 3)) * speed  # at rest both are at rest
    return other


@pytest.mark.parametrize("law", LAWS)
@given(seed=seeds, several=st.booleans(), slack=st.sampled_from([0.0, 2e-4]))
@settings(max_examples=12, derandomize=True)
def test_the_force_with_memory_does_not_jump_between_neighbouring_paths(law, seed, several, slack):
    """Plates lead and trail, gaps open and close, and the dead band is left and entered on the way."""
    rng = np.random.default_rng(seed)
    plates = random_body(rng, 20 if several else 1)
    path = submerged_path(rng, plates.normals[:, 0])
    assert largest_jump(plates, LAWS[law], path, nearby(rng, path), slack) < SMALL


@pytest.mark.parametrize("law", LAWS)
@given(seed=seeds)
@settings(max_examples=20, derandomize=True)
def test_the_force_without_memory_does_not_jump_between_states_near_the_surface(law, seed):
    rng = np.random.default_rng(seed)
    plates = random_body(rng, 20)
    first, second = np.zeros((2, 1, 13))
    for state in (first, second):
        state[0, :3] = rng.uniform(-0.02, 0.02, 3)
        state[0, 3:7] = unit(rng.normal(size=4))
        state[0, 7:] = rng.normal(size=6) * ([0.02] * 3 + [0.5] * 3)
    second[0, 3:7] *= np.sign(second[0, 3:7] @ first[0, 3:7])

    def forces(parts):
        return wrenches(plates, LAWS[law], checked_states(between(first, second, parts)[:, 0]))[
            :, :3
        ]

    parts = np.linspace(0.0, 1.0, 65)
    found = forces(parts)
    peak = np.linalg.norm(found, axis=1).max()
    while parts[1] - parts[0] > 1e-13:
        k = np.linalg.norm(np.diff(found, axis=0), axis=1).argmax()
        parts = np.linspace(parts[k], parts[k + 1], 9)
        found = forces(parts)
    assert np.linalg.norm(np.diff(found, axis=0), axis=1).max() <= SMALL * peak


@given(seed=seeds)
@settings(max_examples=300)
def test_one_step_amplifies_no_change_of_motion_normal_law_or_state_by_more_than_8(seed):
    """The bound of docs/method.md, also at singular places: on the yield surface, along the plate, with no gap."""
    rng = np.random.default_rng(seed)
    span, strength, tiny = LENGTH, 1e6, 1e-7
    k = MODULUS_FACTOR * strength / span

    def inwards(vector, n):
        return vector - max(vector @ n, 0.0) * n

    n = unit(rng.normal(size=3))
    past = {
        "tau": inwards(unit(rng.normal(size=3)) * strength * rng.choice([0.0, rng.random()]), n),
        "t": inwards(unit(rng.normal(size=3)) * strength * rng.choice([0.0, 0.3, 1.0]), n),
        "moved": unit(rng.normal(size=3)) * 10.0 ** rng.uniform(-7.0, -2.0),
        "gap": rng.choice([0.0, 1e-6, 1e-4, 1e-3]),
        "n": n,
    }
    along = [n, past["tau"]][rng.integers(2)]
    if rng.random() < 0.5 and along.any():
        past["moved"] = past["moved"] - (past["moved"] @ along) * along / (along @ along)
    past["y"] = np.linalg.norm(past["tau"]) * (1.0 + rng.choice([0.0, 1e-9, 0.5]))
    past["worn"] = rng.choice([0.0, 0.5, rng.random()])
    past["share"] = rng.choice([0.0, 0.5, 1.0, rng.random()])

    def stepped(*, tau, y, gap, worn, n, moved, t, share):
        past = PlateState(*tau, radius=y, gap=gap, worn=worn)
        now, *_ = advance(past, n, moved, share, t, span, strength)
        return np.array(
            [now.tau_x, now.tau_y, now.tau_z, now.radius, k * now.gap, strength * now.worn]
        )

    before, nudge = stepped(**past), tiny * unit(rng.normal(size=3))
    outward = past["moved"] @ n
    beyond = max(-outward - max(-past["tau"] @ n, 0.0) / k, 0.0)
    path = np.linalg.norm(past["moved"])
    kept = 1.0 - min(max(outward, 0.0), past["gap"]) / max(path, 1e-30)
    way = np.linalg.norm(kept * past["moved"] + beyond * n)
    per_metre = k + past["y"] / max(way, 1e-30)
    turned, slid = unit(n + nudge), past["tau"] + strength * nudge
    nudges = {
        "tau": ({"tau": slid, "y": max(past["y"], np.linalg.norm(slid))}, tiny * strength),
        "y": ({"y": past["y"] + tiny * strength}, tiny * strength),
        "t": ({"t": past["t"] + strength * nudge}, tiny * strength),
        "moved": ({"moved": past["moved"] + 1e-3 * nudge}, 1e-3 * tiny * per_metre),
        "gap": ({"gap": past["gap"] + 1e-3 * tiny}, 1e-3 * tiny * per_metre),
        "worn": ({"worn": past["worn"] + tiny}, tiny * strength),
        "share": ({"share": past["share"] + tiny}, tiny * strength),
        "n": (
            {"n": turned},
            tiny * (per_metre * np.linalg.norm(past["moved"]) + np.linalg.norm(past["tau"])),
        ),
    }
    for what, (changed, size) in nudges.items():
        change = np.linalg.norm(stepped(**{**past, **changed}) - before)
        assert change <= 8.0 * size + 1e-12 * strength, (what, change / max(size, 1e-300))


PLATE = facing("refined", [[0.0, 0.0, 0.0]], [[0.0, 0.6, -0.8]])
NORMAL, ALONG = np.array([0.0, 0.6, -0.8]), np.array([0.0, 0.8, 0.6])


def strokes(*legs, start=(0.0, 0.0, -0.04)):
    """States along straight legs [m], each in 20 steps, with the twist of each step."""
    places, moves = [np.array(start)], [np.asarray(legs[0], dtype=float) / 20]
    for leg in legs:
        for _ in range(20):
            moves.append(np.asarray(leg, dtype=float) / 20)
            places.append(places[-1] + moves[-1])
    states = np.zeros((len(places), 13))
    states[:, :3], states[:, 6], states[:, 7:10] = places, 1.0, np.array(moves) / 0.01
    return states


@pytest.mark.parametrize("law", ["linear", "constant", "table", "agarwal2023"])
@given(seed=seeds)
@settings(max_examples=10)
def test_at_rest_the_force_is_held_whatever_direction_a_vanishing_twist_has(law, seed):
    rng = np.random.default_rng(seed)
    path = np.vstack([strokes(0.008 * NORMAL, 0.001 * ALONG), np.zeros((3, 13))])
    path[-3:, :7] = path[-4, :7]
    held = forces_along(PLATE, LAWS[law], path[None])[0]
    path[-2:, 7:10] = 10.0 ** rng.uniform(-12, -2) * rng.normal(size=(2, 3))
    forces = forces_along(PLATE, LAWS[law], path[None])[0]
    np.testing.assert_allclose(held[-3:], held[-4:-3].repeat(3, axis=0), rtol=1e-12)
    np.testing.assert_allclose(forces[-3:], held[-3:], rtol=1e-12)


@pytest.mark.parametrize("rule", ["refined", "centroid"])
@given(seed=seeds, law=st.sampled_from(["linear", "constant", "agarwal2023"]))
@settings(max_examples=12)
def test_a_closed_path_with_rotations_and_changes_of_depth_yields_no_work(rule, seed, law):
    """Six legs in all directions about random attitudes, and back to the first pose: at no time is work gained."""
    rng = np.random.default_rng(seed)
    normals = unit(rng.normal(size=(12, 3)))
    plates = facing(rule, 0.02 * normals, normals)
    legs, turns = np.zeros((2, 8, 3))
    legs[1:7] = np.cumsum(rng.normal(size=(6, 3)) * 10.0 ** rng.uniform(-5, -2, (6, 1)), axis=0)
    turns[1:7] = np.cumsum(rng.normal(size=(6, 3)) * 10.0 ** rng.uniform(-4, -0.7, (6, 1)), axis=0)
    at, corners = np.linspace(0.0, 7.0, 7 * 250 + 1), np.arange(8.0)
    places = np.column_stack([np.interp(at, corners, legs[:, c]) for c in range(3)])
    rotations = np.column_stack([np.interp(at, corners, turns[:, c]) for c in range(3)])
    angles = np.linalg.norm(rotations, axis=1, keepdims=True)
    states = np.zeros((len(at), 13))
    states[:, :3] = places - [0.0, 0.0, 0.1]
    states[:, 3:6] = 0.5 * np.sinc(0.5 * angles / np.pi) * rotations
    states[:, 6] = np.cos(0.5 * angles[:, 0])
    moved = np.diff(places, axis=0)
    spins = np.array([_spin(a, b) for a, b in zip(states[:-1, 3:7], states[1:, 3:7], strict=True)])
    states[1:, 7:10], states[1:, 10:] = moved, spins
    grains = replace(LAWS[law], mobilization_length=LENGTH)
    wrench = wrenches_in_time(plates, grains, checked_states(states), Memory(plates))[:, :6]
    mean = 0.5 * (wrench[1:] + wrench[:-1])
    work = np.cumsum((mean[:, :3] * moved).sum(axis=1) + (mean[:, 3:] * spins).sum(axis=1))
    assert work.max() <= 1e-6 * np.abs(work).max()


def _spin(before, after):
    """The rotation vector from one attitude to the next, world axes; small."""
    x, y, z, w = before
    a, b, c, d = after
    part = np.array(
        [
            w * a - x * d - b * z + c * y,
            w * b - y * d - c * x + a * z,
            w * c - z * d - a * y + b * x,
        ]
    )
    return 2.0 * part

"""What is doubtful about an estimate: the flags that every estimate carries."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from one_plate import SECOND, estimator, plate_model, pose, push, twist, wrench

from rft_ros.estimator import Estimate
from rft_ros.estimator.quality import QualityFlag, Trust, trust
from rft_ros.ground import HeightMap
from rft_ros.tool import load_tool, tool_of_mesh


def last_flags(tool, positions, *, velocity=None, step=0.01, density=0.0, **settings):
    """The quality_flags after these positions, a step of time apart."""
    e = estimator(model=plate_model(tool=tool, density=density), rest_speed=1e-6, **settings)
    positions = np.asarray(positions, dtype=float)
    velocities = np.gradient(positions, step, axis=0) if velocity is None else np.tile(velocity, (len(positions), 1))
    for k, (p, v) in enumerate(zip(positions.tolist(), velocities.tolist(), strict=True)):
        stamp = SECOND + round(k * step * 1e9)
        answer = push(e, twist(stamp, tuple(v)), pose(stamp, tuple(p)))
    assert isinstance(answer, Estimate)
    return QualityFlag(answer.quality_flags)


def straight(length, *, speed=0.01, start=(0.0, 0.0, -0.03), direction=(0.3, 0.1, -1.0)):
    direction = np.asarray(direction) / np.linalg.norm(direction)
    n = round(length / speed / 0.01) + 2
    return np.asarray(start) + np.linspace(0.0, length, n)[:, None] * direction


@pytest.fixture(scope="module")
def root():
    return load_tool("root_tip")


def test_slow_straight_motion_of_a_convex_tool_has_no_flag_nor_has_any_speed_above_the_grains(root):
    assert last_flags(root, straight(0.15)) == QualityFlag.NONE
    assert trust(QualityFlag.NONE) is Trust.OK
    assert last_flags(root, straight(0.1, speed=1.0, start=(0, 0, 1.0), direction=(1, 0, 0))) == QualityFlag.NONE


FASTER = QualityFlag.FAST | QualityFlag.INERTIAL


@pytest.mark.parametrize(
    ("speed", "density", "quality_flags", "how_far"),
    [
        (0.02, 0.0, QualityFlag.NONE, Trust.OK),
        (0.05, 0.0, QualityFlag.FAST, Trust.CAUTION),
        (0.3, 0.0, FASTER, Trust.NO),
        (4e-6, 0.0, QualityFlag.NEAR_REST, Trust.CAUTION),
        (0.05, 1500.0, QualityFlag.NONE, Trust.OK),
        (0.99, 1500.0, QualityFlag.NONE, Trust.OK),
        (1.1, 1500.0, FASTER, Trust.NO),
    ],
)
def test_speed_beyond_what_was_measured_or_with_a_density_simulated_is_flagged(
    root, speed, density, quality_flags, how_far
):
    still, velocity = np.tile([0.0, 0.0, -0.05], (20, 1)), (0.3 * speed, 0.1 * speed, -0.94 * speed)
    found = last_flags(root, still, velocity=velocity, density=density)
    assert found == quality_flags
    assert trust(found) is how_far


def test_a_helix_of_small_pitch_passes_its_own_wake(root):
    depth = np.linspace(0.0, 0.05, 600)
    for pitch, radius, passes in ((0.012, 0.006, True), (0.04, 0.003, False), (0.167, 0.003, False)):
        turn = 2.0 * np.pi * depth / pitch
        helix = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), -0.04 - depth])
        assert (QualityFlag.WAKE in last_flags(root, helix)) == passes


def test_turning_back_passes_the_wake_until_the_tool_is_out(root):
    down = straight(0.08, direction=(0, 0, -1))
    assert QualityFlag.WAKE in last_flags(root, np.concatenate([down, down[::-1]])[:-20])
    out_and_aside = np.concatenate([down, down[::-1], [[0, 0, 0.2]], straight(0.05, start=(0, 0, -0.03))])
    assert QualityFlag.WAKE not in last_flags(root, out_and_aside)


def test_a_recording_played_again_does_not_cross_the_wake_of_its_first_run(root):
    e = estimator(model=plate_model(tool=root), rest_speed=1e-6)
    for run in (2, 1):
        for k, place in enumerate(straight(0.08, direction=(0, 0, -1)).tolist()):
            stamp = run * 100 * SECOND + 10_000_000 * k
            assert not push(e, twist(stamp), pose(stamp, tuple(place))).quality_flags & QualityFlag.WAKE


@pytest.mark.parametrize("rule", ["centroid", "refined"])
def test_faces_that_move_along_themselves_are_flagged(rule):
    still = np.tile([0.0, 0.0, -0.05], (10, 1))
    plate = load_tool("plate", integration=rule)
    assert QualityFlag.KNIFE_EDGE in last_flags(plate, still, velocity=(0.01, 0.0, 0.0))
    assert QualityFlag.KNIFE_EDGE not in last_flags(plate, still, velocity=(0.0098, 0.0, -0.002))
    straight_down = last_flags(plate, still, velocity=(0.0, 0.0, -0.01))  # its narrow sides are not flagged
    assert straight_down & ~QualityFlag.MESH == QualityFlag.NONE


@pytest.mark.parametrize("pauses", [(), (400,), (400, 401, 405)])
def test_a_tool_that_rises_is_flagged_and_sigma_covers_what_the_grains_held_also_after_pauses(root, pauses):
    e, answers, stamp = estimator(model=plate_model(tool=root)), [], SECOND
    for k, height in enumerate([*np.linspace(0.0, -0.05, 400), *np.linspace(-0.0501, -0.01, 300)]):
        speeds = [-0.01 if k < 400 else 0.01]
        if k in pauses:
            speeds = [*[0.0] * 50, *speeds]
        for speed in speeds:
            stamp += 10_000_000
            answer = push(e, twist(stamp, (0.0, 0.0, speed)), pose(stamp, (0.0, 0.0, height)))
        answers.append(answer)
    down, up = answers[:400], answers[400:]
    assert not any(a.quality_flags & QualityFlag.WITHDRAWAL for a in down)
    assert all(a.quality_flags & QualityFlag.WITHDRAWAL for a in up)
    assert trust(up[0].quality_flags) is Trust.CAUTION
    held, first = down[-1].predicted[2], up[0]
    assert held > 1.0 > first.predicted[2]
    assert abs(held - first.predicted[2]) < first.sigma[2] < 1.5 * abs(held - first.predicted[2])
    for later in up[50:]:  # then nothing holds the tool
        assert abs(later.predicted[2]) < later.sigma[2] < 2.0 * abs(later.predicted[2]) + 0.2


def pressed(factors, *, offset=0.0, surface=0.0):
    """The flags after one plate was pressed 0.1 mm a pose into grains of these strengths; `offset` of the cell [N]."""
    e = estimator(learning_mode="observe", surface_height=surface)
    for k, factor in enumerate(factors):
        stamp, depth = SECOND + 10_000_000 * k, 1e-4 * k
        force = offset + factor * 400.0 * max(depth + surface, 0.0)
        answer = push(e, wrench(stamp, (0, 0, force, 0, 0, 0)), twist(stamp), pose(stamp, (0.0, 0.0, -depth)))
    return QualityFlag(answer.quality_flags)


def on_ground(height_of_x):
    """The flags of the plate 1 cm deep in ground of this height over x."""
    axis = 0.004 * (np.arange(-30, 30) + 0.5)
    x, y = (v.ravel() for v in np.meshgrid(axis, axis, indexing="ij"))
    ground = HeightMap.unknown(0.004).with_points(x, y, height_of_x(x))
    e = estimator(model=replace(plate_model(), ground=ground))
    return QualityFlag(push(e, twist(), pose()).quality_flags)


def mesh(made):
    return tool_of_mesh(made, name="made")


def open_box():
    box = trimesh.creation.box((0.02, 0.02, 0.02))
    box.update_faces(np.arange(len(box.faces)) > 1)
    return mesh(box)


def moving(tool, velocity, **settings):
    """The flags of a tool 5 cm deep that moves at this velocity [m/s]."""
    return last_flags(tool, np.tile([0.0, 0.0, -0.05], (10, 1)), velocity=velocity, **settings)


ASLANT = np.array([0.3, 0.1, -0.94])
DOWN = straight(0.08, direction=(0, 0, -1))
SCENES = {
    QualityFlag.FAST: lambda root: moving(root, 0.05 * ASLANT),
    QualityFlag.INERTIAL: lambda root: moving(root, 0.3 * ASLANT),
    QualityFlag.NEAR_REST: lambda root: moving(root, 4e-6 * ASLANT),
    QualityFlag.WAKE: lambda root: last_flags(root, np.concatenate([DOWN, DOWN[::-1]])[:-20]),
    QualityFlag.CONCAVE: lambda _: last_flags(mesh(trimesh.creation.annulus(0.01, 0.02, 0.03)), straight(0.05)),
    QualityFlag.WITHDRAWAL: lambda root: last_flags(root, straight(0.01, direction=(0, 0, 1))),
    QualityFlag.KNIFE_EDGE: lambda _: moving(load_tool("plate"), (0.01, 0.0, 0.0)),
    QualityFlag.DEEP: lambda root: moving(root, 0.01 * ASLANT, calibrated_depth=0.01),
    QualityFlag.SURPRISE: lambda _: pressed([1.0] * 300 + [3.0] * 30),
    QualityFlag.STEEP: lambda _: on_ground(lambda x: 0.3 * x),
    QualityFlag.UNEVEN: lambda _: on_ground(lambda x: np.where(np.abs(x) < 0.006, 0.01, -0.01)),
    QualityFlag.DISAGREEMENT: lambda _: pressed([1.0] * 180, offset=3.0, surface=-0.02),
    QualityFlag.MESH: lambda _: last_flags(open_box(), straight(0.01)),
    QualityFlag.NOISY: lambda root: last_flags(
        root, straight(0.05) + np.random.default_rng(0).normal(0.0, 1e-4, (502, 3)), velocity=0.01 * ASLANT
    ),
    QualityFlag.IMPOSSIBLE: lambda root: last_flags(root, [[0.0, 0.0, -30.0]] * 2, velocity=(0.0, 0.0, -0.01)),
}
"""For each flag a scene, given the root tip, after which it is set."""


def test_every_flag_has_a_scene():
    assert SCENES.keys() == {flag for flag in QualityFlag if flag}


@pytest.mark.parametrize("flag", SCENES, ids=lambda flag: flag.label)
def test_the_scene_of_a_flag_sets_it(root, flag):
    assert flag in SCENES[flag](root)


def test_the_page_of_failures_names_the_flag_of_every_place_and_every_flag():
    page = (Path(__file__).parents[2] / "docs" / "where-it-fails.md").read_text().partition("\n## When inputs fail")[0]
    head, *places = page.split("\n## ")
    assert [place.partition("\n")[0] for place in places if not re.search(r"Flags?:\s(none|`)", place)] == []
    said = [head, *(place.partition("Flag")[2] for place in places)]
    assert {f.name.lower() for f in QualityFlag if f} <= set(re.findall(r"`(\w+)`", " ".join(said)))


def test_the_calibrations_own_depth_give_or_take_its_rounding_is_not_beyond_it(root):
    positions = np.tile([0.0, 0.0, -0.1], (20, 1))
    lowest = 0.1 - root.lowest_point(np.eye(3))
    for times, flag in ((1.0, QualityFlag.NONE), (1.01, QualityFlag.NONE), (1.03, QualityFlag.DEEP)):
        found = last_flags(root, positions, velocity=(0.0, 0.0, -0.01), calibrated_depth=lowest / times)
        assert found == flag

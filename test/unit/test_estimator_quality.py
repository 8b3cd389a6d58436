"""What is doubtful about an estimate: the flags that every estimate carries."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from one_plate import SECOND, estimator, plate_model, pose, push, twist, wrench

from rft_ros.estimator import Estimate, QualityFlag, Trust, trust
from rft_ros.ground import HeightMap
from rft_ros.tool import load_tool, tool_of_mesh


def last_flags(tool, positions, *, velocity=None, step=0.01, density=0.0, **values):
    """The quality_flags after these positions, a step of time apart."""
    e = estimator(model=plate_model(tool=tool, density=density), rest_speed=1e-6, **values)
    positions = np.asarray(positions, dtype=float)
    velocities = (
        np.gradient(positions, step, axis=0)
        if velocity is None
        else np.tile(velocity, (len(positions), 1))
    )
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


def pressed(factors, *, offset=0.0, surface=0.0):
    """The flags after one plate was pressed 0.1 mm a pose into grains of these strengths; `offset` of the cell [N]."""
    e = estimator(learning_mode="observe", surface_height=surface)
    for k, factor in enumerate(factors):
        stamp, depth = SECOND + 10_000_000 * k, 1e-4 * k
        force = offset + factor * 400.0 * max(depth + surface, 0.0)
        answer = push(
            e, wrench(stamp, (0, 0, force, 0, 0, 0)), twist(stamp), pose(stamp, (0.0, 0.0, -depth))
        )
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


def each_plate(velocity):
    """The flags that the plate has with either integration, but for the one of its mesh."""
    both = [
        moving(load_tool("plate", integration=rule), velocity) & ~QualityFlag.MESH
        for rule in ("centroid", "refined")
    ]
    assert both[0] == both[1]
    return both[0]


def moving(tool, velocity, **values):
    """The flags of a tool 5 cm deep that moves at this velocity [m/s]."""
    return last_flags(tool, np.tile([0.0, 0.0, -0.05], (10, 1)), velocity=velocity, **values)


def rod():
    """20 mm thick and 50 mm long."""
    return mesh(trimesh.creation.box((0.02, 0.02, 0.05)))


def on_grains(*, diameter):
    """The flags of the rod in grains of this diameter [m]."""
    return moving(rod(), 0.02 * ASLANT, medium_grain_diameter=diameter)


def at_froude(number):
    """The flags of the rod at this Froude number of its thickness."""
    return moving(rod(), number * np.sqrt(9.81 * 0.02) * ASLANT)


def at_depth(root, depth, **values):
    """The flags of a tool that goes down with its lowest point at this depth [m]."""
    height = -depth - root.lowest_point(np.eye(3))
    return last_flags(root, [[0.0, 0.0, height]] * 20, velocity=(0.0, 0.0, -0.01), **values)


ASLANT = np.array([0.3, 0.1, -0.94])
DOWN = straight(0.08, direction=(0, 0, -1))
UP_AND_OUT = np.concatenate([DOWN, DOWN[::-1], [[0, 0, 0.2]], straight(0.05, start=(0, 0, -0.03))])
NOISE = np.random.default_rng(0).normal(0.0, 1e-4, (502, 3))
SCENES = {
    "slow and straight": (QualityFlag.NONE, lambda root: last_flags(root, straight(0.15))),
    "1 m/s above the grains": (
        QualityFlag.NONE,
        lambda root: last_flags(root, straight(0.1, speed=1.0, start=(0, 0, 1.0))),
    ),
    "20 mm/s": (QualityFlag.NONE, lambda root: moving(root, 0.02 * ASLANT)),
    "50 mm/s": (QualityFlag.FAST, lambda root: moving(root, 0.05 * ASLANT)),
    "0.3 m/s": (QualityFlag.FAST | QualityFlag.INERTIAL, lambda root: moving(root, 0.3 * ASLANT)),
    "0.99 m/s with a density": (
        QualityFlag.NONE,
        lambda root: moving(root, 0.99 * ASLANT, density=1500.0),
    ),
    "1.1 m/s with a density": (
        QualityFlag.FAST | QualityFlag.INERTIAL,
        lambda root: moving(root, 1.1 * ASLANT, density=1500.0),
    ),
    "4 um/s": (QualityFlag.NEAR_REST, lambda root: moving(root, 4e-6 * ASLANT)),
    "turned back": (
        QualityFlag.WITHDRAWAL,
        lambda root: last_flags(root, np.concatenate([DOWN, DOWN[::-1]])[:-20]),
    ),
    "out, and down aside": (QualityFlag.NONE, lambda root: last_flags(root, UP_AND_OUT)),
    "hollow": (
        QualityFlag.CONCAVE,
        lambda _: last_flags(mesh(trimesh.creation.annulus(0.01, 0.02, 0.03)), straight(0.05)),
    ),
    "plates along themselves": (QualityFlag.NONE, lambda _: each_plate((0.01, 0.0, 0.0))),
    "plates aslant": (QualityFlag.NONE, lambda _: each_plate((0.0098, 0.0, -0.002))),
    "plates straight down": (QualityFlag.NONE, lambda _: each_plate((0.0, 0.0, -0.01))),
    "as deep as calibrated": (
        QualityFlag.NONE,
        lambda root: at_depth(root, 0.1, medium_calibrated_depth=0.1),
    ),
    "deeper by rounding": (
        QualityFlag.NONE,
        lambda root: at_depth(root, 0.101, medium_calibrated_depth=0.1),
    ),
    "deeper": (QualityFlag.DEEP, lambda root: at_depth(root, 0.103, medium_calibrated_depth=0.1)),
    "softer grains learned": (QualityFlag.SURPRISE, lambda _: pressed([1.0] * 300 + [3.0] * 30)),
    "a tool five grains wide": (QualityFlag.NONE, lambda _: on_grains(diameter=0.0039)),
    "a tool under five grains wide": (
        QualityFlag.FEW_GRAINS,
        lambda _: on_grains(diameter=0.0041),
    ),
    "a Froude number of 0.45": (
        QualityFlag.FAST | QualityFlag.INERTIAL,
        lambda _: at_froude(0.45),
    ),
    "a Froude number of 0.35": (QualityFlag.FAST, lambda _: at_froude(0.35)),
    "a slope of 0.2": (QualityFlag.NONE, lambda _: on_ground(lambda x: 0.2 * x)),
    "a slope of 0.3": (QualityFlag.STEEP, lambda _: on_ground(lambda x: 0.3 * x)),
    "a narrow crest": (
        QualityFlag.UNEVEN,
        lambda _: on_ground(lambda x: np.where(np.abs(x) < 0.006, 0.01, -0.01)),
    ),
    "a cell not tared": (
        QualityFlag.DISAGREEMENT,
        lambda _: pressed([1.0] * 180, offset=3.0, surface=-0.02),
    ),
    "an open mesh": (QualityFlag.MESH, lambda _: last_flags(open_box(), straight(0.01))),
    "noisy poses": (
        QualityFlag.NOISY,
        lambda root: last_flags(root, straight(0.05) + NOISE, velocity=0.01 * ASLANT),
    ),
    "30 m deep": (QualityFlag.IMPOSSIBLE, lambda root: at_depth(root, 30.0)),
}
"""For each scene the flags that are set after it, and a function that plays it with the root tip. The rest is unset."""


def test_every_flag_has_a_scene():
    scene_flags = QualityFlag.NONE
    for flags, _ in SCENES.values():
        scene_flags |= flags
    assert [flag for flag in QualityFlag if flag not in scene_flags] == []


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_sets_its_flags_and_no_other(root, name):
    flags, play = SCENES[name]
    assert play(root) == flags


def test_a_flag_lowers_the_trust_and_one_of_a_force_that_cannot_be_ends_it():
    assert [
        trust(flags)
        for flags in (QualityFlag.NONE, QualityFlag.FAST, QualityFlag.FAST | QualityFlag.INERTIAL)
    ] == [Trust.OK, Trust.CAUTION, Trust.NO]


@pytest.mark.parametrize("pauses", [(), (400,), (400, 401, 405)])
def test_a_tool_that_rises_is_flagged_and_sigma_covers_what_the_grains_held_also_after_pauses(
    root, pauses
):
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


def test_the_page_of_failures_names_the_flag_of_every_place_and_every_flag():
    page = (
        (Path(__file__).parents[2] / "docs" / "where-it-fails.md")
        .read_text()
        .partition("\n## When inputs fail")[0]
    )
    head, *places = page.split("\n## ")
    assert [
        place.partition("\n")[0] for place in places if not re.search(r"Flags?:\s(none|`)", place)
    ] == []
    said = [head, *(place.partition("Flag")[2] for place in places)]
    assert {f.name.lower() for f in QualityFlag if f} <= set(
        re.findall(r"`(\w+)`", " ".join(said))
    )

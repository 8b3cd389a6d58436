"""What restarts when: a table of changes and parts of the estimator's state, checked on a real estimator."""

import math
from dataclasses import replace

import numpy as np
import pytest
from one_plate import (
    MS,
    SECOND,
    START,
    estimator,
    plate_model,
    plate_tool,
    pose,
    push,
    twist,
    wrench,
)

from rft_ros.estimator.run import RESTARTS, Change
from rft_ros.ground import Cloud, HeightMap
from rft_ros.parameters import LoadCell

MODEL = replace(plate_model(mobilization_length=0.003), ground=HeightMap.unknown(0.004))

MOTION = {"jumps", "pose", "state", "poses", "pace", "kinematics", "mapper", "surface", "place"}
TOOL = {"step", "withdrawal", "quality", "unseen", "air", "footing"}
COMPARED = {"pending", "last_raw"}
TABLE = {
    "a jump back in time": {*MOTION, *TOOL, *COMPARED, "pose_stamp"},
    "another world_frame": {*MOTION, *TOOL, *COMPARED, "twists", "readings"},
    "another tool_frame": {*MOTION, *TOOL, "twists"},
    "another tool": {*TOOL, "place"},
    "another map": {"mapper", "surface", "place"},
    "a levelled map": {"mapper", "surface", "place"},
    "another surface_height": {"surface", "place"},
    "another zeta": {"learning"},
    "a law without memory": {"learning", "step"},
    "a known zeta_error": {"learning"},
    "no learning": {"learning"},
    "a forgotten strength": {"learning"},
    "another bias": {"air"},
    "another delay": {*COMPARED, "air", "readings"},
    "another sensor_frame": {*COMPARED, "readings"},
    "readings in world axes": {*COMPARED, "readings"},
    "another max_rate": {"pace"},
    "observe in place of apply, another lag": set(),
    "another max_input_age": set(),
    "the same parts of a model, another generation": set(),
}
"""For each change, the parts of `Run` that begin anew; `place`: of `learning`, all but the strength."""


def of_settings(**values):
    return lambda e: e.use(settings=replace(e.settings, **values))


def of_model(**values):
    return lambda e: e.use(model=replace(e.model, **values))


CHANGES = {
    "a jump back in time": lambda e: push(e, pose(START - 10 * SECOND)),
    "another world_frame": of_settings(world_frame="base"),
    "another tool_frame": of_settings(tool_frame="blade"),
    "another tool": of_model(tool=plate_tool()),
    "another map": of_model(ground=HeightMap.unknown(0.004)),
    "a levelled map": lambda e: e.level_ground(),
    "another surface_height": of_settings(surface_height=0.001),
    "another zeta": of_model(law=replace(MODEL.law, zeta=2.0)),
    "a law without memory": of_model(law=replace(MODEL.law, mobilization_length=0.0)),
    "a known zeta_error": of_settings(zeta_error=0.1),
    "no learning": of_settings(learning_mode="off"),
    "a forgotten strength": lambda e: e.forget(),
    "another bias": of_settings(load_cell=LoadCell(bias=(1.0,) * 6)),
    "another delay": of_settings(load_cell=LoadCell(delay=0.01)),
    "another sensor_frame": of_settings(sensor_frame="other"),
    "readings in world axes": of_settings(sensor_source="world"),
    "another max_rate": of_settings(max_rate=1000.0),
    "observe in place of apply, another lag": of_settings(
        learning_mode="observe", learning_lag=0.005
    ),
    "another max_input_age": of_settings(max_input_age=0.2),
    "the same parts of a model, another generation": lambda e: e.use(
        settings=replace(e.settings), model=replace(MODEL, generation=1)
    ),
}


def pressed():
    """An estimator whose tool was pushed 15 mm into grains that are harder than the model's."""
    e = estimator(model=MODEL, learning_mode="apply", twist_source="topic")
    push(
        e,
        Cloud(
            START,
            "world",
            *(0.001 * np.indices((20, 20)).reshape(2, -1) - 0.01),
            np.full(400, 0.002),
        ),
    )
    for k in range(150):
        stamp, depth = START + 10 * k * MS, 1e-4 * k
        force = (0.0, 0.0, 640.0 * depth + 1.0, 0.0, 0.0, 0.0)
        push(e, wrench(stamp, force), twist(stamp), pose(stamp, (0.0, 0.0, -depth)))
    return e


@pytest.mark.parametrize("change", TABLE)
def test_a_change_restarts_the_parts_of_the_table_and_no_other(change):
    e = pressed()
    before = {name: getattr(e.run, name) for name in RESTARTS}
    strength, place = e.learning.strength(), e.learning.belief().surface
    assert place != 0.0
    CHANGES[change](e)
    restarted = {name for name, value in before.items() if getattr(e.run, name) is not value}
    if e.learning is before["learning"]:
        assert e.learning.strength() == strength
        restarted |= {"place"} if e.learning.belief().surface == 0.0 else set()
    elif e.learning is not None:
        assert e.learning.strength() is None
    assert restarted == TABLE[change]


def test_each_change_restarts_something_and_each_part_but_the_inputs_ends_with_a_jump_of_time():
    assert all(any(change & when for when in RESTARTS.values()) for change in Change)
    assert {name for name, when in RESTARTS.items() if not when & Change.RUN} == {
        "twists",
        "readings",
        "learning",
    }


def test_after_a_change_of_everything_the_estimator_answers_as_a_new_one():
    """Another frame, map and law: nothing of the old ones is left in any number."""
    model = replace(
        plate_model(zeta=0.5, mobilization_length=0.002), ground=HeightMap.unknown(0.002)
    )
    others = {
        "world_frame": "base",
        "sensor_frame": "other",
        "learning_mode": "observe",
        "max_rate": 60.0,
    }

    def answers(e):
        found = []
        for k in range(120):
            stamp, depth = START + 5 * SECOND + 10 * k * MS, 2e-4 * k
            place = pose(stamp, (1e-4 * k, 0.0, -depth), frame="base")
            felt = wrench(stamp, (0.0, 0.0, 500.0 * depth, 0.0, 0.0, 0.0), frame="other")
            found.append(push(e, felt, twist(stamp, (0.01, 0.0, -0.02), frame="base"), place))
        e.finish()
        return found, e.measurements(), e.depth(), e.learning.belief()

    e = pressed()
    e.finish()
    e.measurements()
    e.use(settings=replace(e.settings, **others), model=model)
    assert math.isnan(e.depth())
    assert answers(e) == answers(estimator(model=model, **others))

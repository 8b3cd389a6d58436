"""What ends when: a table of changes and the values of the estimator's state, checked on a real estimator."""

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
    use,
    wrench,
)

from rft_ros.estimator import GRAVITY, OFFSET_SENTENCE, TransformSample
from rft_ros.estimator.lifetimes import PLACE, TABLE, Change
from rft_ros.ground import Cloud, HeightMap
from rft_ros.parameters import LoadCell

MODEL = replace(plate_model(mobilization_length=0.003), ground=HeightMap.unknown(0.004))

ALL_OF_MOTION = {"motion", "ground", "contact", "air", "place"}
TABLE_OF_CHANGES = {
    "a jump back in time": ALL_OF_MOTION,
    "another world_frame": {*ALL_OF_MOTION, "twists", "readings"},
    "another tool_frame": {*ALL_OF_MOTION, "twists", "readings"},
    "another tool": {"contact", "air", "place"},
    "another map": {"ground", "place"},
    "a levelled map": {"ground", "place"},
    "another surface_height": {"place"},
    "another zeta": {"learning"},
    "a law without memory": {"learning", "contact"},
    "a known zeta_error": {"learning"},
    "no learning": {"learning"},
    "a forgotten strength": {"learning"},
    "another bias": {"air"},
    "another delay": {"air", "readings"},
    "another sensor_frame": {"readings"},
    "readings in world axes": {"readings"},
    "another max_rate": set(),
    "observe in place of apply, another lag": set(),
    "another max_input_age": set(),
    "the same parts of a model, another generation": set(),
}
"""For each change, the values of `Lifetimes` that end; `place`: of `learning`, all but the strength."""


def of_config(**values):
    return lambda e: use(e, **values)


def of_model(**values):
    return lambda e: e.use(model=replace(e.model, **values))


CHANGES = {
    "a jump back in time": lambda e: push(e, pose(START - 10 * SECOND)),
    "another world_frame": of_config(world_frame="base"),
    "another tool_frame": of_config(tool_frame="blade"),
    "another tool": of_model(tool=plate_tool()),
    "another map": of_model(ground=HeightMap.unknown(0.004)),
    "a levelled map": lambda e: e.level_ground(),
    "another surface_height": of_config(surface_height=0.001),
    "another zeta": of_model(law=replace(MODEL.law, zeta=2.0)),
    "a law without memory": of_model(law=replace(MODEL.law, mobilization_length=0.0)),
    "a known zeta_error": of_config(medium_zeta_error=0.1),
    "no learning": of_config(learning_mode="off"),
    "a forgotten strength": lambda e: e.forget(),
    "another bias": of_config(sensor=LoadCell(bias=(1.0,) * 6)),
    "another delay": of_config(sensor=LoadCell(delay=0.01)),
    "another sensor_frame": of_config(sensor_frame="other"),
    "readings in world axes": of_config(sensor_frame_source="world"),
    "another max_rate": of_config(max_rate=1000.0),
    "observe in place of apply, another lag": of_config(
        learning_mode="observe", learning_lag=0.005
    ),
    "another max_input_age": of_config(max_input_age=0.2),
    "the same parts of a model, another generation": lambda e: e.use(
        config=replace(e.config), model=replace(MODEL, generation=1)
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


def values_of(e):
    return {name: getattr(e._lifetimes, name) for name in TABLE}


@pytest.mark.parametrize("change", TABLE_OF_CHANGES)
def test_a_change_makes_anew_what_it_ends_and_nothing_else(change):
    e = pressed()
    before = values_of(e)
    strength, place = e.learning.strength(), e.learning.belief().surface
    assert place != 0.0
    CHANGES[change](e)
    ended = {name for name, value in values_of(e).items() if value is not before[name]}
    if e.learning is before["learning"]:
        assert e.learning.strength() == strength
        ended |= {"place"} if e.learning.belief().surface == 0.0 else set()
    elif e.learning is not None:
        assert e.learning.strength() is None
    assert ended == TABLE_OF_CHANGES[change]


def test_a_jump_of_the_poses_keeps_the_samples_of_the_new_run_and_drops_the_others():
    e = pressed()
    earlier = START - 10 * SECOND
    push(e, wrench(earlier, (1.0,) * 6), twist(earlier), pose(earlier))
    assert [reading.stamp for reading in e._lifetimes.readings.samples] == [earlier]
    assert [sample.stamp for sample in e._lifetimes.twists] == [earlier]


def test_each_change_ends_something_and_each_value_ends():
    ends = [value.ends_with for value in TABLE.values()]
    assert all(any(change & when for when in [*ends, PLACE]) for change in Change)
    assert all(ends)


def test_a_change_of_the_surface_height_makes_nothing_anew_that_takes_time(monkeypatch):
    """No value of `Lifetimes` is made: making all took 8 ms in the thread that answers the poses."""
    e = pressed()
    for name, value in TABLE.items():
        monkeypatch.setitem(TABLE, name, value._replace(made=None))
    use(e, surface_height=0.001)
    assert e.config.surface_height == 0.001


def resting_in_air(fixed_place, **parameters):
    """An estimator with a load cell by transforms or parameters, whose tool rests in the air under its weight."""
    e = estimator(
        twist_source="topic",
        sensor=LoadCell(mass=1.0, **parameters),
        sensor_frame_source="tf" if fixed_place else "parameters",
    )
    if fixed_place:
        push(e, fixed_place)
    return e


def test_a_fixed_transform_that_corrects_the_sensors_place_ends_what_the_parameter_ends():
    """The weight is read along z. Before the correction the sensor seems to lie on its side: a false force in air."""
    on_its_side = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))

    def mount(quaternion):
        return (
            TransformSample(
                0, "tool", "ft_sensor", fixed=True, position=(0.0,) * 3, quaternion=quaternion
            ),
        )

    def rest(e, begin):
        for k in range(begin, begin + 100):
            stamp = START + 10 * k * MS
            push(
                e,
                wrench(stamp, (0.0, 0.0, -GRAVITY, 0.0, 0.0, 0.0)),
                twist(stamp),
                pose(stamp, (0.0, 0.0, 0.1)),
            )
        e.finish()
        return e.issues()

    by_transform = resting_in_air(mount(on_its_side))
    by_parameter = resting_in_air(None, quaternion=on_its_side)
    assert rest(by_transform, 0) == rest(by_parameter, 0) == [OFFSET_SENTENCE]
    push(by_transform, mount((0.0, 0.0, 0.0, 1.0)))
    use(by_parameter, sensor=LoadCell(mass=1.0))
    assert by_transform.issues() == by_parameter.issues() == []
    assert rest(by_transform, 200) == rest(by_parameter, 200) == []


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
    use(e, **others, model=model)
    assert math.isnan(e.depth())
    assert answers(e) == answers(estimator(model=model, **others))

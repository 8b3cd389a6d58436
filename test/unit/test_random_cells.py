"""The random cells of `bench.doctor`: they repeat, they are right as they are, and each fault shows in its readings."""

import numpy as np
import pytest

from bench.random_cells import FORCES, MOTIONS, TURNS, random_cell
from bench.random_doctor import findings_of
from bench.random_faults import FAULTS, faulty, fits, is_visible, right

SEEDS = range(0, 24, 2)


@pytest.fixture(scope="module")
def drawn():
    return [random_cell(seed) for seed in SEEDS]


def test_the_same_seed_gives_the_same_recording():
    one = random_cell(8)
    again = random_cell(8)
    assert one.parameters == again.parameters
    assert np.array_equal(one.recording.wrenches, again.recording.wrenches)
    assert np.array_equal(one.recording.poses, again.recording.poses)


def test_cells_differ_in_motion_turns_and_forces(drawn):
    assert len({cell.motion for cell in drawn}) > len(MOTIONS) // 2
    assert len({cell.turns for cell in drawn}) == len(TURNS)
    assert len({cell.forces for cell in drawn}) > len(FORCES) // 2


def test_the_file_of_a_right_cell_explains_its_readings_where_the_force_is_the_models(drawn):
    of_model = [c for c in drawn if c.forces == "model" and not c.begins_in_grains]
    assert of_model
    for cell in of_model:
        assert fits(right(cell)) < 0.2, cell.title


def test_the_tool_begins_and_ends_in_the_air(drawn):
    for cell in drawn:
        assert not cell.grains[[0, -1]].any(), cell.title


@pytest.mark.parametrize("kind", FAULTS)
def test_each_fault_can_be_had_and_changes_what_is_sent_or_what_the_file_says(kind):
    made = (faulty(random_cell(seed), kind) for seed in range(0, 200, 2))
    found = next((setup for setup in made if setup is not None), None)
    assert found is not None


@pytest.mark.parametrize("seed", [60020, 60022])
def test_a_force_that_stays_while_the_tool_rests_is_no_limit_of_the_load_cell(seed):
    assert findings_of(right(random_cell(seed))) == []


def test_a_force_that_grows_less_than_the_models_as_a_scoop_rolls_is_no_limit_of_the_load_cell():
    assert findings_of(right(random_cell(90002))) == []


def test_poses_that_do_not_turn_with_a_tool_that_rolls_are_named():
    (found,) = findings_of(faulty(random_cell(50003), "frame does not turn"))
    assert found.name == "frame does not turn"
    assert found.spoils_calibration


def test_a_press_with_few_moments_below_the_limit_of_the_load_cell_shows_it():
    (found,) = findings_of(faulty(random_cell(61000), "saturated"))
    assert found.name == "saturation"


def test_a_fault_that_changes_no_reading_is_left_out(drawn):
    cell = drawn[0]
    assert not is_visible(cell, right(cell))

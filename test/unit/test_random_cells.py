"""The random cells of `bench.doctor`: they repeat, they are right as they are, and each fault shows in its readings."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.random_cells import FORCES, MOTIONS, TURNS, random_cell
from bench.random_doctor import findings_of
from bench.random_faults import FAULTS, Setup, faulty, fits, is_visible, right

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


@pytest.mark.parametrize("seed", [60022])
def test_a_force_that_stays_while_the_tool_rests_is_no_limit_of_the_load_cell(seed):
    assert findings_of(right(random_cell(seed))) == []


def test_a_force_that_grows_less_than_the_models_as_a_scoop_rolls_is_no_limit_of_the_load_cell():
    assert findings_of(right(random_cell(90002))) == []


def test_a_side_force_that_stays_within_the_error_of_the_whole_force_is_no_limit():
    assert findings_of(right(random_cell(800069))) == []


def test_a_limit_is_one_of_the_whole_reading_with_the_weight_that_hangs_on_the_load_cell():
    assert findings_of(right(random_cell(120017))) == []


def test_a_reading_in_world_axes_is_of_the_attitude_in_which_the_model_computes_the_force():
    """The tool turns with 0.85 kg on its way down; its lever seemed to be 127 mm."""
    assert findings_of(right(random_cell(110058))) == []


def test_the_noise_of_the_force_does_not_shorten_the_lever():
    """A straight press does not tell how far off the load cell is along it."""
    assert findings_of(right(random_cell(120103))) == []


@pytest.mark.parametrize("seed", [310009, 800009])
def test_no_delay_is_told_because_the_readings_have_less_noise_half_way_between_two_samples(seed):
    assert findings_of(right(random_cell(seed))) == []


@pytest.mark.parametrize("seed", [120075, 700075, 800077])
def test_grains_unlike_the_model_are_no_cause_that_takes_less_than_half_of_the_misfit(seed):
    """They looked like an angle, poses that do not turn, and a turned mesh."""
    assert findings_of(right(random_cell(seed))) == []


def test_a_recording_that_begins_in_the_grains_may_hold_their_whole_force():
    """It was released within 1 mm, and looked like another strength."""
    assert findings_of(right(random_cell(60020))) == []


def test_a_simple_cause_does_not_keep_the_costly_ones_from_being_tried():
    """Another surface, 231 mm higher, left less than right cells have and was written."""
    (found,) = findings_of(faulty(random_cell(850049), "world tilted"))
    assert found.name == "world frame"


def test_a_delay_is_told_where_its_poses_follow_each_other_fast_although_few_of_them_are_judged():
    (found,) = findings_of(faulty(random_cell(860055), "delay 40 ms"))
    assert found.remedy["sensor.delay"] == pytest.approx(0.04, abs=0.01)


def test_a_mesh_turned_about_its_own_axes_is_named_where_its_frame_is_turned_by_no_quarter():
    cell = random_cell(820013)
    (found,) = findings_of(faulty(cell, "mesh upside down"))
    turn = Rotation.from_quat(found.remedy["mesh.quaternion"])
    true_turn = Rotation.from_quat(cell.parameters["mesh.quaternion"])
    assert (turn.inv() * true_turn).magnitude() < 1e-6


def hurried(cell, *, factor, gaps):
    """A cell whose tool is faster by a factor, and which loses its poses some times, for up to 0.4 s."""
    random = np.random.default_rng(cell.seed)
    sent = cell.recording
    time = sent.time / factor
    kept = np.arange(len(time)) % factor == 0
    for _ in range(gaps):
        begin = random.uniform(time[0], time[-1])
        kept &= (time <= begin) | (time >= begin + random.uniform(0.05, 0.4))
    delay = cell.parameters["sensor.delay"]
    recording = replace(
        sent,
        time=time[kept],
        poses=sent.poses[kept],
        twists=None,
        wrench_time=((sent.wrench_time - delay) / factor + delay)[::factor],
        wrenches=sent.wrenches[::factor],
    )
    parameters = {**cell.parameters, "twist_source": "pose_difference"}
    return Setup(parameters=parameters, recording=recording)


@pytest.mark.parametrize("seed", [151005, 151039, 151059])
def test_a_fast_right_cell_that_loses_poses_is_not_blamed_for_a_filter(seed):
    """Half a step is long in a gap: a force of its middle, compared with that of its end, looked late."""
    assert findings_of(hurried(random_cell(seed), factor=3, gaps=8)) == []


def test_a_tool_that_lies_elsewhere_in_its_frame_is_not_written_as_another_surface():
    """A drag shows the lever that is off beside it."""
    (found,) = findings_of(faulty(random_cell(470055), "TCP at the mesh's end"))
    assert found.name == "TCP"
    # what fits alike is told and not written
    assert found.alike
    assert "surface_height" not in found.remedy


def test_what_fits_alike_is_told_beside_a_delay_although_its_own_gain_is_small():
    (found,) = findings_of(faulty(random_cell(480009), "yielding arm"))
    assert found.alike


def test_a_delay_that_is_off_with_an_error_above_its_tolerance_is_not_written():
    """A filter of 100 ms seemed a delay of 56 ± 12 ms."""
    (found,) = findings_of(faulty(random_cell(480035), "filter 100 ms"))
    assert found.name == "delay" and not found.remedy


def test_a_delay_is_told_that_leaves_as_much_as_right_cells_in_grains_unlike_the_model():
    (found,) = findings_of(faulty(random_cell(470013), "delay 350 ms"))
    assert found.name == "delay"


@pytest.mark.parametrize(("seed", "kind"), [(480033, "step of the zero"), (480009, "friction")])
def test_a_zero_is_told_although_some_moments_lie_on_the_wrong_side_of_its_change(seed, kind):
    (found,) = findings_of(faulty(random_cell(seed), kind))
    assert found.name == "zero that moves"


@pytest.mark.parametrize("seed", [50003, 830201])
def test_poses_that_do_not_turn_with_a_tool_that_rolls_are_named(seed):
    """In the second cell more is left than right cells have, and a tenth of the misfit as given."""
    (found,) = findings_of(faulty(random_cell(seed), "frame does not turn"))
    assert found.name == "frame does not turn"
    assert found.spoils_calibration


def test_a_press_with_few_moments_below_the_limit_of_the_load_cell_shows_it():
    (found,) = findings_of(faulty(random_cell(61000), "saturated"))
    assert found.name == "saturation"


@pytest.mark.parametrize("seed", [430019, 430057])
def test_a_limit_is_seen_although_its_readings_were_compensated_for_a_weight_that_turns(seed):
    """They differ by rounding then."""
    (found,) = findings_of(faulty(random_cell(seed), "saturated"))
    assert found.name == "saturation"
    assert "stops at" in found.said


def test_a_cell_that_one_cause_explains_has_no_limit():
    """Its force in kgf was called the limit of an axis."""
    (found,) = findings_of(faulty(random_cell(320039), "kgf"))
    assert found.name == "strength"


def test_a_fault_that_changes_no_reading_is_left_out(drawn):
    cell = drawn[0]
    assert not is_visible(cell, right(cell))

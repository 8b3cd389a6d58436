"""The node as a user meets it: a real process over loopback DDS."""

import math
import signal

import numpy as np
import pytest
from cell import OUTPUTS, numbers, predicted_by_the_core, stamp_of

from rft_ros.errors import InputError
from rft_ros.estimator.parameters import read_parameter_file

S = 1_000_000_000


def test_a_pose_is_answered_by_three_wrenches_with_its_stamp_in_the_sensor_frame(cell):
    stamp = cell.moment()
    predicted = cell.ask(stamp, force=(0.0, 0.0, 3.0))
    cell.until(lambda: all(any(stamp_of(m) == stamp for m in cell.received[t]) for t in OUTPUTS))
    assert predicted.header.frame_id == "ft_sensor"
    np.testing.assert_array_equal(numbers(predicted), predicted_by_the_core())
    compensated, residual = (
        next(m for m in cell.received[t] if stamp_of(m) == stamp) for t in ("wrench_compensated", "wrench_residual")
    )
    np.testing.assert_array_equal(numbers(compensated)[:3], [0.0, 0.0, 3.0])
    np.testing.assert_array_equal(numbers(residual), numbers(compensated) - numbers(predicted))


def test_a_new_zeta_holds_from_the_next_pose_on(cell):
    assert cell.set(medium__zeta=0.5) == (True, "")
    np.testing.assert_allclose(numbers(cell.ask(cell.moment())), predicted_by_the_core(zeta=0.5), rtol=1e-15)
    assert cell.set(medium__zeta=1.0)[0]


def test_an_integer_is_taken_for_a_double(cell):
    assert cell.set(medium__zeta=2) == (True, "")
    assert cell.get("medium.zeta").double_value == 2.0
    assert cell.set_each(medium__zeta=1) == [(True, "")]
    assert cell.get("medium.zeta").double_value == 1.0


def test_alpha_y_models_swap_at_once(cell):
    sideways = (0.008, 0.005, -0.001)
    assert cell.set(alpha_y__model="linear") == (True, "")
    linear = numbers(cell.ask(cell.moment(), linear=sideways))
    assert cell.set(alpha_y__model="constant") == (True, "")
    constant = numbers(cell.ask(cell.moment(), linear=sideways))
    np.testing.assert_array_equal(linear, predicted_by_the_core(alpha_y="linear", linear=sideways))
    np.testing.assert_array_equal(constant, predicted_by_the_core(linear=sideways))
    assert linear[0] != constant[0]


def test_a_table_of_alpha_y_swaps_in_and_a_missing_one_is_refused(cell, tmp_path):
    table = tmp_path / "alpha_y.csv"
    table.write_text("beta,alpha_y\n0,0.2035\n180,-0.0665\n".replace("-0.0665", "0.0"))
    refused, reason = cell.set(alpha_y__model="table")
    assert not refused and "alpha_y.table" in reason
    assert cell.set(alpha_y__model="table", alpha_y__table=str(table)) == (True, "")
    refused, reason = cell.set(alpha_y__table=str(tmp_path / "none.csv"))
    assert not refused and "none.csv" in reason
    assert numbers(cell.ask(cell.moment()))[2] == pytest.approx(predicted_by_the_core()[2], rel=1e-12)
    assert cell.set(alpha_y__model="constant", alpha_y__table="") == (True, "")


def test_a_new_mesh_is_swapped_in_while_the_old_one_answers(cell):
    _, _, before = cell.diagnostic("model")
    assert cell.set(mesh__file="sphere") == (True, "")
    np.testing.assert_array_equal(numbers(cell.ask(cell.moment())), predicted_by_the_core())
    cell.until(lambda: cell.diagnostic("model")[2]["tool"] == "sphere")
    np.testing.assert_array_equal(numbers(cell.ask(cell.moment())), predicted_by_the_core(mesh="sphere"))
    _, _, after = cell.diagnostic("model")
    assert int(after["generation"]) == int(before["generation"]) + 1
    assert cell.set(mesh__file="plate") == (True, "")
    cell.until(lambda: cell.diagnostic("model")[2]["tool"] == "plate")


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("medium__zeta", -1.0, "medium.zeta"),
        ("medium__zeta", math.nan, "medium.zeta"),
        ("medium__zeta", "much", "medium.zeta"),
        ("medium__name", "custard", "custard"),
        ("alpha_y__model", "cubic", "cubic"),
        ("mesh__file", "no_such_mesh", "no_such_mesh"),
        ("mesh__file", "/none/there.stl", "/none/there.stl"),
        ("mesh__scale", 0.0, "mesh.scale"),
        ("mesh__origin", [0.0, 1.0], "mesh.origin"),
        ("sensor__quaternion", [0.0, 0.0, 0.0, 0.0], "sensor.quaternion"),
        ("sensor__sign", 0.5, "sensor.sign"),
        ("executor", "events", "executor"),
    ],
)
def test_a_bad_value_is_refused_with_a_sentence_and_nothing_changes(cell, name, value, words):
    before = cell.get(name.replace("__", "."))
    successful, reason = cell.set(**{name: value})
    assert not successful
    assert words in reason
    assert cell.get(name.replace("__", ".")) == before
    np.testing.assert_array_equal(numbers(cell.ask(cell.moment())), predicted_by_the_core())


def test_a_mesh_that_turns_out_broken_leaves_the_old_one_and_its_parameter(cell, tmp_path):
    broken = tmp_path / "broken.stl"
    broken.write_text("solid nothing\nendsolid nothing\n")
    assert cell.set(mesh__file=str(broken)) == (True, "")
    cell.until(lambda: cell.diagnostic("model")[2]["last_swap_failure"] != "")
    level, message, values = cell.diagnostic("model")
    assert level == b"\x01"
    assert "broken.stl" in message
    assert values["tool"] == "plate"
    assert cell.get("mesh.file").string_value == "plate"
    np.testing.assert_array_equal(numbers(cell.ask(cell.moment())), predicted_by_the_core())


@pytest.mark.parametrize(
    ("inputs", "reason"),
    [
        ({"z": math.nan}, "pose_not_finite"),
        ({"quaternion": (0.0, 0.0, 0.0, 0.0)}, "pose_quaternion_not_unit"),
        ({"frame": "elsewhere"}, "pose_frame_unknown"),
        ({"twist_stamp": 1 * S}, "twist_stale"),
        ({"linear": (math.inf, 0.0, 0.0)}, "twist_stale"),
        ({"linear": (0.0, 0.0, 0.0)}, "at_rest"),
    ],
)
def test_bad_live_input_is_a_counted_reason_and_the_node_goes_on(cell, inputs, reason):
    def count():
        return int(cell.diagnostic("inputs")[2].get(f"count.{reason}", 0))

    cell.ask(cell.moment())
    before = count()
    bad = cell.moment()
    cell.send(bad, **inputs)
    cell.until(lambda: count() > before, timeout=10.0)
    assert not any(stamp_of(m) == bad for m in cell.received["wrench_predicted"])
    cell.ask(cell.moment())


def test_a_wrong_frame_is_named_in_the_diagnostics_and_in_the_log(start_cell):
    cell = start_cell("-p", "mesh.file:=plate").wait_ready()
    sentence = "pose frame_id 'elsewhere' is not world_frame 'world'"
    cell.send(cell.moment(), frame="elsewhere")
    cell.until(lambda: sentence in cell.diagnostic("inputs")[1], timeout=10.0)
    assert cell.last_status("inputs")[0] == b"\x01"
    cell.until(lambda: f"pose_frame_unknown ({sentence}): 1 in the last 1 s" in cell.said(), timeout=10.0)


@pytest.mark.parametrize("topic", ["pose", "twist", "wrench"])
def test_bytes_that_are_no_message_are_counted_and_the_node_goes_on(cell, topic):
    def count():
        return int(cell.diagnostic("inputs")[2].get("count.message_unreadable", 0))

    before = count()
    for garbage in (b"\x00\x01\x00\x00", b"\x00\x01\x00\x00" + b"\xff" * 40, b"\x00\x07\x00\x00" + b"\x00" * 120):
        getattr(cell, topic).publish(garbage)
    cell.until(lambda: count() >= before + 3, timeout=10.0)
    np.testing.assert_array_equal(numbers(cell.ask(cell.moment())), predicted_by_the_core())


def test_late_and_repeated_poses_are_not_answered_and_a_jump_back_starts_afresh(cell):
    stamp = cell.moment()
    cell.ask(stamp)
    answered = len(cell.received["wrench_predicted"])
    cell.send(stamp)
    cell.send(stamp - 1_000_000)
    cell.ask(stamp + S)
    assert len(cell.received["wrench_predicted"]) == answered + 1
    cell.ask(1 * S)  # the bag loops
    _, _, values = cell.diagnostic("inputs")
    assert int(values["count.pose_repeated"]) >= 1
    assert int(values["count.pose_out_of_order"]) >= 1
    assert int(values["count.time_jump"]) >= 1


def test_tare_is_refused_in_the_grains_and_makes_the_reading_zero_in_the_air(cell):
    cell.ask(cell.moment(), force=(1.0, 2.0, 3.0))
    successful, message = cell.tare()
    assert not successful and "in the grains" in message
    start = cell.moment()
    for k in range(200):
        cell.send(start + k * S // 100, z=0.1, linear=(0.0, 0.0, 0.0), force=(1.0, 2.0, 3.0))
    cell.ask(start + 2 * S, z=0.1, linear=(0.0, 0.0, 0.0), force=(1.0, 2.0, 3.0))
    successful, message = cell.tare()
    assert successful and "sensor.bias set to [1, 2, 3, 0, 0, 0]" in message
    stamp = cell.moment()
    cell.ask(stamp, z=0.1, linear=(0.0, 0.0, 0.0), force=(1.0, 2.0, 3.0))
    cell.until(lambda: any(stamp_of(m) == stamp for m in cell.received["wrench_compensated"]))
    compensated = next(m for m in cell.received["wrench_compensated"] if stamp_of(m) == stamp)
    np.testing.assert_allclose(numbers(compensated), 0.0, atol=1e-12)
    assert cell.set(sensor__bias=[0.0] * 6)[0]


def test_without_a_load_cell_the_prediction_still_comes(cell):
    compensated = len(cell.received["wrench_compensated"])
    cell.ask(cell.moment(), force=None)
    assert int(cell.diagnostic("inputs")[2]["count.wrench_stale"]) >= 1
    assert len(cell.received["wrench_compensated"]) == compensated


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_ends_cleanly_when_told_to(start_cell, number):
    cell = start_cell("-p", "mesh.file:=plate").wait_ready()
    assert cell.stop(number) == 0
    said = cell.said()
    assert "ready: tool plate" in said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    ("argument", "words"),
    [
        ("mesh.file:=nothing_there", "nothing_there"),
        ("medium.zeta:=-2.0", "medium.zeta is -2"),
        ("alpha_y.model:=table", "alpha_y.table"),
        ("sensor.position:=[1.0]", "sensor.position"),
    ],
)
def test_it_does_not_start_on_parameters_it_cannot_use(start_cell, argument, words):
    cell = start_cell("-p", argument)
    assert cell.process.wait(30.0) == 2
    assert words in cell.said()
    assert "Traceback" not in cell.said()


def test_a_parameter_file_that_ros_cannot_read_is_refused_in_the_words_of_a_replay(start_cell, tmp_path):
    file = tmp_path / "cell.yaml"
    file.write_text("/**:\n  ros__parameters:\n    sensor.position: [0, 0, 0.5]\n")
    cell = start_cell("--params-file", str(file))
    assert cell.process.wait(30.0) == 2
    with pytest.raises(InputError) as refusal:
        read_parameter_file(file)
    assert f"rft_node: {refusal.value}" in cell.said()
    assert "Traceback" not in cell.said()


def test_asked_for_help_it_gives_some_and_does_not_start(start_cell):
    cell = start_cell("--help")
    assert cell.process.wait(30.0) == 0
    assert cell.said().startswith("usage: rft_node")


def test_the_events_executor_answers_too(start_cell):
    cell = start_cell("-p", "executor:=events").wait_ready()
    np.testing.assert_array_equal(numbers(cell.ask(cell.moment())), predicted_by_the_core())
    assert cell.stop() == 0

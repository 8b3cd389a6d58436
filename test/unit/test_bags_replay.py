"""A replay is deterministic and complete, and reports what it could not use."""

import json

import numpy as np
import pytest
from recordings import START, STEP, TOPICS, moments, plunge, write_ros2
from replays import rows_of, values
from rosbags.highlevel import AnyReader

from rft_ros.bags.estimates import COLUMNS, LEARNED_COLUMNS
from rft_ros.bags.playback import ReplayOptions, read_replay_options
from rft_ros.bags.replay import replay
from rft_ros.bags.writing import BagWriter
from rft_ros.errors import InputError
from rft_ros.rft import MEDIA, alpha_y_model, checked_states, treers2021, wrenches
from rft_ros.tool import load_tool


def test_estimates_are_the_cores_with_the_poses_stamps(tmp_path):
    bag = write_ros2(tmp_path / "bag", moments())
    summary = replay(bag, tmp_path / "out", values())
    rows = rows_of(tmp_path / "out")
    assert tuple(rows[0]) == COLUMNS
    assert len(rows) == summary.messages["pose"] == summary.estimates == 60
    medium = MEDIA["generic"]
    law = treers2021(medium, alpha_y_model("constant", medium))
    state = checked_states([0.0, 0.0, 0.01 - 39 * 0.002, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -0.2, 0.0, 0.0, 0.0])
    fz = wrenches(load_tool("plate", tolerance=values()["tolerance"]).plates, law, state)[0, 2]
    last = rows[-1]
    assert last["t"] == f"{(START + 59 * STEP) / 1e9:.2f}0000000"
    assert float(last["depth"]) == pytest.approx(39 * 0.002 - 0.01 + 0.0016)
    assert float(last["predicted_fz"]) == pytest.approx(fz, rel=1e-8)
    assert float(last["compensated_fz"]) == pytest.approx(3.0 + 7.8)
    assert float(last["residual_fz"]) == pytest.approx(10.8 - fz, rel=1e-7)


def test_two_replays_give_the_same_bytes(tmp_path):
    bag = write_ros2(tmp_path / "bag", moments())
    for out in ("one", "two"):
        replay(bag, tmp_path / out, values(), ReplayOptions(tare=0.15))
    for name in ("estimates.csv", "summary.json", "estimates/estimates.mcap"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes(), name
    assert "seconds" not in json.loads((tmp_path / "one" / "summary.json").read_text())


def test_the_estimates_bag_holds_four_wrenches_in_the_sensor_frame(tmp_path):
    replay(write_ros2(tmp_path / "bag", moments()), tmp_path / "out", values())
    with AnyReader([tmp_path / "out" / "estimates"]) as reader:
        seen = {}
        for connection, time, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            assert message.header.frame_id == "ft_sensor"
            assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == time
            seen.setdefault(connection.topic, []).append(message.wrench.force.z)
    assert {k: len(v) for k, v in seen.items()} == dict.fromkeys(
        (f"/rft/wrench_{n}" for n in ("predicted", "sigma", "compensated", "residual")), 60
    )
    np.testing.assert_array_equal(
        seen["/rft/wrench_residual"], np.subtract(seen["/rft/wrench_compensated"], seen["/rft/wrench_predicted"])
    )


def test_messages_that_arrive_up_to_5_ms_late_change_no_row_and_no_message(tmp_path):
    random = np.random.default_rng(4)
    rows = [(role, stamp + (3_000_000 if role == "wrench" else 0), v) for role, _, stamp, v in plunge()]
    bags = []
    for name, delay in (("prompt", 0), ("late", 5_000_000)):
        received = []
        for role in ("pose", "wrench"):  # each topic keeps its own order
            stamps = np.array([stamp for r, stamp, _ in rows if r == role])
            times = np.maximum.accumulate(stamps + random.integers(0, delay + 1, len(stamps))).tolist()
            numbers = [v for r, _, v in rows if r == role]
            received += [(role, *row) for row in zip(times, stamps.tolist(), numbers, strict=True)]
        bags.append(write_ros2(tmp_path / name, sorted(received, key=lambda row: row[1])))
        replay(bags[-1], tmp_path / f"{name}_out", values(twist_source="pose_difference"))
    for file in ("estimates.csv", "estimates/estimates.mcap"):
        assert (tmp_path / "prompt_out" / file).read_bytes() == (tmp_path / "late_out" / file).read_bytes(), file
    assert sum(bool(row["residual_fz"]) for row in rows_of(tmp_path / "late_out")) > 500


def test_a_tare_of_0_seconds_means_no_tare(tmp_path):
    bag = write_ros2(tmp_path / "bag", moments())
    assert replay(bag, tmp_path / "out", values(), ReplayOptions(tare=0.0)).bias == (0.0,) * 6


def test_a_tare_over_the_first_seconds_takes_the_bias_off(tmp_path):
    bag = write_ros2(tmp_path / "bag", moments())
    summary = replay(bag, tmp_path / "out", values(), ReplayOptions(tare=0.15))
    assert summary.bias == pytest.approx((1.0, 2.0, 3.0, 0.1, 0.2, 0.3))
    first = rows_of(tmp_path / "out")[0]
    assert [float(first[f"compensated_{a}"]) for a in ("fx", "fz", "tz")] == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)


def test_a_tare_ignores_poses_before_the_first_twist(tmp_path):
    """Poses and twists come at 500 Hz, the load cell at 100 Hz; its last sample is 8 ms older than the last twist."""
    values_of = {role: v for role, _, _, v in moments(1)}
    times = [("pose", k) for k in range(0, 300, 2)] + [("twist", k) for k in range(9, 300, 2)]
    times += [("wrench", k) for k in range(0, 300, 10)]
    rows = [
        (r, START + k * STEP // 10, START + k * STEP // 10, values_of[r]) for r, k in sorted(times, key=lambda t: t[1])
    ]
    summary = replay(write_ros2(tmp_path / "bag", rows), tmp_path / "out", values(), ReplayOptions(tare=0.149))
    assert summary.bias == pytest.approx((1.0, 2.0, 3.0, 0.1, 0.2, 0.3))


def test_a_tare_while_the_tool_moves_is_refused(tmp_path):
    bag = write_ros2(tmp_path / "bag", moments())
    with pytest.raises(InputError, match=r"bag .*tare refused: .*(moved|in the grains)"):
        replay(bag, tmp_path / "out", values(), ReplayOptions(tare=0.5))


def test_penetration_has_statistics_of_its_own(tmp_path):
    summary = replay(write_ros2(tmp_path / "bag", moments()), tmp_path / "out", values())
    rows = rows_of(tmp_path / "out")
    sinking = [r for r in rows if float(r["depth"]) > 0.0 and float(r["speed"]) > 0.0]
    assert [r["phase"] for r in rows] == ["penetration" if r in sinking else "approach" for r in rows]
    penetration = summary.phases["penetration"]
    assert penetration.estimates == penetration.poses == len(sinking) > 30
    assert penetration.wrench["fz"].predicted.rms > summary.wrench["fz"].predicted.rms > 0.0
    assert sum(phase.poses for phase in summary.phases.values()) == 60


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda _role, _stamp: 0, "pose_stamp_zero"),
        (lambda _role, _stamp: START, "pose_repeated"),
        (lambda role, stamp: stamp - (10**9 if role == "twist" else 0), "twist_stale"),
        (lambda role, stamp: stamp - (10**9 if role == "wrench" else 0), "wrench_stale"),
    ],
)
def test_invalid_stamps_are_reasons(tmp_path, change, reason):
    rows = [(role, time, change(role, stamp), v) for role, time, stamp, v in moments()]
    summary = replay(write_ros2(tmp_path / "bag", rows), tmp_path / "out", values())
    assert summary.reasons[reason] >= 59
    assert summary.estimates <= 1 or reason == "wrench_stale"


def test_pose_only_still_predicts_and_wrench_only_is_refused(tmp_path):
    only_pose = write_ros2(tmp_path / "pose", moments(), topics={"pose": TOPICS["pose"]})
    summary = replay(only_pose, tmp_path / "out", values(twist_source="pose_difference"))
    assert summary.estimates == 58
    assert summary.reasons["wrench_missing"] == 58
    assert summary.wrench["fz"].measured.rms is None
    assert rows_of(tmp_path / "out")[-1]["residual_fz"] == ""
    only_wrench = write_ros2(tmp_path / "wrench", moments(), topics={"wrench": TOPICS["wrench"]})
    with pytest.raises(InputError, match="no pose topic"):
        replay(only_wrench, tmp_path / "none", values())


def test_frames_that_are_not_the_parameters_are_reasons(tmp_path):
    bag = write_ros2(tmp_path / "bag", moments(), frame="elsewhere")
    summary = replay(bag, tmp_path / "out", values())
    assert summary.estimates == 0
    assert summary.reasons["pose_frame_unknown"] == 60
    told = "pose_frame_unknown 60 (pose frame_id 'elsewhere' is not world_frame 'world')"
    assert f"  not used or unanswered: {told}" in summary.lines()
    assert "wrench frame_id 'elsewhere' is not sensor_frame 'ft_sensor'" in "\n".join(summary.lines())
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["unknown_frames"] == summary.unknown_frames


def test_a_tare_that_fails_for_a_wrong_frame_names_it(tmp_path):
    bag = write_ros2(tmp_path / "bag", moments(), frame="elsewhere")
    with pytest.raises(InputError, match="pose frame_id 'elsewhere' is not world_frame 'world'"):
        replay(bag, tmp_path / "out", values(), ReplayOptions(tare=0.2))


def test_a_second_publisher_that_lags_is_out_of_order(tmp_path):
    rows = list(moments())
    late = [(role, time + 1, stamp - 5 * STEP, v) for role, time, stamp, v in rows if role == "pose"]
    summary = replay(write_ros2(tmp_path / "bag", sorted(rows + late, key=lambda r: r[1])), tmp_path / "out", values())
    assert summary.reasons["pose_out_of_order"] == 60
    assert summary.estimates == 60


def test_an_output_that_is_not_its_own_is_not_overwritten(tmp_path):
    bag = write_ros2(tmp_path / "bag", moments())
    estimates = tmp_path / "out" / "estimates"
    estimates.mkdir(parents=True)
    (estimates / "thesis.txt").write_text("precious")
    with pytest.raises(InputError, match="estimates"):
        replay(bag, tmp_path / "out", values())
    assert (estimates / "thesis.txt").read_text() == "precious"


def test_what_a_writer_wrote_it_may_replace(tmp_path):
    for force in (1.0, 2.0):
        with BagWriter(tmp_path / "bag") as bag:
            bag.write_wrench("/w", 5, "f", (force, 0.0, 0.0, 0.0, 0.0, 0.0))
    with AnyReader([tmp_path / "bag"]) as reader:
        ((connection, time, data),) = reader.messages()
        assert (time, reader.deserialize(data, connection.msgtype).wrench.force.x) == (5, 2.0)


@pytest.mark.parametrize("files", [["bag.mcap"], []])
def test_what_a_killed_writer_left_may_be_replaced(tmp_path, files):
    (tmp_path / "bag").mkdir()
    for file in files:
        (tmp_path / "bag" / file).touch()
    with BagWriter(tmp_path / "bag") as bag:
        bag.write_wrench("/w", 5, "f", (0.0,) * 6)


def test_a_whole_recording_without_metadata_is_not_replaced(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        bag.write_wrench("/w", 5, "f", (0.0,) * 6)
    (tmp_path / "bag" / "metadata.yaml").unlink()
    with pytest.raises(InputError, match="not overwritten"), BagWriter(tmp_path / "bag"):
        pass
    assert (tmp_path / "bag" / "bag.mcap").stat().st_size > 100


def test_a_bag_in_the_output_is_not_replaced(tmp_path):
    replay(write_ros2(tmp_path / "bag", moments()), tmp_path / "out", values())
    file = tmp_path / "out" / "estimates" / "estimates.mcap"
    with pytest.raises(InputError, match="would overwrite the input"):
        replay(file, tmp_path / "out", values())
    assert file.exists()


def test_options_come_from_the_parameter_file(tmp_path):
    file = tmp_path / "p.yaml"
    file.write_text("rft_replay:\n  ros__parameters:\n    remap: ['~/pose:=/p']\n    tare: 2\n    end: 3.5\n")
    options = read_replay_options(file)
    assert (options.remap, options.tare, options.start, options.end) == (("~/pose:=/p",), 2, None, 3.5)
    for text, words in (("remap: 7", "remap"), ("tear: 2.0", "no 'tear'"), ("tare: soon", "tare")):
        file.write_text(f"rft_replay:\n  ros__parameters:\n    {text}\n")
        with pytest.raises(InputError, match=words):
            read_replay_options(file)


def test_a_learning_replay_reports_what_it_learned_and_the_error_with_and_without(tmp_path):
    bag = write_ros2(tmp_path / "bag", plunge())
    learning = values(learning__mode="apply", sensor__bias=(0.05, 0.0, 0.0, 0.0, 0.0, 0.0))
    summary = replay(bag, tmp_path / "out", learning)
    rows = rows_of(tmp_path / "out")
    assert tuple(rows[0]) == COLUMNS + LEARNED_COLUMNS
    assert all(None not in row.values() for row in rows)
    assert list(summary.learning) == ["off", "2 mm", "5 mm"]
    assert summary.learning["2 mm"]["rms_over_peak"] == summary.rms_over_peak
    assert summary.learning["2 mm"]["within_sigma"] == summary.within_sigma
    assert summary.learning["2 mm"]["median_relative_error"] < 0.5 * summary.learning["off"]["median_relative_error"]
    assert float(rows[200]["vertical_strength"]) != 1.0
    assert float(rows[200]["vertical_strength_error"]) > 0.0


def test_without_learning_the_replay_does_not_mention_it(tmp_path):
    summary = replay(write_ros2(tmp_path / "bag", moments()), tmp_path / "out", values())
    assert summary.learning == {}
    rows = rows_of(tmp_path / "out")
    assert tuple(rows[0]) == COLUMNS
    assert float(rows[-1]["sigma_fz"]) > 0.0

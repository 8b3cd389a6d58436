"""A replay is deterministic and complete, replaces only its own output, and reports what it could not use."""

import json
import subprocess
import sys

import numpy as np
import pytest
from recordings import (
    FRAMES,
    START,
    STEP,
    TOPICS,
    TRANSFORM,
    cdr,
    moments,
    plunge,
    rows_of,
    transform_cdr,
    values,
    write_mcap,
    write_messages,
    write_ros2,
)
from rosbags.highlevel import AnyReader

from rft_ros.bags.estimates import COLUMNS, LEARNED_COLUMNS
from rft_ros.bags.options import ReplayOptions, read_replay_options
from rft_ros.bags.playback import played_estimates
from rft_ros.bags.replay import replay
from rft_ros.cli import main
from rft_ros.errors import InputError
from rft_ros.estimator import TransformSample
from rft_ros.parameters import Config
from rft_ros.rft import MEDIA, alpha_y_model, checked_states, treers2021, wrenches
from rft_ros.tool import load_tool

LOST = dict.fromkeys(FRAMES, "elsewhere")


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return write_ros2(tmp_path_factory.mktemp("bags") / "bag", moments())


@pytest.fixture(scope="module")
def replayed(bag, tmp_path_factory):
    """Summary and folder of the replay of `moments`."""
    out = tmp_path_factory.mktemp("replayed")
    return replay(bag, out, values()), out


def replay_of(
    folder, rows, options=None, *, topics=TOPICS, frames=FRAMES, report=False, **parameters
):
    """Summary and rows of the replay of a bag with these messages."""
    bag = write_ros2(folder / "bag", rows, topics=topics, frames=frames)
    summary = replay(bag, folder / "out", values(**parameters), options, report=report)
    return summary, rows_of(folder / "out")


def test_estimates_are_the_cores_with_the_poses_stamps(replayed):
    summary, out = replayed
    rows = rows_of(out)
    assert tuple(rows[0]) == COLUMNS
    assert len(rows) == summary.messages["pose"] == summary.estimates == 60
    medium = MEDIA["generic"]
    law = treers2021(medium, alpha_y_model("constant", medium))
    state = checked_states(
        [0.0, 0.0, 0.01 - 39 * 0.002, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -0.2, 0.0, 0.0, 0.0]
    )
    fz = wrenches(load_tool("plate", tolerance=values()["tolerance"]).plates, law, state)[0, 2]
    last = rows[-1]
    assert last["t"] == f"{(START + 59 * STEP) / 1e9:.2f}0000000"
    assert float(last["depth"]) == pytest.approx(39 * 0.002 - 0.01 + 0.0016)
    assert float(last["predicted_fz"]) == pytest.approx(fz, rel=1e-8)
    assert float(last["compensated_fz"]) == pytest.approx(3.0 + 7.8)
    assert float(last["residual_fz"]) == pytest.approx(10.8 - fz, rel=1e-7)
    assert float(last["sigma_fz"]) > 0.0
    assert summary.learning == {}
    assert not (out / "report.html").exists()  # unless asked for


def test_the_estimates_bag_holds_four_wrenches_in_the_sensor_frame(replayed):
    seen = {}
    with AnyReader([replayed[1] / "estimates"]) as reader:
        for connection, time, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            assert message.header.frame_id == "ft_sensor"
            assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == time
            seen.setdefault(connection.topic.removeprefix("/rft/wrench_"), []).append(
                message.wrench.force.z
            )
    assert {name: len(found) for name, found in seen.items()} == dict.fromkeys(
        ("predicted", "sigma", "compensated", "residual"), 60
    )
    np.testing.assert_array_equal(
        seen["residual"], np.subtract(seen["compensated"], seen["predicted"])
    )


def test_a_tare_over_the_first_seconds_takes_the_bias_off(bag, tmp_path):
    summary = replay(bag, tmp_path, values(), ReplayOptions(tare=0.15))
    assert summary.bias == pytest.approx((1.0, 2.0, 3.0, 0.1, 0.2, 0.3))
    first = rows_of(tmp_path)[0]
    assert [float(first[f"compensated_{a}"]) for a in ("fx", "fz", "tz")] == pytest.approx(
        [0.0, 0.0, 0.0], abs=1e-12
    )
    assert replay(bag, tmp_path, values(), ReplayOptions(tare=0.0)).bias == (0.0,) * 6
    _, estimator = played_estimates(
        bag, values(), Config.of(values()).model(), ReplayOptions(tare=0.15)
    )
    assert estimator.load_cell.bias == summary.bias  # as rft view draws it


def test_a_tare_ignores_poses_before_the_first_velocity_also_with_a_delay(bag, tmp_path):
    given = values(twist_source="pose_difference", sensor__delay=0.05)
    summary = replay(bag, tmp_path, given, ReplayOptions(tare=0.19))
    assert summary.bias == pytest.approx((1.0, 2.0, 3.0, 0.1, 0.2, 0.3))


def test_a_tare_ignores_poses_before_the_first_twist(tmp_path):
    """Poses and twists come at 500 Hz, the load cell at 100 Hz; its last sample is 8 ms older than the last twist."""
    values_of = {role: v for role, _, _, v in moments(1)}
    times = [("pose", k) for k in range(0, 300, 2)] + [("twist", k) for k in range(9, 300, 2)]
    times += [("wrench", k) for k in range(0, 300, 10)]
    stamps = [(r, START + k * STEP // 10) for r, k in sorted(times, key=lambda t: t[1])]
    summary, _ = replay_of(
        tmp_path, [(r, t, t, values_of[r]) for r, t in stamps], ReplayOptions(tare=0.149)
    )
    assert summary.bias == pytest.approx((1.0, 2.0, 3.0, 0.1, 0.2, 0.3))


@pytest.mark.parametrize(
    ("frames", "tare", "words"),
    [
        (FRAMES, 0.5, "bag .*tare refused: .*(moved|in the grains)"),
        (
            LOST,
            0.2,
            "pose frame_id 'elsewhere' is not world_frame 'world'; set the parameter to .* or publish",
        ),
    ],
)
def test_a_tare_that_fails_says_why(tmp_path, frames, tare, words):
    with pytest.raises(InputError, match=words):
        replay_of(tmp_path, moments(), ReplayOptions(tare=tare), frames=frames)


def test_messages_that_arrive_up_to_5_ms_late_change_no_row_and_no_message(tmp_path):
    random = np.random.default_rng(4)
    rows = [
        (role, stamp + (3_000_000 if role == "wrench" else 0), v) for role, _, stamp, v in plunge()
    ]
    for name, delay in (("prompt", 0), ("late", 5_000_000)):
        received, last = [], dict.fromkeys(TOPICS, 0)
        for role, stamp, numbers in rows:
            # a topic keeps its order
            last[role] = max(last[role], stamp + int(random.integers(0, delay + 1)))
            received.append((role, last[role], stamp, numbers))
        received.sort(key=lambda row: row[1])
        _, found = replay_of(tmp_path / name, received, twist_source="pose_difference")
    for file in ("estimates.csv", "estimates/estimates.mcap"):
        assert (tmp_path / "prompt/out" / file).read_bytes() == (
            tmp_path / "late/out" / file
        ).read_bytes(), file
    assert sum(bool(row["residual_fz"]) for row in found) > 500


def test_stamps_all_zero_give_reasons_and_a_report_without_estimates(tmp_path):
    summary, rows = replay_of(
        tmp_path, [(role, time, 0, v) for role, time, _, v in moments()], report=True
    )
    assert summary.estimates == 0
    assert summary.reasons == {f"{role}_stamp_zero": 60 for role in ("pose", "twist", "wrench")}
    assert {(r["reason"], r["phase"], r["quality_flags"]) for r in rows} == {
        ("pose_stamp_zero", "", "")
    }
    assert "pose_stamp_zero" in (tmp_path / "out" / "report.html").read_text()


def test_poses_alone_predict_by_their_differences(tmp_path):
    poses = {"pose": TOPICS["pose"]}
    summary, rows = replay_of(tmp_path, plunge(), topics=poses, twist_source="pose_difference")
    assert summary.reasons["wrench_missing"] == summary.estimates > 500
    assert summary.wrench["fz"]["measured"]["rms"] is None
    assert summary.phases["penetration"].wrench["force"]["predicted"]["peak"] > 10.0
    assert rows[-1]["residual_fz"] == ""


def test_a_bag_without_any_estimate_writes_its_output_and_fails(tmp_path, capsys):
    lost = write_ros2(tmp_path / "lost", moments(), frames=LOST)
    assert main(["replay", str(lost), "-o", str(tmp_path / "out"), "--no-report"]) == 1
    out, err = capsys.readouterr()
    frame = "pose frame_id 'elsewhere' is not world_frame 'world'"
    assert err.startswith(
        f"rft replay: bag 'lost' has no estimate for its 60 poses; most often {frame}"
    )
    assert "set the parameter" in err
    assert "/tf_static" in err
    assert len(err.splitlines()) == 1
    assert f"  not used or unanswered: pose_frame_unknown 60 ({frame}; set" in out
    assert "wrench frame_id 'elsewhere' is not sensor_frame 'ft_sensor'" in out
    assert "rft doctor proposes the frames" in out
    written = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert written["reasons"]["pose_frame_unknown"] == 60
    assert written["unknown_frames"]["pose_frame_unknown"].startswith(frame)


@pytest.mark.parametrize("role", ["pose", "twist", "wrench"])
def test_a_second_publisher_that_lags_changes_no_estimate(tmp_path, role):
    rows = list(plunge())
    late = [
        (r, time + 1, stamp - 3 * STEP, v)
        for r, time, stamp, v in rows
        if r == role and stamp > START + 5 * STEP
    ]
    summary, _ = replay_of(tmp_path / "both", sorted(rows + late, key=lambda row: row[1]))
    assert summary.reasons[f"{role}_out_of_order"] == len(late)
    alone, _ = replay_of(tmp_path / "alone", rows)
    assert summary.estimates == alone.estimates
    assert summary.phases == alone.phases


def test_a_damaged_bag_says_so_in_the_summary_on_the_terminal_and_in_the_report(tmp_path, capsys):
    whole = write_mcap(tmp_path / "whole.mcap", list(plunge()), chunk_size=2**12)
    cut = tmp_path / "cut.mcap"
    data = bytearray(whole.read_bytes())
    at = len(data) // 2
    data[at : at + 64] = b"\xff" * 64
    cut.write_bytes(bytes(data))
    for bag, out in ((whole, "all"), (cut, "out")):
        assert main(["replay", str(bag), "-o", str(tmp_path / out)]) == 0
    assert "damage: cut.mcap is damaged" in capsys.readouterr().out
    assert "Damage: cut.mcap is damaged" in (tmp_path / "out" / "report.html").read_text()
    summary, rows = (
        json.loads((tmp_path / "out" / "summary.json").read_text()),
        rows_of(tmp_path / "out"),
    )
    assert "cut.mcap is damaged" in summary["damage"]
    assert len(rows) == summary["messages"]["pose"] > 200
    # the last phase before the cut may not have lasted long enough to be told
    assert rows[:-15] == rows_of(tmp_path / "all")[: len(rows) - 15]


def test_an_output_that_is_not_its_own_is_not_overwritten(bag, tmp_path):
    """Other files, and recordings by others."""
    (tmp_path / "notes" / "estimates").mkdir(parents=True)
    (tmp_path / "notes" / "estimates" / "thesis.txt").touch()
    write_ros2(tmp_path / "recorded" / "estimates", moments(1))
    for folder in (tmp_path / "notes", tmp_path / "recorded"):
        before = sorted(folder.rglob("*"))
        with pytest.raises(InputError, match="not written by rft_ros"):
            replay(bag, folder, values())
        assert sorted(folder.rglob("*")) == before


def test_options_come_from_the_parameter_file(tmp_path):
    file = tmp_path / "p.yaml"
    file.write_text(
        "rft_replay:\n  ros__parameters:\n    remap: ['~/pose:=/p']\n    tare: 2\n    end: 3.5\n"
    )
    options = read_replay_options(file)
    assert options == ReplayOptions(remap=["~/pose:=/p"], tare=2, end=3.5)
    wrong = {
        "remap: 7": "remap",
        "tear: 2.0": "tear is 2.0; it has",
        "tare:": "tare has no value",
        "tare: soon": "tare",
        "tare: -1": r"p\.yaml.+tare is -1;",
    }
    for text, words in wrong.items():
        file.write_text(f"rft_replay:\n  ros__parameters:\n    {text}\n")
        with pytest.raises(InputError, match=words):
            read_replay_options(file)


def test_a_learning_replay_reports_what_it_learned_and_the_error_with_and_without(tmp_path):
    bias = (0.05, 0.0, 0.0, 0.0, 0.0, 0.0)
    summary, rows = replay_of(tmp_path, plunge(), learning__mode="apply", sensor__bias=bias)
    assert tuple(rows[0]) == COLUMNS + LEARNED_COLUMNS
    assert all(None not in row.values() for row in rows)
    ((mode, off),) = summary.learning.items()
    assert mode == "off"
    assert summary.median_relative_error < 0.5 * off.median_relative_error
    observed, _ = replay_of(
        tmp_path / "observed", plunge(), learning__mode="observe", sensor__bias=bias
    )
    ((mode, applied),) = observed.learning.items()
    assert mode == "apply"
    assert applied.median_relative_error == summary.median_relative_error
    assert observed.median_relative_error == off.median_relative_error
    assert float(rows[200]["vertical_strength"]) != 1.0
    assert float(rows[200]["vertical_strength_error"]) > 0.0


PEAKS = """
import resource, sys
from pathlib import Path
from rft_ros.bags.playback import played_estimates
from rft_ros.bags.replay import replay
from rft_ros.parameters import Config
for bag in map(Path, sys.argv[2:]):
    replay(bag, Path(sys.argv[1]) / bag.name, Config().values, report=True)
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
"""


def test_a_bag_of_ten_times_the_length_takes_no_more_memory(tmp_path):
    """20 s and 200 s at 100 Hz; the bound on the growth of the peak [MiB] is the largest block of rows."""
    bags = [write_ros2(tmp_path / f"times{n}", plunge(3 * n)) for n in (1, 10)]
    done = subprocess.run(
        [sys.executable, "-c", PEAKS, tmp_path / "out", *bags], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    of_the_short, of_both = map(float, done.stdout.split())
    assert of_both - of_the_short < 40.0


def test_poses_as_motion_capture_sends_them_replay_as_stamped_poses(tmp_path):
    bag = write_ros2(tmp_path / "bag", plunge())
    messages = []
    for role, time, stamp, numbers in plunge():
        if role == "pose":
            sent = TransformSample(
                stamp, "world", "tool", tuple(numbers[:3]), tuple(numbers[3:]), False
            )
            messages.append((time, "/vicon/tool", TRANSFORM, transform_cdr(sent)))
        else:
            messages.append((time, *TOPICS[role], cdr(role, stamp, numbers)))
    captured = write_messages(tmp_path / "captured", messages)
    remap = ("~/pose:=/vicon/tool",)
    replay(bag, tmp_path / "a", values())
    replay(captured, tmp_path / "b", values(), ReplayOptions(remap=remap))
    assert rows_of(tmp_path / "a") == rows_of(tmp_path / "b")

"""Replays of damaged and unsuitable bags use what comes before the damage and report it in the summary."""

import json

import pytest
from recordings import START, STEP, TOPICS, message, moments, plunge, write_ros1, write_ros2
from replays import rows_of, values
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from rft_ros.bags.replay import replay
from rft_ros.cli import main
from rft_ros.errors import InputError


def table(folder):
    return (folder / "estimates.csv").read_text().splitlines()


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_a_bag_cut_in_the_middle_of_a_message_gives_the_rows_before_the_cut(tmp_path, kind):
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    whole = next(write_ros2(tmp_path / "whole", plunge(), plugin=plugin).glob(f"*.{kind}"))
    replay(whole, tmp_path / "all", values())
    cut = tmp_path / f"cut.{kind}"
    data = whole.read_bytes()
    cut.write_bytes(data[: len(data) * 7 // 10 + 13])
    summary = replay(cut, tmp_path / "out", values())
    assert f"cut.{kind} is damaged" in summary.damage
    assert "messages were used, up to" in summary.damage
    rows = table(tmp_path / "out")
    assert len(rows) == summary.messages["pose"] + 1 > 200
    # the last phase before the cut may not have lasted long enough to be told
    assert rows[:-15] == table(tmp_path / "all")[: len(rows) - 15]
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["damage"] == summary.damage


def test_a_ros_1_bag_without_its_index_is_refused_with_what_restores_it(tmp_path):
    whole = write_ros1(tmp_path / "whole.bag", moments()).read_bytes()
    (tmp_path / "cut.bag").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"bag '.*cut\.bag' cannot be read \(.+\); try 'rosbag reindex'"):
        replay(tmp_path / "cut.bag", tmp_path / "out", values())


def test_a_damaged_bag_says_so_on_the_terminal_and_in_the_report(tmp_path, capsys):
    whole = next(write_ros2(tmp_path / "whole", plunge()).glob("*.mcap")).read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    assert main(["replay", str(tmp_path / "cut.mcap"), "-o", str(tmp_path / "out")]) == 0
    assert "reading stopped early: cut.mcap is damaged" in capsys.readouterr().out
    assert "Reading stopped early: cut.mcap is damaged" in (tmp_path / "out" / "report.html").read_text()


def test_a_missing_metadata_file_changes_no_estimate(tmp_path):
    bag = write_ros2(tmp_path / "bag", moments())
    replay(bag, tmp_path / "whole", values())
    (bag / "metadata.yaml").unlink()
    summary = replay(bag, tmp_path / "out", values())
    assert "metadata.yaml is missing" in summary.damage
    assert table(tmp_path / "out") == table(tmp_path / "whole")


def with_unknown_type(path, *, instead_of=()):
    """A bag with one more topic, of a type that only its own definition tells; or with that type on a role's topic."""
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg("float64 dust", "lab_msgs/msg/Dust"))
    dust = store.serialize_cdr(store.types["lab_msgs/msg/Dust"](0.5), "lab_msgs/msg/Dust")
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {r: (n, t) for r, (n, t) in TOPICS.items() if r not in instead_of}
        connections = {r: writer.add_connection(n, t, typestore=store) for r, (n, t) in topics.items()}
        names = [TOPICS[role][0] for role in instead_of] or ["/dust"]
        strange = [writer.add_connection(name, "lab_msgs/msg/Dust", typestore=store) for name in names]
        for role, time, stamp, numbers in moments():
            if role in connections:
                data = store.serialize_cdr(message(store, role, stamp, numbers), TOPICS[role][1])
                writer.write(connections[role], time, data)
            for connection in strange:
                writer.write(connection, time, dust)
    return path


def test_an_unknown_message_type_beside_the_topics_is_ignored(tmp_path):
    replay(write_ros2(tmp_path / "plain", moments()), tmp_path / "one", values())
    summary = replay(with_unknown_type(tmp_path / "bag"), tmp_path / "two", values())
    assert summary.damage is None
    assert table(tmp_path / "one") == table(tmp_path / "two")


def test_an_unknown_message_type_on_a_topic_is_named(tmp_path):
    bag = with_unknown_type(tmp_path / "bag", instead_of=("wrench",))
    sentence = "wrench topic '/rft/wrench_measured' is lab_msgs/msg/Dust; it must be geometry_msgs/msg/WrenchStamped"
    with pytest.raises(InputError, match=sentence):
        replay(bag, tmp_path / "out", values())


@pytest.mark.parametrize(("only", "words"), [("wrench", "no pose topic"), ("pose", "no twist topic")])
def test_one_topic_alone_is_refused_with_a_sentence(tmp_path, capsys, only, words):
    bag = write_ros2(tmp_path / "bag", moments(), topics={only: TOPICS[only]})
    assert main(["replay", str(bag), "-o", str(tmp_path / "out")]) == 2
    (sentence,) = capsys.readouterr().err.splitlines()
    assert words in sentence
    assert str(bag) in sentence


def test_poses_alone_predict_by_their_differences_and_have_a_report(tmp_path):
    bag = write_ros2(tmp_path / "bag", plunge(), topics={"pose": TOPICS["pose"]})
    summary = replay(bag, tmp_path / "out", values(twist_source="pose_difference"), report=True)
    assert summary.reasons["wrench_missing"] == summary.estimates > 500
    assert summary.phases["penetration"].wrench["force"].predicted.peak > 10.0
    assert (tmp_path / "out" / "report.html").stat().st_size > 1_000_000


@pytest.mark.parametrize("beside", [False, True])
def test_a_bag_without_any_estimate_writes_its_output_and_fails(tmp_path, capsys, beside):
    """Alone, and in a batch beside one that brings some."""
    bags = [write_ros2(tmp_path / "bag", moments(), frame="elsewhere")]
    if beside:
        bags.append(write_ros2(tmp_path / "good", moments()))
    assert main(["replay", *map(str, bags), "-o", str(tmp_path / "out"), "--no-report"]) == 1
    out, err = capsys.readouterr()
    (sentence,) = err.splitlines()
    assert sentence.startswith(
        "rft replay: bag 'bag' has no estimate for its 60 poses; most often pose frame_id 'elsewhere'"
    )
    assert "pose frame_id 'elsewhere' is not world_frame 'world'" in out
    folder = tmp_path / "out" / "bag" if beside else tmp_path / "out"
    assert json.loads((folder / "summary.json").read_text())["reasons"]["pose_frame_unknown"] == 60


def test_stamps_all_zero_give_reasons_and_a_report_without_estimates(tmp_path):
    rows = [(role, time, 0, v) for role, time, _, v in moments()]
    summary = replay(write_ros2(tmp_path / "bag", rows), tmp_path / "out", values(), report=True)
    assert summary.estimates == 0
    assert summary.reasons == {
        "pose_stamp_zero": 60, "twist_stamp_zero": 60, "wrench_stamp_zero": 60
    }  # fmt: skip
    assert {(r["reason"], r["phase"], r["quality_flags"]) for r in rows_of(tmp_path / "out")} == {
        ("pose_stamp_zero", "", "")
    }
    assert "pose_stamp_zero" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.parametrize("role", ["pose", "twist", "wrench"])
def test_a_second_publisher_that_lags_changes_no_estimate(tmp_path, role):
    rows = list(plunge())
    late = [(r, time + 1, stamp - 3 * STEP, v) for r, time, stamp, v in rows if r == role and stamp > START + 5 * STEP]
    both = sorted(rows + late, key=lambda row: row[1])
    summary = replay(write_ros2(tmp_path / "both", both), tmp_path / "out", values())
    assert summary.reasons[f"{role}_out_of_order"] == len(late)
    alone = replay(write_ros2(tmp_path / "alone", rows), tmp_path / "one", values())
    assert summary.estimates == alone.estimates
    assert summary.phases == alone.phases

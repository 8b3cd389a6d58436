"""Every format gives the same samples in the same order, and every damage a sentence."""

import json
import os
import re
import shutil
from pathlib import Path

import mcap.writer
import pytest
from recordings import FRAMES, POSE, TOPICS, WRENCH, cdr, moments, plunge, write_ros1, write_ros2
from refusals import refusal
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from rft_ros.bags.playback import topics_of
from rft_ros.bags.reading import Recording
from rft_ros.cli import main
from rft_ros.errors import InputError
from rft_ros.estimator import PoseSample, TwistSample, WrenchSample
from rft_ros.parameters import defaults

NAMES = {role: name for role, (name, _) in TOPICS.items()}
KIND = {"pose": PoseSample, "twist": TwistSample, "wrench": WrenchSample}


def expected(rows):
    split = {"pose": lambda v: (v[:3], v[3:]), "twist": lambda v: (v[:3], v[3:]), "wrench": lambda v: (v,)}
    return [KIND[role](stamp, FRAMES[role], *split[role](values)) for role, _, stamp, values in rows]


def read(path, topics=NAMES, **options):
    with Recording(path, topics, **options) as recording:
        return list(recording), recording.damage


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_rosbag2_folders_give_back_what_was_written(tmp_path, plugin, compress):
    bag = write_ros2(tmp_path / "bag", moments(), plugin=plugin, compress=compress)
    assert read(bag) == (expected(moments()), None)


def test_a_single_mcap_file_and_a_ros_1_bag_give_the_same_samples(tmp_path):
    folder = write_ros2(tmp_path / "bag", moments())
    ros1 = write_ros1(tmp_path / "old.bag", moments())
    assert read(next(folder.glob("*.mcap"))) == read(ros1) == (expected(moments()), None)


def test_order_is_receive_time_then_wrench_twist_pose_whatever_the_header_stamp(tmp_path):
    rows = [(role, time + 3_000_000, stamp, values) for role, time, stamp, values in moments(10)]
    shuffled = [row for k in range(0, 30, 3) for row in (rows[k + 2], rows[k], rows[k + 1])]
    assert read(write_ros2(tmp_path / "bag", shuffled))[0] == expected(rows)


def test_start_and_end_cut_by_receive_time(tmp_path):
    bag = write_ros2(tmp_path / "bag", moments(60))
    samples, _ = read(bag, {"pose": NAMES["pose"]}, start=0.1, end=0.2)
    assert samples == [s for s in expected(moments(21)) if isinstance(s, PoseSample)][10:]
    with pytest.raises(InputError, match=r"lasts 0\.590 s; it has nothing from 9 s"):
        read(bag, start=9.0)


def test_a_bag_cut_in_the_middle_of_a_message_is_used_up_to_there(tmp_path):
    whole = next(write_ros2(tmp_path / "bag", plunge()).glob("*.mcap")).read_bytes()
    cut, kept = tmp_path / "cut.mcap", []
    for part in (0.3, 0.6, 0.9):
        cut.write_bytes(whole[: int(part * len(whole)) + 13])
        samples, damage = read(cut)
        assert "cut.mcap is damaged" in damage
        assert f"{len(samples)} messages were used, up to" in damage
        assert samples == expected(plunge())[: len(samples)]
        kept.append(len(samples))
    assert kept == sorted(kept)
    assert kept[-1] > 1000


def refused(path, *words, topics=NAMES):
    said = refusal(read, path, topics)
    for word in (path.name, *words):
        assert re.search(word, said)


def test_what_is_not_a_bag_is_refused_with_its_name(tmp_path):
    refused(tmp_path / "gone", "does not exist")
    (tmp_path / "empty").mkdir()
    refused(tmp_path / "empty", "is not a bag: give a rosbag2 folder")
    refused(write_ros2(tmp_path / "silent", []), "has no messages")
    for name, content in (("notes.txt", b"no bag"), ("fake.mcap", b"no bag"), ("fake.bag", b"#ROSBAG V2.0\nno")):
        (tmp_path / name).write_bytes(content)
        refused(tmp_path / name, "is not a bag" if name == "notes.txt" else name)
    refused(Path("/dev/null"), "is not a bag")
    os.mkfifo(tmp_path / "pipe.mcap")
    refused(tmp_path / "pipe.mcap", "is a pipe")
    ros1 = write_ros1(tmp_path / "whole.bag", moments())
    sqlite = next(write_ros2(tmp_path / "whole", moments(), plugin=StoragePlugin.SQLITE3).glob("*.db3"))
    for whole, repair in ((ros1, "rosbag reindex"), (sqlite, "sqlite3 FILE .recover")):
        cut = (tmp_path / "cut").with_suffix(whole.suffix)
        cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
        refused(cut, rf"no messages \({cut.name} is damaged: .+; try '{repair}'\)")


def test_a_bag_without_a_needed_topic_or_with_another_type_is_refused_with_a_remedy(tmp_path):
    topics = {"pose": ("/tool_pose", POSE), "wrench": ("/cell", WRENCH)}
    bag = write_ros2(tmp_path / "bag", moments(), topics=topics)
    has = r"/cell \(geometry_msgs/msg/WrenchStamped\)"
    refused(bag, "no pose topic '/rft/pose'", "--remap ~/pose:=/tool_pose", has)
    refused(bag, "no twist topic", "pose_difference", topics=NAMES | {"pose": "/tool_pose", "wrench": "/cell"})
    swapped = {"pose": "/cell", "wrench": "/tool_pose"}
    refused(bag, "WrenchStamped; it must be .* .use .*--remap ~/pose:=/tool_pose", topics=swapped)
    swapped = {"pose": "/tool_pose", "wrench": "/tool_pose"}
    refused(bag, "wrench topic .* .use --remap ~/wrench_measured:=/cell", topics=swapped)


@pytest.mark.parametrize("beside", [True, False])
def test_an_unknown_message_type_is_ignored_beside_the_topics_and_named_on_one(tmp_path, beside):
    """Of a type that only its own definition in the bag tells."""
    store, kind = get_typestore(Stores.ROS2_JAZZY), "lab_msgs/msg/Dust"
    store.register(get_types_from_msg("float64 dust", kind))
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {role: TOPICS[role] for role in (TOPICS if beside else ("pose", "twist"))}
        connections = {r: writer.add_connection(n, t, typestore=store) for r, (n, t) in topics.items()}
        strange = writer.add_connection("/dust" if beside else NAMES["wrench"], kind, typestore=store)
        for role, time, stamp, numbers in moments():
            if role in connections:
                writer.write(connections[role], time, cdr(role, stamp, numbers))
            writer.write(strange, time, store.serialize_cdr(store.types[kind](0.5), kind))
    if beside:
        assert read(tmp_path / "bag") == (expected(moments()), None)
    else:
        refused(tmp_path / "bag", f"wrench topic '/rft/wrench_measured' is {kind}; it must be {WRENCH}")


def test_a_topic_that_is_not_of_ros_is_ignored_beside_the_topics_and_named_on_one(tmp_path):
    rows = list(moments())
    file = tmp_path / "foreign.mcap"
    with file.open("wb") as stream:
        writer = mcap.writer.Writer(stream)
        writer.start()
        foreign = writer.register_schema("Log", "jsonschema", b"{}")
        channels = {"log": writer.register_channel("/log", "json", foreign)}
        for role, (topic, kind) in TOPICS.items():
            channels[role] = writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", b""))
        writer.add_message(channels["log"], rows[0][1], b"{}", 0)
        for role, time, stamp, values in rows:
            writer.add_message(channels[role], time, cdr(role, stamp, values), time)
        writer.finish()
    assert read(file) == (expected(rows), None)
    refused(file, "pose topic '/log' is Log as json; it must be", topics=NAMES | {"pose": "/log"})


def test_a_message_that_cannot_be_decoded_or_found_is_left_out_and_named(tmp_path):
    bag = write_ros2(tmp_path / "bag", moments(5))
    file = next(bag.glob("*.mcap"))
    data = bytearray(file.read_bytes())
    at = data.index(b"\x00\x01\x00\x00", len(data) // 3)
    data[at : at + 4] = b"\x00\x09\x00\x00"
    file.write_bytes(bytes(data))
    samples, damage = read(bag)
    assert len(samples) == 14
    assert re.match(r"a message on /rft/\w+ cannot be decoded \(encoding 0009 is not .*; 14 messages were used", damage)
    assert main(["replay", str(bag), "-o", str(tmp_path / "out"), "--no-report"]) == 0
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["reasons"] == {"message_unreadable": 1}
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(bytes(data[: at + 300]))
    assert "cut.mcap is damaged" in read(cut)[1]
    data[at - 31] = 0x99  # no message any more: rosbags leaves it out
    file.write_bytes(bytes(data))
    assert "bag is damaged: 1 of its messages are missing; 14 messages were used" in read(bag)[1]


def test_a_split_bag_is_one_recording_also_without_metadata(tmp_path):
    rows = list(moments(40))
    (tmp_path / "joined").mkdir()
    for k, part in enumerate((rows[:60], rows[60:])):
        bag = write_ros2(tmp_path / f"part{k}", part)
        shutil.copy(next(bag.glob("*.mcap")), tmp_path / "joined" / f"joined_{k + 9}.mcap")  # 10 comes after 9
    samples, damage = read(tmp_path / "joined")
    assert samples == expected(rows)
    assert damage.startswith("its files were read one by one, without metadata.yaml: it is missing; 120")
    cut = tmp_path / "joined" / "joined_9.mcap"
    cut.write_bytes(cut.read_bytes()[: cut.stat().st_size // 2])
    samples, damage = read(tmp_path / "joined")
    assert samples == expected(rows[: len(samples)])  # nothing from the part after the damage
    assert "joined_9.mcap is damaged" in damage


def test_remaps_resolve_as_in_ros_later_ones_win_and_invalid_ones_are_refused():
    assert topics_of(defaults()) == NAMES
    assert "twist" not in topics_of({**defaults(), "twist_source": "pose_difference"})
    rules = ["~/pose:=/a", "/rft/pose:=/b", "~/twist:=c", "~/wrench_measured:=~/d"]
    assert topics_of(defaults(), rules) == {"pose": "/b", "twist": "/c", "wrench": "/rft/d"}
    for rule, words in (("~/pose", "FROM:=TO"), ("~/pose:=", "FROM:=TO"), ("~/joint:=/x", "~/joint")):
        with pytest.raises(InputError, match=words):
            topics_of(defaults(), [rule])

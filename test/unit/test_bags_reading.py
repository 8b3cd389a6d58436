"""Every format gives the same samples in the same order, and every damage a sentence."""

import itertools
import json
import os
import re
import sqlite3
import tracemalloc
from contextlib import closing, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
import yaml
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from recordings import (
    FRAMES,
    POSE,
    ROS2,
    TOPICS,
    WRENCH,
    cdr,
    moments,
    plunge,
    write_mcap,
    write_ros1,
    write_ros2,
)
from refusals import refusal
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from rft_ros.bags.options import ReplayOptions, topics_of
from rft_ros.bags.reading import opened_recording
from rft_ros.cli import main
from rft_ros.errors import InputError
from rft_ros.estimator import PoseSample, TwistSample, WrenchSample
from rft_ros.parameters import Config

NAMES = {role: name for role, (name, _) in TOPICS.items()}
KIND = {"pose": PoseSample, "twist": TwistSample, "wrench": WrenchSample}


def expected(rows):
    split = {
        "pose": lambda v: (v[:3], v[3:]),
        "twist": lambda v: (v[:3], v[3:]),
        "wrench": lambda v: (v,),
    }
    return [
        KIND[role](stamp, FRAMES[role], *split[role](values)) for role, _, stamp, values in rows
    ]


def read(path, remap=(), *, twist_source="topic", **options):
    values = Config().values | {"twist_source": twist_source}
    with opened_recording(path, values, ReplayOptions(remap=remap, **options)) as recording:
        return list(recording), recording.damage


def test_every_format_gives_back_what_was_written(tmp_path):
    bags = [write_ros1(tmp_path / "old.bag", moments())]
    for plugin, compress in itertools.product(
        (StoragePlugin.MCAP, StoragePlugin.SQLITE3), (False, True)
    ):
        folder = write_ros2(
            tmp_path / f"{plugin.name}_{compress}", moments(), plugin=plugin, compress=compress
        )
        bags += [folder, *(file for file in folder.iterdir() if file.name != "metadata.yaml")]
    for bag in bags:
        assert read(bag) == (expected(moments()), None), bag


def test_order_is_receive_time_then_wrench_twist_pose_whatever_the_header_stamp(tmp_path):
    rows = [(role, time + 3_000_000, stamp, values) for role, time, stamp, values in moments(10)]
    shuffled = [row for k in range(0, 30, 3) for row in (rows[k + 2], rows[k], rows[k + 1])]
    assert read(write_ros2(tmp_path / "bag", shuffled))[0] == expected(rows)


def test_start_and_end_cut_by_receive_time(tmp_path):
    bag = write_ros2(tmp_path / "bag", moments(60))
    samples, _ = read(bag, start=0.1, end=0.2)
    assert [s for s in samples if isinstance(s, PoseSample)] == [
        s for s in expected(moments(21)) if isinstance(s, PoseSample)
    ][10:]
    with pytest.raises(InputError, match=r"lasts 0\.590 s; it has nothing from 9 s"):
        read(bag, start=9.0)


def test_a_bag_is_read_up_to_its_damage_which_is_named_with_the_tool_that_repairs_it(tmp_path):
    rows = list(moments(300))
    file = write_mcap(tmp_path / "run.mcap", rows, chunk_size=2**12)
    whole = file.read_bytes()
    at = len(whole) // 2
    file.write_bytes(whole[:at] + b"\xff" * 64 + whole[at + 64 :])
    samples, said = read(file)
    assert 300 < len(samples) < 600
    assert samples == expected(rows)[: len(samples)]
    assert re.match(r"run.mcap is damaged: .*; try 'mcap recover'; ", said)
    assert f"{len(samples)} messages were used, up to" in said


@pytest.mark.parametrize("damage", ["cut", "zeros", "longer"])
def test_a_bag_without_its_index_is_refused_with_the_tool_that_repairs_it(tmp_path, damage):
    """As of a recorder that was killed, or a lost supply; in `longer` the index points beside the records."""
    file = next(write_ros2(tmp_path / "run", moments()).glob("*.mcap"))
    whole = file.read_bytes()
    middle = len(whole) // 2
    behind = whole[middle:] if damage == "longer" else b""
    between = b"\xff" * 64 if damage == "longer" else b""
    file.write_bytes(whole[:middle] + between + behind)
    if damage == "zeros":
        os.truncate(file, len(whole))
    refused(file, r"no messages \(run.mcap is damaged: .+; try 'mcap recover'\)")


@pytest.mark.parametrize("write", [write_ros1, lambda file, rows: write_mcap(file, [*rows])])
def test_a_length_that_no_file_has_allocates_no_more_than_the_file(tmp_path, write):
    """In place of that of the first record, of 4 bytes for ROS 1 and 8 bytes for MCAP."""
    file = write(tmp_path / ("run.bag" if write is write_ros1 else "run.mcap"), moments(3))
    whole = file.read_bytes()
    tracemalloc.start()
    for at in range(9, 60):
        file.write_bytes(whole[:at] + b"\xff\xff\xff\xff" + whole[at + 4 :])
        with suppress(InputError):
            read(file)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 100e6


def refused(path, *words, **given):
    said = refusal(read, path, **given)
    for word in (path.name, *words):
        assert re.search(word, said)


def test_what_is_not_a_bag_is_refused_with_its_name(tmp_path):
    refused(tmp_path / "gone", "does not exist")
    (tmp_path / "empty").mkdir()
    refused(tmp_path / "empty", "is not a bag: give a rosbag2 folder")
    refused(write_ros2(tmp_path / "silent", []), "has no messages")
    for name, content in (
        ("notes.txt", b"no bag"),
        ("fake.mcap", b"no bag"),
        ("fake.bag", b"#ROSBAG V2.0\nno"),
    ):
        (tmp_path / name).write_bytes(content)
        refused(tmp_path / name, "is not a bag" if name == "notes.txt" else name)
    refused(Path("/dev/null"), "is not a bag")
    os.mkfifo(tmp_path / "pipe.mcap")
    refused(tmp_path / "pipe.mcap", "is a pipe")
    ros1 = write_ros1(tmp_path / "whole.bag", moments())
    sqlite = next(
        write_ros2(tmp_path / "whole", moments(), plugin=StoragePlugin.SQLITE3).glob("*.db3")
    )
    for whole, repair in ((ros1, "rosbag reindex"), (sqlite, "sqlite3 FILE .recover")):
        cut = (tmp_path / "cut").with_suffix(whole.suffix)
        cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
        refused(cut, rf"no messages \({cut.name} is damaged: .+; try '{repair}'\)")


def test_a_bag_without_a_needed_topic_or_with_another_type_is_refused_with_a_remedy(tmp_path):
    topics = {"pose": ("/tool_pose", POSE), "wrench": ("/cell", WRENCH)}
    bag = write_ros2(tmp_path / "bag", moments(), topics=topics)
    has = r"/cell \(geometry_msgs/msg/WrenchStamped\)"
    refused(bag, "no pose topic '/rft/pose'", "--remap ~/pose:=/tool_pose", has)
    refused(
        bag,
        "no twist topic",
        "pose_difference",
        remap=["~/pose:=/tool_pose", "~/wrench_measured:=/cell"],
    )
    poses_of_cell = "WrenchStamped; it must be .* .use .*--remap ~/pose:=/tool_pose"
    refused(bag, poses_of_cell, remap=["~/pose:=/cell"])
    swapped = ["~/pose:=/tool_pose", "~/wrench_measured:=/tool_pose"]
    readings_of_pose = "wrench topic .* .use --remap ~/wrench_measured:=/cell"
    refused(bag, readings_of_pose, remap=swapped, twist_source="pose_difference")


FILTERED = "/force_torque_sensor_broadcaster/wrench_filtered"


def recorded_with(tmp_path, wrench_topic):
    topics = {**TOPICS, "wrench": (wrench_topic, WRENCH)}
    return write_ros2(tmp_path / "bag", plunge(), topics=topics)


@pytest.mark.parametrize("command", ["replay", "calibrate"])
def test_a_load_cell_under_another_name_than_given_is_named_at_once_with_the_remap(
    tmp_path, capsys, command
):
    bag = recorded_with(tmp_path, FILTERED)
    file = tmp_path / "cell.yaml"
    file.write_text("/**: {ros__parameters: {mesh.file: plate}}")
    given = "/force_torque_sensor_broadcaster/wrench"
    remap = f"--remap=~/wrench_measured:={given}"
    out = str(tmp_path / "out.yaml")
    assert main([command, str(bag), "--params", str(file), remap, "-o", out]) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert f"no wrench topic '{given}' (use --remap ~/wrench_measured:={FILTERED}; it has" in said
    assert f"{FILTERED} ({WRENCH})" in said


def test_a_replay_without_a_load_cell_warns_and_a_calibration_is_refused(tmp_path, capsys):
    """What the node itself published is not the load cell."""
    bag = recorded_with(tmp_path, "/left/rft/wrench_predicted")
    file = tmp_path / "cell.yaml"
    file.write_text("/**: {ros__parameters: {mesh.file: plate}}")
    arguments = [str(bag), "--params", str(file), "-o"]
    assert main(["replay", *arguments, str(tmp_path / "out"), "--no-report"]) == 0
    assert "warning: no load cell: nothing on /rft/wrench_measured" in capsys.readouterr().out
    assert main(["calibrate", *arguments, str(tmp_path / "calibrated.yaml")]) == 2
    assert "has no wrench topic '/rft/wrench_measured'" in capsys.readouterr().err


def test_a_table_without_readings_cannot_be_calibrated_and_names_the_columns(tmp_path, capsys):
    table = tmp_path / "trial.csv"
    table.write_text(
        "t,px,py,pz,qx,qy,qz,qw\n" + "\n".join(f"{k},0,0,{k},0,0,0,1" for k in range(9))
    )
    file = tmp_path / "cell.yaml"
    file.write_text("/**: {ros__parameters: {mesh.file: plate}}")
    out = str(tmp_path / "calibrated.yaml")
    assert main(["calibrate", str(table), "--params", str(file), "-o", out]) == 2
    assert "has no wrench: add the columns fx, fy, fz, tx, ty, tz" in capsys.readouterr().err


@pytest.mark.parametrize("beside", [True, False])
def test_an_unknown_message_type_is_ignored_beside_the_topics_and_named_on_one(tmp_path, beside):
    """Of a type that only its own definition in the bag tells."""
    store, kind = get_typestore(Stores.ROS2_JAZZY), "lab_msgs/msg/Dust"
    store.register(get_types_from_msg("float64 dust", kind))
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {role: TOPICS[role] for role in (TOPICS if beside else ("pose", "twist"))}
        connections = {
            r: writer.add_connection(n, t, typestore=store) for r, (n, t) in topics.items()
        }
        strange = writer.add_connection(
            "/dust" if beside else NAMES["wrench"], kind, typestore=store
        )
        for role, time, stamp, numbers in moments():
            if role in connections:
                writer.write(connections[role], time, cdr(role, stamp, numbers))
            writer.write(strange, time, store.serialize_cdr(store.types[kind](0.5), kind))
    if beside:
        assert read(tmp_path / "bag") == (expected(moments()), None)
    else:
        refused(
            tmp_path / "bag", f"wrench topic '/rft/wrench_measured' is {kind}; it must be {WRENCH}"
        )


def test_a_topic_that_is_not_of_ros_2_is_ignored_beside_the_topics_and_on_one_the_advice_is_to_convert(
    tmp_path,
):
    rows = list(moments())
    file = write_mcap(tmp_path / "foreign.mcap", rows)
    assert read(file) == (expected(rows), None)
    refused(file, "pose topic '/log' is Log as json", "convert", remap=["~/pose:=/log"])
    ros1 = write_mcap(tmp_path / "old.mcap", rows, encoding="ros1")
    refused(
        ros1, "pose topic '/rft/pose' is geometry_msgs/msg/PoseStamped as ros1", "convert", "cdr"
    )


def test_a_message_that_cannot_be_decoded_is_left_out_and_named(tmp_path):
    bag = write_ros2(tmp_path / "bag", moments(5))
    file = next(bag.glob("*.mcap"))
    data = bytearray(file.read_bytes())
    at = data.index(b"\x00\x01\x00\x00", len(data) // 3)
    data[at : at + 4] = b"\x00\x09\x00\x00"
    file.write_bytes(bytes(data))
    samples, damage = read(bag)
    assert len(samples) == 14
    assert re.match(
        r"a message on /rft/\w+ cannot be decoded \(encoding 0009 is not .*; 14 messages were used",
        damage,
    )
    assert main(["replay", str(bag), "-o", str(tmp_path / "out"), "--no-report"]) == 0
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["reasons"] == {
        "message_unreadable": 1
    }


WORDS_OF_PYTHON = r"ssize_t|Python|buffer|unpack|object|NoneType|subscript|codec|0x|argument|Error"


@pytest.mark.parametrize("plugin", ["mcap", "db3", "bag"])
@pytest.mark.parametrize("written", [b"\xff", b"\x7f", b"\x00"])
def test_whatever_number_is_damaged_the_message_does_not_speak_of_python(
    tmp_path, plugin, written
):
    rows = list(moments(4))
    if plugin == "bag":
        file = write_ros1(tmp_path / "run.bag", rows)
    else:
        storage = StoragePlugin.MCAP if plugin == "mcap" else StoragePlugin.SQLITE3
        (file,) = write_ros2(tmp_path / "run", rows, plugin=storage).glob(f"*.{plugin}")
    whole = file.read_bytes()
    said = set()
    for at in range(8, len(whole) - 8, max(1, len(whole) // 400)):
        file.write_bytes(whole[:at] + 8 * written + whole[at + 8 :])
        try:
            said.add(read(file)[1] or "")
        except InputError as error:
            said.add(str(error))
    assert any("is damaged" in sentence for sentence in said)
    assert [sentence for sentence in said if re.search(WORDS_OF_PYTHON, sentence)] == []


def part_of(folder, name, rows, plugin, packed):
    """One file of a split bag."""
    suffix = f".{plugin.name.lower()}".replace("sqlite3", "db3")
    (file,) = write_ros2(folder / f"only_{name}", rows, plugin=plugin).glob(f"*{suffix}")
    part = folder / "bag" / f"{name}{suffix}{'.zstd' * packed}"
    part.write_bytes(zstandard.compress(file.read_bytes()) if packed else file.read_bytes())
    return part


@st.composite
def splits(draw):
    """Cuts of a recording, the order of the parts' names, whether metadata.yaml has them, and a malformed part."""
    cuts = sorted(draw(st.lists(st.integers(1, 119), min_size=1, max_size=5, unique=True)))
    order = draw(st.permutations(range(len(cuts) + 1)))
    broken = draw(st.one_of(st.none(), st.integers(0, len(cuts))))
    return cuts, order, draw(st.booleans()), broken


@settings(max_examples=30, deadline=None)
@given(splits(), st.sampled_from([StoragePlugin.MCAP, StoragePlugin.SQLITE3]), st.booleans())
def test_of_a_split_bag_all_that_is_intact_is_read_in_order_whatever_the_names_of_its_files(
    split, plugin, packed
):
    cuts, order, described, broken = split
    rows = list(moments(40))
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "bag").mkdir()
        spans = list(itertools.pairwise([0, *cuts, len(rows)]))
        parts = {
            k: part_of(folder, f"p_{order[k]}", rows[i:j], plugin, packed)
            for k, (i, j) in enumerate(spans)
        }
        if described:
            names = [parts[k].name for k in order]
            about = {"rosbag2_bagfile_information": {"relative_file_paths": names}}
            (folder / "bag" / "metadata.yaml").write_text(yaml.safe_dump(about))
        if broken is not None:
            parts[broken].write_bytes(b"no file of a bag")
        left = [row for k, (i, j) in enumerate(spans) for row in rows[i:j] if k != broken]
        samples, damage = read(folder / "bag")
    assert samples == expected(left)
    assert (damage is None) == (described and broken is None)
    assert broken is None or f"{parts[broken].name} is damaged: " in damage
    assert described or "'ros2 bag reindex' writes it" in damage


def test_files_of_one_time_are_merged_as_of_a_recorder_for_each_topic(tmp_path):
    rows = list(moments(60))
    (tmp_path / "bag").mkdir()
    for role in TOPICS:
        part_of(
            tmp_path,
            role,
            [row for row in rows if row[0] == role],
            StoragePlugin.MCAP,
            packed=False,
        )
    assert read(tmp_path / "bag")[0] == expected(rows)


def test_a_part_that_metadata_names_and_that_is_gone_is_named(tmp_path):
    bag = write_ros2(tmp_path / "bag", moments())
    about = bag / "metadata.yaml"
    about.write_text(about.read_text().replace("- bag.mcap", "- bag.mcap\n  - bag_1.mcap"))
    samples, damage = read(bag)
    assert samples == expected(moments())
    assert re.match("bag file '.*/bag_1.mcap' does not exist; .*; 180 messages were used", damage)


@pytest.mark.parametrize("suffix", [".zstd", ".zst"])
def test_a_loose_compressed_file_is_read_and_a_damaged_one_is_named(tmp_path, suffix):
    (file,) = write_ros2(tmp_path / "run", plunge()).glob("*.mcap")
    packed = zstandard.compress(file.read_bytes())
    loose = tmp_path / f"run.mcap{suffix}"
    loose.write_bytes(packed)
    assert read(loose) == (expected(plunge()), None)
    loose.write_bytes(packed[: len(packed) // 2])
    refused(loose, f"run.mcap{suffix} is damaged: .*try 'mcap recover'")


def test_a_bag_with_compressed_messages_is_read(tmp_path):
    bag = Writer(tmp_path / "bag", version=8, storage_plugin=StoragePlugin.SQLITE3)
    bag.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with bag as writer:
        connections = {
            r: writer.add_connection(name, kind, typestore=ROS2)
            for r, (name, kind) in TOPICS.items()
        }
        for role, time, stamp, values in moments():
            writer.write(connections[role], time, cdr(role, stamp, values))
    assert read(tmp_path / "bag") == (expected(moments()), None)


@pytest.mark.parametrize("name", ["metadata.yaml", "bag.mcap", "more.mcap"])
def test_a_pipe_in_a_bag_is_named_and_not_waited_for(tmp_path, name):
    bag = write_ros2(tmp_path / "bag", moments(4))
    (bag / "metadata.yaml").unlink()
    (bag / name).unlink(missing_ok=True)
    os.mkfifo(bag / name)
    if name == "bag.mcap":
        refused(bag, "has no messages", "is a pipe")
    else:
        assert "is a pipe" in read(bag)[1]


def test_metadata_with_aliases_is_read(tmp_path):
    """The libraries that write it use them, and those that read it take them."""
    bag = write_ros2(tmp_path / "bag", moments())
    about = bag / "metadata.yaml"
    about.write_text(
        "names: &names [bag.mcap]\n" + about.read_text().replace("\n  - bag.mcap", " *names")
    )
    assert "*names" in about.read_text()
    assert read(bag) == (expected(moments()), None)


def sqlite(folder):
    return next(write_ros2(folder / "bag", moments(), plugin=StoragePlugin.SQLITE3).glob("*.db3"))


@pytest.mark.parametrize("log", ["wal", "journal"])
def test_what_a_killed_recorder_left_beside_a_database_is_named_with_the_command_that_merges_it(
    tmp_path, log
):
    """Without the log, messages would be missing, or there that were never finished."""
    file = sqlite(tmp_path)
    file.with_name(f"{file.name}-{log}").write_bytes(b"messages")
    refused(file, rf"{file.name}-{log} has a part of it; 'sqlite3 {file.name} .schema' merges it")


@pytest.mark.parametrize(
    "change", ["data = 'text'", "data = 7", "timestamp = 'noon'", "timestamp = -9e999"]
)
@pytest.mark.parametrize("row", [1, 31])
def test_a_database_with_text_in_its_columns_ends_in_a_sentence(tmp_path, change, row):
    file = sqlite(tmp_path)
    with closing(sqlite3.connect(file)) as database:
        database.execute(f"UPDATE messages SET {change} WHERE id = {row}")
        database.commit()
    try:
        assert re.search("is damaged|cannot be decoded", read(file.parent)[1])
    except InputError as error:
        assert re.search(r"bag.db3 is damaged: .*; try 'sqlite3 FILE .recover'", str(error))


def test_remaps_resolve_as_in_ros_later_ones_win_and_invalid_ones_are_refused():
    fixed = {"tf_static": "/tf_static"}
    assert topics_of(Config().values) == NAMES | fixed
    assert "twist" not in topics_of({**Config().values, "twist_source": "pose_difference"})
    rules = ["~/pose:=/a", "/rft/pose:=/b", "~/twist:=c", "~/wrench_measured:=~/d"]
    topics = {"pose": "/b", "twist": "/c", "wrench": "/rft/d"} | fixed
    assert topics_of(Config().values, rules) == topics
    for rule, words in (
        ("~/pose", "FROM:=TO"),
        ("~/pose:=", "FROM:=TO"),
        ("~/joint:=/x", "~/joint"),
    ):
        with pytest.raises(InputError, match=words):
            topics_of(Config().values, [rule])

"""Every format gives the same samples in the same order, and every damage a sentence."""

import shutil

import pytest
from recordings import POSE, START, STEP, TOPICS, WRENCH, moments, write_ros1, write_ros2
from rosbags.rosbag2 import StoragePlugin

from rft_ros.bags.playback import topics_of
from rft_ros.bags.reading import Recording
from rft_ros.errors import InputError
from rft_ros.estimator import PoseSample, TwistSample, WrenchSample
from rft_ros.parameters import defaults

NAMES = {role: name for role, (name, _) in TOPICS.items()}
KIND = {"pose": PoseSample, "twist": TwistSample, "wrench": WrenchSample}


def expected(rows):
    frames = {"pose": "world", "twist": "world", "wrench": "ft_sensor"}
    split = {"pose": lambda v: (v[:3], v[3:]), "twist": lambda v: (v[:3], v[3:]), "wrench": lambda v: (v,)}
    return [KIND[role](stamp, frames[role], *split[role](values)) for role, _, stamp, values in rows]


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


def test_order_is_receive_time_then_wrench_twist_pose(tmp_path):
    rows = list(moments(10))
    shuffled = [row for k in range(0, 30, 3) for row in (rows[k + 2], rows[k], rows[k + 1])]
    assert read(write_ros2(tmp_path / "bag", shuffled))[0] == expected(rows)


def test_the_header_stamp_need_not_be_the_receive_time(tmp_path):
    rows = [(role, time + 3_000_000, stamp, values) for role, time, stamp, values in moments(5)]
    assert read(write_ros2(tmp_path / "bag", rows))[0] == expected(moments(5))


def test_start_and_end_cut_by_receive_time(tmp_path):
    bag = write_ros2(tmp_path / "bag", moments(60))
    samples, _ = read(bag, start=0.1, end=0.2)
    stamps = [s.stamp for s in samples if isinstance(s, PoseSample)]
    assert stamps == [START + k * STEP for k in range(10, 21)]
    with pytest.raises(InputError, match=r"lasts 0\.590 s; it has nothing from 9 s"):
        read(bag, start=9.0)


def test_only_the_given_topics_are_read(tmp_path):
    bag = write_ros2(tmp_path / "bag", moments())
    samples, _ = read(bag, {"pose": NAMES["pose"]})
    assert {type(s) for s in samples} == {PoseSample}


def test_a_bag_cut_in_the_middle_of_a_message_is_used_up_to_there(tmp_path):
    whole = next(write_ros2(tmp_path / "bag", moments(60)).glob("*.mcap")).read_bytes()
    cut = tmp_path / "cut.mcap"
    kept = []
    for part in (0.3, 0.6, 0.9):
        cut.write_bytes(whole[: int(part * len(whole))])
        try:
            samples, damage = read(cut)
        except InputError as error:  # nothing came before the damage
            assert "cut.mcap" in str(error)
            continue
        assert "cut.mcap is damaged" in damage
        assert samples == expected(moments())[: len(samples)]
        kept.append(len(samples))
    assert kept == sorted(kept)
    assert kept[-1] > 0


def test_the_real_recording_cut_short_gives_what_came_before(shared_data, tmp_path):
    folder = shared_data / "abb_plate" / "abb_plate_3"
    topics = {"pose": "/tool_pose", "wrench": "/ft_sensor/wrench"}
    whole, damage = read(folder, topics)
    assert damage is None
    cut = tmp_path / "cut.mcap"
    cut.write_bytes((folder / "abb_plate_3.mcap").read_bytes()[:2_000_001])
    samples, damage = read(cut, topics)
    assert len(whole) > len(samples) > 3000
    assert samples == whole[: len(samples)]
    assert f"{len(samples)} messages were used" in damage


def test_a_folder_without_metadata_is_read_and_reported(tmp_path):
    bag = write_ros2(tmp_path / "bag", moments())
    (bag / "metadata.yaml").unlink()
    samples, damage = read(bag)
    assert samples == expected(moments())
    assert "metadata.yaml is missing" in damage


def refused(path, *words, topics=NAMES):
    with pytest.raises(InputError) as caught:
        read(path, topics)
    for word in (path.name, *words):
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_not_a_bag_is_refused_with_its_name(tmp_path):
    refused(tmp_path / "gone", "does not exist")
    (tmp_path / "empty").mkdir()
    refused(tmp_path / "empty", "no metadata.yaml")
    (tmp_path / "notes.txt").write_text("no bag")
    refused(tmp_path / "notes.txt", "is not a bag")
    (tmp_path / "fake.mcap").write_bytes(b"no bag at all")
    refused(tmp_path / "fake.mcap")
    (tmp_path / "fake.bag").write_bytes(b"#ROSBAG V2.0\nnot really")
    refused(tmp_path / "fake.bag")


def test_a_bag_without_the_pose_topic_names_what_it_has_and_the_remap(tmp_path):
    topics = {"pose": ("/tool_pose", POSE), "wrench": ("/cell", WRENCH)}
    bag = write_ros2(tmp_path / "bag", moments(), topics=topics)
    refused(bag, "no pose topic '/rft/pose'", "--remap ~/pose:=/tool_pose", "/cell (geometry_msgs/msg/WrenchStamped)")


def test_a_bag_without_the_twist_topic_says_how_to_do_without(tmp_path):
    topics = {role: TOPICS[role] for role in ("pose", "wrench")}
    refused(write_ros2(tmp_path / "bag", moments(), topics=topics), "no twist topic", "pose_difference")


def test_a_topic_of_another_type_is_refused(tmp_path):
    topics = {**TOPICS, "pose": ("/rft/pose", "geometry_msgs/msg/Pose")}
    refused(write_ros2(tmp_path / "bag", [], topics=topics))
    bag = write_ros2(tmp_path / "other", moments(), topics=TOPICS)
    swapped = {**NAMES, "pose": NAMES["wrench"], "wrench": NAMES["pose"]}
    refused(bag, "WrenchStamped; it must be geometry_msgs/msg/PoseStamped", topics=swapped)


def test_a_message_that_is_too_short_ends_the_reading(tmp_path):
    bag = write_ros2(tmp_path / "bag", moments(5))
    file = next(bag.glob("*.mcap"))
    data = bytearray(file.read_bytes())
    at = data.index(b"\x00\x01\x00\x00", len(data) // 3)
    data[at : at + 4] = b"\x00\x09\x00\x00"
    file.write_bytes(bytes(data))
    samples, damage = read(bag)
    assert len(samples) < 15
    assert damage is not None


def test_split_bags_are_one_recording(tmp_path):
    rows = list(moments(40))
    first, second = write_ros2(tmp_path / "a", rows[:60]), write_ros2(tmp_path / "b", rows[60:])
    joined = tmp_path / "joined"
    joined.mkdir()
    shutil.copy(next(first.glob("*.mcap")), joined / "joined_0.mcap")
    shutil.copy(next(second.glob("*.mcap")), joined / "joined_1.mcap")
    samples, _ = read(joined)
    assert samples == expected(rows)


@pytest.mark.parametrize(
    ("rule", "words"),
    [("~/pose", "FROM:=TO"), ("~/pose:=", "FROM:=TO"), ("~/joint:=/x", "~/joint"), ("/tf:=/x", "/tf")],
)
def test_invalid_remaps_are_refused(rule, words):
    with pytest.raises(InputError, match=words):
        topics_of(defaults(), [rule])


def test_a_tilde_that_the_shell_has_expanded_is_understood(monkeypatch):
    monkeypatch.setenv("HOME", "/home/user")
    assert topics_of(defaults(), ["/home/user/pose:=/tool_pose"])["pose"] == "/tool_pose"


def test_remaps_resolve_as_in_ros_and_later_ones_win():
    assert topics_of(defaults()) == NAMES
    assert "twist" not in topics_of({**defaults(), "twist_source": "pose_difference"})
    rules = ["~/pose:=/a", "/rft/pose:=/b", "~/twist:=c", "~/wrench_measured:=~/d"]
    assert topics_of(defaults(), rules) == {"pose": "/b", "twist": "/c", "wrench": "/rft/d"}

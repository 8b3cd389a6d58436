"""A replay of a bag with clouds of points: the ground that it ends with, and the same bytes twice."""

import numpy as np
import pytest
from recordings import POSE, ROS2, STEP, TF, TOPICS, TWIST, WRENCH, message, plunge, transforms_cdr
from replays import rows_of, values
from rosbags.rosbag2 import StoragePlugin, Writer
from test_messages_cloud import KIND, serialised

from rft_ros.bags.replay import replay
from rft_ros.errors import InputError
from rft_ros.estimator import TransformSample
from rft_ros.ground import read_height_map

CELL = 0.004
AXIS = CELL * (np.arange(-20, 20) + 0.5)
X, Y = (v.ravel() for v in np.meshgrid(AXIS, AXIS))


def bag_with_clouds(path, *, every=50, height=0.004, tf=False):
    types = {"pose": POSE, "twist": TWIST, "wrench": WRENCH}
    points = np.column_stack([X, Y, np.full(len(X), height)])
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {**TOPICS, "surface": ("/rft/surface_points", KIND)}
        if tf:
            topics["pose"] = "/tf", TF
        connections = {r: writer.add_connection(name, kind, typestore=ROS2) for r, (name, kind) in topics.items()}
        for k, (role, time, stamp, numbers) in enumerate(plunge()):
            if k % (3 * every) == 0:
                writer.write(connections["surface"], time, serialised(points, stamp=stamp))
            if tf and role == "pose":
                data = transforms_cdr(TransformSample(stamp, "world", "tool", numbers[:3], numbers[3:]))
            else:
                data = ROS2.serialize_cdr(message(ROS2, role, stamp, numbers), types[role])
            writer.write(connections[role], time, data)
    return path


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return bag_with_clouds(tmp_path_factory.mktemp("ground") / "bag")


def test_a_replay_uses_the_clouds_and_writes_the_ground(bag, tmp_path):
    replay(bag, tmp_path / "level", values())
    summary = replay(bag, tmp_path / "mapped", values(ground__cell=CELL), report=True)
    assert summary.messages["surface"] == 13
    ground = read_height_map(tmp_path / "mapped" / "ground.csv", CELL)
    np.testing.assert_allclose(ground.points()[:, 2], 0.004, atol=1e-6)
    level, mapped = (
        np.array([float(row["predicted_fz"] or "nan") for row in rows_of(tmp_path / name)])
        for name in ("level", "mapped")
    )
    early = 0.5e9 // STEP
    np.testing.assert_array_equal(level[: int(early)], mapped[: int(early)])
    assert np.nanmax(mapped) > 1.1 * np.nanmax(level)
    assert "figure-ground" in (tmp_path / "mapped" / "report.html").read_text()


def test_clouds_count_as_much_beside_poses_from_transforms(bag, tmp_path):
    replay(bag, tmp_path / "posed", values(ground__cell=CELL))
    replay(bag_with_clouds(tmp_path / "bag", tf=True), tmp_path / "tf", values(ground__cell=CELL, pose_source="tf"))
    posed, transformed = (
        [float(row["predicted_fz"]) for row in rows_of(tmp_path / name) if not row["reason"]]
        for name in ("posed", "tf")
    )
    assert transformed == pytest.approx(posed, rel=1e-6, abs=1e-9)


def test_replaying_twice_gives_the_same_bytes(bag, tmp_path):
    for name in "ab":
        replay(bag, tmp_path / name, values(ground__cell=CELL))
    for file in ("estimates.csv", "ground.csv", "summary.json"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_the_ground_of_one_replay_begins_the_next(bag, tmp_path):
    replay(bag, tmp_path / "a", values(ground__cell=CELL))
    again = values(ground__cell=CELL, ground__file=str(tmp_path / "a" / "ground.csv"))
    replay(bag, tmp_path / "b", again)
    assert (tmp_path / "a" / "ground.csv").read_bytes() == (tmp_path / "b" / "ground.csv").read_bytes()


def test_the_ground_at_the_start_is_not_overwritten(bag, tmp_path):
    replay(bag, tmp_path / "a", values(ground__cell=CELL))
    before = (tmp_path / "a" / "ground.csv").read_bytes()
    with pytest.raises(InputError, match="would overwrite the input"):
        replay(bag, tmp_path / "a", values(ground__cell=CELL, ground__file=str(tmp_path / "a" / "ground.csv")))
    assert (tmp_path / "a" / "ground.csv").read_bytes() == before


def test_nothing_stays_of_an_earlier_replay(bag, tmp_path):
    learning = values(ground__cell=CELL, learning__mode="observe")
    replay(bag, tmp_path / "a", learning, report=True)
    (tmp_path / "a" / "notes.txt").touch()
    replay(bag, tmp_path / "a", values())
    left = ["estimates", "estimates.csv", "notes.txt", "summary.json"]
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == left
    with pytest.raises(InputError, match="does not exist"):
        replay(tmp_path / "gone", tmp_path / "a", values())
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == left  # nothing was lost for a mistyped name


def test_a_ground_file_without_cells_is_refused(bag, tmp_path):
    with pytest.raises(InputError, match=r"needs ground\.cell"):
        replay(bag, tmp_path / "a", values(ground__file="bed.csv"))

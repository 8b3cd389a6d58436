"""The ground in the node: clouds live and replayed, the services, and clouds that cannot be used."""

from pathlib import Path

import numpy as np
import pytest
from harness import numbers
from recordings import CLOUD, cdr, cloud_cdr
from sensor_msgs.msg import PointCloud2
from test_live_equals_replay import PARAMETERS, TOPICS, assert_equal, publish, started

from rft_ros.bags.writing import BagWriter
from rft_ros.errors import InputError
from rft_ros.ground import read_height_map

CELL = 0.002
START = 1_700_000_000_000_000_000
GROUND = {**PARAMETERS, "ground.cell": CELL}


def cloud(stamp, height, *, n=60):
    axis = CELL * (np.arange(-n // 2, n // 2) + 0.5)
    x, y = (v.ravel() for v in np.meshgrid(axis, axis))
    return cloud_cdr(np.column_stack([x, y, height + 0.2 * x]), stamp=stamp)


def inputs(count=300):
    """(topic, stamp, message): a tool that sinks 1 cm, and a cloud every 0.2 s in which the ground rises."""
    for k in range(count):
        stamp = START + k * 5_000_000
        if k % 40 == 0:
            yield "surface_points", stamp, cloud(stamp, 0.001 * (k // 40))
        yield "wrench_measured", stamp, cdr("wrench", stamp, [0.0] * 6)
        yield "twist", stamp, cdr("twist", stamp, [0.0, 0.0, -0.02, 0.0, 0.0, 0.0])
        yield "pose", stamp, cdr("pose", stamp, [0.0, 0.0, 0.01 - 1e-4 * k, 0.0, 0.0, 0.0, 1.0])


def surface_publisher(rft):
    publisher = rft.node.create_publisher(PointCloud2, f"{rft.name}/surface_points", 10)
    rft.until(lambda: publisher.get_subscription_count() == 1)
    return publisher


def test_live_equals_replay_with_clouds_of_points(start_node, tmp_path):
    rft = started(start_node, GROUND)
    messages = [*inputs()]
    with BagWriter(tmp_path / "inputs") as bag:
        for topic, stamp, data in messages:
            bag.write_raw(f"/rft/{topic}", TOPICS.get(topic, CLOUD), stamp, data)
    publish(
        rft, [(topic, data) for topic, _, data in messages], surface_points=surface_publisher(rft)
    )
    assert_equal(rft, tmp_path / "inputs", GROUND, tmp_path)
    ground = read_height_map(tmp_path / "replayed" / "ground.csv", CELL)
    assert len(ground.points()) > 1000


def test_services_level_and_save_the_ground(start_node, tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    file = tmp_path / "bed.csv"
    file.write_text("x,y,h\n0.001,0.001,0.005\n0.003,0.001,0.005\n")
    rft = started(start_node, {**GROUND, "ground.file": str(file)})
    assert rft.trigger("level_ground") == (True, "ground as at the start")
    saved, path = rft.trigger("save_ground")
    assert saved
    assert np.array_equal(*(read_height_map(Path(name), CELL).points() for name in (file, path)))


def test_a_map_of_the_ground_begins_and_ends_while_the_node_runs(
    start_node, tmp_path, monkeypatch
):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    rft = started(start_node, PARAMETERS)
    level = (False, "the ground is a level plane; set ground.cell")
    assert rft.trigger("level_ground") == level
    assert rft.trigger("save_ground") == (False, f"not saved: {level[1]}")
    assert rft.set(ground__cell=CELL) == (True, "")
    publisher = surface_publisher(rft)
    assert rft.trigger("save_ground") == (False, "not saved: no height is known yet")
    stamp = rft.moment()
    on_plane = numbers(rft.ask(stamp))
    publisher.publish(cloud(stamp, 0.01))
    rft.until(lambda: not np.array_equal(numbers(rft.ask(rft.moment())), on_plane))
    assert rft.trigger("save_ground")[0]
    assert rft.set(ground__cell=0.0) == (True, "")
    rft.until(
        lambda: rft.trigger("level_ground") == level and publisher.get_subscription_count() == 0
    )
    np.testing.assert_array_equal(numbers(rft.ask(rft.moment())), on_plane)


def test_a_sparse_map_is_named_in_the_status_of_the_medium_while_the_node_learns(
    start_node, tmp_path
):
    file, places = tmp_path / "bed.csv", range(-4, 5)
    file.write_text(
        "x,y,h\n" + "".join(f"{0.1 * i},{0.1 * j},0\n" for i in places for j in places)
    )
    rft = started(start_node, {**GROUND, "ground.file": str(file), "learning.mode": "observe"})
    rft.ask(rft.moment())
    rft.until(lambda: "sparser than ground.cell" in rft.diagnostic("medium")[1])


def test_a_refused_change_is_not_made_once_a_map_has_loaded(start_node, tmp_path):
    """The subscription to clouds declares its QoS, and the change that was refused before was taken for it."""
    file = tmp_path / "bed.csv"
    file.write_text("x,y,h\n0,0,0\n")
    rft = started(start_node, PARAMETERS)
    assert rft.set(ground__cell=CELL, ground__file=str(file)) == (True, "")
    assert not rft.set(feedforward__frame="world_frame")[0]
    surface_publisher(rft)
    assert "feedforward.frame" not in rft.said()


def test_a_ground_file_that_cannot_be_used_is_refused_with_a_sentence(start_node, tmp_path):
    with pytest.raises(InputError, match=r"none\.csv' does not exist"):
        started(start_node, {**GROUND, "ground.file": str(tmp_path / "none.csv")})

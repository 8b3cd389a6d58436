"""One estimator, two drivers: what the node answered live is what the replay of its inputs gives, to the last bit."""

import math
from itertools import islice

import numpy as np
import pytest
from harness import OUTPUTS, numbers, stamp_of
from recordings import POSE, TWIST, WRENCH, cdr
from rosbags.highlevel import AnyReader

from rft_ros.bags.replay import replay
from rft_ros.bags.writing import BagWriter
from rft_ros.parameters import Config, checked

PARAMETERS = {
    "mesh.file": "abb_plate",
    "medium.zeta": 0.33,
    "alpha_y.model": "linear",
    "sensor.position": [0.01, -0.02, 0.1],
    "sensor.quaternion": [1.0, 0.0, 0.0, 0.0],
    "sensor.bias": [1.0, -2.0, 3.0, 0.1, 0.2, 0.3],
    "sensor.mass": 0.4,
    "sensor.center_of_mass": [0.0, 0.01, 0.05],
}
OURS = {"integration": "refined", "medium.mobilization_length": 0.003}
LEARNING = {"learning.mode": "apply", "medium.zeta_error": 0.1}
ABB = {
    "mesh.file": "abb_plate",
    "tolerance": 0.0,
    "world_frame": "base_link",
    "sensor_frame": "robot_frame_tool0",
    "sensor.position": [0.0, 0.0, -0.17],
    "twist_source": "pose_difference",
}
TOPICS = {"wrench_measured": WRENCH, "twist": TWIST, "pose": POSE}


def started(start_node, parameters):
    """A node with these parameters, whose inputs and outputs have found their peers."""
    return start_node(
        *(a for name, value in parameters.items() for a in ("-p", f"{name}:={value}"))
    ).wait_ready()


def publish(rft, messages, *, frame="ft_sensor", **others):
    """Publish topics and serialised messages in order, then a load-cell sample that makes every comparison final."""
    publishers = {"wrench_measured": rft.wrench, "twist": rft.twist, "pose": rft.pose, **others}
    poses = 0
    for topic, data in messages:
        publishers[topic].publish(data)
        poses += topic == "pose"
        # no queue overflows, and no topic is ahead of another by the path that learning waits for
        rft.until(lambda poses=poses: len(rft.received["wrench_predicted"]) >= poses - 10)
    rft.wrench.publish(cdr("wrench", 2_000_000_000_000_000_000, [0.0] * 6, frame))


def assert_equal(rft, bag, parameters, tmp_path):
    """The node's answers are those of the replay of a bag; the replayed wrenches by topic and stamp."""
    as_the_node = {"medium.mobilization_length": 0.0, "alpha_y.model": "constant", **parameters}
    values = Config().values | {name: checked(name, value) for name, value in as_the_node.items()}
    replay(bag, tmp_path / "replayed", values)
    replayed = {topic: {} for topic in OUTPUTS}
    with AnyReader([tmp_path / "replayed" / "estimates"]) as reader:
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            replayed[connection.topic.rpartition("/")[2]][stamp_of(message)] = numbers(message)
    rft.until(lambda: all(len(rft.received[t]) >= len(replayed[t]) for t in OUTPUTS))
    for topic in OUTPUTS:
        live = {stamp_of(message): numbers(message) for message in rft.received[topic]}
        assert live.keys() == replayed[topic].keys()
        for stamp, wrench in live.items():
            np.testing.assert_array_equal(wrench, replayed[topic][stamp])
    return replayed


@pytest.mark.parametrize(
    ("twist_source", "model"),
    [("topic", {}), ("pose_difference", {}), ("topic", OURS), ("topic", OURS | LEARNING)],
    ids=["topic", "pose difference, load cell late", "refined, with memory", "learned"],
)
def test_live_equals_replay(start_node, tmp_path, twist_source, model):
    parameters = {**PARAMETERS, **model, "twist_source": twist_source}
    rft = started(start_node, parameters)
    random = np.random.default_rng(3)
    start, count = 1_700_000_000_000_000_000, 300
    arrivals = []
    with BagWriter(tmp_path / "inputs") as bag:
        for k in range(count):
            t = k * 0.005
            stamp = start + k * 5_000_000 + int(random.integers(-100_000, 100_000))
            pitch, measured = 0.15 * math.sin(4.0 * t), stamp - int(random.integers(2_000_000))
            place = (
                0.002 * t,
                0.0,
                0.02 - 0.02 * t,
                0.0,
                math.sin(pitch / 2),
                0.0,
                math.cos(pitch / 2),
            )
            velocity = 0.002, 0.0, -0.02, 0.0, 0.6 * math.cos(4.0 * t), 0.0
            wrench = cdr("wrench", measured, [*random.normal(size=3).tolist(), 0.0, 0.0, 0.0])
            twist, pose = cdr("twist", stamp, velocity), cdr("pose", stamp, place)
            for order, (topic, data) in enumerate(zip(TOPICS, (wrench, twist, pose), strict=True)):
                bag.write_raw(f"/rft/{topic}", TOPICS[topic], stamp, data)
                late = (
                    7_000_000
                    if topic == "wrench_measured" and twist_source == "pose_difference"
                    else 0
                )
                arrivals.append((stamp + late, order, topic, data))
    publish(rft, [(topic, data) for _, _, topic, data in sorted(arrivals)])
    replayed = assert_equal(rft, tmp_path / "inputs", parameters, tmp_path)
    assert len(replayed["wrench_residual"]) >= count - 2
    assert np.abs([w[2] for w in replayed["wrench_predicted"].values()]).max() > 0.1


def test_a_recorded_bag_played_into_the_node_gives_what_its_replay_gives(
    start_node, shared_data, tmp_path
):
    topics = {"/tool_pose": "pose", "/ft_sensor/wrench": "wrench_measured"}
    rft = started(start_node, ABB)
    messages = []
    with (
        AnyReader([shared_data / "abb_plate" / "abb_plate_2"]) as reader,
        BagWriter(tmp_path / "inputs") as bag,
    ):
        connections = [c for c in reader.connections if c.topic in topics]
        for connection, received, data in islice(reader.messages(connections), 5600, 7200):
            topic = topics[connection.topic]
            bag.write_raw(f"/rft/{topic}", TOPICS[topic], received, data)
            messages.append((topic, bytes(data)))
    publish(rft, messages, frame="robot_frame_tool0")
    replayed = assert_equal(rft, tmp_path / "inputs", ABB, tmp_path)
    assert np.abs([w[2] for w in replayed["wrench_predicted"].values()]).max() > 1.0

"""The ABB recordings with /tf and /tf_static in place of poses: the same calibration."""

from pathlib import Path

import pytest
import yaml
from recordings import TF, transforms_cdr
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

from rft_ros.bags.writing import BagWriter
from rft_ros.cli import main
from rft_ros.estimator import PoseSample, TransformSample
from rft_ros.estimator.messages import decoder
from rft_ros.estimator.transforms import Placement

ABB = Path(__file__).resolve().parents[2] / "config" / "abb_plate.yaml"
TOOL = Placement((0.02, -0.01, 0.12), tuple(Rotation.from_euler("xyz", [3, -4, 45], degrees=True).as_quat().tolist()))
"""The tool in the flange, as a cell may have it."""
CELL = Placement((0.0, 0.0, -0.17), (0.0, 0.0, 0.0, 1.0))


def with_transforms(source, path):
    """The recording with nothing but /tf, /tf_static and the wrench."""
    decode = decoder("pose", ros1=False)
    links = (("flange", "tool", TOOL), ("tool", "robot_frame_tool0", CELL))
    with AnyReader([source]) as reader, BagWriter(path) as bag:
        fixed = [TransformSample(0, *link[:2], *link[2]) for link in links]
        bag.write_raw("/tf_static", TF, reader.start_time, transforms_cdr(*fixed))
        for connection, time, data in reader.messages():
            if connection.topic == "/ft_sensor/wrench":
                bag.write_raw(connection.topic, connection.msgtype, time, bytes(data))
            elif connection.topic == "/tool_pose" and isinstance(pose := decode(bytes(data)), PoseSample):
                flange = Placement(pose.position, pose.quaternion).of(TOOL.inverse())
                moving = TransformSample(pose.stamp, "base_link", "flange", *flange)
                bag.write_raw("/tf", TF, time, transforms_cdr(moving))
    return path


def fitted(bag, params, out):
    assert main(["calibrate", str(bag), "--params", str(params), "-o", str(out)]) == 0
    return yaml.safe_load(out.read_text())["rft_calibration"]["ros__parameters"]["fitted"]


def test_transforms_calibrate_to_the_same_zeta_as_poses(shared_data, tmp_path):
    source = shared_data / "abb_plate" / "abb_plate_2"
    tree = yaml.safe_load(ABB.read_text())
    tree["/**"]["ros__parameters"] |= {"pose_source": "tf"}
    tree["/**"]["ros__parameters"]["sensor"] = {"frame_source": "tf"}
    params = tmp_path / "tf.yaml"
    params.write_text(yaml.safe_dump(tree))
    posed = fitted(source, ABB, tmp_path / "posed.yaml")
    transformed = fitted(with_transforms(source, tmp_path / "tf"), params, tmp_path / "transformed.yaml")
    for name, tolerance in (("medium_zeta", 0.005), ("medium_mobilization_length", 0.05)):
        assert transformed[name]["value"] == pytest.approx(posed[name]["value"], rel=tolerance)

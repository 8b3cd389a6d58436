"""For `launch_test`, which `test_launch.py` runs: the launch file with a namespace, a robot's parameters and topics."""

import time
import unittest
from pathlib import Path

import launch_testing
import launch_testing.asserts
import rclpy
from geometry_msgs.msg import PoseStamped, WrenchStamped
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch_testing.actions import ReadyToTest
from rclpy.time import Time

ROOT = Path(__file__).resolve().parents[2]
ARGUMENTS = {
    "params_file": str(ROOT / "config" / "robots" / "universal_robots.yaml"),
    "namespace": "left",
    "pose": "/tcp_pose_broadcaster/pose",
}
PATIENCE_NS = 600.0  # s: a first start compiles, and other work may keep every core busy


def generate_test_description() -> LaunchDescription:
    file = str(ROOT / "launch" / "rft.launch.py")
    return LaunchDescription(
        [IncludeLaunchDescription(file, launch_arguments=ARGUMENTS.items()), ReadyToTest()]
    )


class TestTheNode(unittest.TestCase):
    def test_it_answers_poses_of_the_robots_topic_in_its_namespace(self, proc_output):
        proc_output.assertWaitFor("ready: tool plate", timeout=PATIENCE_NS)
        rclpy.init()
        node = rclpy.create_node("peer")
        answers = []
        node.create_subscription(WrenchStamped, "/left/rft/wrench_predicted", answers.append, 10)
        poses = node.create_publisher(PoseStamped, ARGUMENTS["pose"], 10)
        pose = PoseStamped()
        pose.header.frame_id = "base"
        stamp = time.time_ns()
        end = time.monotonic() + PATIENCE_NS
        while not answers and time.monotonic() < end:
            stamp += 10_000_000
            pose.header.stamp = Time(nanoseconds=stamp).to_msg()
            pose.pose.position.z -= 1e-4
            poses.publish(pose)
            rclpy.spin_once(node, timeout_sec=0.01)
        rclpy.shutdown()
        self.assertEqual(answers[0].header.frame_id, "tool0_controller")


@launch_testing.post_shutdown_test()
class TestTheEnd(unittest.TestCase):
    def test_the_node_ends_with_status_0(self, proc_info):
        launch_testing.asserts.assertExitCodes(proc_info)

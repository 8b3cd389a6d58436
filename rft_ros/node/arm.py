"""What the demo's arms share: the node's inputs, published as the drivers of an arm and its load cell do."""

import argparse
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from numpy.typing import NDArray
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.time import Time

from rft_ros.estimator import Wrench
from rft_ros.estimator.messages import wrench_cdr

RELIABLE = QoSProfile(depth=100)
"""Of the arms' topics."""


def arm_options(description: str) -> argparse.ArgumentParser:
    """A parser with the option of all arms."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--listeners", type=int, default=1, metavar="N", help="start once N subscribe to the pose")
    return parser


class Arm:
    """A ROS node with publishers of pose, twist and load cell."""

    def __init__(self, name: str) -> None:
        self.node = rclpy.create_node(name)
        self._pose = self.node.create_publisher(PoseStamped, "/rft/pose", RELIABLE)
        self._twist = self.node.create_publisher(TwistStamped, "/rft/twist", RELIABLE)
        self._cell = self.node.create_publisher(WrenchStamped, "/rft/wrench_measured", RELIABLE)
        self._serialise = wrench_cdr("ft_sensor")

    def wait(self, listeners: int) -> None:
        """Wait until so many subscribe to each topic."""
        while min(p.get_subscription_count() for p in (self._pose, self._twist, self._cell)) < listeners:
            time.sleep(0.05)

    def now(self) -> int:
        """The time [ns]."""
        stamp: int = self.node.get_clock().now().nanoseconds
        return stamp

    def send(self, stamp: int, state: NDArray[np.float64], reading: Wrench) -> None:
        """Publish a state, shape [13], columns `rft_ros.rft.STATE`, and a reading of the load cell [N, N m]."""
        pose, twist = PoseStamped(), TwistStamped()
        for message in (pose, twist):
            message.header.frame_id, message.header.stamp = "world", Time(nanoseconds=stamp).to_msg()
        p, q, v, w = pose.pose.position, pose.pose.orientation, twist.twist.linear, twist.twist.angular
        p.x, p.y, p.z, q.x, q.y, q.z, q.w, v.x, v.y, v.z, w.x, w.y, w.z = state.tolist()
        self._cell.publish(self._serialise(stamp, reading))
        self._twist.publish(twist)
        self._pose.publish(pose)


@contextmanager
def running_arm(name: str) -> Iterator[Arm]:
    """An arm until the end of the block, or SIGINT or SIGTERM, which end the block."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # ROS must outlive the block
    try:
        arm = Arm(name)
        yield arm
        time.sleep(0.2)  # to send the last messages
        arm.node.destroy_node()
    except KeyboardInterrupt:
        pass
    finally:
        rclpy.try_shutdown()

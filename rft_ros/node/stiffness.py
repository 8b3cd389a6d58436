"""~/stiffness: how the predicted wrench falls with a small motion, for simulators and controllers that are implicit.

The grains act on the tool as springs that each resist any way alike, so their stiffness has the form of an inertia:
geometry_msgs/InertiaStamped with N/m in place of kg. A small displacement u of the centre and a rotation r change the
force by -m u and the torque about the centre by -I r; world axes.
"""

import numpy as np
from geometry_msgs.msg import InertiaStamped
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.time import Time

from rft_ros.estimator import Estimator

__all__ = ["Stiffness", "stiffness_message", "stiffness_sums"]


class Stiffness:
    """Publishes the stiffness at each estimate, while someone subscribes."""

    def __init__(self, node: Node, estimator: Estimator, qos: QoSProfile) -> None:
        self._estimator = estimator
        self._publisher = node.create_publisher(InertiaStamped, "~/stiffness", qos)

    def publish(self, stamp: int) -> None:
        """Publish the stiffness of the estimate with this stamp [ns]."""
        if self._publisher.get_subscription_count():
            e = self._estimator
            self._publisher.publish(stiffness_message(stamp, e.settings.world_frame, e.stiffness, e.state[:3]))


def stiffness_message(stamp: int, frame: str, sums: NDArray[np.float64], origin: NDArray[np.float64]) -> InertiaStamped:
    """The message of `Memory.stiffness`, in its units, shape [10], about an origin in the world [m], shape [3]."""
    message = InertiaStamped()
    message.header.stamp, message.header.frame_id = Time(nanoseconds=stamp).to_msg(), frame
    i = message.inertia
    k, *first = sums[:4].tolist()
    xx, yy, zz, xy, xz, yz = sums[4:].tolist()
    x, y, z = (s / k if k > 0.0 else 0.0 for s in first)
    i.m, (i.com.x, i.com.y, i.com.z) = k, (origin + np.array([x, y, z])).tolist()
    i.ixx, i.iyy, i.izz = yy + zz - k * (y * y + z * z), xx + zz - k * (x * x + z * z), xx + yy - k * (x * x + y * y)
    i.ixy, i.ixz, i.iyz = k * x * y - xy, k * x * z - xz, k * y * z - yz
    return message


def stiffness_sums(message: InertiaStamped, origin: NDArray[np.float64]) -> NDArray[np.float64]:
    """The inverse of `stiffness_message`, same units, shape [10]."""
    i = message.inertia
    k = i.m
    x, y, z = np.array([i.com.x, i.com.y, i.com.z]) - origin
    half = 0.5 * (i.ixx + i.iyy + i.izz)
    squares = half - i.ixx + k * x * x, half - i.iyy + k * y * y, half - i.izz + k * z * z
    products = k * x * y - i.ixy, k * x * z - i.ixz, k * y * z - i.iyz
    return np.array([k, k * x, k * y, k * z, *squares, *products])

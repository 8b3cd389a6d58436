"""~/stiffness: how the predicted wrench falls with a small motion, for simulators and controllers that are implicit.

The grains act on the tool as springs that each resist any way alike, so their stiffness has the form of an inertia:
geometry_msgs/InertiaStamped with N/m in place of kg. A small displacement u of the centre and a rotation r change the
force by -m u and the torque about the centre by -I r; world axes.
"""

import numpy as np
from geometry_msgs.msg import InertiaStamped
from numpy.typing import NDArray
from rclpy.time import Time

_Array = NDArray[np.float64]


def stiffness_message(stamp: int, frame: str, sums: _Array, origin: _Array) -> InertiaStamped:
    """The message of `Memory.stiffness`, in its units, shape [10], about an origin in the world [m], shape [3]."""
    k, xx, yy, zz, xy, xz, yz = sums[[0, 4, 5, 6, 7, 8, 9]].tolist()
    x, y, z = (sums[1:4] / k if k > 0.0 else np.zeros(3)).tolist()
    message = InertiaStamped()
    message.header.stamp, message.header.frame_id = Time(nanoseconds=stamp).to_msg(), frame
    i = message.inertia
    i.m, (i.com.x, i.com.y, i.com.z) = k, (origin + np.array([x, y, z])).tolist()
    i.ixx, i.iyy, i.izz = yy + zz - k * (y * y + z * z), xx + zz - k * (x * x + z * z), xx + yy - k * (x * x + y * y)
    i.ixy, i.ixz, i.iyz = k * x * y - xy, k * x * z - xz, k * y * z - yz
    return message


def stiffness_sums(message: InertiaStamped, origin: _Array) -> _Array:
    """The inverse of `stiffness_message`."""
    i = message.inertia
    k = i.m
    x, y, z = np.array([i.com.x, i.com.y, i.com.z]) - origin
    half = 0.5 * (i.ixx + i.iyy + i.izz)
    squares = half - i.ixx + k * x * x, half - i.iyy + k * y * y, half - i.izz + k * z * z
    products = k * x * y - i.ixy, k * x * z - i.ixz, k * y * z - i.iyz
    return np.array([k, k * x, k * y, k * z, *squares, *products])

"""A virtual arm for the demo: 125 Hz pose, twist and load cell of an ellipsoid that pitches on its way into the grains.

The motion is the paper's (Treers et al. 2021, V-A): straight down at 5 mm/s, pitching ±9° at 0.625 Hz, after a pause in
the air for a tare. The grains are not those of the node's model: 30 % stronger, 40 % weaker sideways, with a hard layer
at a depth of 25 mm. The load cell adds a bias, the tool's weight, noise and its frame.
"""

import argparse
import signal
import sys
import time
from contextlib import suppress

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from numpy.typing import NDArray
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

from rft_ros.estimator import LoadCell, Wrench
from rft_ros.estimator.load_cell import LoadCellFrame
from rft_ros.estimator.messages import wrench_cdr
from rft_ros.rft import MEDIA, Law, alpha_y_model, rotation_matrix, treers2021, wrenches
from rft_ros.sweeps.motions import OscillatingInsertion
from rft_ros.tool import Tool, load_tool

PAUSE = 3.0
"""Time that the arm rests in the air before it moves [s]."""

LAYER = 0.025
"""Depth of the tool's lowest point at which it reaches the hard layer [m]."""

_STRENGTH = np.array([0.6, 0.6, 1.3])  # of the grains over the model's, world axes
_HARDNESS, _TRANSITION = 2.0, 0.002  # strength of the layer over that of the grains above; its upper edge [m]
_RATE = 125.0  # Hz
_DESCENT = OscillatingInsertion(start_height=0.020)  # starts with the ellipsoid's lowest point 2 mm above the surface
_NOISE = (0.02, 0.02, 0.02, 0.0005, 0.0005, 0.0005)  # N, N m, standard deviations
_LOAD_CELL = LoadCell(
    position=(0.0, 0.0, 0.12),
    quaternion=(1.0, 0.0, 0.0, 0.0),  # z down, as flange sensors often have it
    bias=(1.2, -0.7, 2.4, 0.03, -0.02, 0.01),
    mass=0.35,
    center_of_mass=(0.0, 0.0, 0.05),
)


def _state(t: float) -> NDArray[np.float64]:
    """State of the tool frame at time t [s], shape [1, 13], columns `rft_ros.rft.STATE`."""
    state = _DESCENT.at(max(t - PAUSE, 0.0))
    if t <= PAUSE:
        state[:, 7:] = 0.0
    return state


def _grain_wrench(tool: Tool, law: Law, state: NDArray[np.float64]) -> NDArray[np.float64]:
    """Force [N] and torque [N m] of the virtual grains on the tool, world axes, about the tool frame's origin."""
    row = wrenches(tool.plates, law, state, threads=1, sensitivities=True)[0]
    depth = -state[0, 2] - tool.lowest_point(rotation_matrix(state[0, 3:7]))
    strength = _STRENGTH * np.interp(depth, [LAYER, LAYER + _TRANSITION], [1.0, _HARDNESS])
    moment = row[10:19].reshape(3, 3) * strength  # Σ r_j f_l
    torque = moment[1, 2] - moment[2, 1], moment[2, 0] - moment[0, 2], moment[0, 1] - moment[1, 0]
    return np.array([*(strength * row[:3]), *torque])


def _raw_reading(
    frame: LoadCellFrame, quaternion: NDArray[np.float64], on_tool: NDArray[np.float64], noise: NDArray[np.float64]
) -> Wrench:
    """Reading of the load cell: wrench of the grains, weight, bias and noise, in its own frame."""
    force, offset, _ = frame.into_sensor(quaternion, np.concatenate([on_tool, np.zeros(6)]))
    fx, fy, fz, tx, ty, tz = (frame.sign * (force[k] + offset[k]) + noise[k] for k in range(6))
    return fx, fy, fz, tx, ty, tz


def _move(seconds: float, listeners: int) -> None:
    tool, medium = load_tool("ellipsoid"), MEDIA["generic"]
    law = treers2021(medium, alpha_y_model("constant", medium), zeta=0.33)
    frame = LoadCellFrame(_LOAD_CELL)
    _grain_wrench(tool, law, _state(0.0))  # compiles
    random = np.random.default_rng(2021)

    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # ROS must outlive the loop
    node = rclpy.create_node("virtual_arm")
    reliable = QoSProfile(depth=100)
    poses = node.create_publisher(PoseStamped, "/rft/pose", reliable)
    twists = node.create_publisher(TwistStamped, "/rft/twist", reliable)
    cells = node.create_publisher(WrenchStamped, "/rft/wrench_measured", reliable)
    pose, twist, serialise = PoseStamped(), TwistStamped(), wrench_cdr("ft_sensor")
    pose.header.frame_id = twist.header.frame_id = "world"
    try:
        while min(p.get_subscription_count() for p in (poses, twists, cells)) < listeners:
            time.sleep(0.05)
        start = time.monotonic()
        for k in range(round(seconds * _RATE)):
            state = _state(k / _RATE)
            on_tool = _grain_wrench(tool, law, state)
            reading = _raw_reading(frame, state[0, 3:7], on_tool, random.normal(scale=_NOISE))
            time.sleep(max(0.0, start + k / _RATE - time.monotonic()))
            now = node.get_clock().now()
            pose.header.stamp = twist.header.stamp = now.to_msg()
            p, q, v, w = pose.pose.position, pose.pose.orientation, twist.twist.linear, twist.twist.angular
            p.x, p.y, p.z, q.x, q.y, q.z, q.w, v.x, v.y, v.z, w.x, w.y, w.z = state[0].tolist()
            cells.publish(serialise(now.nanoseconds, reading))
            twists.publish(twist)
            poses.publish(pose)
        time.sleep(0.2)  # to send the last messages
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def main() -> int:
    """Run the arm until its time is up, or SIGINT or SIGTERM."""
    parser = argparse.ArgumentParser(description="The demo's virtual arm.")
    parser.add_argument("--seconds", type=float, default=12.0, metavar="S", help="how long it moves [s] (default 12)")
    parser.add_argument("--listeners", type=int, default=1, metavar="N", help="start once N subscribe to the pose")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with suppress(KeyboardInterrupt):
        _move(arguments.seconds, arguments.listeners)
    return 0


if __name__ == "__main__":
    sys.exit(main())

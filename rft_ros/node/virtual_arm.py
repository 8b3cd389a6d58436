"""A virtual arm for the demo: 125 Hz pose, twist and load cell of an ellipsoid that pitches on its way into the grains.

The motion is the paper's (Treers et al. 2021, V-A): straight down at 5 mm/s, pitching ±9° at 0.625 Hz, after a pause in
the air for a tare. Forces come from this package's own model (generic, ζ = 0.33, α_y linear): the demo shows wiring,
frames and the load cell's arithmetic, not accuracy. The load cell adds a bias, the tool's weight, noise and its frame.
"""

import argparse
import math
import sys
import time
from dataclasses import dataclass

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from numpy.typing import NDArray
from rclpy.qos import QoSProfile

from rft_ros.estimator import LoadCell, Wrench
from rft_ros.estimator.load_cell import LoadCellFrame
from rft_ros.estimator.messages import wrench_cdr
from rft_ros.rft import MEDIA, alpha_y_model, treers2021, wrenches
from rft_ros.tool import load_tool

__all__ = ["CELL", "PAUSE", "PitchingDescent", "raw_reading"]

RATE = 125.0  # Hz
PAUSE = 3.0  # s in the air, still
PERIODS = 1.0 / 0.625  # s
PITCH = math.radians(9.0)
SPEED = 0.005  # m/s
START_HEIGHT = 0.020  # m: the ellipsoid's lowest point 2 mm above the surface
NOISE = (0.05, 0.05, 0.05, 0.001, 0.001, 0.001)  # N, N m, standard deviations

CELL = LoadCell(
    position=(0.0, 0.0, 0.12),
    quaternion=(1.0, 0.0, 0.0, 0.0),  # z down, as flange sensors often have it
    bias=(1.2, -0.7, 2.4, 0.03, -0.02, 0.01),
    mass=0.35,
    center_of_mass=(0.0, 0.0, 0.05),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PitchingDescent:
    """Pose and velocity of the tool frame over time [s]."""

    pause: float = PAUSE

    def state(self, t: float) -> NDArray[np.float64]:
        """State at time t, shape [1, 13], columns `rft_ros.rft.STATE`."""
        moving = max(t - self.pause, 0.0)
        rate = 2.0 * math.pi / PERIODS
        pitch = PITCH * math.sin(rate * moving)
        pitch_rate = PITCH * rate * math.cos(rate * moving) if moving > 0.0 else 0.0
        speed = -SPEED if moving > 0.0 else 0.0
        q = (0.0, math.sin(pitch / 2.0), 0.0, math.cos(pitch / 2.0))
        return np.array([[0.0, 0.0, START_HEIGHT - SPEED * moving, *q, 0.0, 0.0, speed, 0.0, pitch_rate, 0.0]])


def raw_reading(
    frame: LoadCellFrame, quaternion: NDArray[np.float64], on_tool: NDArray[np.float64], noise: NDArray[np.float64]
) -> Wrench:
    """What the load cell reports: wrench of the grains, weight, bias and noise, in its own frame."""
    numbers = frame.into_sensor(quaternion, np.concatenate([on_tool[:6], np.zeros(6)]))
    fx, fy, fz, tx, ty, tz = (frame.sign * (numbers[k] + numbers[k + 6]) + frame.bias[k] + noise[k] for k in range(6))
    return fx, fy, fz, tx, ty, tz


def main() -> int:
    """Run the arm until its time is up."""
    parser = argparse.ArgumentParser(description="The demo's virtual arm.")
    parser.add_argument("--seconds", type=float, default=12.0, metavar="S", help="how long it moves [s] (default 12)")
    parser.add_argument(
        "--listeners", type=int, default=1, metavar="N", help="start once N subscribe to the pose (default 1)"
    )
    seconds, listeners = (arguments := parser.parse_args()).seconds, arguments.listeners

    tool = load_tool("ellipsoid")
    medium = MEDIA["generic"]
    law = treers2021(medium, alpha_y_model("linear", medium), zeta=0.33)
    frame = LoadCellFrame(CELL)
    descent = PitchingDescent()
    wrenches(tool.plates, law, descent.state(0.0), threads=1)  # compiles
    random = np.random.default_rng(2021)

    rclpy.init()
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
        for k in range(round(seconds * RATE)):
            state = descent.state(k / RATE)
            on_tool = wrenches(tool.plates, law, state, threads=1)[0]
            reading = raw_reading(frame, state[0, 3:7], on_tool, random.normal(scale=NOISE))
            time.sleep(max(0.0, start + k / RATE - time.monotonic()))
            now = node.get_clock().now()
            pose.header.stamp = twist.header.stamp = now.to_msg()
            p, q, v, w = pose.pose.position, pose.pose.orientation, twist.twist.linear, twist.twist.angular
            p.x, p.y, p.z, q.x, q.y, q.z, q.w, v.x, v.y, v.z, w.x, w.y, w.z = state[0].tolist()
            cells.publish(serialise(now.nanoseconds, reading))
            twists.publish(twist)
            poses.publish(pose)
        time.sleep(0.2)  # the last messages leave
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Play the states of a CSV file (the format of `rft predict`) to a running node, and print the predicted forces.

python examples/play_states.py states.csv --frame base --ros-args -r /rft/pose:=/tcp_pose_broadcaster/pose

Velocities that the file lacks are found from its poses. The topics are those of a node without remapped topics; for a
node that was started with `-r ~/pose:=T`, give `-r /rft/pose:=T`.
"""

import argparse
import sys
import time
from pathlib import Path

import rclpy
from geometry_msgs.msg import Point, PoseStamped, Quaternion, TwistStamped, Vector3, WrenchStamped
from rclpy.qos import qos_profile_sensor_data
from rclpy.utilities import remove_ros_args

from rft_ros.states_file import read_states

REPEAT_S = 5.0  # between two lines that say what is missing
LATEST_S = 1.0  # a prediction may come so long after the last pose

parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
parser.add_argument("file", nargs="?", type=Path, default=Path("states.csv"))
parser.add_argument("--frame", default="world", help="the node's world_frame (default world)")
arguments = parser.parse_args(remove_ros_args(sys.argv)[1:])
times, states = read_states(arguments.file)

rclpy.init()  # takes the remapped topics from the command line
node = rclpy.create_node("feeder")
poses = node.create_publisher(PoseStamped, "rft/pose", qos_profile_sensor_data)
twists = node.create_publisher(TwistStamped, "rft/twist", qos_profile_sensor_data)
predictions = []


def show(prediction):
    """Print the force of a WrenchStamped."""
    if not predictions:
        print(f"force in the axes of {prediction.header.frame_id}:", file=sys.stderr, flush=True)
    force = prediction.wrench.force
    print(f"{force.x:.2f} {force.y:.2f} {force.z:.2f} N", flush=True)
    predictions.append(prediction)


subscription = node.create_subscription(WrenchStamped, "rft/wrench_predicted", show, 200)


def missing():
    """What the running node does not provide yet."""
    lacks = [
        f"a subscription to {publisher.topic_name}"
        for publisher in (poses, twists)
        if not publisher.get_subscription_count()
    ]
    if not node.count_publishers(subscription.topic_name):
        lacks.append(f"a publisher of {subscription.topic_name}")
    return lacks


said = -REPEAT_S
while lacks := missing():
    if time.monotonic() - said > REPEAT_S:
        said = time.monotonic()
        print(f"waiting for the node: {', '.join(lacks)}", file=sys.stderr, flush=True)
    rclpy.spin_once(node, timeout_sec=0.1)

begin = node.get_clock().now()
for t, state in zip(times.tolist(), states.tolist(), strict=True):
    while (node.get_clock().now() - begin).nanoseconds < 1e9 * (t - times[0]):
        rclpy.spin_once(node, timeout_sec=0.001)
    pose = PoseStamped()
    twist = TwistStamped()
    pose.header.frame_id = twist.header.frame_id = arguments.frame
    pose.header.stamp = twist.header.stamp = node.get_clock().now().to_msg()
    x, y, z, qx, qy, qz, qw, vx, vy, vz, wx, wy, wz = state
    pose.pose.position = Point(x=x, y=y, z=z)
    pose.pose.orientation = Quaternion(x=qx, y=qy, z=qz, w=qw)
    twist.twist.linear = Vector3(x=vx, y=vy, z=vz)
    twist.twist.angular = Vector3(x=wx, y=wy, z=wz)
    twists.publish(twist)  # before the pose, which the node answers at once
    poses.publish(pose)
end = time.monotonic() + LATEST_S
while len(predictions) < len(states) and time.monotonic() < end:
    rclpy.spin_once(node, timeout_sec=0.1)
print(f"{len(predictions)} predictions of {len(states)} poses", file=sys.stderr)
if not predictions:
    sys.exit("the node's log and /diagnostics say why; --frame must be its world_frame")

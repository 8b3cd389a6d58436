"""Play the states of states.csv (the format of `rft predict`) to a running node, and print the predicted forces."""

import time

import numpy as np
import rclpy
from geometry_msgs.msg import Point, PoseStamped, Quaternion, TwistStamped, Vector3, WrenchStamped
from rclpy.qos import qos_profile_sensor_data


def show(prediction):
    """Print the force of a WrenchStamped."""
    force = prediction.wrench.force
    print(f"{force.x:.2f} {force.y:.2f} {force.z:.2f} N")


states = np.loadtxt("states.csv", delimiter=",", skiprows=1)

rclpy.init()
node = rclpy.create_node("feeder")
poses = node.create_publisher(PoseStamped, "/rft/pose", qos_profile_sensor_data)
twists = node.create_publisher(TwistStamped, "/rft/twist", qos_profile_sensor_data)
node.create_subscription(WrenchStamped, "/rft/wrench_predicted", show, 10)
while not (
    poses.get_subscription_count()
    and twists.get_subscription_count()
    and node.count_publishers("/rft/wrench_predicted")
):
    rclpy.spin_once(node, timeout_sec=0.1)

begin = node.get_clock().now()
for t, *state in states.tolist():
    while (node.get_clock().now() - begin).nanoseconds < 1e9 * (t - states[0, 0]):
        rclpy.spin_once(node, timeout_sec=0.001)
    pose = PoseStamped()
    twist = TwistStamped()
    pose.header.frame_id = twist.header.frame_id = "world"  # the node's world_frame
    pose.header.stamp = twist.header.stamp = node.get_clock().now().to_msg()
    x, y, z, qx, qy, qz, qw, vx, vy, vz, wx, wy, wz = state
    pose.pose.position = Point(x=x, y=y, z=z)
    pose.pose.orientation = Quaternion(x=qx, y=qy, z=qz, w=qw)
    twist.twist.linear = Vector3(x=vx, y=vy, z=vz)
    twist.twist.angular = Vector3(x=wx, y=wy, z=wz)
    twists.publish(twist)  # before the pose, which the node answers at once
    poses.publish(pose)
end = time.monotonic() + 0.5
while time.monotonic() < end:  # the last answers
    rclpy.spin_once(node, timeout_sec=0.1)

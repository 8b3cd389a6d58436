"""What a subscription to /tf or /tf_static takes. tf2_ros is not needed: `estimator.transforms` has the tree."""

from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from rft_ros.errors import InputError
from rft_ros.estimator.messages import Role

TRANSFORMS_QOS: dict[Role, QoSProfile] = {
    "tf_static": QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL),
    "tf": QoSProfile(depth=200, reliability=ReliabilityPolicy.BEST_EFFORT),
}
"""/tf_static is kept by its publishers for those who come later; best effort matches every publisher of /tf."""


def transform_message(*, needed: bool) -> Any:
    """The class of TFMessage; None if its package is not installed. Raises InputError then if it is `needed`."""
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError:
        if needed:
            why = "pose_source tf and sensor.frame_source tf need the package tf2_msgs"
            raise InputError(f"{why}: apt install ros-jazzy-tf2-msgs") from None
        return None
    return TFMessage

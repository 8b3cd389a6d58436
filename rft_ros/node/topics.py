"""Types and QoS of the node's topics."""

from typing import Any

from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2

from rft_ros.errors import InputError
from rft_ros.estimator.messages import Role

TYPES: dict[Role, Any] = {"pose": PoseStamped, "twist": TwistStamped, "wrench": WrenchStamped, "surface": PointCloud2}
"""The inputs' message types; that of transforms comes from `transform_message`."""

# Best effort matches every publisher, reliable or not; the depth holds bursts of a 1,000 Hz stream.
_SENSOR_DATA = QoSProfile(depth=200, reliability=ReliabilityPolicy.BEST_EFFORT)
INPUTS: dict[Role, QoSProfile] = {
    **dict.fromkeys(("pose", "twist", "wrench", "tf"), _SENSOR_DATA),
    "surface": QoSProfile(depth=2, reliability=ReliabilityPolicy.BEST_EFFORT),  # a cloud has megabytes
    "tf_static": QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL),  # kept for those who come later
}
OUTPUTS = QoSProfile(depth=200)  # reliable


def type_name(message: Any) -> str:
    """The name of a message class, as topics have it."""
    return f"{message.__module__.partition('.')[0]}/msg/{message.__name__}"


def transform_message(*, needed: bool) -> Any:
    """The class of TFMessage; if its package is not installed None, or InputError where it is `needed`."""
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError:
        if needed:
            why = "pose_source tf and sensor.frame_source tf need the package tf2_msgs"
            raise InputError(f"{why}: apt install ros-jazzy-tf2-msgs") from None
        return None
    return TFMessage

"""Subscriptions to /tf and /tf_static. tf2_ros is not needed: `estimator.transforms` has the tree."""

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from rft_ros.errors import InputError
from rft_ros.estimator.messages import Role
from rft_ros.estimator.parameters import Values

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


def subscribe_transforms(node: Node, values: Values, callback: Callable[[Role, bytes], None]) -> None:
    """Subscribe to /tf_static, and with `pose_source` tf to /tf; `callback` gets role and serialised message.

    Without tf2_msgs there are no transforms; that raises InputError if the parameters need them.
    """
    message = transform_message(needed="tf" in (values["pose_source"], values["sensor.frame_source"]))
    for role, qos in TRANSFORMS_QOS.items() if message else ():
        if role == "tf_static" or values["pose_source"] == "tf":
            overridable = QoSOverridingOptions.with_default_policies()
            take = partial(callback, role)
            node.create_subscription(message, f"/{role}", take, qos, raw=True, qos_overriding_options=overridable)

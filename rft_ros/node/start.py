"""Start ROS in this process."""

from typing import Any

import rclpy

from rft_ros.errors import InputError

__all__ = ["start_ros"]


def start_ros(**options: Any) -> None:
    """Call `rclpy.init` with these options. Raises InputError if ROS cannot write its log, as in a read-only home."""
    try:
        rclpy.init(**options)
    except RuntimeError as error:
        if "log" not in str(error).partition(":")[0]:
            raise
        why = " ".join(str(error).partition(", at ")[0].split())
        advice = "set ROS_LOG_DIR to a folder in which this user may write, such as /tmp/ros_log"
        raise InputError(f"ROS cannot write its log ({why}); {advice}") from None

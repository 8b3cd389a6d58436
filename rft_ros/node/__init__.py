"""The ROS 2 adapter: the only room that imports rclpy or messages."""

"""The demo: an arm that moves in virtual grains beside a real node. The part that needs ROS is `node.recorded_node`."""

"""The demo: a virtual arm in virtual grains, and a real node. `node.recorded_node` has the part that needs ROS."""

"""Read and write recordings, and replay them through the estimator; needs no ROS installation."""

"""Recordings in and out, and their replay through the estimator; works with no ROS installed."""

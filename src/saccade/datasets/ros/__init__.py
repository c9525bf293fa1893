"""Bags of ROS 1 and ROS 2 as landmark logs and as camera drives."""

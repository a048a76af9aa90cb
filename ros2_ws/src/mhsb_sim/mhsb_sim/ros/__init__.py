"""The simulator as a ROS node."""

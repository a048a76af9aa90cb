"""The planner as a ROS node."""

"""The planner as a ROS node, and the command that sends goals to it."""

"""What `ros2 run mhsb_planner` offers beside the node."""

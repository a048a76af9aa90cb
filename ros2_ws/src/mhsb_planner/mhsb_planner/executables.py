"""Executables that `ros2 run mhsb_planner` starts."""

from mhsb_model.process import forward_to_tools, make_command_entry, make_node_entry, run_named

planner_node = make_node_entry("mhsb_planner.ros.planner_node")
build_table = make_command_entry("mhsb_planner.build_table")
goal = make_command_entry("mhsb_planner.ros.goal_command")

# Commands of mhsb_tools that can be started from here, too.
plan = forward_to_tools("plan")
reproduce = forward_to_tools("reproduce")

if __name__ == "__main__":
    run_named(globals())

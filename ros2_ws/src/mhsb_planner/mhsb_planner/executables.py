"""What `ros2 run mhsb_planner` starts."""

from mhsb_model.process import command, node, run_named

planner_node = node("mhsb_planner.ros.planner_node")
build_table = command("mhsb_planner.build_table")
plan = command("mhsb_planner.commands.plan_command")
goal = command("mhsb_planner.commands.goal_command")
reproduce = command("mhsb_planner.commands.reproduce_command")

if __name__ == "__main__":
    run_named(globals())

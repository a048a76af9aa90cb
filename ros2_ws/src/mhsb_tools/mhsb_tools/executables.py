"""Entry points of the executables that `ros2 run mhsb_tools` starts."""

from mhsb_model.process import make_command_entry, make_node_entry, run_named

check = make_command_entry("mhsb_tools.commands.check_command")
plan = make_command_entry("mhsb_tools.commands.plan_command")
reproduce = make_command_entry("mhsb_tools.commands.reproduce_command")
simulate = make_command_entry("mhsb_tools.commands.simulate_command")
compare = make_command_entry("mhsb_tools.comparison.compare_command")
study = make_command_entry("mhsb_tools.study.study_command")
tune = make_command_entry("mhsb_tools.study.tune_command")
report = make_command_entry("mhsb_tools.report.report_command")
animate = make_command_entry("mhsb_tools.commands.animate_command")
demo = make_command_entry("mhsb_tools.commands.demo_command")
record = make_node_entry("mhsb_tools.recording.record_command")
viewer = make_node_entry("mhsb_tools.viewer.viewer_command")

if __name__ == "__main__":
    run_named(globals())

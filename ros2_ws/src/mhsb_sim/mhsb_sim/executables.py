"""What `ros2 run mhsb_sim` starts."""

from mhsb_model.process import command, node, run_named

sim_node = node("mhsb_sim.ros.sim_node")
record = node("mhsb_sim.recording.record_command")
viewer = node("mhsb_sim.viewer.viewer_command")
simulate = command("mhsb_sim.commands.simulate_command")
compare = command("mhsb_sim.study.compare_command")
study = command("mhsb_sim.study.study_command")
tune = command("mhsb_sim.study.tune_command")
report = command("mhsb_sim.report.report_command")
animate = command("mhsb_sim.commands.animate_command")
demo = command("mhsb_sim.commands.demo_command")

if __name__ == "__main__":
    run_named(globals())

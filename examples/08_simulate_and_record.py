"""Simulate two goals, the second one given in motion, and record the signals.

    python examples/08_simulate_and_record.py [FOLDER]

Planner, servo, hydraulic circuit and mechanics run in lock-step, without ROS and faster than real
time. Writes signals.csv (a row for each 10 ms) and simulated.png to FOLDER.
"""

import sys
from pathlib import Path

import numpy as np

from mhsb_control import load_machine
from mhsb_model.figure_style import open_figure
from mhsb_planner import PlanOptions, load_or_build_table
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.result_files import write_rows
from mhsb_sim import Simulator
from mhsb_tools.study.headless import HeadlessRun, TimedGoal

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples")

machine = load_machine()
replanner = Replanner(machine, load_or_build_table(machine))
run = HeadlessRun(Simulator(machine, "coordinated", seed=1), replanner, PlanOptions())
goals = [TimedGoal((0.55, 0.60), 2.0), TimedGoal((0.60, 0.10), 6.0)]  # each with its time [s]
for result in run.run(goals):
    state = "in motion" if result.overdue < 0 else "at rest"
    print(
        f"goal {result.goal.position} m: tip {1e3 * result.goal_distance:.1f} mm from it after "
        f"{result.goal.time:g} s, {state}"
    )

samples = run.samples()
error = 1e3 * samples.tip_error
print(
    f"tracking error of the tip: {np.sqrt(np.mean(error**2)):.2f} mm RMS, {error.max():.2f} mm max"
)
write_rows(folder / "signals.csv", samples.column_names(), samples.table().tolist())
with open_figure(folder / "simulated.png", height=5.0, width=8.0) as figure:
    joints, pressures = figure.subplots(2, 1, sharex=True)
    joints.plot(samples.time, samples.position, label=machine.joint_names)
    joints.set_ylabel("joint position [rad]")
    pressures.plot(samples.time, 1e-6 * samples.supply_pressure, label=machine.actuator_names)
    pressures.set(xlabel="time [s]", ylabel="supply pressure [MPa]")
    for axes in (joints, pressures):
        axes.legend()
print(f"signals: {folder / 'signals.csv'}, picture: {folder / 'simulated.png'}")

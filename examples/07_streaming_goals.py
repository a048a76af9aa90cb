"""Follow a goal that moves: plan anew from the motion in force, five times a second.

    python examples/07_streaming_goals.py

Each new plan repeats the one before up to the commit horizon and leaves it there with equal
position, velocity and acceleration. The node does the same with goals from a topic.
"""

import numpy as np

from mhsb_model import load_machine
from mhsb_model.command import Command
from mhsb_model.holding import choose_holding_modes
from mhsb_planner import PlanOptions, load_or_build_table
from mhsb_planner.online.replanning import Replanner

PERIOD = 0.2  # time from one goal to the next [s]
COMMIT_HORIZON = 0.05  # time from a goal to the instant at which its plan leaves the old one [s]

machine = load_machine()
replanner = Replanner(machine, load_or_build_table(machine))
options = PlanOptions(period=PERIOD)
start = np.array(machine.config.simulation.start_posture)
command = Command.hold(0, start, choose_holding_modes(machine, machine.piston_forces(start)))

tip = machine.tip_position(start)
for k in range(15):
    now_ns = round(k * PERIOD * 1e9)
    goal = (tip[0], tip[1] + 0.05 * k * PERIOD)  # upwards at 50 mm/s
    replan = replanner.replan(command, now_ns, goal, COMMIT_HORIZON, options)
    if replan is None:
        print(f"{1e-9 * now_ns:4.1f} s: the arm is there already")
        continue
    old = command.trajectory.sample(replan.change_ns)
    new = replan.command.trajectory.sample(replan.change_ns)
    jump = np.abs(new.velocity - old.velocity).max()
    behind = np.hypot(*(machine.tip_position(new.position) - np.array(goal)))
    print(
        f"{1e-9 * now_ns:4.1f} s: goal z {goal[1]:6.3f} m, planned in "
        f"{1e3 * replan.plan.planning_time:5.1f} ms, {1e3 * behind:5.1f} mm behind at the change, "
        f"velocity jumps by {jump:.1e} rad/s"
    )
    command = replan.command

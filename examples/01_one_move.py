"""Plan one move of the suite's arm, print it, and draw it.

    python examples/01_one_move.py [FOLDER]

Writes move.png and move.csv to FOLDER (out/examples if left out).
"""

import sys
from pathlib import Path

from mhsb_model import MotionState, load_machine
from mhsb_planner import Planner
from mhsb_tools import compute_single_supply, plot_plan

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples")
folder.mkdir(parents=True, exist_ok=True)

machine = load_machine()  # the three-joint arm of the paper; or load_machine("excavator")
planner = Planner(machine)

# Joint angles [rad] are counted from the link before; positive raises the link.
start = MotionState.at_rest(machine.config.simulation.start_posture)
plan = planner.plan((0.55, 0.60), start)  # tip position x, z [m]

print(plan)
one_pump = compute_single_supply(machine, plan.motion.trajectory)
print(f"compare:  {one_pump.describe_saving(plan.energy.series)}")
print(f"joint angles at the end: {plan.motion.trajectory.position[-1].round(3)} rad")
plan.to_csv(folder / "move.csv")
plot_plan(plan, folder / "move.png")
print(f"picture: {folder / 'move.png'}, table over time: {folder / 'move.csv'}")

"""Plan around keep-out zones, and see which refusal a goal inside of one gets.

    python examples/06_zones.py [FOLDER]

The whole arm keeps clear of boxes and circles. Writes zones.png to FOLDER.
"""

import sys
from pathlib import Path

from mhsb_model import MhsbError, MotionState, load_machine
from mhsb_model.obstacles.zones import Zones
from mhsb_planner import Planner, load_or_build_table
from mhsb_tools import plot_plan

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples")
folder.mkdir(parents=True, exist_ok=True)

machine = load_machine()
table = load_or_build_table(machine)  # zones do not change the posture table
start = MotionState.at_rest(machine.config.simulation.start_posture)
goal = (0.55, 0.60)
free = Planner(machine, table).plan(goal, start)

zones = Zones(boxes=((0.65, 0.10, 0.90, 0.30),), circles=((0.30, 0.90, 0.05),))  # [m]
guarded = machine.changed(zones=zones)
planner = Planner(guarded, table)
plan = planner.plan(goal, start)
clearance = min(guarded.clearance(q)[0] for q in plan.motion.trajectory.position)
print(f"without zones: {free!r}")
print(f"with zones:    {plan!r}, at least {1e3 * clearance:.0f} mm from every zone")
plot_plan(plan, folder / "zones.png", "around a box and a circle")

try:
    planner.plan((0.75, 0.20), start)
except MhsbError as error:
    print(f"refused: {error}")

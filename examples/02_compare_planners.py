"""Plan the same move with every planner, for least energy and for least time.

    python examples/02_compare_planners.py

The path planners choose posture, path and modes in different ways; the motion is fitted to the path
in the same way for all.
"""

from mhsb_model import MotionState, load_machine
from mhsb_planner import Planner, PlanOptions, Weights
from mhsb_planner.planners.registry import REGISTERED_PLANNERS

GOAL = (0.55, 0.60)
OBJECTIVES = {"energy": Weights(0.5, 0.0, 2.0), "time": Weights(0.0, 15.0, 2.0)}

machine = load_machine()
planner = Planner(machine)
start = MotionState.at_rest(machine.config.simulation.start_posture)

print(
    f"{'least':8}{'planner':12}{'energy [J]':>11}{'time [s]':>10}{'switches':>10}{'bound [J]':>11}"
)
for objective, weights in OBJECTIVES.items():
    for name in REGISTERED_PLANNERS:
        plan = planner.plan(GOAL, start, options=PlanOptions(weights, planner=name))
        switches = plan.motion.schedule.switch_count
        print(
            f"{objective:8}{name:12}{plan.energy.series:11.1f}{plan.duration:10.2f}"
            f"{switches:10d}{plan.lower_bound:11.1f}"
        )

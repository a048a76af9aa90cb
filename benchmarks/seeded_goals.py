"""Random goals that can be reached, with the times between them; a seed determines both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.errors import MhsbError
from mhsb_model.trajectory import MotionState
from mhsb_model.types import Position
from mhsb_planner.cases.moves import draw_random_position
from mhsb_planner.planner import Planner, PlanOptions

MIN_INTERVAL, MAX_INTERVAL = 0.5, 3.0
"""Wall-clock time between two goals [s]."""
MAX_REFUSALS = 1000
"""Number of positions in a row that may be out of reach; a machine that none suits is an error."""


@dataclass(frozen=True)
class SeededGoal:
    """A random goal and the pause after it.

    Attributes:
        position: Goal of the tip in `base_link`, (x, z), or (x, y, z) if the arm slews [m].
        pause: Wall-clock time from this goal to the next one [s].
    """

    position: Position
    pause: float


def draw_reachable_goals(
    planner: Planner,
    count: int,
    seed: int,
    pause_range: tuple[float, float] = (MIN_INTERVAL, MAX_INTERVAL),
) -> list[SeededGoal]:
    """Draw random goals that have a plan from rest in the start posture.

    Positions are drawn anywhere in the workspace until there are `count` to which the table planner
    finds a plan. It takes a twentieth of the integrated planner's time. Whether a goal can be
    reached from the one before is not checked.

    The pauses are spaced evenly over `pause_range` and then shuffled. Their sum therefore does not
    depend on the seed.

    Args:
        planner: Planner with the machine and its posture table.
        count: Number of goals.
        seed: Seed of positions and of the order of the pauses.
        pause_range: Shortest and longest time between two goals [s].

    Returns:
        The goals in the order in which they are to be sent. The same seed gives the same goals.

    Raises:
        MhsbError: There is no plan to more than MAX_REFUSALS positions in a row. The message is the
            planner's for the last one.
    """
    random = np.random.default_rng(seed)
    waits = np.random.default_rng([seed, 1]).permutation(np.linspace(*pause_range, count))
    machine, options = planner.machine, PlanOptions(planner="table")
    start = MotionState.at_rest(np.array(machine.config.simulation.start_posture))
    goals: list[SeededGoal] = []
    refused = 0
    while len(goals) < count:
        position = draw_random_position(machine, random)
        try:
            planner.plan(position, start, options=options)
        except MhsbError:
            refused += 1
            if refused > MAX_REFUSALS:
                raise
            continue
        goals.append(SeededGoal(position, float(waits[len(goals)])))
        refused = 0
    return goals

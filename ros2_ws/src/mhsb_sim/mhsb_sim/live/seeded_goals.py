"""Random goals that there is a way to, and when to send them; the same seed, the same goals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.errors import MhsbError
from mhsb_model.trajectory import MotionState
from mhsb_model.types import Position
from mhsb_planner.evaluation.moves import anywhere
from mhsb_planner.planner import Planner, PlanOptions

SHORTEST, LONGEST = 0.5, 3.0
"""Wall-clock time between two goals [s]."""


@dataclass(frozen=True)
class SeededGoal:
    """A tip position [m] in `base_link`, and the time until the next one [s]."""

    position: Position
    time: float


def seeded_goals(
    planner: Planner, count: int, seed: int, times: tuple[float, float] = (SHORTEST, LONGEST)
) -> list[SeededGoal]:
    """Goals anywhere in the workspace, each with a plan from rest in the start posture.

    The table's planner says whether there is one: it takes a twentieth of the online planner's
    time. Times between two goals are spread evenly between both `times` [s] and shuffled, so that
    as many goals take as long with any seed.
    """
    random = np.random.default_rng(seed)
    waits = np.random.default_rng([seed, 1]).permutation(np.linspace(*times, count))
    machine, options = planner.machine, PlanOptions(planner="table")
    start = MotionState.at_rest(np.array(machine.config.simulation.start_posture))
    goals: list[SeededGoal] = []
    while len(goals) < count:
        position = anywhere(machine, random)
        try:
            planner.plan(position, start, options=options)
        except MhsbError:
            continue
        goals.append(SeededGoal(position, float(waits[len(goals)])))
    return goals
